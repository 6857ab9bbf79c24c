"""Strain paths: equilibria of springs, followed in strain from a transition or from an equilibrium.

An equilibrium at strain γ has vertices x = F(γ) y with coordinates y that move with the cell.  A path is a curve z(γ)
of the unknowns z = y, which an extra may extend.  `Path` follows it: each step predicts z from the last points,
corrects the prediction to an equilibrium, tests whether that lies on the same branch, and measures the response there.

The strain γ has the rate A = F'F⁻¹ of the cell and the second derivative F''F⁻¹; free components q of the cell have
rates A_m and mixed second derivatives with γ.  For rates a, b with relaxed bond rates L̇ = A L + g u and ḣ = L·L̇,
    E_ab = Σ ḣ_a K ḣ_b + σ (L̇_a·L̇_b + L·L̈_ab),   H u_a = −∂E_a/∂x;
free components follow with q̇ = −E_mn⁻¹ E_nγ, and the modulus along the path is (E_γγ + E_γm q̇_m)/V.  Antisymmetric
parts of A only rotate, so their relaxation u is zero.

From a transition the rest lengths are the lengths there, ℓ = |L(0)|; the default is dilation, with volumes
V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).  Where rest lengths are known, as of an onset, slack edges follow as cables
until they tighten.  Cables that are floppy at γ = 0, as `spring_state(..., Cable())` at any coordinates, are followed
through their onset: energy, stress and moduli are zero up to γ_c of `critical_strain`, at which the branch begins.
Coordinates are not unique before, and their error is NaN.

An equilibrium of a convex law without compressed springs is unique and the global minimum, so its branch is not
checked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, singledispatch
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgesv

from critflow.arguments import held, of_kind, shown
from critflow.calls import counted, running
from critflow.deformation import Deformable, Deformation, deformation_of, strain_components
from critflow.equilibria import (
    FINEST_TOLERANCE,
    FLOPPY_SHIFT,
    LOOSEST_TOLERANCE,
    ROUNDING_COMPRESSION,
    Equilibrium,
    relaxation_method,
    relaxed,
)
from critflow.extensions import from_extras
from critflow.lean_steps import LeanSteps
from critflow.linear_response import (
    CONTRACTION_MARGIN,
    MOST_CORRECTIONS,
    NO_RELAXATION,
    Elasticity,
    accumulated_rounding,
    combined,
    linear_response,
    strains_of,
    unit_strains,
)
from critflow.manifold import COLLAPSED, CriticalConfiguration
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, largest, mean, norms
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor
from critflow.springs import HOOKEAN, SpringLaw, SpringState, checked_law, require_directions
from critflow.taut_part import backbone

# Points of the path from which it is extrapolated, and the number of previous steps beyond which a polynomial
# extrapolates worse than a straight line.
_MOST_POINTS, _FARTHEST = 3, 2
# A step may have left its branch if Newton's method took more steps, or ended further from the prediction.  At 200
# vertices and steps of 1e-3 it takes 2 to 5 steps; it ends within 2e-3 in the first step of strain and within 1e-6 in
# later ones.  With a third of 1,000 vertices slack the first step takes 11 to 26 and ends within 2e-2; shorter ones
# take no fewer.
EXPECTED_STEPS, EXPECTED_DISTANCE = 40, 0.05
# Ends further than the first from the prediction are accepted if the step back ends within the second of the start:
# beyond a fold it ends on another branch, a distance of order one away.
DOUBTED_DISTANCE, RETURN_DISTANCE = 1e-3, 1e-6
# Stress over the square of the strain, in units of each edge's k, below which a state has none.  Newton's method leaves
# 1e-16; by symmetry a stress may be of second order in the strain, or of third.
UNSTRESSED = 1e-8
# A resisted strain of size s extends some edge by s of its length; below WEAK s the state may be unstressed: forces
# balanced to 1e-14 leave up to 1e-9 where stresses are nearly balanced by themselves.
WEAK = 1e-6
# Part of the strain interval below which a step is not divided further.
_SMALLEST_PART = 2.0**-16
# A step that covers this part of the remaining interval ends at the requested strain, not a rounding next to it.
_WHOLE = 0.999
# Steps towards one strain, and iterations of Newton's method: no path within them needed more than a tenth.
_MOST_STEPS, _MOST_ITERATIONS = 400, 4000
# Corrections of a relaxation, the part of it at which they stop, and the largest that rounding may leave.  One below
# the last part of the affine motion is compared with that: all edges then follow it.
_CONVERGED, _CORRECT = 1e-9, 1e-2
# Stress η, in units of k, that stands for the limit of no stress: its effect is of this order, and rounding of 1e-10.
_DEPARTING_STRESS = 1e-6
# Forces of an affine motion below this part of those of one edge are rounding.
_BALANCED = 16 * EPS
# Largest force of a state from which a path starts, in units of stiffness times length: the first relaxation removes
# rounding, and a larger force would hide a jump.
BALANCED_START = 1e-6
LOOSENING_WORK = 1e-9  # work of a strain on the stress of a transition, relative to its size, below which it loosens

MEASURES = ("tensors", "moduli", "energy")  # what a path measures at each strain, in falling order of time
NONE_FREE = np.zeros(0)  # q of a cell without free components

_FLOPPY, _FIX = "springs keep all lengths, so nothing resists: ", "fix the free components of the cell"
_OTHER = "deform the cell in another way"
_UNDETERMINED = "rounding errors hide the response to strain: measure it further from the transition"
_LIMIT = "the steps became too short to arrive: give strains that are closer together, or another method"
_UNRESOLVED = "this strain and the one before it give the same cell in floating-point numbers: choose larger ones"
_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"
_LOOSENED = "the strain loosens the network, which is floppy on this side of the transition: change its sign"
_ADVICE = "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one"
_OF_STRESS = "change its stress, or remove it"
_OF_CABLES = "paths of cables from given rest lengths (taut_only=True has the taut edges as springs at rest)"


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


@running("strain_path")
def strain_path(
    start: Any,
    strains: ArrayLike,
    deformation: Deformable | None = None,
    *,
    law: SpringLaw | None = None,
    taut_only: bool = False,
    measure: Literal["tensors", "moduli", "energy"] = "tensors",
    method: str = "auto",
    tolerance: float = FINEST_TOLERANCE,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Deform springs from an equilibrium through strains γ away from zero, relaxing and measuring at each.

    b → F(γ) b, with γ positive and increasing or negative and decreasing.  Strains count from the start: from an onset
    at γ_c the network as given is deformed by F(γ) F(γ_c), and `total_strains` are its strains.  A step that fails, or
    may have left its branch of equilibria, is halved, down to 2⁻¹⁶ of the strain interval; where even the smallest
    leaves the branch the path ends with `Status.unstable`.

    start              a critical configuration, also of a tissue, a state of springs in equilibrium, such as
                       `spring_state` or a state of another path, or a solution with one.  A configuration that knows
                       rest lengths, as that of `critical_strain` or `critical_from_lengths`, is one of cables, taut and
                       slack ones; of others the lengths are the rest lengths, and where edges are slack, σ = 0, the
                       path is that of the taut part (`backbone`).  Only a state may begin with γ = 0
    deformation        what `deformation_of` accepts; None: that of the onset, else a dilation
    law                of springs from a critical configuration: Cable() where rest lengths are known, else Hookean; a
                       state has one
    taut_only          True: the taut part alone also where rest lengths are known, as springs at rest
    measure            "tensors"; "moduli": bulk and shear moduli alone, in less time, and `elasticity` is empty;
                       "energy": no moduli but that along the path
    method, tolerance  those of `equilibrium`; free components of the cell need Newton's method.  The tolerance is for
                       FIRE, cables, and free components; Newton's answer is otherwise exact to rounding

    `Status.floppy` at a strain where springs keep all lengths, as free components of the cell permit next to a
    transition, or where no stress fixes these components: cables only pull, so free sides are undetermined past the
    onset, or are pulled together until the cell is flat.

    Raises `InputError` for strains that do not lead away from zero, a deformation that inverts the cell, a start
    without balance, `SolveError` where the path stops and `throw` is set. Many parameters: each is one choice.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> path = cf.strain_path(cf.optimize(network, 'B_0'), [0.001, 0.002]).value
    >>> path.bulk_modulus.round(6)
    array([0.296637, 0.296489])
    """
    of_kind(SpringLaw, None, law=law)
    of_kind(bool, taut_only=taut_only, throw=throw)
    springs, stress, note, onset = start_of(start, law, taut_only)
    method, tolerance = relaxation_method(method), of_kind(float, tolerance=tolerance)
    gamma = check_strains(strains, signed=True, zero=stress is None)
    along = deformation if deformation is not None else onset[0] if onset else "dilation"
    F = deformation_of(along, springs.network.dimension)
    if not isinstance(measure, str) or measure not in MEASURES:
        raise InputError(f"a path measures one of {', '.join(MEASURES)}, not {shown(measure)}")
    kind = from_extras("FreeCellPath", "free components of the cell") if F.free else Path
    kind = from_extras("cable_path", "paths of cables")(kind) if springs.law.one_sided else kind
    path = kind(springs.network, F, gamma, method, tolerance, measure, stress)
    result = _solution(path, path.follow(springs), onset[1](F, gamma) if onset else gamma, note)
    return result.or_raise("the strain path stopped") if throw else result


