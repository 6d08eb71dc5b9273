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
    "shipped_studies",
    "sphinx_gallery.gen_gallery",
    "commands",
    "python_api",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "examples", "scripts"]
default_role = "code"
nitpicky = True
nitpick_ignore_regex = [("py:class", ".*")]  # types in docstrings: those of other packages are not fetched to link them

myst_enable_extensions = ["dollarmath", "deflist", "attrs_block", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
suppress_warnings = ["config.cache"]  # functions in sphinx_gallery_conf

sphinx_gallery_conf = {
    "examples_dirs": "scripts",
    "gallery_dirs": "gallery",
    "plot_gallery": "True",
    "abort_on_example_error": True,
    "show_memory": False,
    "min_reported_time": 1e9,
    "show_signature": False,
    "reset_modules": ("matplotlib",),
    "download_all_examples": False,
    "remove_config_comments": True,
}

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
