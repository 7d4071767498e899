"""The site: `make docs` builds it from these pages, the docstrings and the commands' own help. Warnings are errors."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # examples take frames and ground from validation/
sys.path.insert(0, str(Path(__file__).parent))

from reference import write_reference

import windsysid
from measured import write_measured

project = "windsysid"
author = "The windsysid developers"
copyright = "the windsysid developers, MIT licence"
release = version = windsysid.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "pages",
]
exclude_patterns = ["_build"]
root_doc = "index"
default_role = "py:obj"
myst_heading_anchors = 4
suppress_warnings = ["ref.python"]  # `name` in a docstring may be an attribute of several classes
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"Array": "numpy.ndarray"}
napoleon_google_docstring = False
napoleon_use_ivar = True
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",  # all are run
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 3600,  # times of a busy machine say nothing
}
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "pydata_sphinx_theme"
html_title = "windsysid"
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": False,
}


HERE = Path(__file__).parent
write_reference(HERE / "reference")  # before Sphinx looks for pages
write_measured(HERE.parent / "validation" / "results", HERE / "reference" / "measured.md")
