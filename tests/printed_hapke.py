"""Hapke's equations as they are printed, beside the package's own arrangement of them."""

import math


def printed_radiance_factor(w, i, e, psi, b, c, b0, h, theta):
    """By angles instead of cosines, as printed in Hapke (1984, 1993)."""
    g = math.acos(math.cos(i) * math.cos(e) + math.sin(i) * math.sin(e) * math.cos(psi))
    t = math.tan(theta)
    chi = (1 + math.pi * t**2) ** -0.5

    def e1(x):
        return math.exp(-2 / (math.pi * t * math.tan(x)))

    def e2(x):
        return math.exp(-1 / (math.pi * t**2 * math.tan(x) ** 2))

    def eta(x):
        return chi * (math.cos(x) + math.sin(x) * t * e2(x) / (2 - e1(x)))

    f = math.exp(-2 * math.tan(psi / 2))
    s2 = math.sin(psi / 2) ** 2
    small, large = min(i, e), max(i, e)
    below = 2 - e1(large) - psi / math.pi * e1(small)
    eff_small = chi * (math.cos(small) + math.sin(small) * t * (math.cos(psi) * e2(large) + s2 * e2(small)) / below)
    eff_large = chi * (math.cos(large) + math.sin(large) * t * (e2(large) - s2 * e2(small)) / below)
    mu0e, mue = (eff_small, eff_large) if i <= e else (eff_large, eff_small)
    shadowing = mue / eta(e) * math.cos(i) / eta(i) * chi / (1 - f + f * chi * math.cos(small) / eta(small))
    gamma = math.sqrt(1 - w)

    def big_h(x):
        return (1 + 2 * x) / (1 + 2 * x * gamma)

    def lobe(sign):
        return (1 - b * b) / (1 - sign * 2 * b * math.cos(g) + b * b) ** 1.5

    p = (1 + c) / 2 * lobe(1) + (1 - c) / 2 * lobe(-1)
    surge = b0 / (1 + math.tan(g / 2) / h)
    r = w / (4 * math.pi) * mu0e / (mu0e + mue) * ((1 + surge) * p + big_h(mu0e) * big_h(mue) - 1)
    return math.pi * r * shadowing