def _solution(path: Path, reached: list[PathPoint], total_strains: Array, note: str) -> Solution[StrainPath]:
    """The path up to the last strain that was reached, with the status of the last step."""
    gamma, F, last = path.strains, path.deformation, reached[-1]
    scalars = (
        *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "bulk_modulus_error"),
        *("shear_modulus_error", "energy", "max_force", "coordinate_error", "modulus", "modulus_error"),
    )
    missing: dict[str, Any] = dict.fromkeys(scalars, np.nan) | {"steps": 0, "inserted": 0, "status": Status.missing}
    missing |= {"stress": np.full((F.dimension,) * 2, np.nan), "free_components": np.full(len(F.free), np.nan)}
    rows = [missing | point.measurements() for point in reached] + [missing] * (len(gamma) - len(reached))
    ends = [point for point in reached if point.ok]
    value = StrainPath(
        strains=gamma,
        states=tuple(end.state for end in ends),
        deformation=F,
        total_strains=total_strains,
        elasticity=tuple(end.moduli for end in ends if end.moduli and path.measure == "tensors"),
        **{name: np.array([row[name] for row in rows]) for name in missing},
    )
    stats = Stats(
        path.method,
        int(value.steps.sum()),
        residual=float(np.max(value.max_force[: len(ends)], initial=0.0)),
        error_bound=float(np.nanmax(value.coordinate_error[: len(ends)], initial=0.0)),
    )
    return Solution(value, last.status, stats, note if last.ok else f"at strain {last.strain:g}, {last.note}")


