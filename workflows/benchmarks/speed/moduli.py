"""Tasks: bulk and shear modulus past the transition and at it, by differences, by linear response, in closed form.

Differences relax the springs again at each strain, to a force of 1e-14, and difference the energy twice or the stress
once; levels are their steps.  A step too large has a bias of its square, a step too small leaves rounding: of energies
over h², of stresses over h.  matscipy has Born's constants, stress and non-affine forces from our Hessian and solves
for the latter by its conjugate gradients, to a relative residual that is its level; its Birch coefficients C are
changes of the Cauchy stress, so that B = (C_xxxx + C_yyyy + 2 C_xxyy)/4 and G = C_xyxy − ½ dE/dV.

At the transition the energy is zero and grows on one side only: 2E/(Vγ²) → B_0 and linear response at γ → 0 are limits,
levels the strains.  The self-stress of a network at rest, by `rigidity`, needs no strain and no stress to be given.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from critflow import Deformation, elasticity, equilibrium, strain_path
from critflow.critical.transition import pure_shear
from critflow.paths.strain_path import PathSolver
from critflow.response.linear_response import linear_response
from critflow.springs.state import SpringState

from ..timing import Answer, Method, Task, installed, peer
from . import references
from .springs import StrainedSprings, answer_of, random_critical, relative

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
# Thickness of the layer; volumes are areas times it.
_THICKNESS = 1.0


def atoms_of(state: SpringState) -> Any:
    """ASE's `Atoms` at the coordinates of a state, in a layer."""
    network = state.network
    cell = np.diag([0.0, 0.0, _THICKNESS])
    cell[:2, :2] = network.cell
    x = np.zeros((network.n_vertices, 3))
    x[:, :2] = state.coordinates
    return peer("ase").Atoms(positions=x, cell=cell, pbc=True, numbers=np.ones(len(x), int))


def matscipy_springs(state: SpringState) -> Any:
    """A calculator of stress and of Hessians in matscipy's two formats, for edges and their reverses."""

    class Springs(peer("matscipy.calculators.calculator").MatscipyCalculator):  # type: ignore[misc, name-defined]
        implemented_properties = (
            *("energy", "forces", "stress", "hessian", "nonaffine_forces", "born_constants"),
            *("birch_coefficients", "elastic_constants"),
        )

        def calculate(self, atoms, properties, system_changes):
            super().calculate(atoms, properties, system_changes)
            L, length, tension = _springs(self.atoms)
            pull = L * (tension / length)[:, None]
            stress = self._virial(L, pull) / self.atoms.get_volume()
            forces = np.zeros((len(self.atoms), 3))
            forces[:] = -(g.T @ pull)
            extension = length - state.rest_lengths
            self.results |= {"energy": 0.5 * float(tension @ extension), "forces": forces, "stress": stress}

        def get_hessian(self, atoms, format="sparse", divide_by_masses=False):
            L, length, tension = _springs(atoms)
            stiffness, sigma = state.network.stiffness, tension / length
            n = L / length[:, None]
            blocks = (stiffness - sigma)[:, None, None] * n[:, :, None] * n[:, None, :]
            blocks += sigma[:, None, None] * np.eye(3)
            if format == "neighbour-list":
                pairs, vectors = np.concatenate([edges, edges[:, ::-1]]), np.concatenate([L, -L])
                lengths = np.concatenate([length, length])
                return -np.concatenate([blocks, blocks]), pairs[:, 0], pairs[:, 1], vectors, lengths
            weight = sp.bsr_array((blocks, np.arange(len(L)), np.arange(len(L) + 1)))
            return sp.csr_array(g3.T @ weight @ g3)

    network = state.network
    edges, g, b = network.edges, network.incidence, np.zeros((network.n_edges, 3))
    b[:, :2] = network.offsets @ network.cell
    g3 = sp.csr_array(sp.kron(g, sp.eye_array(3)))

    def _springs(atoms):
        L = g @ atoms.positions + b
        length = np.linalg.norm(L, axis=1)
        return L, length, network.stiffness * (length - state.rest_lengths)

    return Springs()


