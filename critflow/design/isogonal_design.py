"""Design at a fixed force network: lengths, face areas and stiffening change, the response at the transition does not.

Isogonal modes keep the direction and the tension of every edge, and so S = Σσ L⊗L, D = Σσ²|L|²/k and every modulus at
the transition.  With amplitudes a the lengths are ℓ = ℓ_0 + Eᵀa, and the configuration needs no solve:
    L_α = ℓ_α n_α,  σ_α = τ_α/ℓ_α,   dO/dℓ_α = n_α·∂O/∂L_α − (σ_α/ℓ_α) ∂O/∂σ_α,   dO/da = E dO/dℓ.
Among the configurations that reach the targets the nearest one has about the least ½⟨log²(ℓ/ℓ_0)⟩, which is also the
change of log σ that `design` minimises.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import LengthVariance, Objective
from critflow.design.isogonal import IsogonalModes, face_modes, isogonal_modes
from critflow.design.modulus_bounds import bulk_modulus_bound
from critflow.design.restoration import Interval, limits_of
from critflow.design.tolerances import INDEPENDENT_TARGETS, SHORTEST_ISOGONAL, STIFFEST
from critflow.mechanics.moduli import transition_moduli
from critflow.mechanics.stiffening_objective import StiffeningCoefficient
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status
from critflow.solvers.sequential import Limits, nearest_point

_COEFFICIENTS = ("C_B", "C_G", "length_variance")
# Powers of a length in the units of targets.
_POWERS = {"length": 1, "area": 2}


@dataclass(frozen=True, eq=False, kw_only=True)
class IsogonalDesign(Solution[CriticalConfiguration]):
    """A configuration with requested properties and the force network of another one.

    amplitudes   (n_modes,) of the isogonal modes that lead to it
    achieved     values of the targets by name
    multipliers  cost of each target, by name: the derivative of ½⟨log²(ℓ/ℓ_0)⟩ by its value
    gram         (n, n) cosines between the gradients of the targets: 1 where two cannot be changed independently; 0 in
                 the row of a target that no mode changes
    independent  whether all targets can be changed independently here: the least eigenvalue of `gram` is not zero
    distance     root mean square of log(ℓ/ℓ_0)
    """

    amplitudes: Array
    achieved: dict[str, float]
    multipliers: dict[str, float]
    gram: Array = field(repr=False)
    independent: bool
    distance: float


@checked
def isogonal_design(
    critical: CriticalConfiguration,
    targets: Mapping[str, Interval],
    shortest: float | None = None,
    max_steps: int = 100,
    throw: bool = True,
) -> IsogonalDesign:
    """The configuration nearest in lengths with the same force network and requested properties.

    targets   name → value, or (low, high); names are "C_B", "C_G" (energy convention), "length_variance", "length_α" of
              edge α, and "area_f" of face f
    shortest  least length of every edge; a twentieth of the mean by default

    S, D, B_0 and G_0 are those of the given configuration, to rounding.  The optimum is local, and its distance is the
    least one within a few percent.  `stats.residual` is the largest error of a target relative to its size.
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
    family = _Family(critical, targets)
    least = _shortest(critical, shortest)
    limits = Limits(
        family.low / family.scale,
        family.high / family.scale,
        family.lengths_of / family.unit,
        (least - critical.lengths) / family.unit,
    )
    excess = family.excess()
    start = np.zeros(family.lengths_of.shape[1])
    if excess:
        return _finished(family.report(start, np.zeros(len(family.names)), 0, Status.infeasible, excess), throw)
    found = nearest_point(family.targets, limits, family.distance, start, max_steps)
    note = ""
    if found.status is Status.infeasible:
        note = "no isogonal change reduces the errors of the targets further: relax one, or change the force network"
    return _finished(family.report(found.x, found.multipliers, found.steps, found.status, note), throw)