@dataclass(frozen=True, eq=False)
class PathPoint:
    """One equilibrium of a path, or the end of a step that was refused, whose status and note say why.

    gradient  F by which cell and vertices have moved since γ = 0, x = F y, (d, d)
    free      free components q (m,) of the cell; without those m = 0
    z         unknowns (n,)
    velocity  dz/dγ (n,); None where it is not determined
    moduli    of bulk and shear alone where a path measures no tensors; None where it measures energies
    second    d²E/dγ² of the relaxed energy and its error (estimate)
    steps     of the corrections since the last strain; `inserted` counts accepted steps to strains in between
    indefinite  whether the correction met an indefinite Hessian
    final     of a refused step: smaller ones would end alike
    """

    strain: float
    state: SpringState
    gradient: Array
    free: Array = field(default_factory=NONE_FREE.copy)
    z: Array = field(default_factory=NONE_FREE.copy)
    velocity: Array | None = None
    moduli: Elasticity | None = None
    second: tuple[float, float] = (np.nan, np.nan)
    coordinate_error: float = np.nan
    steps: int = 0
    inserted: int = 0
    indefinite: bool = False
    status: Status = Status.ok
    note: str = ""
    final: bool = False

    @property
    def ok(self) -> bool:
        return self.status is Status.ok

    @property
    def volume(self) -> float:
        """V of the cell or as named, or 1 without either."""
        return self.state.network.volume if self.state.network.has_volume else 1.0

    @cached_property
    def inverse(self) -> Array:
        """F⁻¹, (d, d)."""
        # LAPACK itself: NumPy takes ten times as long for so small a matrix, with the same bits.
        return np.asarray(dgesv(self.gradient, np.eye(len(self.gradient)))[2])

    def refused(self, status: Status, note: str, final: bool = False) -> PathPoint:
        """The end of the same step, refused."""
        return replace(self, status=status, note=note, final=final)

    def relaxed_to(self, solution: Equilibrium[SpringState], final: bool = False) -> PathPoint:
        """The point at the equilibrium that is reached from it, refused where there is none."""
        return replace(
            self,
            state=solution.value,
            coordinate_error=solution.stats.error_bound,
            steps=solution.stats.steps,
            indefinite=solution.indefinite,
            status=solution.status,
            note=solution.reason,
            final=final,
        )

    def measurements(self) -> dict[str, Any]:
        """What `StrainPath` has of this point by name; of a refused one the status and its steps."""
        row: dict[str, Any] = {"steps": self.steps, "inserted": self.inserted, "status": self.status}
        if not self.ok:
            return row
        state, C, volume = self.state, self.moduli, self.volume
        row |= {"energy": state.energy, "max_force": state.max_force, "coordinate_error": self.coordinate_error}
        row |= {"modulus": self.second[0] / volume, "modulus_error": self.second[1] / volume}
        if C is None:
            L = state.bond_vectors
            return row | {"stress": L.T @ (state.sigma[:, None] * L) / volume, "free_components": self.free}
        row |= {"stress": C.stress, "bulk_modulus": C.bulk, "bulk_modulus_error": C.errors.bulk}
        row |= {"shear_modulus": C.shear, "shear_modulus_stress_corrected": C.shear_stress_corrected}
        row["shear_modulus_error"] = max(C.errors.shear, C.errors.shear_stress_corrected)
        return row | {"free_components": self.free}


