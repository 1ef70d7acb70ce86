"""Brightness: predicted, rendered, and used to find albedos, normals and Suns."""
