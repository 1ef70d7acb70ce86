"""Georeferenced rasters."""
