"""Tasks: bulk and shear modulus past the transition and at it, by differences, by linear response, in closed form.

Differences relax the springs again at each strain, to a force of 1e-14, and difference the energy twice or the stress
once; levels are their steps.  A step too large has a bias of its square, a step too small leaves rounding: of energies
over h², of stresses over h.  matscipy has Born's constants, stress and non-affine forces from our Hessian and solves
for the latter by its conjugate gradients, to a relative residual that is its level; its Birch coefficients C are
changes of the Cauchy stress, so that B = (C_xxxx + C_yyyy + 2 C_xxyy)/4 and G = C_xyxy − ½ dE/dV.

At the transition the energy is zero and grows on one side only: 2E/(Vγ²) → B_0 and linear response at γ → 0 are limits,
levels the strains.  The self-stress of a network at rest, by `rigidity`, needs no strain and no stress to be given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    Solution,
    Status,
    elastic_moduli,
    equilibrium,
    linear_response,
    spring_state,
    strain_path,
    transition_moduli,
    voronoi_network,
)
from critflow.critical.quantity import pure_shear
from critflow.linalg.factor import FixedPattern
from critflow.networks.network import Array
from critflow.precision.double_double import extended
from critflow.response.elasticity import Moduli
from critflow.springs.state import SpringState
from critflow.workflow import stable_rng

from ..timing import Accuracy, Method, Task, installed, peer
from . import references
from .ase import atoms_of, matscipy_springs
from .references import ExtendedModuli, relative_error

STRAIN = 1e-3
SIZES = (100, 1_000, 10_000)
# Steps of the differences; half the strain still keeps both sides past the transition.
STEPS = (5e-4, 2e-4, 1e-4, 1e-5, 1e-6, 1e-7)
RESIDUALS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
# Strains that approach the transition.
STRAINS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
# From here on methods that relax again run at their best level only.
LARGE = 10_000
# `rigidity` finds self-stresses by dense algebra, which takes too long beyond this.
AT_REST = 1_000
MOST_STEPS = 100_000
# Options of SciPy's `spilu`; with more dropped entries the free translations are undefined.
_NEARLY_EXACT = {"drop_tol": 1e-10, "fill_factor": 50.0}
# It is then there at once; residuals that rounding does not allow would keep it going for hours.
_FIRST = RESIDUALS[:4]


def random_critical(n_vertices: int, seed: int) -> tuple[CriticalManifold, CriticalConfiguration]:
    """A network and its configuration under a random stress."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    rng = stable_rng(seed, "contest", "stress")
    return manifold, manifold.configuration(np.abs(rng.standard_normal(manifold.network.n_edges)))


@dataclass(frozen=True)
class Measured:
    """Moduli as a method gives them, how it ended, and relative bounds on their errors if it claims any."""

    bulk: float
    shear: float
    status: Status = Status.ok
    iterations: int = 0
    bound: float = np.nan

    @classmethod
    def of(cls, solution: Solution[Moduli]) -> Measured:
        value, claim = solution.value, solution.stats.error_bound
        bound = max(claim.bulk / value.bulk, claim.shear / value.shear) if isinstance(claim, Moduli) else np.nan
        return cls(value.bulk, value.shear, solution.status, solution.stats.steps, bound)

    def against(self, exact: ExtendedModuli) -> Accuracy:
        """The larger of the relative errors of B and G."""
        error = max(relative_error(self.bulk, exact.bulk), relative_error(self.shear, exact.shear))
        return Accuracy(error, self.status, self.iterations, self.bound)


@dataclass(frozen=True, eq=False)
class StressedSprings:
    """Springs in equilibrium past the transition, and their exact moduli."""

    state: SpringState
    pattern: FixedPattern
    reference: ExtendedModuli

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> StressedSprings:
        manifold, critical = random_critical(n_vertices, seed)
        F = np.sqrt(1 + STRAIN) * np.eye(2)
        start = spring_state(manifold.network.deformed(F), critical.lengths, critical.coordinates @ F.T)
        state = equilibrium(start, pattern=manifold.hessian).value
        near = state.coordinates[state.network.free]
        exact = references.equilibrium(state.network, extended(critical.lengths), near, manifold.hessian)
        return cls(state, manifold.hessian, references.moduli(*exact))

    def accuracy(self, answer: Measured) -> Accuracy:
        return answer.against(self.reference)


def _dilated(strain: float) -> tuple[Array, Array]:
    """F and Ḟ F⁻¹ of a change of the volume."""
    return np.sqrt(1 + strain) * np.eye(2), np.eye(2) / (2 * (1 + strain))


def _sheared(strain: float) -> tuple[Array, Array]:
    """F and Ḟ F⁻¹ of a pure shear."""
    F = np.eye(2) + strain * pure_shear(2)
    return F, pure_shear(2) @ np.linalg.inv(F)


