"""The strain path: springs deformed step by step from an equilibrium, each step from the last state.

From a transition the rest lengths are the lengths there, ℓ = |L(0)|; the default is dilation, with volumes
V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.backbone import backbone
from critflow.critical.manifold import COLLAPSED, CriticalConfiguration
from critflow.linalg.factor import FixedPattern
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.networks.network import Array, Network
from critflow.paths.continuation import Arrival, Continuation, Relaxer, Step
from critflow.response.tensor import Elasticity
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.springs.equilibrium import relaxation_method
from critflow.springs.laws import HOOKEAN, SpringLaw, checked_law
from critflow.springs.state import SpringState

# Largest force of a state from which a path starts, in units of stiffness times length: the first relaxation removes
# rounding, and a larger force would hide a jump.
BALANCED_START, LOOSENING_WORK = 1e-6, 1e-9
# Relative deviation of the lengths of taut edges from the given rest lengths; solutions have 1e-9.
CONSISTENT_LENGTHS, OPENING = 1e-6, 1e-3

_LOOSENED = "the strain loosens the network, which is floppy on this side of the transition: change its sign"

_RECORDS = (
    *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "energy", "max_force", "coordinate_error"),
    *("bulk_modulus_error", "shear_modulus_error", "modulus", "modulus_error"),
)

Start = CriticalConfiguration | SpringState | Solution[Any]
"""What a path starts from."""


@dataclass(frozen=True, eq=False)
class StrainPath(Record):
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), work and status of each step, the states.

    From the first strain that is not reached, values are NaN and `status` holds the reason.
    Stability is tested at these strains and at inserted ones: a symmetric state that loses and regains it in between,
    where F(γ) turns back, passes.

    inserted  steps (n,) to intermediate strains, which are not stored
    coordinate_error, bulk_modulus_error, shear_modulus_error  bounds (n,) on the errors against the exact equilibrium;
    the last one for both conventions.  Error bounds (estimate): those of `equilibrium` and `elasticity`

    deformation      the path F(γ) of the cell
    modulus          (1/V) d²E/dγ² along the path (n,) with the volume V(γ) and the relaxed energy E(γ), with its error
                     bound (estimate); dilation has B/(1 + γ)²
    stress           Cauchy stress (1/V) Σ σ L⊗L, (n, d, d)
    elasticity       tensors of each state (`Elasticity`); empty without moduli or tensors, and without a cell
    free_components  q (n, m) of the cell (1 + Σ q E) F(γ), free of stress (`Deformation.free`)

    Networks without a cell have no volume: their moduli and stresses are those of V = 1.
    """

    strains: Array
    bulk_modulus: Array
    shear_modulus: Array
    shear_modulus_stress_corrected: Array
    energy: Array
    max_force: Array
    steps: NDArray[np.int64]
    status: NDArray[np.int64]
    states: tuple[SpringState, ...]
    inserted: NDArray[np.int64]
    coordinate_error: Array
    bulk_modulus_error: Array
    shear_modulus_error: Array
    deformation: Deformation
    modulus: Array
    modulus_error: Array
    stress: Array
    elasticity: tuple[Elasticity, ...]
    free_components: Array


def check_strains(strains: ArrayLike, signed: bool = False, zero: bool = False) -> Array:
    """Strains as an increasing array of positive numbers, else an `InputError`.

    signed  they may also be negative and decreasing
    zero    the first one may be zero
    """
    gamma = np.atleast_1d(np.asarray(strains, dtype=float))
    if gamma.ndim != 1 or len(gamma) == 0:
        raise InputError("the list of strains is empty: give at least one, such as 0.001")
    size = -gamma if signed and gamma[-1] < 0 else gamma
    if not (np.isfinite(size).all() and (size[0] > 0 or (zero and size[0] == 0)) and (np.diff(size) > 0).all()):
        other = ", or negative and decreasing: one path for each sign" if signed else ""
        raise InputError(f"strains must be finite, positive and increasing, such as 0.001:0.010:0.001{other}")
    return gamma


