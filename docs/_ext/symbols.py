"""The symbols of the field in text: B_0 is an italic B with the index 0, in prose, headings, tables and docstrings.

Only the symbols listed here are replaced, as whole words.  Every other equation is written as one: $...$ in a page, an
indented line in a docstring.
"""

import re

from docutils import nodes
from sphinx.transforms import SphinxTransform

SYMBOLS = (
    *("B_0", "G_0", "M_0", "C_B", "C_G", "C_ε", "V_L", "V_τ", "N_v", "N_b", "N_f", "N_0", "N_s"),
    *("γ_c", "σ_α", "τ_α", "ℓ_α", "L_α", "b_α", "S_xx", "S_yy", "S_xy", "κ_phys", "κ_force"),
)
SYMBOL = re.compile(rf"(?<![^\W\d])(?<!\.)((?:{'|'.join(SYMBOLS)})(?:\^[−-]?[\d.]*\d)?)(?!\w)")
SKIPPED = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw, nodes.FixedTextElement)


def typeset(text: str) -> list[nodes.Node]:
    """The text with its symbols as italic letters with an index."""
    made: list[nodes.Node] = []
    for at, part in enumerate(SYMBOL.split(text)):
        if at % 2 == 0:
            made += [nodes.Text(part)] if part else []
            continue
        letter, index, power = re.fullmatch(r"(.)_([^^]+)\^?(.*)", part).groups()
        written = [nodes.emphasis("", letter), nodes.subscript("", index)]
        written += [nodes.superscript("", power)] if power else []
        made.append(nodes.inline("", "", *written, classes=["symbol"]))
    return made


class Symbols(SphinxTransform):
    default_priority = 860

    def apply(self, **kwargs):
        for text in list(self.document.findall(nodes.Text)):
            node = text.parent
            while node is not None and not isinstance(node, SKIPPED) and not node.tagname.startswith("desc_sig"):
                node = node.parent
            if node is None and SYMBOL.search(text.astext()):
                text.parent.replace(text, typeset(text.astext()))


def setup(app):
    app.add_transform(Symbols)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