def _differences(springs: StressedSprings, order: int, h: float) -> Measured:
    """d²E of relaxed springs by central differences of E (order 2) or of dE, the work of the stress (order 1)."""
    moduli, ends = [], []
    for deformed in (_dilated, _sheared):
        terms = []
        for strain in (-h, h):
            F, rate = deformed(strain)
            end = equilibrium(springs.state.deformed(F), pattern=springs.pattern, throw=False)
            L = end.value.bond_vectors
            work = float(end.value.sigma @ np.einsum("ad,de,ae->a", L, rate, L))
            terms.append(end.value.energy if order == 2 else work)
            ends.append(end)
        below, above = terms
        second = (below + above - 2 * springs.state.energy) / h**2 if order == 2 else (above - below) / (2 * h)
        moduli.append(second / springs.state.network.volume)
    status = max(end.status for end in ends)
    return Measured(*moduli, status, sum(end.stats.steps for end in ends))


def _matscipy(springs: StressedSprings) -> list[Method]:
    """With plain conjugate gradients, and with an incomplete LU factorisation that drops next to nothing."""

    def run(preconditioner: dict[str, float] | None, residual: float) -> Measured:
        atoms = start.copy()
        atoms.calc = calculator
        # Forces out of the plane are rounding, which no displacement balances.
        options = {"x0": None, "rtol": residual, "atol": 1e-12, "maxiter": MOST_STEPS, "M": None, "callback": None}
        C = calculator.get_birch_coefficients(atoms)
        C += peer("matscipy.elasticity").nonaffine_elastic_contribution(
            atoms, pc_parameters=preconditioner, cg_parameters=options
        )
        bulk = (C[0, 0, 0, 0] + C[1, 1, 1, 1] + C[0, 0, 1, 1] + C[1, 1, 0, 0]) / 4
        stress = calculator.get_property("stress", atoms)
        # From the change of the Cauchy stress to the second derivative of the energy.
        return Measured(float(bulk), float(C[0, 1, 0, 1] - (stress[0] + stress[1]) / 4))

    if installed("matscipy"):
        start, calculator = atoms_of(springs.state), matscipy_springs(springs.state)
    return [
        Method("matscipy", partial(run, None), springs.accuracy, RESIDUALS, "matscipy"),
        Method("matscipy LU", partial(run, _NEARLY_EXACT), springs.accuracy, _FIRST, "matscipy", "SuperLU"),
    ]


def _stressed(n_vertices: int, seed: int) -> list[Method]:
    springs = StressedSprings.of(n_vertices, seed)
    steps = STEPS if n_vertices < LARGE else (1e-5,)

    def respond(level: float) -> Measured:
        return Measured.of(linear_response(replace(springs.state), springs.pattern))

    return [
        Method("linear response", respond, springs.accuracy, backend="qdldl"),
        Method("differences of stress", partial(_differences, springs, 1), springs.accuracy, steps),
        Method("differences of energy", partial(_differences, springs, 2), springs.accuracy, steps),
        *_matscipy(springs),
    ]


def _at_transition(n_vertices: int, seed: int) -> list[Method]:
    manifold, critical = random_critical(n_vertices, seed)
    strains = STRAINS if n_vertices < LARGE else STRAINS[-1:]
    exact = references.transition_moduli(manifold, critical.sigma)

    def accuracy(answer: Measured) -> Accuracy:
        """The relative error of B_0."""
        return Accuracy(relative_error(answer.bulk, exact.bulk), answer.status, answer.iterations, answer.bound)

    def closed(level: float) -> Measured:
        value = transition_moduli(replace(critical))
        return Measured(value.bulk, value.shear)

    def past(strain: float, moduli: bool) -> Measured:
        solution = strain_path(replace(critical), [strain], moduli=moduli, pattern=manifold.hessian, throw=False)
        path = solution.value
        bulk = path.bulk_modulus[0] if moduli else 2 * path.energy[0] / (manifold.network.volume * strain**2)
        return Measured(float(bulk), np.nan, solution.status, int(path.steps[0]))

    def at_rest(level: float) -> Measured:
        return Measured.of(elastic_moduli(manifold.network, critical.coordinates))

    methods = [
        Method("closed form", closed, accuracy),
        Method("linear response at γ → 0", partial(past, moduli=True), accuracy, strains, backend="qdldl"),
        Method("energy at γ → 0", partial(past, moduli=False), accuracy, strains, backend="qdldl"),
    ]
    if n_vertices <= AT_REST:
        methods.append(Method("self-stress at rest", at_rest, accuracy))
    return methods


TASKS = (
    Task(
        "moduli",
        "bulk and shear modulus at γ = 0.001",
        "larger of the relative errors of B and G",
        SIZES,
        ("linear response", "differences of stress", "differences of energy", "matscipy", "matscipy LU"),
        "linear response",
        _stressed,
    ),
    Task(
        "transition_moduli",
        "bulk modulus at the transition",
        "relative error of B₀",
        SIZES,
        ("closed form", "linear response at γ → 0", "energy at γ → 0", "self-stress at rest"),
        "closed form",
        _at_transition,
    ),
)
