"""The network that a page starts from: a random one by size and seed, or that of a file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.extras.explore.model import Model
from critflow.extras.files.convert import network_from
from critflow.extras.files.repair import ImportedNetwork
from critflow.extras.inference.nearest import nearest_critical
from critflow.generators.random_networks import voronoi_network
from critflow.result import CritflowError, InputError

# Vertices beyond which a change takes seconds.
LARGEST = 20_000
# Distance from the nearest critical configuration over the mean edge length, as closely as other programs relax.
_RELAXED = 1e-3
# Steps towards the nearest critical configuration of a file: to one at its positions ten are enough.
_FEW_STEPS = 20


class Source(Protocol):
    """A network with its first configuration; `title` names it in a few words."""

    @property
    def title(self) -> str: ...

    def open(self) -> tuple[Model, CriticalConfiguration]:
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

    def open(self) -> tuple[Model, CriticalConfiguration]:
        return opened(Model(voronoi_network(self.n_vertices, self.seed), self.seed))

    def lines(self, start: CriticalConfiguration) -> list[str]:
        return [
            f"network = voronoi_network(n_vertices={self.n_vertices}, seed={self.seed})",
            "manifold = CriticalManifold(network)",
            "critical = manifold.configuration(network.stiffness)",
        ]


@dataclass(frozen=True)
class File:
    """The network of a file, or of two tables, critical at its force densities or positions, or at equal stress.

    hints  options of `network_from`, such as pins and volume; with labels the file numbers the cells of a tissue
    """

    path: Path
    second: Path | None = None
    hints: dict[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return " and ".join(path.name for path in (self.path, self.second) if path)

    def open(self) -> tuple[Model, CriticalConfiguration]:
        imported = self._read()
        check_size(imported.network.n_vertices)
        known = imported.force_densities
        return opened(Model(imported.network), _stress_at(imported) if known is None else known)

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
        if lines[-1].endswith("force_densities)") and self._read().force_densities is None:
            lines[-1:] = [
                f"near = nearest_critical(network, imported.positions, max_steps={_FEW_STEPS})",
                "critical = manifold.configuration(near.value.sigma)",
            ]
        return lines


def _stress_at(imported: ImportedNetwork) -> Any:
    """σ of the critical configuration at the positions, as closely as other programs relax; None where none is."""
    try:
        near = nearest_critical(imported.network, imported.positions, max_steps=_FEW_STEPS, throw=False)
    except CritflowError:
        return None
    return near.value.sigma if near.ok and near.distance < _RELAXED * near.value.lengths.mean() else None


def opened(model: Model, stress: Any = None) -> tuple[Model, CriticalConfiguration]:
    """A model with its configuration at a stress σ (N_b,) that is known, or else at its stiffnesses."""
    network = model.network
    if stress is not None and np.shape(stress) == (network.n_edges,) and np.isfinite(stress).all() and np.any(stress):
        critical = model.manifold.solve(np.asarray(stress))
        if critical.ok:
            return model, critical.value
    return model, model.manifold.configuration(network.stiffness)


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
