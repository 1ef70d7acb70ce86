"""Products of a scene for other programs: maps for GIS, meshes, models and tables."""

from photoclinometry.export.export import export_scene
from photoclinometry.export.options import ExportOptions

__all__ = ["ExportOptions", "export_scene"]
