"""Settings of Sphinx for the site; `docs/make_site.py` runs it."""

from numpydoc.xref import DEFAULT_LINKS
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

import pdecodec

project = "pdecodec"
release = pdecodec.__version__
copyright = author = "The pdecodec maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]

myst_heading_anchors = 6  # headings get the same anchors as on pages that host repositories

default_role = "literal"  # `encode` in a docstring is code
autodoc_typehints = "none"  # docstrings have types with shapes and units
autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "list_contents"}  # its default is the class `tuple`
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
# Public names in the types of parameters, results and errors are links; Python's own names are not.
numpydoc_xref_aliases = {name: name for name in DEFAULT_LINKS} | {name: f"pdecodec.{name}" for name in pdecodec.__all__}

toc_object_entries_show_parents = "hide"

html_theme = "furo"  # loads nothing from other hosts
smartquotes = False
html_title = f"pdecodec {release}"
html_favicon = "icon.svg"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_use_index = False
html_copy_source = False
html_show_sourcelink = False


def setup(app: Sphinx) -> None:
    app.add_lexer("csv", TextLexer)
