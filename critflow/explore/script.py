"""The lines of Python, and the link, that make a state again."""

from __future__ import annotations

import base64
import json
import zlib
from itertools import groupby
from typing import Any

from critflow.explore.model import OPTIMA, POPULATIONS, SPREAD
from critflow.explore.session import Change, Session
from critflow.result import InputError

# A longer text is no link of this page.
_LONGEST = 200_000


def script(session: Session) -> str:
    """Python that makes the state of a session with the same numbers to the last digit."""
    body = session.source.lines()
    for name, group in groupby(session.recipe(), key=lambda change: change[0]):
        body += _LINES[name](list(group), session)
    body.append("print(transition_moduli(critical), stiffening(manifold, critical).value)")
    text = "\n".join(body)
    names = [name for name in _IMPORTED if name + "(" in text]
    heads = [f"from critflow import {', '.join(names)}"]
    if "stable_rng(" in text:
        heads.append("from critflow.workflow import stable_rng")
    if "np." in text:
        heads.insert(0, "import numpy as np\n")
    return "\n".join(heads) + "\n\n" + text + "\n"


_IMPORTED = (
    *("CriticalManifold", "critical_from_lengths", "face_modes", "network_from", "optimize", "prune", "stiffening"),
    *("strain_path", "transition_moduli", "voronoi_network"),
)


def _population_stress(name: str, seed: int) -> str:
    noise = f'stable_rng({seed}, "{name}").standard_normal(network.n_edges)'
    if name in OPTIMA:
        return f'optimize(manifold, "{name}", throw=False).value.sigma'
    if name == "random_stress":
        return f"manifold.solve(np.abs({noise})).value.sigma"
    return f"critical_from_lengths(manifold, 1 + {SPREAD} * {noise}, throw=False).value.sigma"


def _populations(changes: list[Change], session: Session) -> list[str]:
    stress = _population_stress(changes[-1][1], session.state.model.seed)
    return [f"critical = manifold.configuration({stress})"]


def _blends(changes: list[Change], session: Session) -> list[str]:
    weights = {name: weight for name, weight in zip(POPULATIONS, changes[-1][1:], strict=True) if weight}
    lines = [f"{name} = {_population_stress(name, session.state.model.seed)}" for name in weights]
    total = " + ".join(f"{weight!r} * {name}" for name, weight in weights.items())
    return [*lines, f"critical = manifold.configuration({total})"]


def _edges(changes: list[Change], session: Session) -> list[str]:
    pairs = ", ".join(f"({edge}, {change!r})" for _, edge, change in changes)
    raised = "np.exp(change * (np.arange(network.n_edges) == edge))"
    return [
        f"for edge, change in [{pairs}]:",
        f"    critical = manifold.configuration(critical.sigma * {raised})",
    ]


def _faces(changes: list[Change], session: Session) -> list[str]:
    pairs = ", ".join(f"({face}, {amplitude!r})" for _, face, amplitude in changes)
    return [
        f"for face, amplitude in [{pairs}]:",
        "    modes = face_modes(critical)",
        "    amplitudes = amplitude * (np.arange(modes.elongations.shape[0]) == face)",
        "    critical = manifold.configuration(modes.walk(amplitudes).sigma)",
    ]


def _cuts(changes: list[Change], session: Session) -> list[str]:
    return [
        f"for edge in {[edge for _, edge in changes]}:",
        "    pruned = prune(network, np.arange(network.n_edges) != edge)",
        "    network, manifold = pruned.network, CriticalManifold(pruned.network)",
        "    critical = manifold.configuration(critical.sigma[pruned.edges])",
    ]


def _strains(changes: list[Change], session: Session) -> list[str]:
    _, deformation, gamma = changes[-1]
    if gamma == 0:
        return []
    return [
        f'path = strain_path(critical, [{gamma!r}], deformation="{deformation}").value',
        "print(path.bulk_modulus, path.shear_modulus, path.modulus, path.states[-1].coordinates)",
    ]


_LINES = {
    "population": _populations,
    "blend": _blends,
    "edge": _edges,
    "face": _faces,
    "cut": _cuts,
    "strain": _strains,
}


def link_text(session: Session) -> str:
    """The state of a session as the part of a link after #."""
    record = {"source": session.source.recipe, "changes": session.recipe()}
    packed = zlib.compress(json.dumps(record, separators=(",", ":")).encode(), 9)
    return base64.urlsafe_b64encode(packed).decode().rstrip("=")


def from_link(text: str) -> tuple[dict[str, Any], list[Any]]:
    """The recipe of the source and the changes of a link.

    Raises `InputError` for a text that is not the part after # of a link of this page.
    """
    try:
        if len(text) > _LONGEST:
            raise ValueError
        packed = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        unpacker = zlib.decompressobj()
        record = json.loads(unpacker.decompress(packed, 50 * _LONGEST))
        source, changes = record["source"], record["changes"]
        if not isinstance(source, dict) or not isinstance(changes, list):
            raise ValueError
    except (ValueError, KeyError, TypeError, zlib.error):
        raise InputError("this link is incomplete or of another version: copy it again from the page") from None
    return source, changes