class Path:
    """A path of springs: what stays the same along it, and the last points.  An extra with other unknowns overrides it.

    network  at γ = 0
    strains  γ (n,) at which it is measured
    stress   tension over length of each spring, σ (N_b,) or T/p (N_f,), while the last point is a transition, else None
    points   the last three that were accepted, the newest last
    stride   length of the next step in strain
    better   which polynomial predicted the last point better: that of two points 0, of three −1
    within_reach  whether the last correction of Newton's method reaches the equilibrium from predictions
    """

    within_reach: ClassVar[bool] = True

    def __init__(
        self,
        network: Network,
        deformation: Deformation,
        strains: Array,
        method: str,
        tolerance: float,
        measure: str,
        stress: Array | None,
    ):
        """Raises `InputError` where a strain inverts the cell."""
        self.network, self.deformation, self.strains = network, deformation, strains
        self.method, self.tolerance, self.measure, self.stress = method, tolerance, measure, stress
        self.points, self.stride, self.better = list[PathPoint](), np.inf, -1
        self.lean: LeanSteps | None = None
        self.gradients = {strain: deformation.gradient(strain) for strain in strains.tolist()}
        self.has_moduli = measure != "energy" and network.has_volume and network.dimension > 1

    def follow(self, springs: SpringState) -> list[PathPoint]:
        """The points at the strains, from springs at γ = 0; the last one alone may be refused."""
        # A kind of path or of springs with other unknowns or forces takes general steps.
        lean = type(self) is Path and type(springs) is SpringState and self.method == "newton"
        self.lean = LeanSteps(springs) if lean and springs.law.convex else None
        reached = self.begin(springs)
        for strain in counted(self.strains[len(reached) :].tolist(), "strain"):
            if reached and not reached[-1].ok:
                break
            reached.append(self.advance(strain))
        return reached

    def begin(self, springs: SpringState) -> list[PathPoint]:
        """Make the first point: a transition, or springs relaxed at γ = 0.  Returns strains that need no step."""
        self.points = [self.point(0.0, springs)]
        if self.stress is not None:
            loose = loosened(springs, self.stress, self.deformation, self.strains[0])
            return [replace(self.points[0].refused(Status.floppy, _LOOSENED), strain=self.strains[0])] if loose else []
        if not balanced(springs):
            raise InputError(
                f"the springs are not in equilibrium, a force of {springs.max_force:.2g} is left: call equilibrium() "
                "first"
            )
        # Unknowns other than vertices may have forces here, and the velocity is unknown.
        start = self.step_to(0.0, np.zeros(len(self.points[0].z)))
        self.points = [start]
        return [start] if self.strains[0] == 0 or not start.ok else []

    def advance(self, target: float) -> PathPoint:
        """Step to a strain; the point that is reached, or refused, counts all steps since the last strain."""
        here = self.points[-1]
        if (self.gradient(target, here.free) == here.gradient).all():
            return replace(here.refused(Status.ill_conditioned, _UNRESOLVED), strain=target, steps=0)
        if self.stress is not None:
            self.points = [replace(here, velocity=self.departure(here, target))]
        # F(γ) does not resolve smaller strains.
        smallest = max(_SMALLEST_PART * abs(target - here.strain), EPS)
        self.stride = max(self.stride, smallest)
        steps, inserted, failed = 0, 0, None
        for _ in range(_MOST_STEPS):
            here = self.points[-1]
            left = target - here.strain
            ahead = min(self.stride, abs(left))
            strain = target if ahead >= _WHOLE * abs(left) else here.strain + np.copysign(ahead, left)
            changes = self.predictions(strain)
            end = self.step_to(strain, changes[self.better if len(changes) > 1 else 0])
            steps += end.steps
            if end.ok:
                # An accepted step becomes the last point, and the stride doubles.
                arrived, failed = strain == target, None
                self.accept(end, changes)
                self.stride = 2 * ahead if not arrived or ahead == self.stride else self.stride
                if arrived:
                    return replace(end, steps=steps, inserted=inserted)
                inserted += 1
            else:
                # A refused one is halved.  The reason is that of the longest: shorter ones may fail by rounding alone.
                failed = end if end.final else failed or end
                if end.final or 0.5 * ahead < smallest:
                    return replace(failed, strain=target, steps=steps, inserted=inserted)
                self.stride = 0.5 * ahead
            if self.method == "newton" and steps > _MOST_ITERATIONS:
                break
        return replace(end.refused(Status.step_limit, _LIMIT), strain=target, steps=steps, inserted=inserted)

    def step_to(self, strain: float, change: Array) -> PathPoint:
        """One step, by a predicted change of z (n,): correction, tests of the branch, measurement."""
        if lean := self.lean_step(strain, change):
            return lean
        # 1. Begin at the prediction, 2. correct it to an equilibrium, where the forces conjugate to z vanish.
        here = self.points[-1]
        start = self.moved(here, strain, change)
        end, factor = self.corrected(start)
        if not end.ok:
            return end
        if keeps_lengths(end.state, self.gradient(strain)):
            return self.floppy(end)
        # 3. An equilibrium without compressed springs is the global minimum, on the branch of taut states.  Another one
        # may lie on another branch: after many iterations, which FIRE takes everywhere, or far from the prediction.
        certain, few = end.state.unique, end.steps <= EXPECTED_STEPS or self.method == "fire"
        if not (certain or (few and not end.indefinite and distance(start, end) <= EXPECTED_DISTANCE)):
            return end.refused(Status.unstable, _JUMPED)
        # 4. Measure moduli and velocity, by the factor of the Hessian.
        end = self.measured(end, factor)
        if certain or not end.ok or distance(start, end) <= DOUBTED_DISTANCE:
            return end
        # 5. Beyond a fold the step back does not end at the last point.  None returns to a transition, where nothing is
        # determined.
        behind = here.strain - end.strain
        if self.stress is not None or behind == 0:
            return end
        velocity = np.zeros(len(end.z)) if end.velocity is None else end.velocity
        back, _ = self.corrected(self.moved(end, here.strain, behind * velocity))
        returned = back.ok and distance(back, here) <= RETURN_DISTANCE
        return end if returned else end.refused(Status.unstable, _JUMPED)

    def lean_step(self, strain: float, change: Array) -> PathPoint | None:
        """The same step of springs in tension under a convex law (`LeanSteps`); None where it does not apply."""
        here = self.points[-1]
        if self.lean is None or strain == 0 or (here.state.softens and self.stress is None):
            return None
        F = self.gradient(strain)
        end = self.lean.equilibrium(F, here.z + change)
        if end is None or weakly_stressed(end[0], F):
            return None
        state, error, steps, factor, contraction = end
        point = PathPoint(strain, state, F, coordinate_error=error, steps=steps)
        if not self.has_moduli:
            return self.measured(point, factor)
        rates = self.rates(point)
        strains = tuple(range(len(unit_strains(len(F))))) if self.measure == "tensors" else strains_of(rates[0])
        response = self.lean.response(state, factor, contraction, strain, strains)
        return None if response is None else self.responding(point, *response, strains, rates)

    def accept(self, end: PathPoint, changes: Array) -> None:
        """Make a point the last one, of which these changes of z were predicted; the last three are kept."""
        if len(changes) > 1:
            self.better = int(np.abs(changes - (end.z - self.points[-1].z)).max(axis=1).argmin())
        self.points, self.stress = [*self.points[1 - _MOST_POINTS :], end], None

    def predictions(self, strain: float) -> Array:
        """Changes of z from the last point (1 or 2, n): Hermite polynomials through the last two and three points."""
        last = self.points[-1]
        if last.velocity is None:
            return np.zeros((1, len(last.z)))
        if abs(strain - last.strain) > _FARTHEST * abs(last.strain - self.points[-2:][0].strain):
            return (last.velocity * (strain - last.strain))[None]
        values = [part for here in self.points for part in (here.z - last.z, here.velocity) if part is not None]
        weights = [hermite_weights(self.points[-n:], strain) for n in range(2, len(self.points) + 1)]
        return np.array([[0.0] * (len(values) - len(row)) + row for row in weights]) @ np.array(values)

    # The unknowns and their corrections.

    def gradient(self, strain: float, free: Array = NONE_FREE) -> Array:
        """F (d, d) of cell and vertices at a strain and free components q (m,)."""
        F = self.gradients.get(strain)
        return self.deformation.gradient(strain) if F is None else F

    def floppy(self, end: PathPoint) -> PathPoint:
        """The point, refused since springs keep all lengths."""
        return end.refused(Status.floppy, _FLOPPY + (_FIX if self.deformation.free else _OTHER), final=True)

    def unknowns(self, point: PathPoint) -> Array:
        """z: the coordinates y that move with the cell, (n_free·d,)."""
        return np.asarray(point.state.coordinates[point.state.network.free_rows] @ point.inverse.T).ravel()

    def velocity(self, point: PathPoint, relaxation: Array, along: Array) -> Array:
        """dz/dγ of dx/dγ − A x, (n_free, d), and of the rates (1, q̇) of γ and q by γ."""
        return np.asarray(relaxation @ point.inverse.T).ravel()

    def point(self, strain: float, state: SpringState, free: Array | None = None) -> PathPoint:
        """The point of a state in the cell of a strain and of free components q (m,), zero by default."""
        free = np.zeros(len(self.deformation.free)) if free is None else free
        point = PathPoint(strain, state, self.gradient(strain, free), free)
        return replace(point, z=self.unknowns(point))

    def moved(self, here: PathPoint, strain: float, change: Array, free: Array = NONE_FREE) -> PathPoint:
        """The point after a change of y (n_free·d,) and the affine motion to the cell of another strain."""
        F = self.gradient(strain, free)
        displacement = change.reshape(-1, len(F)) @ here.gradient.T
        state = here.state.deformed_to(self.network.deformed(F), F @ here.inverse, displacement)
        return PathPoint(strain, state, F, free)

    def corrected(self, start: PathPoint) -> tuple[PathPoint, Factor | None]:
        """The equilibrium from a prediction, H u = f by Newton's method or by FIRE, and a factor of H near it."""
        tolerance = LOOSEST_TOLERANCE if self.within_reach and self.method == "newton" else self.tolerance
        solution, factor = relaxed(start.state, self.method, tolerance, condition=False)
        # FIRE at its step limit gains nothing from smaller strain steps.
        limited = self.method == "fire" and solution.status is Status.step_limit
        return start.relaxed_to(solution, final=limited), factor

    # Measurements.

    def rates(self, point: PathPoint, path: Deformation | None = None) -> tuple[Array, Array]:
        """Rates A of the cell by γ and q, and second derivatives by γ and each, (1 + m, d, d): F'F⁻¹ and F''F⁻¹.

        path  the deformation, with other derivatives; None: as it is
        """
        path = path or self.deformation
        first, second = path.rate(point.strain), path.second_rate(point.strain)
        return (first @ point.inverse)[None], (second @ point.inverse)[None]

    def along(self, E: Array) -> Array:
        """The rates (1, q̇) of γ and q along the path, from the second derivatives E_ab (1 + m, 1 + m)."""
        return np.ones(1)

    def measured(self, end: PathPoint, factor: Factor | None) -> PathPoint:
        """The point with moduli, velocity and d²E/dγ², or refused where its response is not determined."""
        state, rates = end.state, self.rates(end)
        if not self.has_moduli:
            along = self.without_moduli(end, factor, *rates)
            # Between the strains of the path none is needed.
            if end.strain not in self.gradients or not np.isnan(along.second).any():
                return replace(along, z=self.unknowns(end))
            # Corrections by another factor may converge.
            if state.network.dimension < 2:
                return end.refused(Status.ill_conditioned, _UNDETERMINED)
        chosen = None if self.measure == "tensors" else strains_of(rates[0])
        response = linear_response(state, end.volume, self.method == "newton", factor, condition=False, strains=chosen)
        if not response.ok:
            return end.refused(response.status, response.reason)
        end = self.responding(end, response.value, response.responses, response.strains, rates)
        return end if self.has_moduli else replace(end, moduli=None)

    def responding(
        self, end: PathPoint, C: Elasticity, responses: Array, strains: tuple[int, ...], rates: tuple[Array, Array]
    ) -> PathPoint:
        """The point with the moduli of responses to rows of `unit_strains`, z, its velocity and d²E/dγ²."""
        E, weights = second_derivatives(C, *rates)
        along = self.along(E)
        # Errors of q̇ enter squared only.
        components, size, modulus = along @ weights, np.abs(along @ weights), float(E[0] @ along)
        error = self.deformation.error(
            modulus, lambda path: second_derivatives(C, *self.rates(end, path))[0][0] @ along
        )
        second = float(C.volume * modulus), C.volume * float(size @ C.errors.tensor @ size + error)
        velocity = self.velocity(end, combined(responses, strains, components), along)
        return replace(end, z=self.unknowns(end), moduli=C, velocity=velocity, second=second)

    def without_moduli(self, end: PathPoint, factor: Factor | None, rates: Array, second_rates: Array) -> PathPoint:
        """As `measured`, velocity and d²E/dγ² alone."""
        state = end.state
        if factor is None:
            factor = state.factorize()
            if factor.indefinite:
                factor = state.factorize(FLOPPY_SHIFT * state.stiffness_scale)
        end = self.with_tangent(end, factor, rates, second_rates)
        value, error = end.second
        error += self.deformation.error(
            value, lambda path: self.with_tangent(end, factor, *self.rates(end, path)).second[0]
        )
        end = replace(end, second=(value, error))
        if self.method == "newton":
            return end
        # FIRE ends next to the exact equilibrium: twice the change up to that is a part of the error.
        correction = state.exact_displacement(factor)
        exact = replace(end, state=replace(state, bond_vectors=correction.bond_vectors))
        change = self.with_tangent(exact, factor, rates, second_rates).second[0] - end.second[0]
        change = 2 * abs(change) if np.isfinite(correction.remainder) else np.inf
        return replace(end, second=(end.second[0], end.second[1] + change))

    def with_tangent(self, end: PathPoint, factor: Factor, rates: Array, second_rates: Array) -> PathPoint:
        """The point with velocity and d²E/dγ² by a factor of the Hessian near its state; NaN where not determined."""
        state, network, n = end.state, end.state.network, len(rates)
        L, sigma = state.bond_vectors, state.sigma
        # The antisymmetric part rotates all.
        responses = [relaxation(state, factor, 0.5 * (L @ (A + A.T))) for A in rates]
        u, left = np.array([motion for motion, _ in responses]), np.array([energy for _, energy in responses])
        if not np.isfinite(left).all():
            return replace(end, second=(np.nan, np.nan))
        speeds = np.array([L @ A.T + network.free_incidence @ each for A, each in zip(rates, u, strict=True)])
        hdots, rows = np.array([dot(L, speed) for speed in speeds]), speeds.reshape(n, -1)
        E = hdots @ state.resistance(hdots).T + (np.repeat(sigma, L.shape[1]) * rows) @ rows.T
        curved = np.array([sigma * dot(L, L @ A.T) for A in second_rates])
        E[0] += curved.sum(axis=1)
        E[1:, 0] = E[0, 1:]
        along = self.along(E)
        moving, second = np.tensordot(along, u, 1), float(E[0] @ along)
        noise = _edge_rounding(state, np.tensordot(along, speeds, 1), moving)
        error = accumulated_rounding(noise + 4 * EPS * np.abs(curved[0])) + 4 * EPS * abs(second)
        error += (np.abs(along) @ np.sqrt(left)) ** 2
        return replace(end, velocity=self.velocity(end, moving, along), second=(second, float(error)))

    def departure(self, here: PathPoint, target: float) -> Array | None:
        """dz/dγ at a transition on the side of a strain: the limit under a stress η σ as η → 0, if it is determined."""
        springs, (rates, second_rates), stress = here.state, self.rates(here), self.stress
        assert stress is not None
        L, sigma = springs.bond_vectors, springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
        work = np.vdot(sigma[:, None] * L, L @ rates[0].T)
        stress = stress / springs.stiffness * np.copysign(1.0, work * (target - here.strain))
        tightened = springs.spring_lengths * (1 - _DEPARTING_STRESS * stress / np.abs(stress).max())
        # Slack edges resist nothing.
        rest = np.where(stress != 0, tightened, springs.rest_lengths)
        # All laws are Hookean next to rest, but for springs that are slack below.
        law = springs.law if springs.law.one_sided else HOOKEAN
        stressed = replace(springs, rest_lengths=rest, law=law)
        # Where the affine motion keeps the balance, as a dilation does where σ = k, vertices follow it.
        affine = 0.5 * (L @ (rates[0] + rates[0].T))
        left = stressed.force_rates(affine)
        if len(rates) == 1 and largest(left) <= _BALANCED * springs.stiffness_scale * largest(affine):
            return self.velocity(here, np.zeros_like(left), np.ones(1))
        factor = stressed.factorize(FLOPPY_SHIFT * springs.stiffness_scale)
        return self.with_tangent(replace(here, state=stressed), factor, rates, second_rates).velocity


