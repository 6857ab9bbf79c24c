"""Tables of the statements of the paper and of what was found, from the committed results."""

import json
from collections import Counter
from pathlib import Path

from critflow.engine.report import counted, table
from critflow.engine.study import DIFFERENCES, VERDICTS, Claim

from ..paper.statements import STATEMENTS


def committed(reference: Path) -> dict[str, list[Claim]]:
    """The claims of the committed run of each study."""
    files = sorted(reference.glob("*/claims.json"))
    return {
        file.parent.name: [Claim(**claim) for claim in json.loads(file.read_text(encoding="utf-8"))] for file in files
    }


def of_the_paper(reference: Path) -> list[Claim]:
    """The tested statements of the paper in its order, each once: that of the study that its table names."""
    runs = committed(reference)
    measured = {claim.key: claim for study in runs for claim in runs[study] if _belongs(claim, study)}
    return [measured[name] for name in STATEMENTS if name in measured]


def _belongs(claim: Claim, study: str) -> bool:
    return claim.kind == "paper" and claim.key in STATEMENTS and STATEMENTS[claim.key].study == study


def statements(reference: Path) -> str:
    """One table of all statements."""
    claims = of_the_paper(reference)
    missing = [known for known in STATEMENTS.values() if known.id not in {claim.key for claim in claims}]
    lines = table(claims, places=True)
    if missing:
        names = "; ".join(f"{known.text} ({known.place}, `{known.study}`)" for known in missing)
        lines += ["", f"Not in the committed results yet, {len(missing)} statements: {names}."]
    return "\n".join(lines)


def statement_counts(reference: Path) -> str:
    """The verdicts in three lines, in words that need no other page."""
    claims = of_the_paper(reference)
    verdicts = Counter(claim.verdict for claim in claims)
    kinds = Counter(claim.difference for claim in claims if claim.verdict == "differs")
    of = {"proof": "by an error of the paper that we prove", "text": "because its text contradicts itself"}
    of["number"] = "by a number"
    parts = [f"{kinds[kind]} {of[kind]}" for kind in DIFFERENCES if kinds[kind]]
    lines = [
        f'Of {len(claims)} statements of the paper that were tested, {counted(verdicts)}. "Differs" is about the '
        "paper, not about your run:",
        "its sentence and the measurement disagree" + (f", {', '.join(parts)}." if parts else "."),
    ]
    return "\n".join(lines)


def differences(reference: Path) -> str:
    """One line for each statement that differs or is undecided, with the kind of the difference and the reason."""
    lines = []
    for verdict in ("differs", "undecided"):
        for claim in of_the_paper(reference):
            if claim.verdict == verdict:
                kind = DIFFERENCES.get(claim.difference, "undecided")
                reason = claim.because.removeprefix("open: ")
                lines.append(
                    f"- **{_capital(claim.statement)}** ({claim.place}). {_capital(kind)}. Measured: {claim.value}. "
                    f"{'Open' if verdict == 'undecided' else 'Reason'}: {reason}."
                )
    return "\n".join(lines) or "None."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def found(reference: Path) -> str:
    """A table for each study of what it found beyond the paper."""
    lines = []
    for study, claims in committed(reference).items():
        if ours := [claim for claim in claims if claim.kind == "ours"]:
            lines += ["", f"### {study}", "", *table(ours, places=False)]
    return "\n".join(lines).strip()


def counts(claims: list[Claim]) -> str:
    """The verdicts of the statements of the paper in one study, empty if it tests none."""
    verdicts = Counter(claim.verdict for claim in claims if claim.kind == "paper" and claim.key in STATEMENTS)
    tested = {name: verdicts[name] for name in VERDICTS if name != "measured" and verdicts[name]}
    return ", ".join(f"{number} {'hold' if name == 'holds' else name}" for name, number in tested.items())


def ensemble_statements(reference: Path) -> str:
    """The statements that the main study tests."""
    return "\n".join(table([one for one in of_the_paper(reference) if STATEMENTS[one.key].study == "ensemble"], True))


def of_committed_run(reference: Path, study: str) -> str:
    """The verdicts of a committed run, as the end of a run quotes them."""
    claims = [claim for claim in committed(reference).get(study, []) if _belongs(claim, study)]
    if not claims:
        return ""
    return f"In the committed run of {claims[0].sample}, {counted(Counter(claim.verdict for claim in claims))}."
