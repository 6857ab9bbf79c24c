"""Equilibria of springs and a weak energy together, E = Σ ½k(|L| − ℓ)² + κU(x, F), by Newton's method along a strain.

The forces and the Hessian of the weak energy are added to those of the springs, in one sparse matrix.  A path starts
where the network is taut and descends in small strain steps, from each equilibrium to the next, so that it stays on the
branch that tension stabilises.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import floats, of_kind
from critflow.calls import running
from critflow.deformation import Deformable, Deformation, deformation_of
from critflow.equilibria import newton
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor
from critflow.springs import HOOKEAN, TAUT, Cable, SpringLaw, SpringState, checked_law
from critflow_extras.weak.weak_energies import ENERGIES, WeakEnergy, WeakFunction, weak_function
from critflow_extras.weak.weak_pattern import WeakPattern

TOLERANCE = 1e-13  # of forces, in units of stiffness times length: ten roundings
_MOST_STEPS = 300
_TAUT_START, _LARGEST_STEP = 0.01, 0.005  # strains: where a path begins, and its steps
_RAISE = 10.0  # of the shift of an indefinite Hessian, until it is positive definite
# Step of differences along a strain, of fourth order: the error of the stress is 1e-12.
_STEP = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class WeakSpringState(SpringState):
    """Springs with a weak energy κU(x, F): the state of `SpringState` after the deformation F of the cell."""

    weak: WeakFunction = None  # type: ignore[assignment]
    kappa: float = 0.0
    gradient: Array = None  # type: ignore[assignment]
    pattern: WeakPattern = field(default=None, repr=False)  # type: ignore[assignment]

    @cached_property
    def _weak(self) -> tuple[float, Array, sp.csr_array]:
        """κU, its gradient (n_free, d) and its Hessian (d·n_free)²."""
        value, gradient, hessian = self.weak(self.coordinates, self.gradient)
        rows = np.arange(gradient.size).reshape(gradient.shape)[self.network.free].ravel()
        H = sp.csr_array(hessian)[rows][:, rows]
        H.sum_duplicates()
        return self.kappa * value, self.kappa * gradient[self.network.free], sp.csr_array(self.kappa * H)

    @property
    def energy(self) -> float:
        return super().energy + self._weak[0]

    @cached_property
    def forces(self) -> Array:
        tension = -np.asarray(self.network.divergence @ (self.sigma[:, None] * self.bond_vectors))
        return tension - self._weak[1]

    def taut(self, least: float = TAUT) -> bool:
        # Weak energies may soften motions.
        return False

    def factorize(self, shift: float = 0.0) -> Factor:
        springs = self.blocks(self.modified_stiffness, self.sigma)
        return self.pattern.factorize(self.pattern.values(springs, self._weak[2]), shift)

    def factorize_convex(self, shift: float) -> Factor:
        factor = self.factorize(shift)
        while factor.indefinite and shift < 1 / shift:
            shift *= _RAISE
            factor = self.factorize(shift)
        return factor


@dataclass(frozen=True, eq=False, repr=False)
class WeakEquilibria(Record):
    """Equilibria at strains γ from the transition, (n,); NaN where none was found.

    tension  Σ σ|L₀|(|L| − ℓ)/Σ σ²|L₀|²/k, the amplitude of the self-stress in the tensions, (n,)
    stress   (1/V) dE/dγ with V of the strained network, (n,)
    energy   (n,)
    status   codes of `Status`, (n,): unstable at a saddle
    states   the equilibria, None where there is none
    """

    strains: Array
    tension: Array
    stress: Array
    energy: Array
    status: NDArray[np.int64]
    states: tuple[WeakSpringState | None, ...]


@running("weak_equilibrium")
def weak_equilibrium(
    critical: CriticalConfiguration,
    energy: WeakEnergy,
    strains: ArrayLike,
    kappa: float,
    deformation: Deformable = "dilation",
    *,
    law: SpringLaw | None = None,
    throw: bool = True,
) -> Solution[WeakEquilibria]:
    """Equilibria of springs and a weak energy κU at strains (n,) from the transition: no expansion, no assumption.

    Networks with slack edges or several self-stresses are served too; edges are springs of rest lengths |L| at the
    transition, or cables of those of the onset where it knows them.  One branch is followed, from tension downwards.

    energy       what `weak_forces` accepts
    deformation  what `deformation_of` accepts, with a fixed cell

    `Status.stalled` or `Status.unstable` where an equilibrium is not found or is a saddle, from there on.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> from critflow_extras.weak.weak_equilibrium import weak_equilibrium
    >>> critical = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0').value
    >>> found = weak_equilibrium(critical, ce.AngleSprings(), [-0.001, 0.001], 1e-4).value
    >>> bool((found.tension > 0).all())
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    of_kind(*ENERGIES, energy=energy)
    of_kind(np.ndarray, strains=strains)
    of_kind(float, kappa=kappa)
    of_kind(SpringLaw, None, law=law)
    of_kind(bool, throw=throw)
    gammas = np.atleast_1d(floats(strains, "strains"))
    if gammas.ndim != 1 or not gammas.size or not np.isfinite(gammas).all():
        raise InputError("strains must be one or more finite numbers in one row: leave out the others")
    if not 0 < kappa < np.inf:
        raise InputError(f"kappa must be positive and finite, not {kappa}: it is the size of the weak energy")
    network = critical.network
    path = fixed_deformation(deformation, network.dimension)
    U = weak_function(energy, network)
    rest = critical.lengths if critical.rest_lengths is None else critical.rest_lengths
    chosen = (HOOKEAN if (critical.sigma != 0).all() else Cable()) if law is None else law
    chosen = checked_law(chosen, rest, network.stiffness)
    state = WeakSpringState(
        *(network, rest, critical.coordinates, critical.bond_vectors, chosen),
        weak=U,
        kappa=float(kappa),
        gradient=np.eye(network.dimension),
    )
    A = path.rate(0.0)
    work = float(critical.sigma @ np.einsum("ad,ad->a", critical.bond_vectors, critical.bond_vectors @ A.T))
    found, status = _followed(state, path, gammas, 1.0 if work >= 0 else -1.0)
    value = _equilibria(critical, path, gammas, found, status)
    outcome = next((code for code in status if code is not Status.ok), Status.ok)
    solution = Solution(value, outcome, Stats("newton", len(gammas)))
    return solution.or_raise("no equilibrium with these weak forces") if throw else solution


