"""Numerical continuation of equilibria in strain: predictor, steps of variable length, and checks of the branch.

States are followed in coordinates y that move with the cell, x = (1 + Σ q E) F(γ) y, together with the free components
q of the cell.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.paths.predictor import Predictor
from critflow.paths.tangent import Tangent, path_rates, relaxations_to, tangent, tangent_of_response
from critflow.response.linear_response import LinearResponse, linear_response, strains_of
from critflow.response.tensor import Elasticity
from critflow.result import Status
from critflow.springs.equilibrium import Equilibrium, relaxed
from critflow.springs.free_cell import FreeCellState, relaxed_with_cell, stretched
from critflow.springs.laws import HOOKEAN
from critflow.springs.newton import FLOPPY_SHIFT
from critflow.springs.state import SpringState

# A step may have left its branch if Newton's method took more steps, or ended further from the prediction.  At 200
# vertices and steps of 1e-3 it takes 2 to 5 steps; it ends within 2e-3 in the first step of strain and within 1e-6 in
# later ones.  With a third of 1,000 vertices slack the first step takes 11 to 26 and ends within 2e-2; shorter ones
# take no fewer.
EXPECTED_STEPS, EXPECTED_DISTANCE = 40, 0.05
# Ends further than the first from the prediction are accepted if the step back ends within the second of the start:
# beyond a fold it ends on another branch, a distance of order one away.
DOUBTED_DISTANCE, RETURN_DISTANCE = 1e-3, 1e-6

# Part of the strain interval below which a step is not divided further.
_SMALLEST_PART = 2.0**-16
# Steps, and their iterations, towards one strain: no path within them needed more than a tenth.
_MOST_STEPS, _MOST_ITERATIONS = 400, 4000
# Stress η, in units of k, that stands for the limit of no stress: its effect is of this order, and rounding of 1e-10.
_DEPARTING_STRESS = 1e-6
# A step that covers this part of the remaining interval ends at the requested strain, not a rounding next to it.
_WHOLE = 0.999

_LIMIT = "the steps became too short to arrive: give strains that are closer together, or another method"
_UNRESOLVED = "this strain and the one before it give the same cell in floating-point numbers: choose larger ones"
_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"


@dataclass(frozen=True, eq=False)
class Step:
    """End of one step, from which the continuation proceeds if it is accepted.

    curable   a smaller step may succeed where this one failed
    velocity  d(y, q)/dγ (n_free·d + m,); None where it was not computed
    stretch   free components q (m,)
    tangent, moduli, elasticity, coordinate_error  measured at the end; without tensors `moduli` has bulk and shear
                                                   moduli alone, and `elasticity` is None
    """

    strain: float
    state: SpringState
    stretch: Array
    iterations: int
    status: Status = Status.ok
    note: str = ""
    curable: bool = True
    velocity: Array | None = None
    tangent: Tangent | None = None
    moduli: Elasticity | None = None
    elasticity: Elasticity | None = None
    coordinate_error: float = np.nan

    @property
    def ok(self) -> bool:
        return self.status is Status.ok


@dataclass(frozen=True, eq=False)
class Arrival:
    """The last step towards one strain, the iterations of all steps to it, and the accepted ones before the last."""

    end: Step
    iterations: int
    inserted: int


@dataclass(frozen=True, eq=False)
class Relaxer:
    """Options of the relaxation at each strain, which are those of `strain_path`."""

    method: str
    tolerance: float
    with_moduli: bool
    with_tensors: bool
    pattern: FixedPattern


@dataclass(eq=False)
class Continuation:
    """The last accepted state, the predictor and the length of the next step.

    state    at the start of the path, γ = 0 and q = 0
    regular  whether the start is an isolated equilibrium, to which steps can return; not at a transition
    stress   σ (N_b,) of the transition from which the path starts
    """

    state: SpringState
    deformation: Deformation
    relaxer: Relaxer
    regular: bool = False
    stress: Array | None = None
    strain: float = 0.0
    stride: float = np.inf
    reference: Network = field(init=False)
    stretch: Array = field(init=False)
    predictor: Predictor = field(init=False)
    _gradients: dict[float, Array] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.reference, self.stretch = self.state.network, np.zeros(len(self.deformation.free))
        self.predictor = Predictor(self._point(self.state, 0.0, self.stretch))

    def begin(self) -> Arrival:
        """Relax at γ = 0, where free components of the cell may have stress and velocities are unknown."""
        step = self._step(0.0)
        if step.ok:
            self.state, self.stretch, self.regular = step.state, step.stretch, True
            self.predictor = Predictor(self._point(step.state, 0.0, step.stretch), step.velocity)
        return Arrival(step, step.iterations, 0)

    def refused(self, strain: float, status: Status, note: str) -> Arrival:
        """The end of the path before a strain, without a step."""
        return Arrival(Step(strain, self.state, self.stretch, 0, status, note), 0, 0)

    def advance(self, strain: float) -> Arrival:
        """Proceed to a strain by steps that halve after failures and double after successes."""
        whole = abs(strain - self.strain)
        if np.array_equal(self._affine(strain), self._affine(self.strain)):
            return self.refused(strain, Status.ill_conditioned, _UNRESOLVED)
        # F(γ) does not resolve smaller strains.
        smallest = max(_SMALLEST_PART * whole, EPS)
        self.stride = max(self.stride, smallest)
        iterations = inserted = 0
        failed: Step | None = None
        for _ in range(_MOST_STEPS):
            left = abs(strain - self.strain)
            ahead = min(self.stride, left)
            target = strain if ahead >= _WHOLE * left else self.strain + np.copysign(ahead, strain - self.strain)
            step = self._step(target)
            iterations += step.iterations
            if step.ok:
                self._accept(step)
                failed = None
                if target == strain:
                    self.stride *= 2 if ahead == self.stride else 1
                    return Arrival(step, iterations, inserted)
                inserted += 1
                self.stride = 2 * ahead
            elif step.curable and self._departs(strain):
                continue
            else:
                # The longest step has the clearest reason: shorter ones may fail by rounding alone.
                failed = failed or step
                if not step.curable or 0.5 * ahead < smallest:
                    return Arrival(failed, iterations, inserted)
                self.stride = 0.5 * ahead
            if self.relaxer.method == "newton" and iterations > _MOST_ITERATIONS:
                break
        return Arrival(replace(step, status=Status.step_limit, note=_LIMIT), iterations, inserted)

    def _step(self, strain: float) -> Step:
        """One step to a strain, which leaves the continuation unchanged."""
        start, q = self._predicted(strain)
        solution, factor, q = self._relaxed(start, strain, q)
        state, n = solution.value, solution.stats.steps
        if not solution.ok:
            # FIRE at its step limit gains nothing from smaller strain steps.
            curable = self.relaxer.method != "fire" or solution.status is not Status.step_limit
            return Step(strain, state, q, n, solution.status, solution.reason, curable)
        unique = _unique(state)
        if not (unique or self._expected(start, solution)):
            return Step(strain, state, q, n, Status.unstable, _JUMPED)
        response = None
        rates = path_rates(self.deformation, strain, self._affine(strain), q)
        if self.relaxer.with_moduli and state.network.has_volume and state.network.dimension > 1:
            exact = self.relaxer.method == "newton"
            wanted = None if self.relaxer.with_tensors else strains_of(rates[0])
            volume, pattern = state.network.volume, self.relaxer.pattern
            response = linear_response(state, volume, pattern, exact, factor, condition=False, strains=wanted)
            if not response.ok:
                return Step(strain, state, q, n, response.status, response.reason)
        along, velocity = self._tangent(state, rates, factor, response), None
        if along is not None:
            back = np.linalg.inv(self._gradient(strain, q))
            velocity = np.concatenate([(along.relaxation @ back.T).ravel(), along.stretch_rate])
        if not (unique or self._returns(start, state, strain, q, velocity)):
            return Step(strain, state, q, n, Status.unstable, _JUMPED)
        return Step(
            strain,
            state,
            q,
            n,
            velocity=velocity,
            tangent=along if self.relaxer.with_moduli else None,
            moduli=None if response is None else response.value,
            elasticity=response.value if response is not None and self.relaxer.with_tensors else None,
            coordinate_error=solution.stats.error_bound,
        )

    def _relaxed(
        self, start: SpringState, strain: float, q: Array
    ) -> tuple[Equilibrium[SpringState], Factor | None, Array]:
        """The equilibrium at a strain, a factor of the Hessian near it, and the free components."""
        relaxer = self.relaxer
        if not len(q):
            return *relaxed(start, relaxer.pattern, relaxer.method, relaxer.tolerance, condition=False), q
        free = FreeCellState.of(start, q, self.deformation.free_strains)
        gradient = self._affine(strain)
        return relaxed_with_cell(free, self.reference, gradient, relaxer.pattern, relaxer.tolerance)

    def _tangent(
        self, state: SpringState, rates: tuple[Array, Array], factor: Factor | None, response: LinearResponse | None
    ) -> Tangent | None:
        """The tangent of the path from its `path_rates`, or None where the response is not determined."""
        if response is not None:
            return tangent_of_response(response, *rates)
        if factor is None:
            factor = state.factorize(self.relaxer.pattern)
            if factor.indefinite:
                factor = state.factorize(self.relaxer.pattern, FLOPPY_SHIFT * state.stiffness_scale)
        relaxations = relaxations_to(state, factor, rates[0])
        return None if relaxations is None else tangent(state, *rates, relaxations)

    def _departs(self, strain: float) -> bool:
        """Find the velocity at a transition, once, where a step without it fails.

        It is the limit of that of the same configuration under a stress η σ as η → 0, on the side of the strain.
        """
        if self.stress is None or self.strain != 0.0:
            return False
        state, stress, self.stress = self.state, self.stress, None
        work = np.vdot(stress[:, None] * state.bond_vectors, state.bond_vectors @ self.deformation.velocity(0.0).T)
        stress = stress / state.network.stiffness * np.copysign(1.0, work * strain)
        rest = state.lengths * (1 - _DEPARTING_STRESS * stress / np.abs(stress).max())
        stressed = replace(state, rest_lengths=rest, law=HOOKEAN)
        factor = stressed.factorize(self.relaxer.pattern, FLOPPY_SHIFT * state.stiffness_scale)
        rates = path_rates(self.deformation, 0.0, self._affine(0.0), self.stretch)
        along = None if factor.indefinite else self._tangent(stressed, rates, factor, None)
        if along is None:
            return False
        velocity = np.concatenate([along.relaxation.ravel(), along.stretch_rate])
        self.predictor = Predictor(self.predictor.last, velocity)
        return True

    def _accept(self, step: Step) -> None:
        self.strain, self.state, self.stretch = step.strain, step.state, step.stretch
        self.predictor.add(step.strain, self._point(step.state, step.strain, step.stretch), step.velocity)

    def _gradient(self, strain: float, q: Array) -> Array:
        """(1 + Σ q E) F(γ), (d, d)."""
        F = self._affine(strain)
        return stretched(q, self.deformation.free_strains) @ F if len(q) else F

    def _affine(self, strain: float) -> Array:
        """F(γ) (d, d), of which a step needs those at its two ends many times."""
        if strain not in self._gradients:
            kept = {at: F for at, F in self._gradients.items() if at == self.strain}
            self._gradients = kept | {strain: self.deformation.gradient(strain)}
        return self._gradients[strain]

    def _point(self, state: SpringState, strain: float, q: Array) -> Array:
        """(y, q) of a state, (n_free·d + m,)."""
        back = np.linalg.inv(self._gradient(strain, q))
        return np.concatenate([(state.coordinates[state.network.free_rows] @ back.T).ravel(), q])

    def _predicted(self, strain: float) -> tuple[SpringState, Array]:
        """The last state moved to a strain affinely and by the predictor, and the free components."""
        return self._moved(self.state, (self.strain, self.stretch), strain, self.predictor.displacement(strain))

    def _moved(
        self, state: SpringState, at: tuple[float, Array], strain: float, displacement: Array
    ) -> tuple[SpringState, Array]:
        """A state at (γ, q) after a change of (y, q) and of the strain."""
        m, d = len(self.stretch), self.reference.dimension
        n = len(displacement) - m
        q = at[1] + displacement[n:]
        if m and not np.linalg.det(stretched(q, self.deformation.free_strains)) > 0:
            q = at[1]
        before, after = self._gradient(*at), self._gradient(strain, q)
        state = state.moved(displacement[:n].reshape(-1, d) @ before.T)
        return state.deformed_to(self.reference.deformed(after), after @ np.linalg.inv(before)), q

    def _expected(self, start: SpringState, solution: Equilibrium[SpringState]) -> bool:
        """Whether the relaxation ended near its prediction, after few steps and no indefinite Hessian."""
        few = self.relaxer.method != "newton" or solution.stats.steps <= EXPECTED_STEPS
        return few and not solution.indefinite and _distance(start, solution.value) <= EXPECTED_DISTANCE

    def _returns(self, start: SpringState, state: SpringState, strain: float, q: Array, velocity: Array | None) -> bool:
        """Whether the step back ends at the last state, which it does not from beyond a fold."""
        if (self.strain == 0.0 and not self.regular) or _distance(start, state) <= DOUBTED_DISTANCE:
            return True
        change = np.zeros(len(self.predictor.last)) if velocity is None else (self.strain - strain) * velocity
        back, q = self._moved(state, (strain, q), self.strain, change)
        solution, _, _ = self._relaxed(back, self.strain, q)
        return solution.ok and _distance(solution.value, self.state) <= RETURN_DISTANCE


def _unique(state: SpringState) -> bool:
    """Whether the state is certainly the global minimum, and so on the branch formed by all taut states.

    Replace each spring by a cable of the same law with zero energy below ℓ: the energy is then convex, also in the free
    components of the cell, and nowhere above that of the springs.  A taut equilibrium is its minimum, where both
    energies are equal.
    """
    return state.law.convex and (state.law.one_sided or bool((state.extension >= 0).all()))


def _distance(one: SpringState, other: SpringState) -> float:
    """The largest difference of two states' bond vectors, in units of the mean length."""
    return float(np.abs(one.bond_vectors - other.bond_vectors).max() / one.lengths.mean())