def second_derivatives(C: Elasticity, rates: Array, second_rates: Array) -> tuple[Array, Array]:
    """E_ab/V (1 + m, 1 + m) by rates A and second derivatives (1 + m, d, d), and the components of the rates.

    From the responses to all strains: no sums over edges.
    """
    symmetric = 0.5 * (rates + rates.swapaxes(1, 2))
    weights = np.array([strain_components(A) for A in symmetric])
    pairs = list(zip(rates, symmetric, strict=True))
    turning = [[np.vdot(C.stress, A.T @ B - one @ other) for B, other in pairs] for A, one in pairs]
    E = weights @ C.tensor @ weights.T + turning
    E[0] += [float(np.vdot(C.stress, A)) for A in second_rates]
    E[1:, 0] = E[0, 1:]
    return E, weights


def hermite_weights(points: list[PathPoint], strain: float) -> list[float]:
    """The weights in a Hermite polynomial at a strain: of z and, if known, of the velocity of each point.

    z = Σ_i w_i ((1 − (γ − γ_i) s_i) z_i + (γ − γ_i) dz_i/dγ) with w_i = Π_j ((γ − γ_j)/(γ_i − γ_j))^o_j and
    s_i = Σ_j o_j/(γ_i − γ_j) over j ≠ i, of orders o_j = 2; where a velocity is not known o_j = 1, and z_i has w_i.
    """
    weights = list[float]()
    for here in points:
        weight, slope, ahead = 1.0, 0.0, strain - here.strain
        for there in points:
            if there is not here:
                order, apart = 1 if there.velocity is None else 2, here.strain - there.strain
                weight *= ((strain - there.strain) / apart) ** order
                slope += order / apart
        weights += [weight] if here.velocity is None else [weight * (1 - ahead * slope), weight * ahead]
    return weights