def _differences(springs: StrainedSprings, order: int, h: float) -> Answer:
    """d²E of relaxed springs by central differences of E (order 2) or of dE, the work of the stress (order 1)."""
    moduli, ends = [], []
    for path in (Deformation.dilation(2), Deformation.linear(pure_shear(2))):
        terms = []
        for strain in (-h, h):
            start = springs.relaxed.deformed(path.gradient(strain))
            end = equilibrium(start, pattern=springs.pattern, throw=False)
            L = end.value.bond_vectors
            work = float(end.value.sigma @ np.einsum("ad,de,ae->a", L, path.velocity(strain), L))
            terms.append(end.value.energy if order == 2 else work)
            ends.append(end)
        below, above = terms
        second = (below + above - 2 * springs.relaxed.energy) / h**2 if order == 2 else (above - below) / (2 * h)
        moduli.append(second / springs.relaxed.network.volume)
    return Answer(moduli, max(end.status for end in ends), sum(end.stats.steps for end in ends))


def _matscipy(springs: StrainedSprings) -> list[tuple]:
    """With plain conjugate gradients, and with an incomplete LU factorisation that drops next to nothing."""

    def run(preconditioner: dict[str, float] | None, residual: float) -> Answer:
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
        return Answer([float(bulk), float(C[0, 1, 0, 1] - (stress[0] + stress[1]) / 4)])

    if installed("matscipy"):
        start, calculator = atoms_of(springs.relaxed), matscipy_springs(springs.relaxed)
    return [
        ("matscipy", partial(run, None), RESIDUALS, "matscipy"),
        ("matscipy LU", partial(run, _NEARLY_EXACT), _FIRST, "matscipy", "SuperLU"),
    ]


def _stressed(n_vertices: int, seed: int) -> list[Method]:
    springs = StrainedSprings.of(n_vertices, seed)
    error = partial(relative, references.moduli(*springs.exact))
    steps = STEPS if n_vertices < LARGE else (1e-5,)

    def respond(level: float) -> Answer:
        state = replace(springs.relaxed)
        return answer_of(linear_response(state, state.network.volume, springs.pattern), "bulk", "shear")

    return [
        Method("linear response", respond, error, backend="qdldl"),
        Method("differences of stress", partial(_differences, springs, 1), error, steps),
        Method("differences of energy", partial(_differences, springs, 2), error, steps),
        *(Method(name, run, error, *rest) for name, run, *rest in _matscipy(springs)),
    ]


def _at_transition(n_vertices: int, seed: int) -> list[Method]:
    manifold, critical = random_critical(n_vertices, seed)
    strains = STRAINS if n_vertices < LARGE else STRAINS[-1:]
    error = partial(relative, references.transition_moduli(manifold, critical.sigma)[:1])

    def closed(level: float) -> Answer:
        return Answer([elasticity(replace(critical)).value.bulk])

    def past(strain: float, moduli: bool) -> Answer:
        measure, solver = "tensors" if moduli else "energy", PathSolver(pattern=manifold.hessian)
        solution = strain_path(replace(critical), [strain], measure=measure, solver=solver, throw=False)
        path = solution.value
        bulk = path.bulk_modulus[0] if moduli else 2 * path.energy[0] / (manifold.network.volume * strain**2)
        return Answer([float(bulk)], solution.status, int(path.steps[0]))

    def at_rest(level: float) -> Answer:
        return answer_of(elasticity(manifold.network, critical.coordinates), "bulk")

    methods = [
        Method("closed form", closed, error),
        Method("linear response at γ → 0", partial(past, moduli=True), error, strains, backend="qdldl"),
        Method("energy at γ → 0", partial(past, moduli=False), error, strains, backend="qdldl"),
    ]
    if n_vertices <= AT_REST:
        methods.append(Method("self-stress at rest", at_rest, error))
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
