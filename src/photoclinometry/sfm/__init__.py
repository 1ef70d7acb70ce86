"""Sparse structure from motion: images and intrinsics -> poses and sparse points, from nothing.

`reconstruct.py` is the entry. Structure from motion is pycolmap's.
"""

from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.reconstruct import reconstruct_sparse

__all__ = ["SfmOptions", "reconstruct_sparse"]
