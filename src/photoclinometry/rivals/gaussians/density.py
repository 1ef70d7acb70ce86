"""Gaussians added where the picture pulls at them, and removed where they are not seen (Kerbl et al. 2023, section 5).

Where the mean derivative of the loss by a Gaussian's place in the picture is large, a small one is cloned and a large
one is split in two. Left out: the opacity's reset, which removes floaters before a camera; here all
cameras are far away.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.rivals.gaussians.cloud import Cloud, rotations

GRADIENT = 2e-4
"""Mean derivative of the loss by a place in units of half the picture, beyond which a Gaussian is doubled."""
SMALL = 0.01
"""Gaussians narrower than this share of the map's radius are cloned, others are split."""
SPLIT_BY = 1.6
"""The halves of a split Gaussian are narrower by this."""
LEAST_OPACITY = 0.005
"""Fainter ones are removed."""
LARGEST = 0.1
"""So are those wider than this share of the map's radius."""


def densified(
    cloud: Cloud, gradient: np.ndarray, radius: float, most: int, rng: np.random.Generator
) -> tuple[Cloud, np.ndarray]:
    """The cloud after one round, and the index (n,) of the Gaussian that each has come from; -1 for new ones.

    gradient: (N,) mean derivatives; radius: of the map; most: Gaussians at most.
    """
    parameters, scale = cloud.parameters, np.exp(cloud.log_scale)
    largest = scale.max(-1)
    wanted = np.flatnonzero(gradient > GRADIENT)
    room = max(most - len(cloud), 0)
    wanted = wanted[np.argsort(-gradient[wanted], kind="stable")[:room]]
    split = wanted[largest[wanted] > SMALL * radius]
    cloned = wanted[largest[wanted] <= SMALL * radius]
    copies = {name: values[np.r_[cloned, split]].copy() for name, values in parameters.items()}
    moved = {name: values.copy() for name, values in parameters.items()}
    axes = rotations(cloud.quaternion[split])
    for half, at in ((moved, split), (copies, slice(len(cloned), None))):
        offset = scale[split] * rng.normal(size=(len(split), 3))
        half["position"][at] = cloud.position[split] + np.einsum("nij,nj->ni", axes, offset)
    moved["log_scale"][split] -= np.log(SPLIT_BY)
    copies["log_scale"][len(cloned) :] -= np.log(SPLIT_BY)
    whole = Cloud.of({name: np.concatenate([moved[name], copies[name]]) for name in parameters})
    origin = np.r_[np.arange(len(cloud)), np.full(len(wanted), -1)]
    kept = (whole.opacity > LEAST_OPACITY) & (np.exp(whole.log_scale).max(-1) < LARGEST * radius)
    return Cloud.of({name: values[kept] for name, values in whole.parameters.items()}), origin[kept]
