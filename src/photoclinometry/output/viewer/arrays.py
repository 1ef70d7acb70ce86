"""Arrays as text in a page: whole numbers of a step, differences, byte planes, deflate, base64.

    q = round(value / step),  int32, MISSING where a value is not finite
    z = zigzag(q[i] - q[i - 1]) small where neighbours are similar; modulo 2^32
    text = base64(deflate(all first bytes of z, all second bytes, all third, all fourth))

Columns of an array (n, c) follow each other, so that differences are between rows. `assets/js/arrays.js` is the
inverse.
"""

from __future__ import annotations

import base64
import math
import zlib
from typing import Any

import numpy as np

MISSING = -(2**31)
"""Stands for a value that is not finite; the page reads NaN."""
_LARGEST = 2**30
"""Bound of whole numbers; a step too fine for this is made coarser."""
_LEVEL = 6
"""Of deflate: the highest level makes a page 1 % smaller in four times the time."""


def packed(values: np.ndarray, step: float) -> dict[str, Any]:
    """Values (n,), (n, c) or of any shape as a mapping for JSON: shape, columns, step, and the text.

    The page's values differ by at most half of the step, which is above 0, from those that are finite. Others are NaN.
    """
    values = np.asarray(values, float)
    finite = np.isfinite(values)
    top = float(np.abs(values[finite]).max(initial=0.0))
    step = max(step, top / _LARGEST)
    whole = np.where(finite, np.rint(np.where(finite, values, 0.0) / step), MISSING).astype(np.int64)
    columns = values.shape[1] if values.ndim == 2 else 1
    in_columns = whole.reshape(-1, columns).T.ravel()
    change = np.diff(in_columns, prepend=0).astype(np.uint32).view(np.int32).astype(np.int64)
    zigzag = ((change << 1) ^ (change >> 31)).astype(np.uint32)
    planes = zigzag.astype("<u4").view(np.uint8).reshape(-1, 4).T.tobytes()
    text = base64.b64encode(zlib.compress(planes, _LEVEL)).decode()
    return {"shape": list(values.shape), "columns": columns, "step": step, "data": text}


def three_digits(values: np.ndarray) -> float:
    """A step for positive values such as standard deviations: 1/1000 of their median; 1 if none is positive."""
    positive = values[np.isfinite(values) & (values > 0)]
    return 1e-3 * float(np.median(positive)) if positive.size else 1.0


def share_of_peak(values: np.ndarray, levels: int) -> float:
    """The step that divides the greatest finite value into `levels`; 1 if there is none."""
    peak = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    return peak / levels if peak > 0 and math.isfinite(peak) else 1.0