def fixed_deformation(deformation: Deformable, dimension: int) -> Deformation:
    """A deformation without free components of the cell, else an `InputError`."""
    path = deformation_of(deformation, dimension)
    if path.free:
        raise InputError("weak forces act in a cell of fixed components: choose a deformation that frees none")
    return path


def _followed(
    state: WeakSpringState, path: Deformation, gammas: Array, sign: float
) -> tuple[list[WeakSpringState | None], list[Status]]:
    """The states at the strains, in their order, found in the order of decreasing tension."""
    order = np.argsort(-sign * gammas, kind="stable")
    found: list[WeakSpringState | None] = [None] * len(gammas)
    statuses = [Status.stalled] * len(gammas)
    network, here = state.network, sign * max(_TAUT_START, float(np.max(sign * gammas)))
    state = _strained(state, network, path, here)
    state, status = _relaxed(replace(state, pattern=WeakPattern(network, state._weak[2])))
    for place in order:
        steps = max(1, int(np.ceil(abs(gammas[place] - here) / _LARGEST_STEP)))
        for strain in np.linspace(here, gammas[place], steps + 1)[1:]:
            if status is Status.ok:
                state, status = _relaxed(_strained(state, network, path, float(strain)))
        here = float(gammas[place])
        found[place], statuses[place] = (state if status is Status.ok else None), status
    return found, statuses


def _strained(state: WeakSpringState, network: Network, path: Deformation, strain: float) -> WeakSpringState:
    """The state moved affinely to another strain of the path."""
    F = path.gradient(strain)
    change = F @ np.linalg.inv(state.gradient)
    return replace(state.deformed_to(network.deformed(F), change), gradient=F)


def _relaxed(state: WeakSpringState) -> tuple[WeakSpringState, Status]:
    end, _ = newton(state, TOLERANCE, _MOST_STEPS)
    saddle = end.ok and end.value.factorize().n_negative
    return end.value, Status.unstable if saddle else end.status


def _equilibria(
    critical: CriticalConfiguration,
    path: Deformation,
    gammas: Array,
    found: list[WeakSpringState | None],
    status: list[Status],
) -> WeakEquilibria:
    weight = critical.sigma * critical.lengths
    weight = weight / float(weight @ (weight / critical.network.stiffness))
    tension, stress, energy = np.full((3, len(gammas)), np.nan)
    for n, (gamma, state) in enumerate(zip(gammas, found, strict=True)):
        if state is not None:
            energy[n], tension[n] = state.energy, weight @ (state.tension / state.network.stiffness)
            stress[n] = _stress(state, path, float(gamma))
    return WeakEquilibria(gammas, tension, stress, energy, np.array(status, dtype=np.int64), tuple(found))


def _stress(state: WeakSpringState, path: Deformation, gamma: float) -> float:
    """(1/V) dE/dγ: at equilibrium the vertices may follow the strain affinely."""
    L, A = state.bond_vectors, path.velocity(gamma)
    springs = float(state.sigma @ np.einsum("ad,ad->a", L, L @ A.T))
    values = []
    for n in (-2, -1, 1, 2):
        F = path.gradient(gamma + n * _STEP)
        values.append(state.weak(state.coordinates @ (F @ np.linalg.inv(state.gradient)).T, F)[0])
    weak = float(np.array([1, -8, 8, -1]) @ np.array(values)) / (12 * _STEP)
    return (springs + state.kappa * weak) / state.network.volume
