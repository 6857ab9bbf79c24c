"""The strain path: springs deformed step by step from an equilibrium, each step from the last state.

From a transition the rest lengths are the lengths there, ℓ = |L(0)|; the default is dilation, with volumes
V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).  Where rest lengths are known, as of an onset, slack edges follow as cables
until they tighten.  `continuation` has the algorithm, `start` the state at γ = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind, shown
from critflow.calls import counted, running
from critflow.linalg.factor import FixedPattern
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.networks.network import Array
from critflow.paths.continuation import Attempt, Interval, PathProblem, advance
from critflow.paths.start import Beginning, Start, start_of
from critflow.paths.unknowns import unknowns_of
from critflow.response.tensor import Elasticity
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.springs.equilibrium import FINEST_TOLERANCE, relaxation_method
from critflow.springs.laws import SpringLaw
from critflow.springs.state import SpringState

MEASURES = ("tensors", "moduli", "energy")  # what a path measures at each strain, in falling order of time


@dataclass(frozen=True, eq=False, repr=False)
class StrainPath(Record):
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), Newton steps and status, the states.

    From the first strain that is not reached, values are NaN and `status` holds the reason.
    Stability is tested at these strains and at inserted ones: a symmetric state that loses and regains it in between,
    where F(γ) turns back, passes.

    steps     Newton steps (n,) before the correction to the exact equilibrium, none from a close prediction
    inserted  steps (n,) to intermediate strains, which are not stored
    coordinate_error, bulk_modulus_error, shear_modulus_error  bounds (n,) on the errors against the exact equilibrium;
    the last one for both conventions.  Error bounds (estimate): those of `equilibrium` and `elasticity`

    deformation      the path F(γ) of the cell
    modulus          (1/V) d²E/dγ² along the path (n,) with the volume V(γ) and the relaxed energy E(γ), with its error
                     bound (estimate); dilation has B/(1 + γ)²
    stress           Cauchy stress (1/V) Σ σ L⊗L, (n, d, d)
    elasticity       tensors of each state (`Elasticity`); empty without moduli or tensors, and without a cell
    free_components  q (n, m) of the cell (1 + Σ q E) F(γ), free of stress (`Deformation.free`)
    total_strains    (n,) strains of the network as given where the path starts from an onset: F(γ_total) = F(γ) F(γ_c),
                     NaN where the deformation has no such strain, as along another one than that of the onset; of any
                     other start the strains themselves

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
    total_strains: Array


def check_strains(strains: ArrayLike, signed: bool = False, zero: bool = False) -> Array:
    """Strains as an increasing array of positive numbers, else an `InputError`.

    signed  they may also be negative and decreasing
    zero    the first one may be zero
    """
    of_kind(np.ndarray, strains=strains)
    gamma = np.atleast_1d(np.asarray(strains, dtype=float))
    if gamma.ndim != 1:
        raise InputError(f"strains must be a list of numbers, not an array of shape {gamma.shape}")
    if len(gamma) == 0:
        raise InputError("the list of strains is empty: give at least one, such as 0.001")
    size = -gamma if signed and gamma[-1] < 0 else gamma
    if not (np.isfinite(size).all() and (size[0] > 0 or (zero and size[0] == 0)) and (np.diff(size) > 0).all()):
        other = ", or negative and decreasing: one path for each sign" if signed else ""
        raise InputError(f"strains must be finite, positive and increasing, such as 0.001:0.010:0.001{other}")
    return gamma


@dataclass(frozen=True)
class PathSolver:
    """How the springs of a path are relaxed: method and tolerance of `equilibrium`.

    tolerance  for FIRE, cables, and free components of the cell; Newton's answer is otherwise exact to rounding
    pattern    of the Hessian; by default that of the manifold that made the start, or one made for the path
    """

    method: str = "auto"
    tolerance: float = FINEST_TOLERANCE
    pattern: FixedPattern | None = None


@running("strain_path")
def strain_path(
    start: Start,
    strains: ArrayLike,
    deformation: Deformable = "dilation",
    *,
    law: SpringLaw | None = None,
    taut_only: bool = False,
    measure: Literal["tensors", "moduli", "energy"] = "tensors",
    solver: PathSolver | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Deform springs from an equilibrium through strains γ away from zero, relaxing and measuring at each.

    b → F(γ) b, with γ positive and increasing or negative and decreasing.  Strains count from the start: from an onset
    at γ_c the network as given is deformed by F(γ) F(γ_c), and `total_strains` are its strains.  Each step starts from
    the last state, extrapolated by the last states and their linear responses.  A step that fails, or may have left its
    branch of equilibria, is halved, down to 2⁻¹⁶ of the strain interval, and steps grow again after that; where even
    the smallest leaves the branch the path ends with `Status.unstable`.  An equilibrium of a convex law without
    compressed springs is unique and the global minimum, so its branch is not checked.

    start              a critical configuration, also of a tissue, a state of springs in equilibrium, such as
                       `spring_state` or a state of another path, or a solution with one.  A configuration that knows
                       rest lengths, as that of `critical_strain` or `critical_from_lengths`, is one of cables, taut and
                       slack ones; of others the lengths are the rest lengths, and where edges are slack, σ = 0, the
                       path is that of the taut part (`backbone`).  Only a state may begin with γ = 0
    deformation        what `deformation_of` accepts
    law                of springs from a critical configuration: Cable() where rest lengths are known, else Hookean; a
                       state has one
    taut_only          True: the taut part alone also where rest lengths are known, as springs at rest
    measure            "tensors"; "moduli": bulk and shear moduli alone, in less time, and `elasticity` is empty;
                       "energy": equilibria only
    solver             `PathSolver`; free components of the cell need Newton's method

    Cables that are floppy at γ = 0, as `spring_state(..., Cable())` at any coordinates, are followed through their
    onset: energy, stress and moduli are zero up to γ_c of `critical_strain`, at which the branch begins.  Coordinates
    are not unique before, and their error is NaN.
    `Status.floppy` at a strain where springs keep all lengths, as free components of the cell permit next to a
    transition, or where no stress fixes these components: cables only pull, so free sides are undetermined past the
    onset, or are pulled together until the cell is flat.

    Raises `InputError` for strains that do not lead away from zero, a deformation that inverts the cell, a start
    without balance, `SolveError` where the path stops and `throw` is set.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> path = cf.strain_path(cf.optimize(network, 'B_0'), [0.001, 0.002]).value
    >>> path.bulk_modulus.round(6)
    array([0.296637, 0.296489])
    """
    of_kind(SpringLaw, None, law=law)
    of_kind(bool, taut_only=taut_only, throw=throw)
    first, options = start_of(start, law, taut_only), of_kind(PathSolver, None, solver=solver) or PathSolver()
    gamma, method = check_strains(strains, signed=True, zero=first.stress is None), relaxation_method(options.method)
    path = deformation_of(deformation, first.springs.network.dimension)
    if not isinstance(measure, str) or measure not in MEASURES:
        raise InputError(f"a path measures one of {', '.join(MEASURES)}, not {shown(measure)}")
    springs, network = first.springs, first.springs.network
    pattern = (None if first.part else options.pattern) or first.pattern or springs.pattern()
    unknowns = unknowns_of(springs, path, gamma, pattern, method, options.tolerance)
    has_moduli = measure != "energy" and network.has_volume and network.dimension > 1
    problem = PathProblem(network, path, pattern, unknowns, method == "newton", measure, has_moduli)
    result = _solution(problem, method, gamma, _follow(problem, first, gamma), first)
    return result.or_raise("the strain path stopped") if throw else result


