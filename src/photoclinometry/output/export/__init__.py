"""Products of a scene for other programs: maps for GIS, meshes, models and tables."""

from photoclinometry.output.export.export import export_scene
from photoclinometry.output.export.options import ExportOptions

__all__ = ["ExportOptions", "export_scene"]
