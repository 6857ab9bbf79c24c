"""Where the networks of a page come from: random networks by size and seed, one file, or the cases of a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.exchange.convert import network_from
from critflow.explore.model import Model, start_of
from critflow.generators.random_networks import voronoi_network
from critflow.result import CritflowError, InputError

# Beyond this a change takes seconds.
LARGEST = 20_000


class Source(Protocol):
    """A source of networks.

    recipe  the values of the source that a link contains
    title   the network in a few words
    """

    @property
    def recipe(self) -> dict[str, Any]: ...

    @property
    def title(self) -> str: ...

    def open(self) -> tuple[Model, CriticalConfiguration]:
        """The network and its first configuration."""
        ...

    def lines(self) -> list[str]:
        """Lines of Python that make `network`, its manifold and the first configuration `critical`."""
        ...


@dataclass(frozen=True)
class Random:
    """The standard disordered network of a size and a seed, at equal stress."""

    n_vertices: int = 1000
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("n_vertices", "seed"):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool):
                raise InputError(f"{name} must be a whole number, not {value!r:.40}")
        if self.n_vertices > LARGEST:
            raise InputError(f"the page shows at most {LARGEST:,} vertices, not {self.n_vertices:,}: choose fewer")

    @property
    def recipe(self) -> dict[str, Any]:
        return {"n_vertices": self.n_vertices, "seed": self.seed}

    @property
    def title(self) -> str:
        return f"Voronoi network of {self.n_vertices:,} vertices, seed {self.seed}"

    def open(self) -> tuple[Model, CriticalConfiguration]:
        model = Model(voronoi_network(self.n_vertices, self.seed), self.seed)
        return model, start_of(model, None)

    def lines(self) -> list[str]:
        return [
            f"network = voronoi_network(n_vertices={self.n_vertices}, seed={self.seed})",
            "manifold = CriticalManifold(network)",
            "critical = manifold.configuration(network.stiffness)",
        ]


@dataclass(frozen=True)
class File:
    """The network of a file, at the force densities that it contains, or at equal stress."""

    path: Path

    @property
    def recipe(self) -> dict[str, Any]:
        return {"file": self.path.name}

    @property
    def title(self) -> str:
        return self.path.name

    def open(self) -> tuple[Model, CriticalConfiguration]:
        try:
            imported = network_from(self.path)
        except CritflowError:
            raise
        except (OSError, ValueError, KeyError, IndexError) as error:
            raise InputError(f"{self.path.name} could not be read, {error}: check that it is complete") from None
        check_size(imported.network.n_vertices)
        model = Model(imported.network)
        return model, start_of(model, _stress(imported.force_densities, model))

    def lines(self) -> list[str]:
        return opened_lines(f"network_from({self.path.name!r})", self)


def opened_lines(source: str, opened: Source) -> list[str]:
    """Lines that make a network of an expression, at its stress if it was used."""
    model, critical = opened.open()
    plain = np.array_equal(critical.sigma, model.manifold.configuration(model.network.stiffness).sigma)
    start = "network.stiffness" if plain else "imported.force_densities"
    return [
        f"imported = {source}",
        "network = imported.network",
        "manifold = CriticalManifold(network)",
        f"critical = manifold.configuration({start})",
    ]


def _stress(found: Any, model: Model) -> Any:
    return None if found is None or len(found) != model.network.n_edges else np.asarray(found)


def check_size(n_vertices: int) -> None:
    """Raise `InputError` for networks that are too large for the page."""
    if n_vertices > LARGEST:
        raise InputError(f"the page shows at most {LARGEST:,} vertices, and this network has {n_vertices:,}")
