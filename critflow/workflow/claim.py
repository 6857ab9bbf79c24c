"""Claims: statements with their verdicts, and the files of a report that list them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from typing import Any

from critflow.result import StudyError

KINDS = {"paper": "statements of the paper", "ours": "what we found", "check": "checks of the library"}
VERDICTS = ("holds", "differs", "undecided", "measured")
# Why a statement of the paper and the measurement disagree.
DIFFERENCES = {
    "proof": "the paper is wrong, with a proof",
    "text": "the text contradicts itself",
    "number": "the number is another",
}
MEANING = '"Differs" means that the sentence of the paper and the measurement disagree.'


@dataclass(frozen=True)
class Claim:
    """A statement, the criterion of its verdict, and the value measured in the dataset.

    The criterion follows from the statement and is chosen before the value is known.
    """

    key: str
    statement: str
    paper: str  # value printed there
    value: str  # measured, with its spread
    verdict: str  # "holds", "differs", or "undecided" between them; "measured" without a criterion
    because: str = ""  # required when it differs or is undecided
    criterion: str = ""  # tolerance of the verdict, required with one
    sample: str = ""  # what was measured, for example "84 networks"; values of the first axis by default
    kind: str = "ours"
    place: str = ""  # where the paper makes the statement: section, equation, figure
    difference: str = ""  # one of `DIFFERENCES`, where a statement of the paper differs
    rows: Sequence[Mapping[str, str]] = ()  # measurements under the statement: variant, value, n, verdict

    def __post_init__(self) -> None:
        claim, tested = f"claim {self.key!r}", self.verdict != "measured"
        _require(self.verdict in VERDICTS, f"verdict {self.verdict!r} of {claim} must be one of {', '.join(VERDICTS)}")
        _require(self.kind in KINDS, f"kind {self.kind!r} of {claim} must be one of {', '.join(KINDS)}")
        known = not self.difference or self.difference in DIFFERENCES
        _require(known, f"difference {self.difference!r} of {claim} must be one of {', '.join(DIFFERENCES)}")
        explained = self.verdict in ("holds", "measured") or bool(self.because.strip())
        _require(explained, f"{claim} {self.verdict}: give the reason in `because`")
        _require(not tested or bool(self.criterion), f"{claim} {self.verdict}: state its `criterion`")

    @classmethod
    def tested(
        cls, key: str, statement: str, paper: str, value: str, holds: object, because: str = "", note: str = "",
        **more: Any,
    ) -> Claim:  # fmt: skip
        """The claim with the verdict of one condition, "undecided" if it is None.

        because  reason if it does not hold, dropped otherwise; `note` is stored in both cases
        more     criterion, sample and kind
        """
        reasons = "; ".join(filter(None, (note,) if holds else (because, note)))
        verdict = "undecided" if holds is None else "holds" if holds else "differs"
        return cls(key, statement, paper, value, verdict, reasons, **more)


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise StudyError(message)


def tally(claims: Iterable[Claim], kind: str = "paper") -> Counter[str]:
    """Number of tested claims of one kind by verdict; measured values do not count."""
    return Counter(claim.verdict for claim in claims if claim.kind == kind and claim.verdict != "measured")


def counted(verdicts: Mapping[str, int]) -> str:
    """The verdicts in words: "15 hold, 2 differ and 1 is undecided"."""
    forms = {"holds": ("holds", "hold"), "differs": ("differs", "differ")}
    forms["undecided"] = ("is undecided", "are undecided")
    parts = [f"{number} {words[number != 1]}" for name, words in forms.items() if (number := verdicts.get(name, 0))]
    return " and ".join(filter(None, (", ".join(parts[:-1]), *parts[-1:])))


def verdict_sentence(claims: Sequence[Claim], kind: str, link: str) -> str:
    """The verdicts of a run on one kind of claims for its reader, empty if none was tested."""
    verdicts = tally(claims, kind)
    if not (number := verdicts.total()):
        return ""
    noun = "statement" if number == 1 else "statements"
    of = {"paper": f"{noun} of the paper", "ours": f"{noun} of ours", "check": f"{noun} on the library"}[kind]
    return f"Of {number} {of} that this study tests, {counted(verdicts)}{link}."


def claims_files(title: str, claims: Iterable[Claim], sample: str, note: str = "") -> tuple[str, str]:
    """The claims as JSON, and as Markdown: a table for each kind; `sample` for claims without one.

    note  a remark on the dataset, below the title
    """
    stated = [replace(claim, sample=claim.sample or sample) for claim in claims]
    lines = [f"# {title}", *(["", f"{note[0].upper()}{note[1:]}."] if note else [])]
    for kind in KINDS:
        if of_kind := [claim for claim in stated if claim.kind == kind]:
            lines += ["", f"## {KINDS[kind].capitalize()}", ""]
            if text := verdict_sentence(of_kind, kind, ""):
                lines += [f"{text} {MEANING}" if kind == "paper" else text, ""]
            lines += table(of_kind, places=kind == "paper")
    texts = json.dumps([asdict(claim) for claim in stated], indent=1, ensure_ascii=False)
    return texts + "\n", "\n".join(lines) + "\n"


def table(claims: Sequence[Claim], places: bool) -> list[str]:
    """The lines of a table of claims in Markdown; criterion, reason and variants are folded beneath the value."""
    head = ["statement", *(["place"] if places else []), "verdict", "value", "n", "remark"]
    if not any(claim.because for claim in claims):
        head.pop()
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for claim in claims:
        cells = {
            "statement": escape(claim.statement, quote=False), "place": claim.place, "verdict": claim.verdict,
            "value": f"{escape(claim.value, quote=False)}{_folded(claim)}", "n": claim.sample,
            "remark": escape(_reason(claim), quote=False),
        }  # fmt: skip
        lines.append("| " + " | ".join(_cell(cells[name]) for name in head) + " |")
    return lines


def _reason(claim: Claim) -> str:
    """The kind of a difference and the reason, or the reason alone."""
    kind = DIFFERENCES.get(claim.difference, "")
    return f"{kind}: {claim.because}" if kind and claim.because else kind or claim.because


def _folded(claim: Claim) -> str:
    """What is printed, the criterion and the variants, as HTML that a reader unfolds."""
    lines = [f"printed: {claim.paper}"] if claim.paper else []
    lines += [claim.criterion] if claim.criterion else []
    lines += [
        f"{row['variant']}: {row['value']} ({', '.join(filter(None, (row.get('n', ''), row.get('verdict', ''))))})"
        for row in claim.rows
    ]
    if not lines:
        return ""
    words = ["criterion"] if claim.criterion else []
    words += [f"{len(claim.rows)} measurement{'s' * (len(claim.rows) > 1)}"] if claim.rows else []
    text = "<br>".join(escape(line, quote=False) for line in lines)
    return f" <details><summary>{', '.join(words) or 'printed'}</summary>{text}</details>"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
