"""How the documentation is built: `make docs`, offline, warnings are errors."""

import sys
from pathlib import Path

import heliosweep

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "heliosweep"
author = "The heliosweep developers"
copyright = "The heliosweep developers, BSD-3-Clause"
version = release = heliosweep.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "study_keys",
    "variables",
    "gallery",
    "commands",
    "python_api",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "examples"]
default_role = "code"
nitpicky = True
nitpick_ignore_regex = [("py:class", ".*")]  # types in docstrings: those of other packages are not fetched to link them

myst_enable_extensions = ["dollarmath", "deflist", "attrs_block", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
suppress_warnings: list[str] = []

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"heliosweep {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {"top_of_page_buttons": []}