def _follow(problem: PathProblem, first: Beginning, gamma: Array) -> list[Interval]:
    """Advance from strain to strain; the last entry alone may have failed."""
    reached, point = problem.unknowns.beginning(problem, first, gamma)
    for strain in counted(gamma[len(reached) :].tolist(), "strain"):
        if reached and not reached[-1].end.ok:
            break
        reached.append(advance(problem, point, strain))
        point = reached[-1].point
    return reached


def _solution(
    problem: PathProblem, method: str, gamma: Array, reached: list[Interval], first: Beginning
) -> Solution[StrainPath]:
    """The path up to the last strain that was reached, with the status of the last step."""
    path, last = _assembled(problem, gamma, reached, first), reached[-1]
    stats = Stats(
        method,
        int(path.steps.sum()),
        residual=float(np.max(path.max_force[: len(path.states)], initial=0.0)),
        error_bound=float(np.nanmax(path.coordinate_error[: len(path.states)], initial=0.0)),
    )
    note = first.note if last.end.ok else f"at strain {last.target:g}, {last.end.note}"
    return Solution(path, last.end.status, stats, note)


def _assembled(problem: PathProblem, gamma: Array, reached: list[Interval], first: Beginning) -> StrainPath:
    """The path of all strains, of which only the last one tried may have failed."""
    n, d, m = len(gamma), problem.deformation.dimension, len(problem.deformation.free)
    ends = [interval.end for interval in reached if interval.end.ok]
    measured = {name: np.full(n, np.nan) for name in _SCALARS}
    measured |= {"stress": np.full((n, d, d), np.nan), "free_components": np.full((n, m), np.nan)}
    if ends:
        rows = [_measured(end) for end in ends]
        for name, missing in measured.items():
            measured[name] = np.concatenate([[row[name] for row in rows], missing[len(ends) :]])
    steps, inserted, status = (np.full(n, value) for value in (0, 0, int(Status.missing)))
    steps[: len(reached)] = [interval.iterations for interval in reached]
    inserted[: len(reached)] = [interval.inserted for interval in reached]
    status[: len(reached)] = [interval.end.status for interval in reached]
    return StrainPath(
        strains=gamma,
        steps=steps,
        status=status,
        inserted=inserted,
        states=tuple(end.state for end in ends),
        deformation=problem.deformation,
        total_strains=gamma if first.total_strains is None else first.total_strains(problem.deformation, gamma),
        elasticity=tuple(end.moduli for end in ends if end.moduli and problem.measure == "tensors"),
        **measured,
    )


