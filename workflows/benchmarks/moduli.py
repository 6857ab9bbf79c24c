"""Task: bulk and shear modulus past the transition, by linear response and by differences.

Differences relax the springs again at each strain, to a force of 1e-14, and difference the energy twice or the stress
once; levels are their steps over γ.  A step too large has a bias of its square, a step too small leaves rounding: of
energies over h², of stresses over h.  matscipy has Born's constants, stress and non-affine forces from our Hessian and
solves for the latter by its conjugate gradients, to a relative residual that is its level; its Birch coefficients C are
changes of the Cauchy stress, so that B = (C_xxxx + C_yyyy + 2 C_xxyy)/4 and G = C_xyxy − ½ dE/dV.
"""

from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from typing import Any

import numpy as np
import scipy.sparse as sp

from critflow import Deformation, Status, equilibrium
from critflow.linear_response import linear_response
from critflow.networks import Array
from critflow.quantities import pure_shear
from critflow.springs import SpringState

from . import references
from .springs import StrainedSprings, prepared
from .timing import TALLY, Answer, Method, Run, Task, peer

SIZES = (100, 1_000, 10_000)
# Steps of the differences over γ; half of it still keeps both sides past the transition.
STEPS = (0.5, 0.2, 0.1, 1e-2, 1e-3, 1e-4)
RESIDUALS = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
MOST_STEPS = 10_000
# Options of SciPy's `spilu`; with more dropped entries the free translations are undefined.
NEARLY_EXACT = {"drop_tol": 1e-10, "fill_factor": 50.0}
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


def _by_response(springs: StrainedSprings) -> Run:
    relaxed = prepared(springs.relaxed)

    def run(level: float) -> Answer:
        response = linear_response(replace(relaxed), relaxed.network.volume)
        return Answer([response.value.bulk, response.value.shear], response.status)

    return run


def _by_differences(springs: StrainedSprings, order: int) -> Run:
    """d²E of relaxed springs by central differences of E (order 2) or of dE, the work of the stress (order 1)."""
    relaxed = prepared(springs.relaxed)

    def run(part: float) -> Answer:
        h, moduli, ends = part * springs.gamma, [], []
        for path in (Deformation.dilation(2), Deformation.linear(pure_shear(2))):
            terms = []
            for strain in (-h, h):
                end = equilibrium(relaxed.deformed(path.gradient(strain)), throw=False)
                L = end.value.bond_vectors
                work = float(end.value.sigma @ np.einsum("ad,de,ae->a", L, path.velocity(strain), L))
                terms.append(end.value.energy if order == 2 else work)
                ends.append(end)
            below, above = terms
            second = (below + above - 2 * relaxed.energy) / h**2 if order == 2 else (above - below) / (2 * h)
            moduli.append(second / relaxed.network.volume)
        return Answer(moduli, max(end.status for end in ends))

    return run


def by_matscipy(state: SpringState, preconditioner: dict[str, float] | None) -> Run:
    """With plain conjugate gradients, or with an incomplete LU factorisation that drops next to nothing."""
    relaxed = prepared(state)
    start, calculator = atoms_of(relaxed), matscipy_springs(relaxed)

    def run(residual: float) -> Answer:
        atoms = start.copy()
        atoms.calc = calculator
        products = []
        # Forces out of the plane are rounding, which no displacement balances.
        options = {"x0": None, "rtol": residual, "atol": 1e-12, "maxiter": MOST_STEPS, "M": None}
        C = calculator.get_birch_coefficients(atoms)
        try:
            with redirect_stdout(StringIO()):
                C += peer("matscipy.elasticity").nonaffine_elastic_contribution(
                    atoms, pc_parameters=preconditioner, cg_parameters=options | {"callback": products.append}
                )
        except RuntimeError:  # of its conjugate gradients
            return Answer([np.nan, np.nan], Status.step_limit)
        finally:
            TALLY.update(evaluations=len(products))
            if preconditioner:
                TALLY.update(factorisations=1, solves=len(products))
        bulk = (C[0, 0, 0, 0] + C[1, 1, 1, 1] + C[0, 0, 1, 1] + C[1, 1, 0, 0]) / 4
        stress = calculator.get_property("stress", atoms)
        # From the change of the Cauchy stress to the second derivative of the energy.
        return Answer([float(bulk), float(C[0, 1, 0, 1] - (stress[0] + stress[1]) / 4)])

    return run


def _methods(n_vertices: int, seed: int, gamma: float) -> list[Method]:
    springs = StrainedSprings.of(n_vertices, seed, gamma)
    exact = references.moduli(*springs.exact)

    def error(moduli: Array) -> float:
        return max(references.relative_error(value, truth) for value, truth in zip(moduli, exact, strict=True))

    nearly_exact = partial(by_matscipy, springs.relaxed, NEARLY_EXACT)
    return [
        Method("linear response", partial(_by_response, springs), error, backend="qdldl"),
        Method("differences of stress", partial(_by_differences, springs, 1), error, STEPS),
        Method("differences of energy", partial(_by_differences, springs, 2), error, STEPS),
        Method("matscipy", partial(by_matscipy, springs.relaxed, None), error, RESIDUALS, "matscipy"),
        Method("matscipy LU", nearly_exact, error, _FIRST, "matscipy", "superlu"),
    ]


TASKS = (
    Task(
        "moduli",
        "bulk and shear modulus at a strain γ",
        "larger of the relative errors of B and G",
        SIZES,
        ("linear response", "differences of stress", "differences of energy", "matscipy", "matscipy LU"),
        "linear response",
        _methods,
        strained=True,
    ),
)