def _finished(solution: IsogonalDesign, throw: bool) -> IsogonalDesign:
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

    def __init__(self, critical: CriticalConfiguration, targets: Mapping[str, Interval]):
        self.critical, self.network = critical, critical.network
        if not targets:
            raise InputError("give at least one target, such as {'C_B': 0.1}")
        self.values_of = [_target(critical, name) for name in targets]
        self.names = tuple(targets)
        limits = [limits_of(name, value) for name, value in targets.items()]
        self.low, self.high = (np.array(values) for values in zip(*limits, strict=True))
        self.unit = float(critical.lengths.mean())
        # Errors are relative to the size of the target, and absolute below a hundredth of its unit.
        largest = [max(abs(x) for x in pair if np.isfinite(x)) for pair in limits]
        powers = [0 if name in _COEFFICIENTS else _POWERS[name.split("_")[0]] for name in targets]
        self.scale = np.maximum(largest, 1e-2 * self.unit ** np.array(powers))
        self.modes = _modes(critical)
        # Equal amplitudes of all faces change nothing, so that one face is left out.
        self.n_modes = self.modes.n_independent
        self.lengths_of = self.unit * sp.csr_array(sp.csr_array(self.modes.elongations)[: self.n_modes].T)
        self.directions = critical.bond_vectors / critical.lengths[:, None]

    def values(self, a: Array) -> tuple[Array, Array]:
        """Values (n,) and gradients by the lengths (n, N_b) at amplitudes a."""
        lengths = self.critical.lengths + self.lengths_of @ a
        sigma = self.critical.tensions / lengths
        values, rows = zip(*(of(sigma, lengths, self.directions) for of in self.values_of), strict=True)
        return np.array(values), np.array(rows)

    def targets(self, a: Array) -> tuple[Array, Array]:
        """Targets of order one (n,) and their gradients by the amplitudes."""
        values, rows = self.values(a)
        return values / self.scale, (rows / self.scale[:, None]) @ self.lengths_of

    def distance(self, a: Array) -> tuple[Array, sp.csr_array]:
        """log(ℓ/ℓ_0)/√N_b, (N_b,), and its Jacobian."""
        lengths, size = self.critical.lengths + self.lengths_of @ a, np.sqrt(self.network.n_edges)
        ratio = np.maximum(lengths / self.critical.lengths, np.finfo(float).tiny)
        return np.log(ratio) / size, sp.csr_array(sp.diags_array(1 / (size * lengths)) @ self.lengths_of)

    def excess(self) -> str:
        """A sentence where a closed form excludes the target of C_B, else an empty string."""
        if "C_B" not in self.names:
            return ""
        n, bulk = self.names.index("C_B"), transition_moduli(self.critical).bulk
        bound = bulk_modulus_bound(self.network)
        least = -bulk / 2
        if (self.critical.sigma > 0).all() and self.high[n] < least * (1 + STIFFEST):
            return f"C_B is at least -B_0/2 = {least:.8g} for every isogonal change: start from a larger B_0"
        if bulk < bound * (1 - STIFFEST):
            return ""
        if self.low[n] - STIFFEST * bound <= -bound / 2 <= self.high[n] + STIFFEST * bound:
            return ""
        return f"at the largest B_0, C_B is {-bound / 2:.8g} for every isogonal change: start from a smaller B_0"

    def report(self, a: Array, mu: Array, steps: int, status: Status, note: str) -> IsogonalDesign:
        """The design at amplitudes a."""
        full = np.zeros(self.modes.elongations.shape[0])
        full[: self.n_modes] = self.unit * a
        values, rows = self.values(a)
        error = np.abs(values - np.clip(values, self.low, self.high)) / self.scale
        rows = rows @ self.lengths_of
        norm = np.linalg.norm(rows, axis=1)
        unit = rows / np.where(norm > 0, norm, 1.0)[:, None]
        gram = unit @ unit.T
        return IsogonalDesign(
            value=self.modes.walk(full),
            status=status,
            stats=Stats("sequential quadratic programs", steps, float(error.max())),
            note=note,
            amplitudes=full,
            achieved=dict(zip(self.names, map(float, values), strict=True)),
            multipliers=dict(zip(self.names, map(float, mu / self.scale), strict=True)),
            gram=gram,
            independent=bool(np.linalg.eigvalsh(gram)[0] > INDEPENDENT_TARGETS),
            distance=float(np.linalg.norm(self.distance(a)[0])),
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


def _target(critical: CriticalConfiguration, name: str) -> ValueOf:
    """A target as a function of σ, lengths and directions: its value and derivatives by the lengths (N_b,)."""
    network = critical.network
    if name in _COEFFICIENTS:
        if name == "length_variance":
            return _of_objective(LengthVariance())
        return _of_objective(StiffeningCoefficient(CriticalManifold(network), of_shear=name == "C_G"))
    kind, _, number = name.partition("_")
    counts = {"length": network.n_edges, "area": 0 if network.faces is None else network.faces.n_faces}
    if kind not in counts or not number.isdecimal():
        raise InputError(f"no target is called {name!r}: choose from {', '.join(_COEFFICIENTS)}, length_0, area_0, ...")
    if int(number) >= counts[kind]:
        noun = {"length": "edges", "area": "faces"}[kind]
        raise InputError(f"{name} does not exist: the network has {counts[kind]} {noun}, counted from 0")
    return _length(int(number)) if kind == "length" else _area(network, int(number))


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
