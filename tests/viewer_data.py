"""The data of a viewer's page, read back from it."""

import base64
import json
import re
import zlib

import numpy as np

from photoclinometry.output.viewer.arrays import MISSING


def data_of(html):
    """What the page's program reads."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])


def unpacked(stored):
    """Values of `packed`, as the page reads them: its columns as the last axis."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(stored["data"])), np.uint8).reshape(4, -1)
    zigzag = np.ascontiguousarray(planes.T).view("<u4").ravel()
    change = (zigzag >> 1).astype(np.int64) ^ -(zigzag & 1).astype(np.int64)
    whole = np.cumsum(change).astype(np.uint32).view(np.int32)
    values = np.where(whole == MISSING, np.nan, whole * stored["step"])
    return values.reshape(stored["columns"], -1).T.reshape(stored["shape"])