def relaxation(state: SpringState, factor: Factor, affine: Array) -> tuple[Array, float]:
    """u (n_free, d) with H u = −∂E/∂x of rates L̇ (N_b, d) of the bond vectors, and the energy of its error (estimate).

    factor  of the Hessian at or near the state; without convergence the energy is infinite
    """
    u, before, energy, least = np.zeros(state.forces.shape), np.inf, np.inf, NO_RELAXATION * largest(affine)
    for _ in range(MOST_CORRECTIONS):
        force = state.force_rates(affine + state.edge_rates(u))
        correction = factor.solve(force.ravel()).reshape(u.shape)
        u += correction
        size, whole, gain = largest(correction), max(largest(u), least), abs(float(np.vdot(force, correction)))
        # What a correction leaves is its energy times the contraction.
        left, energy = gain * min(1.0, CONTRACTION_MARGIN * np.sqrt(gain / energy)), gain
        # Corrections that no longer shrink are rounding, or the factor is of no use.
        if not size < before:
            return u, left if size <= _CORRECT * whole else np.inf
        if size <= _CONVERGED * whole:
            break
        before = size
    return u, left


def _edge_rounding(state: SpringState, speed: Array, u: Array) -> Array:
    """Rounding error of each edge's part of d²E/dγ², (N_b,), as `linear_response` has it."""
    network, sigma, length = state.network, state.sigma, state.lengths
    stress = state.resistance(dot(state.bond_vectors, speed))
    size, vertex_speed = norms(speed), np.zeros(network.n_vertices)
    vertex_speed[network.free_rows] = norms(u)
    rate_rounding = EPS * (size + vertex_speed.take(network.edges.T).sum(axis=0) + length)
    noise = state.stress_rounding * (size**2 + length * size)
    return noise + 2 * (np.abs(stress) * length + np.abs(sigma) * size) * rate_rounding


