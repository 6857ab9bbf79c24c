"""What was found beyond the paper, in a few sentences whose numbers are those of the committed runs."""

import json
from pathlib import Path

from critflow.engine.study import Claim

from .verdicts import committed

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
