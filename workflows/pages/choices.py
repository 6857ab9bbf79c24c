"""Tables of the README about speed, accuracy and failure: what critflow chooses and why, sizes, where methods fail."""

from __future__ import annotations

import re

# What the library does when it is asked for nothing in particular, and the reason that the measurements give.
WHY = {
    "configuration": "the sparse solver of the size: QDLDL for small matrices, Pardiso or a METIS order for large ones",
    "gradient": "one more solve with the same factor",
    "length_variance": "L-BFGS while a rough answer will do; then the cone program, whose optimum is exact",
    "tension_variance": "L-BFGS; Newton's method takes over where gradients alone stop",
    "bulk_modulus": "a closed form: one solve attains the bound",
    "shear_modulus": "L-BFGS with the known curvature of the penalty; Newton's method takes over where it stops",
    "length_variance_pinned": "as above, on pins, where others can take part",
    "tension_variance_pinned": "as above, on pins",
    "rest_lengths": "the cone program, then Newton's method on lengths and stresses together",
    "strain_step": "Newton's method: no other reaches these errors, for softness grows as 1/γ",
    "moduli": "linear response with the factor that Newton's method leaves behind",
    "transition_moduli": "sums over edges; nothing is factorised",
    "coefficients": "exact, from the transition alone; fits have a bias and need a path",
}


def choices(summary: dict) -> str:
    """One row a task and size: what is chosen, its time and error, how it stands to the others, why."""
    lines = [
        "| task | N_v | chosen | time | error | over the front | the others, for their best accuracy | why |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for word, task in summary["tasks"].items():
        for size, its in task["sizes"].items():
            if "auto" not in its:
                continue
            seconds, error = min(its["auto"], key=lambda point: point[1])
            first = size == next(iter(task["sizes"]))
            cells = (
                _plain(task["title"]) if first else "", f"{int(size):,}", task["auto"], _time(seconds), f"{error:.0e}",
                f"{its['auto_over_front']:.2g} ×", _others(its["gain"]), WHY[word] if first else "",
            )  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _others(gains: dict[str, float]) -> str:
    """The nearest rival and the farthest, in times of the default's."""
    if not gains:
        return "none"
    order = sorted(gains, key=gains.__getitem__)
    ends = order if len(order) == 1 else [order[0], order[-1]]
    return ", ".join(f"{name} {_number(gains[name])} ×" if gains[name] else f"{name} is more accurate" for name in ends)


def _plain(title: str) -> str:
    """A title without the dollars of its mathematics."""
    return re.sub(r"\$(.*?)\$", lambda m: m[1].replace("\\tau", "τ").replace("{", "").replace("}", ""), title)


def _time(seconds: float) -> str:
    return f"{_number(1e3 * seconds)} ms" if seconds < 1 else f"{_number(seconds)} s"


def _number(value: float) -> str:
    """Two digits, and no power of ten for large ones."""
    return f"{value:,.0f}" if value >= 99.5 else f"{value:.2g}"


def sizes(summary: dict) -> str:
    """One row a stage: seconds at every size, and the exponent of the large ones."""
    lines = [
        "| seconds at N_v = | " + " | ".join(f"{n:,}" for n in summary["n_vertices"]) + " | exponent from 10⁴ |",
        "|---" * (len(summary["n_vertices"]) + 2) + "|",
    ]
    powers = summary["exponents_from_10000"]
    for stage, seconds in summary["seconds"].items():
        cells = [f"{s:.2g}" if s is not None else "" for s in seconds]
        lines.append(f"| {stage} | {' | '.join(cells)} | {f'{powers[stage]:.2f}' if stage in powers else ''} |")
    return "\n".join(lines)


def failures(summary: dict, claims: list[dict]) -> str:
    """The count of silent wrong answers in a sentence, and the claims about bounds."""
    counts = summary["outcomes"].values()
    points = sum(sum(kinds.values()) for kinds in counts)
    right = sum(kinds.get(kind, 0) for kinds in counts for kind in ("exact", "bounded", "tolerated"))
    lines = [
        f"Of {points:,} questions asked at all strengths of all difficulties {right:,} are answered rightly, within",
        "the claimed bound or tolerance; the others end in a status or a refusal that says why. Silent wrong answers: "
        f"{summary['violations']}.",
        "",
        "| claim | measured | |",
        "|---|---|---|",
    ]
    lines += [f"| {c['statement']} | {c['value']} | {c['verdict']} |" for c in claims]
    return "\n".join(lines)
