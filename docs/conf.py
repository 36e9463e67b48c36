"""How Sphinx builds the pages: `make docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

import iceg

project = "iceg"
version = release = iceg.__version__
html_title = "iceg"
html_theme = "furo"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_domain_indices = False
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["math.css"]
highlight_language = "none"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "api_signatures",
    "mathml",
    "outside_links",
    "settings_tables",
]
exclude_patterns = ["_build", "_extensions"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_rtype = False
maximum_signature_line_length = 90
