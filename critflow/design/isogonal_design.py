"""Design at a fixed force network: lengths, face areas and stiffening change, the response at the transition does not.

Isogonal modes keep the direction and the tension of every edge, and so S = Σσ L⊗L, D = Σσ²|L|²/k and every modulus at
the transition.  With amplitudes a the lengths are ℓ = ℓ_0 + Eᵀa, and the configuration needs no solve:
    L_α = ℓ_α n_α,  σ_α = τ_α/ℓ_α,   dO/dℓ_α = n_α·∂O/∂L_α − (σ_α/ℓ_α) ∂O/∂σ_α,   dO/da = E dO/dℓ.
Among the configurations that reach the targets the nearest one has about the least ½⟨log²(ℓ/ℓ_0)⟩, which is also the
change of log σ that `design` minimises.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from critflow.arguments import checked
from critflow.critical.isogonal import IsogonalModes, face_modes, isogonal_modes
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import LengthVariance, Objective
from critflow.design.result import Design, Interval, all_limits, of_targets, outcome
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.quantities.errors import error_bounds
from critflow.quantities.largest_modulus import bulk_modulus_bound
from critflow.quantities.stiffening import StiffeningCoefficient
from critflow.response.elasticity import elasticity
from critflow.result import InputError, Stats
from critflow.solvers.constrained import Minimum, Point, minimise_constrained

SHORTEST_ISOGONAL = 5e-2  # shortest length of an isogonal design by default, in units of the mean
ISOGONAL_NEAREST = 1e-2  # component of the gradient of the isogonal change along the targets, relative to 1 + it
STIFFEST = 1e-9  # relative distance from the largest B_0 at which C_B is the closed form for all isogonal changes

# Longest change of an amplitude in one step, in units of the mean length.
_LONGEST = 0.3
# Unit of the lengths as limits, over the mean: those within a fifth of it take part in a step.
_LENGTHS = 10.0
_COEFFICIENTS = ("C_B", "C_G", "length_variance")
# Powers of a length in the units of targets.
_POWERS = {"length": 1, "area": 2}


@dataclass(frozen=True, eq=False, kw_only=True)
class IsogonalDesign(Design[CriticalConfiguration]):
    """A configuration with requested properties and the force network of another one; unknowns are log lengths.

    amplitudes  (n_modes,) of the isogonal modes that lead to it
    """

    amplitudes: Array


@checked
def isogonal_design(
    critical: CriticalConfiguration,
    targets: Mapping[str, Interval],
    shortest: float | None = None,
    max_steps: int = 300,
    throw: bool = True,
) -> IsogonalDesign:
    """The configuration nearest in lengths with the same force network and requested properties.

    targets   name → value, or (low, high); names are "C_B", "C_G" (energy convention), "length_variance", "length_α" of
              edge α, and "area_f" of face f
    shortest  least length of every edge; a twentieth of the mean by default

    S, D, B_0 and G_0 are those of the given configuration, to rounding.  The optimum is local; distances of
    different optima differ by a few percent, by a tenth where many edges are shortest.
    `stats.residual` is the largest error of a target relative to its size.
    `Status.infeasible`: no isogonal change reduces the errors further, and the configuration is the best compromise
    found.  Targets of C_B below −B_0/2 are refused where all stresses are positive, and all but −B_0/2 at the largest
    B_0 of the network: bounds for every isogonal change (proof, `stiffening_bound`).
    Raises `InputError` for unknown or contradictory targets, stresses with zeros, and networks that are not planar,
    `SolveError` with `throw`.
    """
    if not (critical.sigma != 0).all():
        raise InputError("edges without stress have no isogonal modes: use the configuration of the taut part")
    if max_steps < 1:
        raise InputError(f"max_steps must be positive, not {max_steps}")
    family = _Family(critical, targets, _shortest(critical, shortest))
    excess = family.excess()
    with np.errstate(all="ignore"):
        # Trial lengths that are not positive have values that are not finite, and are refused.
        found = family.nearest(0 if excess else max_steps)
    solution = family.report(found, excess)
    return solution.or_raise("no isogonal change has these properties") if throw else solution


def _shortest(critical: CriticalConfiguration, shortest: float | None) -> float:
    """The least length of every edge, which the given configuration has."""
    least = float(critical.lengths.min())
    if shortest is None:
        return min(SHORTEST_ISOGONAL * float(critical.lengths.mean()), 0.5 * least)
    if not 0 < shortest <= least:
        raise InputError(
            f"the shortest length must be positive and at most {least:.6g}, that of the given configuration: "
            "modes.largest() leads to longer edges"
        )
    return shortest


class _Family:
    """The isogonal family of a configuration and the targets as functions of its amplitudes, in units of ⟨ℓ_0⟩."""

    def __init__(self, critical: CriticalConfiguration, targets: Mapping[str, Interval], shortest: float):
        self.critical, self.network = critical, critical.network
        self.manifold = CriticalManifold(critical.network)
        if not targets:
            raise InputError("give at least one target, such as {'C_B': 0.1}")
        self.values_of = [_target(self.manifold, name) for name in targets]
        self.names = tuple(targets)
        self._low, self._high = all_limits(targets)
        self.unit = float(critical.lengths.mean())
        # Errors are relative to the size of the target, and absolute below a hundredth of its unit.
        ends = np.abs(np.array([self._low, self._high]))
        largest = np.where(np.isfinite(ends), ends, 0.0).max(axis=0)
        powers = [0 if name in _COEFFICIENTS else _POWERS[name.split("_")[0]] for name in targets]
        self.scale = np.maximum(largest, 1e-2 * self.unit ** np.array(powers))
        self.modes = _modes(critical)
        # Equal amplitudes of all faces change nothing, so that one face is left out.
        self.n_modes = self.modes.n_independent
        self.lengths_of = self.unit * sp.csr_array(sp.csr_array(self.modes.elongations)[: self.n_modes].T)
        self.directions = critical.bond_vectors / critical.lengths[:, None]
        self.reach = _LENGTHS * self.unit
        n_edges, self.least = self.network.n_edges, (1 - 1e-6) * shortest
        self.low = np.concatenate([self._low / self.scale, np.full(n_edges, shortest / self.reach)])
        self.high = np.concatenate([self._high / self.scale, np.full(n_edges, np.inf)])

    def metric(self, z: Array) -> Callable[[Array], Array]:
        """Products of rows (..., n_modes) with the inverse of Σ (∂log ℓ)², so that a step changes no length too far."""
        lengths = self.critical.lengths + self.lengths_of @ z
        relative = sp.diags_array(1 / lengths) @ self.lengths_of
        factor = splu(sp.csc_matrix(relative.T @ relative))
        return lambda rows: np.asarray(factor.solve(rows.T).T)

    def nearest(self, max_steps: int) -> Minimum:
        """The search through half the distance of the targets, which ends nearer, else the direct one."""
        start = np.zeros(self.n_modes)
        half = self.search(start, 0.5, max_steps // 5)
        found = self.search(half.point.z, 1.0, max_steps - half.steps)
        if found.reached or found.steps + half.steps >= max_steps:
            return found
        direct = self.search(start, 1.0, max_steps)
        return min(found, direct, key=lambda end: end.violation)

    def search(self, start: Array, part: float, max_steps: int) -> Minimum:
        """The search from amplitudes with the limits of the targets at a part of their distance."""
        stage = copy(self)
        if part < 1:
            here = self.at(np.zeros(self.n_modes)).constraints
            stage.low = np.where(here < self.low, here + part * (self.low - here), self.low)
            stage.high = np.where(here > self.high, here + part * (self.high - here), self.high)
        return minimise_constrained(stage, start, ISOGONAL_NEAREST, _LONGEST, max_steps, self.metric)

    def values(self, a: Array) -> tuple[Array, Array]:
        """Values (n,) and gradients by the lengths (n, N_b) at amplitudes a."""
        lengths = self.critical.lengths + self.lengths_of @ a
        sigma = self.critical.tensions / lengths
        values, rows = zip(*(of(sigma, lengths, self.directions) for of in self.values_of), strict=True)
        return np.array(values), np.array(rows)

    def at(self, z: Array) -> Point:
        """½Σ log²(ℓ/ℓ_0), and as constraints the targets relative to their sizes and the lengths."""
        lengths = self.critical.lengths + self.lengths_of @ z
        # Collapsed edges would trap a search: lengths below the limit are outside the domain.
        change = np.log(np.where(lengths > self.least, lengths, np.nan) / self.critical.lengths)
        values, by_length = self.values(z)
        n, rows = len(values), (by_length / self.scale[:, None]) @ self.lengths_of

        def of(indices: NDArray[np.intp]) -> Array:
            limited = self.lengths_of[indices[indices >= n] - n].toarray() / self.reach
            return np.concatenate([rows[indices[indices < n]], limited])

        constraints = np.concatenate([values / self.scale, lengths / self.reach])
        return Point(z, 0.5 * float(change @ change), self.lengths_of.T @ (change / lengths), constraints, of)

    def bounds(self, value: CriticalConfiguration, rows: Array) -> Array:
        """Error bounds (estimate) of the targets (n,), from their derivatives by the lengths (n, N_b)."""
        size = np.abs(rows)
        found = np.asarray(size @ value.bond_errors + 4 * EPS * size @ value.lengths)
        for n, name in enumerate(self.names):
            if name in _COEFFICIENTS:
                found[n] = error_bounds([_objective(self.manifold, name)], value)[0]
        return found

    def excess(self) -> str:
        """A sentence where a closed form excludes the target of C_B, else an empty string."""
        if "C_B" not in self.names:
            return ""
        n, bulk = self.names.index("C_B"), elasticity(self.critical).value.bulk
        bound = bulk_modulus_bound(self.network)
        least = -bulk / 2
        if (self.critical.sigma > 0).all() and self._high[n] < least * (1 + STIFFEST):
            return f"C_B is at least -B_0/2 = {least:.8g} for every isogonal change: start from a larger B_0"
        if bulk < bound * (1 - STIFFEST):
            return ""
        if self._low[n] - STIFFEST * bound <= -bound / 2 <= self._high[n] + STIFFEST * bound:
            return ""
        return f"at the largest B_0, C_B is {-bound / 2:.8g} for every isogonal change: start from a smaller B_0"

    def report(self, found: Minimum, excess: str) -> IsogonalDesign:
        """The design at the end of a search."""
        a, n = found.point.z, len(self.names)
        full = np.zeros(self.modes.elongations.shape[0])
        full[: self.n_modes] = self.unit * a
        value, (values, rows) = self.modes.walk(full), self.values(a)
        bounds = self.bounds(value, rows)
        error = np.abs(values - np.clip(values, self._low, self._high)) / self.scale
        unreached = "no isogonal change reduces the errors of the targets: relax one, or change the force network"
        status, note = outcome(found, excess, unreached)
        n_edges = self.network.n_edges
        return IsogonalDesign(
            value=value,
            status=status,
            stats=Stats("sqp", found.steps, float(error.max())),
            note=note,
            amplitudes=full,
            preference=found.point.value,
            distance=float(np.sqrt(2 * found.point.value / n_edges)),
            **of_targets(self.names, values, bounds, -found.multipliers[:n] / self.scale, rows @ self.lengths_of),
        )


def _modes(critical: CriticalConfiguration) -> IsogonalModes:
    """Sparse modes of faces where the network has them, else modes by singular values."""
    network = critical.network
    degree = np.bincount(network.edges.ravel(), minlength=network.n_vertices)
    simple = network.dimension == 2 and not network.pins and network.faces is not None and bool((degree == 3).all())
    modes = face_modes(critical) if simple else isogonal_modes(critical)
    if modes.n_independent == 0:
        raise InputError("no isogonal mode exists here: every change of lengths turns some edge")
    return modes


ValueOf = Callable[[Array, Array, Array], tuple[float, Array]]


def _target(manifold: CriticalManifold, name: str) -> ValueOf:
    """A target as a function of σ, lengths and directions: its value and derivatives by the lengths (N_b,)."""
    network = manifold.network
    if name in _COEFFICIENTS:
        return _of_objective(_objective(manifold, name))
    kind, _, number = name.partition("_")
    counts = {"length": network.n_edges, "area": 0 if network.faces is None else network.faces.n_faces}
    if kind not in counts or not number.isdecimal():
        raise InputError(f"no target is called {name!r}: choose from {', '.join(_COEFFICIENTS)}, length_0, area_0, ...")
    if int(number) >= counts[kind]:
        noun = {"length": "edges", "area": "faces"}[kind]
        raise InputError(f"{name} does not exist: the network has {counts[kind]} {noun}, counted from 0")
    return _length(int(number)) if kind == "length" else _area(network, int(number))


def _objective(manifold: CriticalManifold, name: str) -> Objective:
    if name == "length_variance":
        return LengthVariance()
    return StiffeningCoefficient(manifold, of_shear=name == "C_G")


def _of_objective(objective: Objective) -> ValueOf:
    def value(sigma: Array, lengths: Array, directions: Array) -> tuple[float, Array]:
        found, (by_sigma, by_L) = objective.evaluate(sigma, lengths[:, None] * directions)
        return found, np.einsum("ad,ad->a", directions, by_L) - sigma / lengths * by_sigma

    return value


def _length(edge: int) -> ValueOf:
    def value(sigma: Array, lengths: Array, directions: Array) -> tuple[float, Array]:
        gradient = np.zeros_like(lengths)
        gradient[edge] = 1.0
        return float(lengths[edge]), gradient

    return value


def _area(network: Network, face: int) -> ValueOf:
    """½ Σ_(i<j) s_i × s_j of the sides s in turn."""
    faces = network.faces
    assert faces is not None
    walk = slice(faces.starts[face], faces.starts[face + 1])
    edges, signs = faces.edges[walk], faces.signs[walk]

    def value(sigma: Array, lengths: Array, directions: Array) -> tuple[float, Array]:
        n = signs[:, None] * directions[edges]
        sides = lengths[edges][:, None] * n
        before = np.cumsum(sides, axis=0) - sides
        after = sides.sum(axis=0) - before - sides
        area = 0.5 * float(np.sum(before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]))
        lever = before - after
        gradient = np.zeros_like(lengths)
        np.add.at(gradient, edges, 0.5 * (lever[:, 0] * n[:, 1] - lever[:, 1] * n[:, 0]))
        return area, gradient

    return value
