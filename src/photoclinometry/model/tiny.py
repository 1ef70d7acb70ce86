"""The number that keeps quotients finite."""

from __future__ import annotations

import numpy as np

TINY = float(np.finfo(np.float32).tiny)
"""Least value of a divisor that is zero where its dividend is, too. It is the least normal number of single precision,
and so serves both precisions."""
