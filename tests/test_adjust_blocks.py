"""Inverses of landmarks' blocks against NumPy's."""

import numpy as np

from photoclinometry.adjust.solve.blocks import apply_blocks, invert_blocks

RNG = np.random.default_rng(4)


def blocks(count=50, rank=6):
    """Symmetric matrices (count, 6, 6) of some rank, with diagonals of very different size."""
    rows = RNG.normal(size=(count, rank, 6)) * np.r_[[1.0] * 3, [300.0] * 2, 1e4]
    return np.einsum("nri,nrj->nij", rows, rows)


def test_inverses_and_their_products_are_those_of_numpy():
    block, out = blocks(rank=9), np.empty((50, 6, 6), np.float32)
    damping = RNG.uniform(0.0, 0.1, 50)
    invert_blocks(block, damping, out)
    damped = block * (1 + damping[:, None, None] * np.eye(6))
    expected = np.linalg.inv(damped)
    size = np.sqrt(np.einsum("nii->ni", damped))
    scaling = size[:, :, None] * size[:, None, :]
    np.testing.assert_allclose(out * scaling, expected * scaling, rtol=1e-4, atol=1e-5)
    x, product = RNG.normal(size=(50, 6)).astype(np.float32), np.empty((50, 6), np.float32)
    apply_blocks(out, x, np.float32(2.0), product)
    np.testing.assert_allclose(product, 2 * np.einsum("nij,nj->ni", out, x), rtol=1e-4, atol=1e-6)


def test_inverses_of_singular_blocks_are_finite_and_positive():
    """Of rank 5: rounding decides on the sign of the last pivot."""
    block, out = blocks(rank=5), np.empty((50, 6, 6), np.float32)
    invert_blocks(block, np.zeros(50), out)
    assert np.isfinite(out).all()
    assert np.all(np.einsum("nii->ni", out) > 0)
