"""The viewer of a map or a body: one page for the browser that holds it, its reflectance model and its images."""

from photoclinometry.output.viewer.body_content import ViewedBody
from photoclinometry.output.viewer.page import write_body_viewer, write_viewer

__all__ = ["ViewedBody", "write_body_viewer", "write_viewer"]
