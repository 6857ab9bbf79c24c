"""The configuration of a network that `critflow make` writes: the best one, the nearest one, or one with targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from critflow.networks import Network
from critflow.optima import optimize
from critflow.result import InputError, Solution
from critflow.springs import SpringState, spring_state
from critflow_extras.files.hints import value_of
from critflow_extras.files.repair import ImportedNetwork
from critflow_extras.inference.nearest import nearest_critical
from critflow_extras.targets.targets import Design, change_of, design


def made(
    imported: ImportedNetwork, objective: str, target: Sequence[str], change: str | None
) -> tuple[Solution[Any], str, list[str]]:
    """The configuration with the targets, nearest to the positions or best, a title of it, and lines that report it."""
    if target:
        return _designed(imported, target, change)
    if change is not None:
        raise InputError("--change says what reaches targets: give --target NAME=VALUE, or leave it out")
    if objective == "nearest":
        fit = nearest_critical(imported.network, imported.positions, throw=False)
        line = f"root mean square distance {fit.distance:.6g} ({fit.status.name}: {fit.reason})"
        return fit, f"{fit.distance:.3g} from the positions", [line]
    optimum = optimize(imported.network, objective, throw=False)
    line = f"{objective} {optimum.objective:.10g} ({optimum.status.name}: {optimum.reason})"
    return optimum, f"{objective} {optimum.objective:.6g}", [line]


def _designed(imported: ImportedNetwork, words: Sequence[str], change: str | None) -> tuple[Design, str, list[str]]:
    """The design for targets of the command line, a title of it, and lines that report it.

    change  of what; None: of stress, unless one of the targets is that of another change
    """
    network = imported.network
    targets = dict[str, Any]()
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise InputError(f"--target must be NAME=VALUE or NAME=LOW:HIGH, such as B_0=0.25, not {word!r}")
        if name in targets:
            raise InputError(f"--target {name} is given twice: give one value, or limits LOW:HIGH")
        targets[name] = value_of(value)
    change = change or change_of(targets)
    if change not in ("stress", "stiffness"):
        raise InputError(f"--change is stress or stiffness, not {change!r:.40}: other changes need Python, design(...)")
    start: Network | SpringState = network
    if change == "stiffness":
        lengths = np.linalg.norm(network.bond_vectors(imported.positions), axis=1)
        start = spring_state(network, lengths, imported.positions)
    solution = design(start, targets, change=change, throw=False)
    lines = [f"{solution.status.name}: {solution.reason}"] + [
        f"{name} {one.value:.12g} ± {one.error:.1e}, requested {targets.get(name, 0)}, "
        f"cost {one.multiplier + 0.0:.3g}, independence {one.independence:.3g}"
        for name, one in solution.targets.items()
    ]
    if change == "stiffness":
        k = solution.value.network.stiffness
        lines.append(f"springs at rest at the positions of the file, stiffness from {k.min():.6g} to {k.max():.6g}")
    return (
        solution,
        ", ".join(f"{name} {one.value:.4g}" for name, one in solution.targets.items() if name in targets),
        lines,
    )
