"""The statements of the paper and what was found, from the committed results, as entries that a terminal shows."""

import json
import os
import re
import textwrap
from collections import Counter
from collections.abc import Iterable

from critflow.engine.report import counted
from critflow.engine.study import DIFFERENCES, VERDICTS, Claim

from ..paper.statements import STATEMENTS
from .packages import Package
from .paper import FINDINGS, Finding

WIDTH = 110  # of a line
LONGEST = 160  # of a value; the list of its study has the rest
OF_THE_LIBRARY = ("failure_map", "speed")  # studies of the library, which have pages of their own


def committed(package: Package) -> dict[str, list[Claim]]:
    """The claims of the committed run of each study."""
    files = sorted(package.reference.glob("*/claims.json"))
    return {
        file.parent.name: [Claim(**claim) for claim in json.loads(file.read_text(encoding="utf-8"))] for file in files
    }


def of_the_paper(package: Package) -> dict[str, tuple[Claim, str]]:
    """The tested statements of the paper in its order, each once, with the study.

    The study that the table of the statements names comes before all others.
    """
    runs = {study: claims for one in (package, *package.extensions) for study, claims in committed(one).items()}
    measured: dict[str, tuple[Claim, str]] = {}
    for study, claims in runs.items():
        for claim in claims:
            if claim.kind == "paper" and (claim.key not in measured or _belongs(claim, study)):
                measured[claim.key] = claim, study
    return {name: measured[name] for name in STATEMENTS if name in measured}


def _belongs(claim: Claim, study: str) -> bool:
    return claim.kind == "paper" and claim.key in STATEMENTS and STATEMENTS[claim.key].study == study


def short(value: str) -> str:
    """The parts of a value that a line has room for; an ellipsis stands for the others."""
    for ending in ("; ", " and ", ", ", " "):
        parts = value.split(ending)
        kept = [part for n, part in enumerate(parts, 1) if len(ending.join(parts[:n])) <= LONGEST]
        if kept:
            return ending.join(kept if kept == parts else [*kept, "…"])
    return value


def plain(text: str) -> str:
    """A text without the dollars of its mathematics."""
    return re.sub(r"\$(.*?)\$", lambda m: m[1].replace("\\tau", "τ").replace("{", "").replace("}", ""), text)


def entry(text: str) -> str:
    """An entry of a list, in lines of equal width."""
    text = "- " + re.sub(r"(?<!\*)\*(?!\*)", r"\\*", plain(text)).replace("….", "…")  # a length L* is no emphasis
    wrapped = (
        textwrap.fill(text, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
        for width in range(WIDTH, 0, -1)
    )
    return next(one for one in wrapped if not re.search(r"^ +([-+#>]|\d+[.)]) ", one, flags=re.M))  # no list by chance


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:] if text[:1].isascii() else text  # σ stays


def links(package: Package) -> str:
    """The lists of the studies, as the targets of links [STUDY] of a page in docs/."""
    linked = {*committed(package), *(study for _, study in of_the_paper(package).values())}
    references = [one.reference / study for one in (package, *package.extensions) for study in committed(one)]
    docs = package.folder / "docs"
    return "\n".join(f"[{r.name}]: {os.path.relpath(r, docs)}/claims.md" for r in references if r.name in linked)


def holding(package: Package) -> str:
    """One entry for each statement that holds, in the order of the paper."""
    return "\n".join(_entries(package, "holds"))


def differences(package: Package) -> str:
    """One entry for each statement that differs or is undecided, with the kind of the difference and the reason."""
    return "\n".join(_entries(package, "differs") + _entries(package, "undecided")) or "None."


