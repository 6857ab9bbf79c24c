"""Equations in plain text, as docstrings and pages contain them, become mathematics: B_0 = (Σσ|L|²)²/(4V Σσ²|L|²/k).

A text is divided at blanks into words.  A run of mathematical words around an operator is an equation; a word with an
index or an exponent is a symbol; everything else stays text.
"""

import re
import unicodedata

from docutils import nodes
from mathml import mathml
from sphinx.transforms.post_transforms import SphinxPostTransform

FUNCTIONS = ("min", "max", "log", "exp", "tr", "det", "sin", "cos", "tan", "diag", "rank", "ptp", "sign")
RELATIONS = set("=≤≥<>∝≈→≠∈")
OPERATORS = RELATIONS | set("+−±×·∘⊗/")
LOOSE = OPERATORS - {"−"} | {"–", "-"}
ARTICLES = ("a", "A", "I")
LETTERS = {"\u0307": "dot", "\u0308": "ddot", "\u0302": "hat", "\u0303": "tilde", "\u0304": "bar"}
SYMBOLS = {
    "Σ": r"\sum ", "∂": r"\partial ", "∘": r"\circ ", "⊗": r"\otimes ", "×": r"\times ", "·": r"\cdot ", "−": "-",
    "≤": r"\le ", "≥": r"\ge ", "≠": r"\ne ", "∝": r"\propto ", "≈": r"\approx ", "→": r"\to ", "∈": r"\in ",
    "±": r"\pm ", "⟨": r"\langle ", "⟩": r"\rangle ", "½": r"\tfrac{1}{2}", "¼": r"\tfrac{1}{4}", "∞": r"\infty ",
    "⌊": r"\lfloor ", "⌋": r"\rfloor ", "⌈": r"\lceil ", "⌉": r"\rceil ", "‖": r"\| ", "%": r"\%", "#": r"\#",
    "…": r"\ldots ", "<": r"\lt ", ">": r"\gt ", "&": r"\&",
}  # fmt: skip
NOT_CONVERTED: set[str] = set()
RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀʰ", "0123456789+-Th", strict=True))
LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True))
SYMBOL = re.compile(r"(?:[A-Za-zα-ωΑ-Ωℓ∂][\u0300-\u036f]*|\d|[)\]|⟩])(?:_(?:\{|[A-Za-z0-9α-ω])|\^(?:\{|[\w½−*(]))")


def tex_of(text: str) -> str:
    """An equation in plain text as TeX."""
    text = unicodedata.normalize("NFD", text)
    text = re.sub(f"(\\w)([{''.join(LETTERS)}])", lambda found: f"\\{LETTERS[found[2]]}{{{found[1]}}}", text)
    text = re.sub(f"[{''.join(RAISED)}]+", lambda found: f"^{{{''.join(RAISED[c] for c in found[0])}}}", text)
    text = re.sub(f"[{''.join(LOWERED)}]+", lambda found: f"_{{{''.join(LOWERED[c] for c in found[0])}}}", text)
    text = re.sub(r"([_^])([A-Za-z0-9α-ω½]+)", r"\1{\2}", text)
    text = re.sub(r"\^\(([^()]*)\)", r"^{(\1)}", text)
    text = re.sub(r"√\(([^()]*)\)|√(\|[^|]*\||\w)", lambda found: f"\\sqrt{{{found[1] or found[2]}}}", text)
    text = re.sub(rf"(?<![\\\w])({'|'.join(FUNCTIONS)})(?![A-Za-z])", r"\\operatorname{\1}", text)
    return "".join(SYMBOLS.get(letter, letter) for letter in text).strip()


def is_mathematical(word: str) -> bool:
    """Whether a word consists of symbols, numbers and operators: no two adjacent letters outside an index."""
    bare = re.sub(r"[_^](\{[^}]*\}|\w+)", "", unicodedata.normalize("NFD", word))
    bare = re.sub(rf"\b({'|'.join(FUNCTIONS)})\b", "", bare)
    bare = re.sub(r"d(?=[A-Z])", "", bare)
    if re.search(r"_[A-Za-z]{6}", word):
        return False
    return bool(word) and not re.search(r"[A-Za-z]{2}|['’\"`%$&\\@]|\.\.|\d[A-Za-z]|[A-Za-z]\d|:", bare)


def balanced(text: str) -> bool:
    pairs, open_brackets = {")": "(", "]": "[", "}": "{"}, []
    for letter in text:
        if letter in pairs.values():
            open_brackets.append(letter)
        elif letter in pairs and (not open_brackets or open_brackets.pop() != pairs[letter]):
            return False
    return not open_brackets and text.count("|") % 2 == 0


