"""Equations as MathML, which browsers display without a script or a font from elsewhere."""

import re

from docutils import nodes
from latex2mathml.converter import convert


def mathml(tex: str, display: str = "inline") -> str:
    """The MathML of an equation in TeX; a command that the converter does not know is an error."""
    tex = re.sub(r"\\[lr]vert\s*", "|", tex)
    tex = re.sub(r"(?<!\\)\|([^|]+)(?<!\\)\|", r"{\\left|\1\\right|}", tex)  # bars in pairs, as brackets
    tex = tex.replace(r"\mathbf{1}", "𝟏")  # browsers ignore the attribute of bold letters
    try:
        markup = convert(tex, display=display)
    except Exception as error:  # the converter's errors have no common class
        raise ValueError(f"not converted to MathML: {tex}") from error
    if "\\" in markup:
        raise ValueError(f"not converted to MathML: {tex}")
    return markup


def visit_math(translator, node):
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def visit_math_block(translator, node):
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
