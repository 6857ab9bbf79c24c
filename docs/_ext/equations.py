"""Displayed equations of docstrings, which are plain text, as TeX: B_0 = (Σσ|L|²)²/(4V Σσ²|L|²/k)."""

import re
import unicodedata

FUNCTIONS = ("min", "max", "log", "exp", "tr", "det", "sin", "cos", "tan", "diag", "rank", "ptp", "sign")
LETTERS = {"\u0307": "dot", "\u0308": "ddot", "\u0302": "hat", "\u0303": "tilde", "\u0304": "bar"}
SYMBOLS = {
    "Σ": r"\sum ", "∂": r"\partial ", "∘": r"\circ ", "⊗": r"\otimes ", "×": r"\times ", "·": r"\cdot ", "−": "-",
    "≤": r"\le ", "≥": r"\ge ", "≠": r"\ne ", "∝": r"\propto ", "≈": r"\approx ", "→": r"\to ", "∈": r"\in ",
    "±": r"\pm ", "⟨": r"\langle ", "⟩": r"\rangle ", "½": r"\tfrac{1}{2}", "¼": r"\tfrac{1}{4}", "∞": r"\infty ",
    "⌊": r"\lfloor ", "⌋": r"\rfloor ", "⌈": r"\lceil ", "⌉": r"\rceil ", "‖": r"\| ", "%": r"\%", "#": r"\#",
    "…": r"\ldots ", "<": r"\lt ", ">": r"\gt ", "&": r"\&",
}  # fmt: skip
RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀʰ", "0123456789+-Th", strict=True))
LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True))


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