def _entries(package: Package, verdict: str) -> list[str]:
    lines: list[str] = []
    known = set[str]()
    for claim, study in of_the_paper(package).values():
        if claim.verdict == verdict:
            because = "as above" if claim.because in known else claim.because.removeprefix("open: ")
            reason = (
                ""
                if verdict == "holds"
                else f". {_capital(DIFFERENCES.get(claim.difference, 'open'))}: {because}. Measured"
            )
            value = short(claim.value).removeprefix("in 10 of 10; ")  # docs/claims.md says it once for all
            lines.append(entry(f"**{_capital(claim.statement)}** ({claim.place}){reason}: {value}. [{study}]"))
            known.add(claim.because)
    return lines


# An identity says little: it holds unless the paper errs.
_KINDS = {
    "measurement": "the {} that are measurements",
    "identity": "the {} that are identities and theorems, and can differ only by an error of the paper",
}


def statement_counts(package: Package) -> str:
    """The verdicts in words that need no other page."""
    measured = of_the_paper(package)
    claims = [claim for claim, _ in measured.values()]
    kinds = Counter(claim.difference for claim in claims if claim.verdict == "differs")
    of = {
        "proof": "by an error of the paper that we prove",
        "text": "because its text contradicts itself",
        "number": "by a number",
    }
    parts = [f"{kinds[kind]} {of[kind]}" for kind in DIFFERENCES if kinds[kind]]
    lines = [
        f"Of {len(claims)} statements of the paper that were tested, "
        f'{counted(Counter(claim.verdict for claim in claims))}. "Differs" is about the paper, not about your run:',
        "its sentence and the measurement disagree" + (f", {', '.join(parts)}." if parts else "."),
    ]
    for kind, noun in _KINDS.items():
        if of_kind := [claim for claim in claims if STATEMENTS[claim.key].kind == kind]:
            lines.append(f"Of {noun.format(len(of_kind))}, {counted(Counter(claim.verdict for claim in of_kind))}.")
    if elsewhere := [study for _, study in measured.values() if study not in committed(package)]:
        are, studies = "is" if len(elsewhere) == 1 else "are", ", ".join(dict.fromkeys(elsewhere))
        lines.append(f"Of these, {len(elsewhere)} {are} tested by studies of critflow-extras: {studies}.")
    return "\n".join(lines)


def found(package: Package) -> str:
    """What each study found beyond the paper: one entry a claim."""
    lines = []
    for study, claims in committed(package).items():
        ours = [
            entry(
                f"**{_capital(claim.statement)}**: {short(claim.value)} ({claim.verdict}).".replace(" (measured)", "")
            )
            for claim in claims
            if claim.kind == "ours" and study not in OF_THE_LIBRARY
        ]
        lines += [f"### [{study}]", "", *ours, ""] if ours else []
    return "\n".join(lines).strip()


def counts(claims: Iterable[Claim]) -> str:
    """The verdicts of the statements of the paper in one study, empty if it tests none."""
    verdicts = Counter(claim.verdict for claim in claims if claim.kind == "paper" and claim.key in STATEMENTS)
    tested = {name: verdicts[name] for name in VERDICTS if name != "measured" and verdicts[name]}
    return ", ".join(f"{number} {'hold' if name == 'holds' else name}" for name, number in tested.items())


def of_committed_run(package: Package, study: str) -> str:
    """The verdicts of a committed run, as the end of a run quotes them."""
    claims = [claim for claim in committed(package).get(study, []) if _belongs(claim, study)]
    if not claims:
        return ""
    return f"In the committed run of {claims[0].sample}, {counted(Counter(claim.verdict for claim in claims))}."


def what_we_found(package: Package) -> str:
    """One entry for each finding, with the value of its claim where the committed results have it."""
    lines = []
    for finding in FINDINGS[package.name]:
        value = short(_value(package, finding))
        lines.append(entry(f"{finding.text} ({value})." if value else f"{finding.text}."))
    return "\n".join(lines)


def _value(package: Package, finding: Finding) -> str:
    if finding.claim:
        claims = committed(package).get(finding.study, [])
        return next((claim.value for claim in claims if claim.key == finding.claim), "")
    summary = json.loads((package.reference / finding.study / "summary.json").read_text(encoding="utf-8"))
    return finding.value.format(**summary["populations"])