def keeps_lengths(state: SpringState, gradient: Array) -> bool:
    """Whether a strain from rest by F (d, d) causes no stress beyond rounding: motions keep the lengths of all springs.

    Where springs resist, some are extended by a part of their lengths of the order of the strain.
    """
    strain, stress = strain_and_stress(state, gradient)
    if strain == 0 or not weakly_stressed(state, gradient):
        return False
    unit, rounding = strain**2 * stress, ROUNDING_COMPRESSION * state.stress_rounding
    least = np.maximum(UNSTRESSED * unit, np.where(rounding < WEAK * unit, rounding, 0.0))
    return bool((np.abs(state.sigma) <= least).all())


def weakly_stressed(state: SpringState, gradient: Array) -> bool:
    """Whether the stress of each edge is far below that of a strain by F (d, d) which the springs resist."""
    strain, stress = strain_and_stress(state, gradient)
    return bool((np.abs(state.sigma) <= WEAK * strain * stress).all())


def strain_and_stress(state: SpringState, gradient: Array) -> tuple[float, Array]:
    """The size of a strain, Σ_ij |F − 1|_ij, at most 1, and σ (N_b,) of springs whose extension is their length: k.

    The size of a small dilation, uniaxial strain or simple shear is γ.
    """
    strain = min(1.0, float(np.abs(gradient - np.eye(len(gradient))).sum()))
    return strain, state.edge_tension(state.stiffness * state.spring_lengths) / state.lengths


