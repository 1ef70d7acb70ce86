"""The viewer of a map: one page for the browser that holds the map, its reflectance model and its images."""

from photoclinometry.output.viewer.page import write_viewer

__all__ = ["write_viewer"]
