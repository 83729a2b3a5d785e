"""Settings of Sphinx for the site; `docs/make_site.py` runs it."""

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

import pdecodec

project = "pdecodec"
release = pdecodec.__version__
copyright = author = "The pdecodec maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]

myst_heading_anchors = 6  # anchors are those of the pages that host repositories

default_role = "py:obj"  # `encode` in a docstring is a link if it is a public name, and code otherwise
autodoc_typehints = "none"  # docstrings have types with shapes and units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"  # loads nothing from other hosts
smartquotes = False
html_title = f"pdecodec {release}"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False


def setup(app: Sphinx) -> None:
    app.add_lexer("csv", TextLexer)