def distance(one: PathPoint, other: PathPoint) -> float:
    """The largest difference of the bond vectors of two points, in units of the mean length."""
    return largest(one.state.bond_vectors - other.state.bond_vectors) / mean(one.state.lengths)


def loosened(springs: SpringState, stress: Array, deformation: Deformation, strain: float) -> bool:
    """Whether a strain of this sign loosens a network in tension, which is then floppy: γ Σ σ L·A L < 0."""
    sigma = springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
    L, A = springs.bond_vectors, np.copysign(1.0, strain) * deformation.velocity(0.0)
    work, size = np.sum(sigma[:, None] * L * (L @ A.T)), np.linalg.norm(A) * np.sum(sigma * springs.lengths**2)
    return bool((sigma >= 0).all() and work < -LOOSENING_WORK * size)


def balanced(springs: SpringState) -> bool:
    """Whether the forces of springs vanish but for rounding."""
    return springs.max_force <= BALANCED_START * springs.stiffness_scale * springs.length_scale


Onset: TypeAlias = tuple[Deformation, Callable[[Deformation, Array], Array]]
"""The deformation of an onset, and strains (n,) of the network as given by those (n,) along a path from there."""

Beginning: TypeAlias = tuple[SpringState, Array | None, str, Onset | None]
"""Springs at γ = 0; their tension over length at a transition, σ (N_b,) or T/p (N_f,); a note; and the onset there."""


@singledispatch
def start_of(start: Any, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The springs from which a path starts, with the stress of a transition; `InputError` for other kinds."""
    known = held(start, (CriticalConfiguration, SpringState))
    if known is not None:
        return start_of(known, law, taut_only)
    kinds, advice = (
        "a CriticalConfiguration or a SpringState or a Solution",
        getattr(start, "network_refusal", "") or _ADVICE,
    )
    raise InputError(f"start must be {kinds}, not {shown(start)}: {advice}")


@start_of.register
def _(start: Solution, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """That of the value; slack or compressed edges are no failure."""
    if start.status not in (Status.slack_edges, Status.compressed_edges):
        start.or_raise("no path starts from this solution")
    return start_of(start.value, law, taut_only)


@start_of.register
def _(start: CriticalConfiguration, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """Springs at rest: all edges, or the taut ones; cables where rest lengths are known."""
    if start.rest_lengths is not None and not taut_only:
        return from_extras("cables_at_onset", _OF_CABLES)(start, start.rest_lengths, law)
    require_directions((start.lengths <= COLLAPSED * start.lengths.mean()) & (start.sigma != 0), _OF_STRESS)
    part, note = start, ""
    if not start.sigma.all():
        taut = backbone(start)
        part = taut.configuration
        note = f"{taut.n_slack} of {len(start.sigma)} edges are slack, so the path is that of the taut part alone"
    law = checked_law(HOOKEAN if law is None else law, part.lengths, part.network.stiffness)
    springs = SpringState(part.network, part.lengths, part.coordinates, part.bond_vectors, law)
    return springs, part.sigma, note, None


@start_of.register
def of_state(state: SpringState, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """A state of springs, which has its own law and all of its edges."""
    if law is not None and law != state.law:
        raise InputError("the state has a spring law: leave out law=, or make a state with the other law")
    if taut_only:
        raise InputError("a state of springs has no slack part to leave out: taut_only belongs to a configuration")
    require_directions(state.lengths == 0, "move its ends apart")
    return state, None, "", None
