"""Whole bodies as closed triangle meshes: shape, relief, rays, orbits and truth."""
