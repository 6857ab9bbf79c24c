"""Contact networks of jammed packings: soft discs and spheres of two sizes, compressed beyond jamming."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.checks import check_size
from critflow.networks import Array, IntArray, Network
from critflow.points import points_in_cell
from critflow.result import InputError
from critflow_extras.graphs.dilution import diluted
from critflow_extras.pruning.pruning import pruned

# Ratio of the two radii, at which neither discs nor spheres crystallise (O'Hern et al. 2003).
_RATIO = 1.4
# Share of the cell that frictionless packings of this kind fill at jamming.
_JAMMING = {2: 0.842, 3: 0.648}
_MOST_DENSE = {2: 1.2, 3: 0.9}
# Overlap of two particles, relative to the sum of their radii, from which they are in contact; forces are far smaller.
_CONTACT = 1e-6
_FORCE = 1e-10
_MOST_STEPS = 20_000
# Fewer particles would touch two images of one neighbour.
_FEWEST = {2: 20, 3: 60}


@running("packing_network")
def packing_network(
    n_vertices: int = 200,
    z: float = 4.5,
    seed: int | np.random.Generator = 0,
    density: float = 1.0,
    dimension: int = 2,
) -> Network:
    """Springs between the touching particles of a jammed packing, edges removed at random down to z.

    n_vertices  number of particles, half of them 1.4 times as large as the others; those without contacts are dropped
    density     volume of the particles over that of the cell, counting overlaps twice; jamming is near 0.84 in the
                plane and 0.65 in space, and the coordination of the packing grows with the density above
    dimension   2: discs, 3: spheres

    Particles that repel like harmonic springs relax from random places (O'Hern et al., Phys. Rev. E 68, 011306, 2003);
    springs at rest take the places of their contacts, and V = n_vertices.
    Raises `InputError` for a density below jamming, and for a z above the coordination of the packing.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.packing_network(n_vertices=24, z=4.5, seed=1).dimension
    2
    """
    n_vertices, dimension = of_kind(int, n_vertices=n_vertices, dimension=dimension)
    of_kind(float, z=z, density=density)
    seed = of_kind(int, np.random.Generator, seed=seed)
    if dimension not in _JAMMING:
        raise InputError(f"a packing has dimension 2 or 3, not {dimension}")
    if n_vertices < _FEWEST[dimension]:
        raise InputError(f"a packing needs at least {_FEWEST[dimension]} particles, not {n_vertices}")
    check_size(n_vertices)
    if not z > 0:
        raise InputError(f"z must be positive, not {z}")
    least, most = _JAMMING[dimension] + 0.01, _MOST_DENSE[dimension]
    if not least <= density <= most:
        raise InputError(f"the density must be between {least:.3g}, above jamming, and {most:g}, not {density}")
    rng = generator(seed)
    side = n_vertices ** (1 / dimension)
    radii = rng.permutation(np.where(np.arange(n_vertices) % 2, _RATIO, 1.0))
    content = np.sum(np.pi * radii**2 if dimension == 2 else 4 / 3 * np.pi * radii**3)
    radii *= (density * n_vertices / content) ** (1 / dimension)
    start = points_in_cell(n_vertices, 0.7, rng, np.eye(dimension)) * side
    packing = _Packing(radii, side)
    positions = packing.relaxed(start)
    edges, offsets = packing.contacts(positions)
    network = pruned(edges, offsets=offsets, cell=side * np.eye(dimension), positions=positions).network
    found = diluted(network, z, rng)
    return replace(found, note=f"{network.n_vertices} of {n_vertices} particles in contact; {found.note}")


class _Packing:
    """Particles of radii (n,) in a periodic cube: energy ½ Σ (1 − |r|/(R_i + R_j))² over overlapping pairs."""

    def __init__(self, radii: Array, side: float):
        self._radii, self._side = radii, side
        self._listed_at = np.empty(0)
        self._reach = 2 * radii.max()
        # Pairs are listed again when particles have moved by half of this.
        self._skin = 0.3 * self._reach

    def relaxed(self, start: Array) -> Array:
        """Positions (n, d) at a minimum of the energy."""
        found = scipy.optimize.minimize(
            lambda x: self._energy(x.reshape(start.shape)),
            start.ravel(),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _MOST_STEPS, "maxfun": 2 * _MOST_STEPS, "ftol": 0.0, "gtol": _FORCE, "maxcor": 20},
        )
        return np.asarray(found.x.reshape(start.shape) % self._side)

    def contacts(self, x: Array) -> tuple[IntArray, IntArray]:
        """Edges (n, 2) and offsets (n, d) of overlapping pairs; particles that d or fewer others hold are left out."""
        self._listed_at = np.empty(0)
        first, second, apart, overlap = self._overlaps(x)
        offsets = np.round((apart - (x[second] - x[first])) / self._side).astype(int)
        edges, kept = np.column_stack([first, second]), overlap > _CONTACT
        while True:
            loose = np.bincount(edges[kept].ravel(), minlength=len(x)) <= x.shape[1]
            if not (dropped := kept & loose[edges].any(axis=1)).any():
                return edges[kept], offsets[kept]
            kept &= ~dropped

    def _overlaps(self, x: Array) -> tuple[IntArray, IntArray, Array, Array]:
        """Pairs that overlap, the vectors between them, and their relative overlaps."""
        if self._listed_at.shape != x.shape or np.abs(x - self._listed_at).max() > 0.35 * self._skin:
            tree = scipy.spatial.cKDTree(x % self._side, boxsize=self._side)
            self._pairs = np.ascontiguousarray(tree.query_pairs(self._reach + self._skin, output_type="ndarray").T)
            self._listed_at = x.copy()
        first, second = self._pairs
        apart = x[second] - x[first]
        apart -= self._side * np.round(apart / self._side)
        overlap = 1 - np.sqrt(np.sum(apart**2, axis=1)) / (self._radii[first] + self._radii[second])
        near = np.flatnonzero(overlap > 0)
        return first[near], second[near], apart[near], overlap[near]

    def _energy(self, x: Array) -> tuple[float, Array]:
        """Energy and its gradient."""
        first, second, apart, overlap = self._overlaps(x)
        sums = self._radii[first] + self._radii[second]
        # Coinciding particles have no direction, and none occurs from a start with a hard core.
        pull = -(overlap / sums**2 / np.maximum(1 - overlap, 1e-9))[:, None] * apart
        gradient = np.empty_like(x)
        for axis in range(x.shape[1]):
            gradient[:, axis] = np.bincount(second, pull[:, axis], len(x)) - np.bincount(first, pull[:, axis], len(x))
        return 0.5 * float(overlap @ overlap), gradient.ravel()
