"""Photoclinometry-from-Motion: poses, dense landmarks, normals and albedo from spacecraft images."""

__version__ = "0.1.0"
