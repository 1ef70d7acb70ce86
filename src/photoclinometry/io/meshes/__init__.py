"""Meshes: PLY, OBJ, glTF."""
