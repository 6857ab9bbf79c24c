"""The network that a page starts from: a random one by size and seed, or that of a file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array
from critflow.points import voronoi_network
from critflow.result import CritflowError, InputError
from critflow_extras.explore.model import Model
from critflow_extras.files.convert import network_from
from critflow_extras.files.repair import ImportedNetwork
from critflow_extras.inference.nearest import nearest_critical

# Vertices beyond which a change takes seconds.
LARGEST = 20_000
# Distance from the nearest critical configuration over the mean edge length, as closely as other programs relax.
_RELAXED = 1e-3
# Changes of edges over the mean edge length that are rounding.
_ROUNDING = 1e-9
# Steps towards the nearest critical configuration of a file: to one at its positions ten are enough.
_FEW_STEPS = 20


class Opening(NamedTuple):
    """What a page starts from.

    critical  the first configuration, from which changes start
    given     coordinates (N_v, d) of the file, where those of `critical` are others: shown until the first change
    remark    how far apart the two are, in sentences
    """

    model: Model
    critical: CriticalConfiguration
    given: Array | None = None
    remark: str = ""


class Source(Protocol):
    """A network with its first configuration; `title` names it in a few words."""

    @property
    def title(self) -> str: ...

    def open(self) -> Opening:
        """The network and its first configuration."""
        ...

    def lines(self, start: CriticalConfiguration) -> list[str]:
        """Lines of Python that make `network`, `manifold` and the first configuration, `critical`."""
        ...


@dataclass(frozen=True)
class Random:
    """The Voronoi network of a size and a seed, at equal stress."""

    n_vertices: int = 1000
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("n_vertices", "seed"):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool):
                raise InputError(f"{name} must be a whole number, not {value!r:.40}")
        check_size(self.n_vertices)

    @property
    def title(self) -> str:
        return f"Voronoi network of {self.n_vertices:,} vertices, seed {self.seed}"

    def open(self) -> Opening:
        return opened(Model(voronoi_network(self.n_vertices, self.seed), self.seed))

    def lines(self, start: CriticalConfiguration) -> list[str]:
        return [
            f"network = voronoi_network(n_vertices={self.n_vertices}, seed={self.seed})",
            "manifold = CriticalManifold(network)",
            "critical = manifold.configuration(network.stiffness)",
        ]


@dataclass(frozen=True)
class File:
    """The network of a file, or of two tables, as given where its positions are not critical.

    Changes start at its force densities, in the critical configuration at its positions, or else at equal stress.

    hints  options of `network_from`, such as pins and volume; with labels the file numbers the cells of a tissue
    """

    path: Path
    second: Path | None = None
    hints: dict[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return " and ".join(path.name for path in (self.path, self.second) if path)

    def open(self) -> Opening:
        imported = self._read()
        check_size(imported.network.n_vertices)
        model, known = Model(imported.network), _stresses(imported)
        if known is not None:
            return _as_given(opened(model, known), imported, "the force densities of the file")
        near = _stress_at(imported)
        start = "equal stress" if near is None else "the critical configuration nearest to the positions of the file"
        return _as_given(opened(model, near), imported, start)

    def _read(self) -> ImportedNetwork:
        hints = dict(self.hints)
        labels = hints.pop("labels", False)
        files = (self.path, self.second) if self.second else self.path
        return network_from(labels=self.path, **hints) if labels else network_from(files, **hints)

    def lines(self, start: CriticalConfiguration) -> list[str]:
        names = (self.path.name, self.second.name) if self.second else self.path.name
        hints = "".join(f", {name}={value!r}" for name, value in self.hints.items() if name != "labels")
        first = f"labels={names!r}" if self.hints.get("labels") else repr(names)
        lines = imported_lines(f"network_from({first}{hints})", start)
        if lines[-1].endswith("force_densities)") and _stresses(self._read()) is None:
            lines[-1:] = [
                f"near = nearest_critical(network, imported.positions, max_steps={_FEW_STEPS})",
                "critical = manifold.configuration(near.value.sigma)",
            ]
        return lines


def _stresses(imported: ImportedNetwork) -> Array | None:
    """The force densities σ (N_b,) of a file; None without them, and where all are zero, as of springs at rest."""
    known = imported.force_densities
    return None if known is None or not known.any() else known


def _stress_at(imported: ImportedNetwork) -> Any:
    """σ of the critical configuration at the positions, as closely as other programs relax; None where none is."""
    try:
        near = nearest_critical(imported.network, imported.positions, max_steps=_FEW_STEPS, throw=False)
    except CritflowError:
        return None
    return near.value.sigma if near.ok and near.distance < _RELAXED * near.value.lengths.mean() else None


def _as_given(opening: Opening, imported: ImportedNetwork, start: str) -> Opening:
    """With the positions of the file, unless those of the first configuration equal them but for a small difference.

    start  what the first configuration is, in words
    """
    given = opening.model.network.bond_vectors(imported.positions)
    size = float(np.linalg.norm(given, axis=1).mean())
    moved = float(np.linalg.norm(opening.critical.bond_vectors - given, axis=1).max()) / (size or 1.0)
    if moved <= _ROUNDING:
        return opening
    change = f"which changes edges by up to {moved:.2g} of the mean edge length"
    if moved <= _RELAXED:
        return opening._replace(remark=f"It is shown in {start}, {change}.")
    none = "is not at" if _stresses(imported) is not None else "has no force densities and is not at"
    shown = f"It {none} a critical configuration, so it is shown as given, with springs at rest."
    remark = f"{shown} The first change starts from {start}, {change}."
    return opening._replace(given=imported.positions, remark=remark)


def opened(model: Model, stress: Any = None) -> Opening:
    """A model with its configuration at a stress σ (N_b,) that is known, or else at its stiffnesses."""
    network = model.network
    if stress is not None and np.shape(stress) == (network.n_edges,) and np.isfinite(stress).all() and np.any(stress):
        critical = model.manifold.solve(np.asarray(stress))
        if critical.ok:
            return Opening(model, critical.value)
    return Opening(model, model.manifold.configuration(network.stiffness))


def imported_lines(expression: str, start: CriticalConfiguration) -> list[str]:
    """Lines that make the network of an expression at its own stress, or at equal stress if `start` has that."""
    network = start.network
    equal = np.array_equal(start.sigma, CriticalManifold(network).configuration(network.stiffness).sigma)
    return [
        f"imported = {expression}",
        "network = imported.network",
        "manifold = CriticalManifold(network)",
        f"critical = manifold.configuration({'network.stiffness' if equal else 'imported.force_densities'})",
    ]


def check_size(n_vertices: int) -> None:
    """Raise `InputError` for networks that are too large for the page."""
    if n_vertices > LARGEST:
        raise InputError(f"the page shows networks of at most {LARGEST:,} vertices, not {n_vertices:,}")
