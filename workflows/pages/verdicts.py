"""Tables of the statements of the paper and of what was found, from the committed results."""

import json
from collections import Counter
from pathlib import Path

from critflow.engine.report import counted, table
from critflow.engine.study import DIFFERENCES, VERDICTS, Claim

from ..paper.statements import STATEMENTS

# Each finding: a sentence, and the study and key of the claims whose values follow it.
FINDINGS = (
    (
        "**Every modulus at the transition is a function of the force network alone**, which the paper leaves open. "
        "Isogonal changes move lengths and keep it",
        ("gallery", "B_0-degenerate"),
    ),
    (
        "**Bounds in closed form.** B_0 has its largest value at σ = k; G_0 has a bound of the same kind, for stresses "
        "of any sign",
        ("shear", "G_0-bound"),
    ),
    (
        "**The price of shear rigidity.** The bound of G_0 needs compressed edges",
        ("shear", "G_0-needed-compression"),
    ),
    (
        "**Growth without a fit.** C_B and C_G follow from one linear solve. C_B ≥ −B_0/2, with equality at the "
        "stiffest network alone, so that being stiffest means softening",
        ("stiffening", "stiffening-least"),
    ),
    (
        "**The sign of C_G is a convention**, for max G_0",
        ("ensemble", "C_G"),
    ),
    (
        "**A third of B_0.** As weak forces such as bending vanish, the modulus at the transition tends to B_0/3, "
        "whatever these forces are",
        ("weak_forces", "weak-third"),
    ),
    (
        "**Percolation of stress depends on size**",
        ("percolation", "percolation-threshold"),
    ),
    (
        "**One B_0, many growths**: networks of one topology and one B_0 soften, keep and stiffen by design",
        ("stiffening", "stiffening-curves"),
    ),
    (
        "**Pictures give tensions**, with error bars; errors of positions are amplified less without pressures",
        ("tension_inference", "inference-amplification"),
    ),
    (
        "**One source commands every face.** A stress can be designed so that, while one pair of vertices is pulled "
        "apart, the diagonal of every other face grows or shrinks by as much, as chosen at random",
        ("allostery", "allostery-faces"),
    ),
)


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


def what_we_found(reference: Path) -> str:
    """One line for each finding, with the value of its claim where the committed results have it."""
    runs = committed(reference)
    lines = [f"- {text}{_value(reference, runs, *source)}." for text, source in FINDINGS]
    return "\n".join(lines)


def _value(reference: Path, runs: dict[str, list[Claim]], study: str, key: str) -> str:
    value = _signs(reference) if key == "C_G" else next((c.value for c in runs.get(study, []) if c.key == key), "")
    return f" ({value})" if value else ""


def _signs(reference: Path) -> str:
    """C_G of max G_0 in both conventions, medians."""
    file = reference / "ensemble" / "summary.json"
    one = json.loads(file.read_text(encoding="utf-8"))["populations"].get("max_G_0", {}) if file.is_file() else {}
    both = {"energy": "C_G", "stress-corrected": "C_G_stress_corrected"}
    if any(name not in one for name in both.values()):
        return ""
    return ", ".join(f"{word} {one[name]['median']:+.3f} k" for word, name in both.items())