_SCALARS = (
    *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "bulk_modulus_error", "shear_modulus_error"),
    *("energy", "max_force", "coordinate_error", "modulus", "modulus_error"),
)


def _measured(end: Attempt) -> dict[str, float | Array]:
    """What `StrainPath` has of one state: floats `_SCALARS`, the stress (d, d) and q (m,); NaN where not measured."""
    state, along, moduli = end.state, end.tangent, end.moduli
    # V of the cell or as named, or 1 without either.
    volume = state.network.volume if state.network.has_volume else 1.0
    row: dict[str, float | Array] = dict.fromkeys(_SCALARS, np.nan)
    row |= {"energy": state.energy, "max_force": state.max_force, "coordinate_error": end.coordinate_error}
    if along is not None:
        row |= {"modulus": along.second / volume, "modulus_error": along.second_error / volume}
    if moduli is None:
        L = state.bond_vectors
        stress = L.T @ (state.sigma[:, None] * L) / volume
    else:
        stress, shear, corrected = moduli.stress, moduli.errors.shear, moduli.errors.shear_stress_corrected
        row |= {"bulk_modulus": moduli.bulk, "bulk_modulus_error": moduli.errors.bulk}
        row |= {"shear_modulus": moduli.shear, "shear_modulus_error": max(shear, corrected)}
        row["shear_modulus_stress_corrected"] = moduli.shear_stress_corrected
    return row | {"stress": stress, "free_components": end.cell.free}
