"""Sparse structure from motion: images and intrinsics -> poses and sparse points, from nothing.

`reconstruct.py` is the entry. The folder is the one place (besides `io/colmap.py`) that knows pycolmap.
"""

from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.reconstruct import reconstruct_sparse

__all__ = ["SfmOptions", "reconstruct_sparse"]
