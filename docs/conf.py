"""Configuration of the documentation: `make docs` builds it into build/docs."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
logging.getLogger("photoclinometry").setLevel(logging.WARNING)  # examples run here

import photoclinometry  # noqa: E402

project = "photoclinometry"
author = "The photoclinometry authors"
release = photoclinometry.__version__
html_title = "photoclinometry"

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
    "cli_reference",
    "faults_reference",
    "root_pages",
    "tutorial",
    "api_reference",
]
exclude_patterns = ["_ext"]
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False

myst_enable_extensions = ["deflist", "fieldlist"]
myst_heading_anchors = 4

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
# Public classes are documented twice, by their public name and in their module; attributes share names.
suppress_warnings = ["ref.python"]
smartquotes = False

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1.0,
    "capture_repr": ("_repr_html_", "__repr__"),
    "remove_config_comments": True,
    "plot_gallery": "True",
}