def trimmed(run: list[str]) -> tuple[int, int]:
    """The part of a run of mathematical words that is an equation: no operator, article or number alone at its ends."""
    start, stop = 0, len(run)

    while start < stop and (run[start] in LOOSE or (run[start] in ARTICLES and run[start + 1 : start + 2] != ["="])):
        start += 1
    while stop > start and run[stop - 1] in {*LOOSE, *ARTICLES, "−"}:
        stop -= 1
    return start, stop


def equations_of(text: str) -> list[tuple[bool, str]]:
    """The text in parts: (True, equation) or (False, text)."""
    words = re.split(r"(\s+)", text)
    parts: list[tuple[bool, str]] = []
    at = 0
    while at < len(words):
        stop, closed = at, False
        while (
            stop < len(words) and not closed and (words[stop].isspace() or is_mathematical(words[stop].rstrip(".,;")))
        ):
            closed = words[stop][-1:] in (".", ",", ";")
            stop += 1
        found = equation(words[at:stop])
        if found is None:
            parts.extend(symbols_of(words[at]))
            at += 1
            continue
        before, inside, after = found
        parts += [(False, before), (True, inside), (False, after)]
        at = stop
    return parts


def equation(words: list[str]) -> tuple[str, str, str] | None:
    """Text before, the equation, and text after it; None if these words contain no relation or sum of symbols."""
    if not words or words[0].isspace():
        return None
    run = [word for word in words if not word.isspace()]
    start, stop = trimmed(run)
    if stop - start < 3 or start > 0:
        return None
    first = 0
    last = [at for at, word in enumerate(words) if not word.isspace()][stop - 1] + 1
    inside, after = "".join(words[first:last]), "".join(words[last:])
    ending = re.search(r"[.,;]+$", inside)
    if ending:
        inside, after = inside[: ending.start()], ending[0] + after
    before = ""
    if not balanced(inside) and inside.startswith("(") and balanced(inside[1:]):
        before, inside = "(", inside[1:]
    elif not balanced(inside) and inside.endswith(")") and balanced(inside[:-1]):
        inside, after = inside[:-1], ")" + after
    letters = re.search(r"[A-Za-zα-ωΑ-Ωℓ]", inside)
    if not balanced(inside) or not letters or not any(word in OPERATORS for word in inside.split()[1:-1]):
        return None
    return before, inside, after


def symbols_of(word: str) -> list[tuple[bool, str]]:
    """One word: a symbol with an index or exponent, with the punctuation around it, or text."""
    found = re.fullmatch(r"([(\[]*)(.*?)([)\].,;:]*)", word, flags=re.S)
    before, inside, after = found.groups()
    while after[:1] in (")", "]") and not balanced(inside) and balanced(inside + after[0]):
        inside, after = inside + after[0], after[1:]
    if SYMBOL.search(inside) and is_mathematical(inside) and balanced(inside):
        return [(False, before), (True, inside), (False, after)]
    return [(False, word)]


def markup_of(text: str) -> str:
    """The equation as MathML, or nothing if the text is no equation after all: it then stays text."""
    try:
        return mathml(tex_of(text))
    except ValueError:
        NOT_CONVERTED.add(text)
        return ""


class PlainEquations(SphinxPostTransform):
    """Replace equations in plain text by mathematics, except in code."""

    default_priority = 900
    formats = ("html",)

    def run(self, **kwargs):
        skipped = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw, nodes.FixedTextElement)
        for text in list(self.document.findall(nodes.Text)):
            node = text.parent
            while node is not None and not isinstance(node, skipped) and not node.tagname.startswith("desc_sig"):
                node = None if node.tagname in ("desc_content", "document") else node.parent
                if node is not None and node.tagname == "desc_signature":
                    break
            if node is None and not isinstance(text.parent, nodes.title):
                self.replace(text)

    def replace(self, text):
        parts = equations_of(text.astext())
        if any(is_equation for is_equation, _ in parts):
            made = []
            for is_equation, part in parts:
                if is_equation and (markup := markup_of(part)):
                    made.append(nodes.raw("", markup, format="html"))
                elif made and isinstance(made[-1], nodes.Text):
                    made[-1] = nodes.Text(made[-1].astext() + part)
                else:
                    made.append(nodes.Text(part))
            text.parent.replace(text, made)


def setup(app):
    app.add_post_transform(PlainEquations)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