@checked
def strain_path(
    network: Network,
    start: Start,
    strains: ArrayLike,
    method: str = "auto",
    *,
    deformation: Deformable = "dilation",
    law: SpringLaw | None = None,
    rest_lengths: ArrayLike | None = None,
    tolerance: float = 1e-14,
    moduli: bool = True,
    tensors: bool = True,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Deform a network from an equilibrium through strains γ away from zero, relaxing and measuring at each.

    b → F(γ) b, with γ positive and increasing or negative and decreasing.  Each step starts from the last state,
    extrapolated by the last two states and their linear responses.  A step that fails, or may have left its branch of
    equilibria, is halved, down to 2⁻¹⁶ of the strain interval, and steps grow again after that; where even the smallest
    leaves the branch the path ends with `Status.unstable`.  An equilibrium of a convex law without compressed springs
    is unique and the global minimum, so its branch is not checked.

    start              a critical configuration, whose lengths are the rest lengths (of one with slack edges, σ = 0, the
                       path and its states are those of the taut part: `backbone`), or a state of springs in
                       equilibrium, such as `spring_state` or a state of another path; or a solution with one.  Only a
                       state may begin with γ = 0
    method, tolerance  those of `equilibrium`; free components of the cell need Newton's method
    deformation        what `deformation_of` accepts
    law                of springs from a critical configuration, Hookean by default; a state has one
    rest_lengths       ℓ (N_b,) to a common factor: the path of a slack configuration as that of all edges, as Cable()
    moduli             False: equilibria only
    tensors            False: bulk and shear moduli alone, in less time; `elasticity` is then empty
    pattern            of the Hessian, made here by default; given for many paths of one network
    Many parameters: those after the strains are options of the relaxation, most by keyword only.

    Raises `InputError` for strains that do not lead away from zero, a deformation that inverts the cell, a start of
    another network or without balance, `SolveError` where the path stops and `throw` is set.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> path = cf.strain_path(network, cf.optimize(network, 'bulk_modulus'), [0.001, 0.002]).value
    >>> path.bulk_modulus.round(6)
    array([0.296637, 0.296489])
    """
    state, critical, note = _start(network, _value(start), law, rest_lengths)
    gamma, method = check_strains(strains, signed=True, zero=critical is None), relaxation_method(method)
    deformation = deformation_of(deformation, state.network.dimension)
    _ = [deformation.gradient(strain) for strain in gamma]  # refuses those that invert the cell
    if deformation.free and method != "newton":
        raise InputError("free components of the cell need Newton's method: choose method='newton'")
    reached: list[Arrival] = []
    relaxer = Relaxer(method, tolerance, moduli, tensors, state.pattern() if note or not pattern else pattern)
    continuation = Continuation(state, deformation, relaxer, stress=None if critical is None else critical.sigma)
    if critical is None:
        first = continuation.begin()
        if gamma[0] == 0 or not first.end.ok:
            reached.append(first)
    elif _loosened(critical, deformation, gamma[0]):
        reached.append(continuation.refused(gamma[0], Status.floppy, _LOOSENED))
    for strain in gamma[len(reached) :]:
        if reached and not reached[-1].end.ok:
            break
        reached.append(continuation.advance(strain))
    result = _solution(gamma, reached, deformation, method, note)
    return result.or_raise("the strain path stopped") if throw else result


def _solution(
    gamma: Array, reached: list[Arrival], deformation: Deformation, method: str, note: str
) -> Solution[StrainPath]:
    """The path of all arrivals, of which only the last may have failed, with its status."""
    path, last = _assembled(gamma, reached, deformation), reached[-1].end
    stats = Stats(
        method,
        int(path.steps.sum()),
        residual=float(np.max(path.max_force[: len(path.states)], initial=0.0)),
        error_bound=float(np.max(path.coordinate_error[: len(path.states)], initial=0.0)),
    )
    note = note if last.ok else f"at strain {last.strain and gamma[len(reached) - 1]:g}, {last.note}"
    return Solution(path, last.status, stats, note)


def _value(start: Any) -> Any:
    """The configuration or state of a solution; that of one with slack edges is valid."""
    if not isinstance(start, Solution):
        return start
    if start.status is not Status.slack_edges:
        start.or_raise("no path starts from this solution")
    return getattr(start.value, "configuration", start.value)


def _taut_start(network: Network, critical: CriticalConfiguration) -> tuple[Network, CriticalConfiguration, str]:
    """The taut part of a configuration with slack edges, whose rest lengths it does not know, and a note about it."""
    part = backbone(replace(critical, network=critical.springs_of(network)))
    note = (
        f"{part.n_slack} of {network.n_edges} edges are slack, so the path is that of the taut part: for edges that "
        "become taut on it give rest_lengths and law=Cable()"
    )
    return part.network, part.configuration, note


def _cables(
    network: Network, start: Any, rest_lengths: ArrayLike, law: SpringLaw | None
) -> tuple[SpringState, CriticalConfiguration]:
    """All edges of a critical configuration as cables: taut ones at rest, slack ones below their rest lengths."""
    if not isinstance(start, CriticalConfiguration):
        raise InputError("rest_lengths belong to a critical configuration: a state of springs has its rest lengths")
    if law is None or not law.one_sided:
        raise InputError(
            "slack springs would be compressed at this configuration: choose law=Cable(), or relax a spring_state with "
            "equilibrium() and start from it"
        )
    network, taut = start.springs_of(network), start.sigma != 0
    rest = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    ratios = start.lengths[taut] / rest[taut]
    scale = float(ratios.mean())
    if not np.ptp(ratios) <= CONSISTENT_LENGTHS * scale:
        raise InputError("the taut edges do not have these rest lengths: give those of which the configuration is made")
    if not (start.lengths > COLLAPSED * start.lengths.mean()).all():
        start = _opened(start, float(scale * rest.mean()))
    rest = np.where(taut, start.lengths, scale * rest)
    return SpringState(network, rest, start.coordinates, start.bond_vectors, law), start


def _opened(critical: CriticalConfiguration, length: float) -> CriticalConfiguration:
    """The configuration with its floppy vertices displaced a little, so that every slack edge has a direction."""
    network, floppy = critical.network, backbone(critical).floppy_vertices
    x = critical.coordinates.copy()
    x[floppy] += OPENING * length * np.random.default_rng(0).standard_normal((len(floppy), network.dimension))
    x = x if network.pins else x - x[0]
    L = np.where((critical.sigma != 0)[:, None], critical.bond_vectors, network.bond_vectors(x))
    lengths = np.linalg.norm(L, axis=1)
    if not (lengths > COLLAPSED * lengths.mean()).all():
        raise InputError(
            f"the slack edge {int(lengths.argmin())} joins two vertices of the taut part at one place, so it has no "
            "direction: vary the rest lengths a little, or follow the taut part without rest_lengths"
        )
    return replace(critical, coordinates=x, bond_vectors=L)


def _start(
    network: Network, start: Any, law: SpringLaw | None, rest_lengths: ArrayLike | None
) -> tuple[SpringState, CriticalConfiguration | None, str]:
    """The state at γ = 0, the critical configuration if it is one, and a note if it is a part."""
    if rest_lengths is not None:
        return *_cables(network, start, rest_lengths, law), ""
    if isinstance(start, CriticalConfiguration):
        network, note = start.springs_of(network), ""
        if not start.sigma.all():
            network, start, note = _taut_start(network, start)
        law = checked_law(HOOKEAN if law is None else law, start.lengths, network.stiffness)
        return SpringState(network, start.lengths, start.coordinates, start.bond_vectors, law), start, note
    if not isinstance(start, SpringState):
        raise InputError(f"a path starts from a critical configuration or a state of springs, not {start!r:.60}")
    same = start.network
    if network is not same and not (
        np.array_equal(network.edges, same.edges)
        and np.array_equal(network.boundary_vectors, same.boundary_vectors)
        and np.array_equal(network.stiffness, same.stiffness)
    ):
        raise InputError("the state belongs to another network: start with the network of the state, state.network")
    if law is not None and law != start.law:
        raise InputError("the state has a spring law: leave out law=, or make a state with the other law")
    if not start.max_force <= BALANCED_START * start.stiffness_scale * start.length_scale:
        raise InputError(
            f"the springs are not in equilibrium, a force of {start.max_force:.2g} is left: call equilibrium() first"
        )
    return replace(start, network=network), None, ""


def _loosened(critical: CriticalConfiguration, deformation: Deformation, strain: float) -> bool:
    """Whether a strain of this sign loosens a network in tension, which is then floppy: γ Σ σ L·A L < 0."""
    sigma, L = critical.sigma, critical.bond_vectors
    A = np.copysign(1.0, strain) * deformation.velocity(0.0)
    work, size = np.sum(sigma[:, None] * L * (L @ A.T)), np.linalg.norm(A) * np.sum(sigma * critical.lengths**2)
    return bool((sigma >= 0).all() and work < -LOOSENING_WORK * size)


def _assembled(gamma: Array, arrivals: list[Arrival], deformation: Deformation) -> StrainPath:
    """The path of all arrivals, of which only the last may have failed."""
    d, n_strains = deformation.dimension, len(gamma)
    records: dict[str, Array] = {name: np.full(n_strains, np.nan) for name in _RECORDS}
    stress, stretch = np.full((n_strains, d, d), np.nan), np.full((n_strains, len(deformation.free)), np.nan)
    steps, inserted = np.zeros(n_strains, int), np.zeros(n_strains, int)
    status = np.full(n_strains, int(Status.missing))
    states = []
    for n, arrival in enumerate(arrivals):
        end = arrival.end
        steps[n], inserted[n], status[n] = arrival.iterations, arrival.inserted, end.status
        if end.ok:
            for name, value in _record(end).items():
                records[name][n] = value
            L = end.state.bond_vectors
            stress[n], stretch[n] = L.T @ (end.state.sigma[:, None] * L) / volume_of(end.state), end.stretch
            states.append(end.state)
    return StrainPath(
        strains=gamma,
        steps=steps,
        inserted=inserted,
        status=status,
        states=tuple(states),
        deformation=deformation,
        stress=stress,
        elasticity=tuple(a.end.elasticity for a in arrivals if a.end.ok and a.end.elasticity is not None),
        free_components=stretch,
        **records,
    )


def _record(end: Step) -> dict[str, float]:
    """The numbers of one equilibrium."""
    moduli, V = end.moduli, volume_of(end.state)
    measured = (
        {}
        if moduli is None
        else {
            "bulk_modulus": moduli.bulk,
            "shear_modulus": moduli.shear,
            "shear_modulus_stress_corrected": moduli.shear_stress_corrected,
            "bulk_modulus_error": moduli.errors.bulk,
            "shear_modulus_error": max(moduli.errors.shear, moduli.errors.shear_stress_corrected),
        }
    )
    return {
        **measured,
        "energy": end.state.energy,
        "max_force": end.state.max_force,
        "coordinate_error": end.coordinate_error,
        "modulus": np.nan if end.tangent is None else end.tangent.second / V,
        "modulus_error": np.nan if end.tangent is None else end.tangent.second_error / V,
    }


def volume_of(state: SpringState) -> float:
    """V of the cell or as named, or 1 without either."""
    return state.network.volume if state.network.has_volume else 1.0
