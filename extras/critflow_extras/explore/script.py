"""The lines of Python that make a state again."""

from __future__ import annotations

from collections.abc import Callable

from critflow.growth import stiffening
from critflow.result import InputError
from critflow_extras.explore.model import OPTIMA, POPULATIONS, SPREAD
from critflow_extras.explore.session import Session

_SCENE = (
    *("CriticalManifold", "critical_from_lengths", "optimize", "stiffening", "strain_path", "elasticity"),
    "voronoi_network",
)
_EXTRAS = ("nearest_critical", "network_from", "pruned")
_AT_TRANSITION = "print(elasticity(critical).value, stiffening(critical).value)"
_MODULI = "print(elasticity(critical).value)"
_AT_REST = "print(elasticity(network, imported.positions).value)  # springs at rest, as in the file"


def script(session: Session) -> str:
    """Python that makes the state of a session with the same numbers to the last digit."""
    body = session.source.lines(session.start.critical)
    for name, *values in session.recipe():
        body += _LINES[name](session.start.model.seed, *values)
    body.append(_measured(session))
    text = "\n".join(body)
    heads = ["import numpy as np"] * ("np." in text) + ["import xarray as xr"] * ("xr." in text)
    heads += [""] * bool(heads)
    for package, names in (("critflow", _SCENE), ("critflow_extras", _EXTRAS)):
        if used := [name for name in names if f"{name}(" in text]:
            heads.append(f"from {package} import {', '.join(used)}")
    heads += ["from critflow.isogonal import face_modes"] * ("face_modes(" in text)
    heads += ["from critflow.engine import stable_rng"] * ("stable_rng(" in text)
    return "\n".join([*heads, "", text, ""])


def _measured(session: Session) -> str:
    """The call that prints the numbers of the state: coefficients only where they exist, else why they do not."""
    if session.state.given is not None:
        return _AT_REST
    try:
        found = stiffening(session.state.critical, throw=False)
    except InputError as error:
        return f"{_MODULI}  # without C_B and C_G: {error}"
    return _AT_TRANSITION if found.ok else f"{_MODULI}  # without C_B and C_G: {found.reason}"


def _stress(seed: int, name: str) -> str:
    """The stress of a population."""
    noise = f'stable_rng({seed}, "{name}").standard_normal(network.n_edges)'
    if name in OPTIMA:
        return f'optimize(manifold, "{OPTIMA[name]}", throw=False).value.sigma'
    if name == "random_stress":
        return f"manifold.solve(np.abs({noise})).value.sigma"
    return f"critical_from_lengths(manifold, 1 + {SPREAD} * {noise}, throw=False).value.sigma"


def _population(seed: int, name: str) -> list[str]:
    return [f"critical = manifold.configuration({_stress(seed, name)})"]


def _blend(seed: int, *weights: float) -> list[str]:
    parts = {name: weight for name, weight in zip(POPULATIONS, weights, strict=True) if weight}
    total = " + ".join(f"{weight!r} * {name}" for name, weight in parts.items())
    return [*(f"{name} = {_stress(seed, name)}" for name in parts), f"critical = manifold.configuration({total})"]


def _edge(seed: int, edge: int, change: float) -> list[str]:
    return [
        f"raised = np.exp({change!r} * (np.arange(network.n_edges) == {edge}))",
        "critical = manifold.configuration(critical.sigma * raised)",
    ]


def _face(seed: int, face: int, amplitude: float) -> list[str]:
    return [
        "modes = face_modes(critical)",
        f"amplitudes = {amplitude!r} * (np.arange(modes.elongations.shape[0]) == {face})",
        "critical = manifold.configuration(modes.walk(amplitudes).sigma)",
    ]


def _cut(seed: int, edge: int) -> list[str]:
    return [
        f"part = pruned(network, np.arange(network.n_edges) != {edge})",
        "network, manifold = part.network, CriticalManifold(part.network)",
        "critical = manifold.configuration(critical.sigma[part.edges])",
    ]


def _strain(seed: int, deformation: str, gamma: float) -> list[str]:
    if gamma == 0:
        return []
    return [
        f'path = strain_path(critical, [{gamma!r}], deformation="{deformation}").value',
        "print(path.bulk_modulus, path.shear_modulus, path.modulus, path.states[-1].coordinates)",
    ]


def _equal_stress(seed: int) -> list[str]:
    return ["critical = manifold.configuration(network.stiffness)"]


_LINES: dict[str, Callable[..., list[str]]] = {
    "population": _population,
    "blend": _blend,
    "equal_stress": _equal_stress,
    "edge": _edge,
    "face": _face,
    "cut": _cut,
    "strain": _strain,
}
