"""The site of the documents: sphinx-build -W docs docs/_build/site."""

import sys
from importlib import metadata
from pathlib import Path

from pygments.lexers.shell import BashSessionLexer
from pygments.lexers.special import TextLexer

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

project = "critflow"
release = metadata.version("critflow")
author = "the critflow developers"
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "symbols", "api", "entries", "contents", "pages"]
exclude_patterns = ["_build", "_ext", "pictures"]
suppress_warnings = ["config.cache"]
myst_enable_extensions = ["dollarmath", "attrs_block"]
myst_heading_anchors = 4
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"critflow {release}"
html_static_path = [str(HERE / "_static")]
html_css_files = ["site.css"]
html_favicon = str(HERE / "_static" / "favicon.svg")
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "IntArray", "Deformable", "Mask")}
python_display_short_literal_types = True
python_maximum_signature_line_length = 88
highlight_language = "text"


def setup(app):
    app.add_lexer("output", TextLexer)
    app.add_lexer("console", BashSessionLexer)
