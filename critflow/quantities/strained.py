"""Moduli, stress and Poisson's ratio at finite strain, with exact gradients by rest lengths, stiffnesses and stresses.

With relaxed rates L̇_a = E_a L + g u_a and ḣ_a = L·L̇_a, in equilibrium at positions x,
    V C_ab = Σ K ḣ_a ḣ_b + σ L̇_a·L̇_b  (stationary in the relaxations u, not in x),   V S = Σ σ L⊗L.
For a parameter p of the springs implicit differentiation of the force balance gives, with H y = −gᵀ ∂O/∂L,
    dO/dp = ∂O/∂p|_L + (∂σ/∂p) L·g y:
one solve with the Hessian for each quantity.  Free components q of the cell are condensed: g y gains Σ z_m L̇_m, with
the relaxed rates L̇_m and z = −(∂²E/∂q∂q)⁻¹ dO/dq.  The equilibrium does not depend on the path that leads to it, so
the path needs no derivatives.  At the transition ℓ = |L(σ)|, and the pull-back of ∂ℓ/∂L gives the gradient by σ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.quantity import Balanced, Partials, SpringResponse
from critflow.linalg.factor import Factor
from critflow.networks.deformation import Deformable, Deformation, deformation_of, strain_basis
from critflow.networks.network import Array, Network
from critflow.paths.strain_path import strain_path
from critflow.paths.tangent import path_rates
from critflow.response.linear_response import linear_response
from critflow.response.tensor import Elasticity, strain_components
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs.laws import SpringLaw
from critflow.springs.state import SpringState

SAME_LAW = 1e-12  # relative difference of tensions below which a spring law counts as homogeneous

Gradients = dict[str, Array]


@dataclass(frozen=True, eq=False, kw_only=True)
class StrainedResponse(Solution[SpringState | None]):
    """The strained state, quantities of it by name, and their gradients (N_b,) by name.

    achieved        values
    by_rest_length  dO/dℓ at constant k
    by_stiffness    dO/dk at constant ℓ
    by_stress       dO/dσ of the critical configuration from which the path starts, at constant k and with ℓ = |L(σ)|;
                    empty for paths from another state

    All are empty, and the state is None, where the path does not reach the strain.
    """

    achieved: dict[str, float] = field(default_factory=dict)
    by_rest_length: Gradients = field(default_factory=dict, repr=False)
    by_stiffness: Gradients = field(default_factory=dict, repr=False)
    by_stress: Gradients = field(default_factory=dict, repr=False)


@checked
def strained_response(
    network: Network,
    start: CriticalConfiguration | SpringState,
    strain: float,
    quantities: Sequence[str] = ("bulk_modulus", "shear_modulus"),
    *,
    deformation: Deformable = "dilation",
    law: SpringLaw | None = None,
    throw: bool = True,
) -> StrainedResponse:
    """Properties of the equilibrium at strain γ of a deformation, with exact gradients.

    quantities   "bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected" (conventions of `moduli`), "modulus"
                 (that of the path, without free components), "youngs_modulus" and "poissons_ratio" (of small additional
                 strains along x, transverse y), "S_xx", ... (Cauchy), "C_xxxx", ... (energy tensor)
    start, law   as for `strain_path`

    Gradients are those of the branch of equilibria that the path follows.  `stats.error_bound` (estimate) limits the
    relative error of the elasticity tensor.
    Raises `InputError` for unknown quantities, pinned networks, slack edges and laws that are not homogeneous,
    E'(λe, λℓ, k) = λ E'(e, ℓ, k); `SolveError` where the path stops before γ and `throw` is set.
    """
    path = deformation_of(deformation, network.dimension)
    forms = _forms(path, strain, quantities)
    if network.cell is None:
        raise InputError("moduli at finite strain are those of a periodic cell: give a network without pins")
    springs = isinstance(start, CriticalConfiguration)
    if isinstance(start, CriticalConfiguration) and not (start.sigma > 0).all():
        raise InputError("gradients at finite strain need tension on every edge: give positive stresses")
    found = strain_path(start, [strain], deformation=path, law=law, taut_only=springs, throw=False)
    if not found.ok:
        nothing = StrainedResponse(None, found.status, found.stats, found.note)
        return nothing.or_raise("the strain was not reached") if throw else nothing
    state, stretch = found.value.states[-1], found.value.free_components[-1]
    _require_homogeneous(state)
    adjoint = _Adjoint(state, path, strain, stretch)
    linearised = {name: _linearised(form, adjoint.tensors) for name, form in forms.items()}
    rows = {name: adjoint.gradients(form) for name, (_, form) in linearised.items()}
    by_rest, by_k = ({name: pair[n] for name, pair in rows.items()} for n in (0, 1))
    by_stress: Gradients = {}
    if isinstance(start, CriticalConfiguration):
        # ℓ = |L(σ)|
        balance, unit = start.manifold.balance(start.sigma), start.bond_vectors / start.lengths[:, None]
        partials = ((name, (np.zeros_like(row), row[:, None] * unit)) for name, row in by_rest.items())
        by_stress = {name: balance.pull_back(*pair)[0] for name, pair in partials}
    tensor = found.value.elasticity[-1]
    error = float(tensor.errors.tensor.max() / np.abs(tensor.tensor).max())
    return StrainedResponse(
        state,
        Status.ok,
        Stats("implicit differentiation", found.stats.steps, found.stats.residual, error_bound=error),
        achieved={name: value for name, (value, _) in linearised.items()},
        by_rest_length=by_rest,
        by_stiffness=by_k,
        by_stress=by_stress,
    )


@dataclass(frozen=True)
class StrainedQuantity(SpringResponse):
    """A property at strain γ as a quantity of the stresses at the transition.

    quantity  its name in `strained_response`
    maximise  whether the largest value is the best
    """

    quantity: str
    strain: float
    deformation: str = "dilation"
    maximise: bool = False

    @property
    def name(self) -> str:
        return f"{self.quantity} at strain {self.strain:g}"

    def unit(self, network: Network) -> float:
        return 1.0 if self.quantity == "poissons_ratio" else super().unit(network)

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        network, sigma, L = balance.network, balance.sigma, balance.bond_vectors
        critical = balance.manifold.solve(sigma).value
        found = strained_response(
            network, critical, self.strain, (self.quantity,), deformation=self.deformation, throw=False
        )
        if not found.ok:
            return np.nan, (np.full_like(sigma, np.nan), np.full_like(L, np.nan))
        by_length = found.by_rest_length[self.quantity] / np.linalg.norm(L, axis=1)
        return found.achieved[self.quantity], (np.zeros_like(sigma), by_length[:, None] * L)


def _require_homogeneous(state: SpringState) -> None:
    if state.faces is not None:
        raise InputError("gradients at finite strain are those of springs on edges: give a spring_state")
    e, rest, k = state.extension, state.rest_lengths, state.network.stiffness
    once, twice = state.law.tension(e, rest, k), state.law.tension(2 * e, 2 * rest, k)
    stiffer = state.law.tension(e, rest, 2 * k)
    scale = SAME_LAW * np.abs(once).max()
    if not (np.abs(twice - 2 * once).max() <= scale and np.abs(stiffer - 2 * once).max() <= scale):
        raise InputError(
            f"gradients at finite strain need a homogeneous law, with a tension proportional to k and ℓ at a constant "
            f"|L|/ℓ, which {type(state.law).__name__} is not: choose Hookean(), PowerLaw() or WormLike()"
        )


# Quantities as functions of the tensor and the stress


Form = Callable[[Elasticity], float]
"""A function that is linear in the tensor C and the stress S."""


def _linearised(form: Form | str, tensors: Elasticity) -> tuple[float, Form]:
    """The value of a quantity and its change with C and S: of a form, or of E = 1/s_xxxx or ν = −s_yyxx/s_xxxx.

    s is the inverse of the stress-strain tensor B, whose change is −s dB s.
    """
    if callable(form):
        return float(form(tensors)), form
    s = np.linalg.inv(tensors.stress_strain)
    stretched, across = float(s[0, 0]), float(s[1, 0])
    value = 1 / stretched if form == "youngs_modulus" else -across / stretched
    by_stretched = -value / stretched
    by_across = 0.0 if form == "youngs_modulus" else -1 / stretched
    by_B = -np.outer(by_stretched * s[0] + by_across * s[1], s[:, 0])
    return value, lambda unit: float(np.vdot(by_B, unit.stress_strain))


def _components(form: Form, tensors: Elasticity) -> list[Array]:
    """Derivatives of a form by C (m, m) and by S (d, d), shared by both entries of a symmetric pair."""
    parts = [np.zeros_like(tensors.tensor), np.zeros_like(tensors.stress)]
    for place, part in enumerate(parts):
        for a, b in zip(*np.triu_indices(len(part)), strict=True):
            C, S = units = [np.zeros_like(one) for one in parts]
            units[place][a, b] = units[place][b, a] = 1.0
            value = form(Elasticity(C, np.zeros_like(C), S, tensors.volume))
            part[a, b] = part[b, a] = value if a == b else value / 2
    return parts


def _forms(deformation: Deformation, strain: float, quantities: Sequence[str]) -> dict[str, Form | str]:
    """The requested quantities, names for those that are not linear; `InputError` for unknown ones."""
    d = deformation.dimension
    if d < 2:
        raise InputError("moduli at finite strain need two or three dimensions")
    if not np.isfinite(strain) or strain == 0:
        raise InputError(f"the strain must be finite and not zero, not {strain}: at the transition call stiffening()")
    names = strain_basis(d)[0]
    table: dict[str, Form | str] = {
        "bulk_modulus": lambda tensors: tensors.bulk,
        "shear_modulus": lambda tensors: tensors.shear,
        "shear_modulus_stress_corrected": lambda tensors: tensors.shear_stress_corrected,
        **{name: name for name in ("youngs_modulus", "poissons_ratio")},
    }
    if not deformation.free:
        A, W = deformation.velocity(strain), deformation.acceleration(strain)
        table["modulus"] = lambda tensors: tensors.second(A, A) + float(np.vdot(tensors.stress, W))
    for a, name in enumerate(names):
        i, j = ("xyz".index(axis) for axis in name)
        table[f"S_{name}"] = lambda tensors, i=i, j=j: float(tensors.stress[i, j])  # type: ignore[misc]
        for b in range(a, len(names)):
            table[f"C_{name}{names[b]}"] = lambda tensors, a=a, b=b: float(tensors.tensor[a, b])  # type: ignore[misc]
    if isinstance(quantities, str) or not len(quantities):
        raise InputError("quantities must be a list of at least one name, such as ['bulk_modulus']")
    unknown = [name for name in quantities if name not in table]
    if unknown:
        raise InputError(f"no quantity is called {unknown[0]!r:.40}: choose from {', '.join(table)}")
    return {name: table[name] for name in quantities}


# Implicit differentiation


class _Adjoint:
    """Derivatives of one state by L and by the parameters of its springs."""

    def __init__(self, state: SpringState, deformation: Deformation, strain: float, stretch: Array):
        response = linear_response(state, state.network.volume)
        self.tensors, self._state = response.value, state
        self._factor: Factor = state.factorize(state.pattern())
        L, network = state.bond_vectors, state.network
        self._E = strain_basis(network.dimension)[1]
        self._affine = np.einsum("aij,ej->aei", self._E, L)
        relaxed = [response.relaxation(strain) for strain in np.eye(len(self._E))]
        self._rates = self._affine + np.array([network.free_incidence @ u for u in relaxed])
        self._hdots = np.einsum("ei,aei->ae", L, self._rates)
        l, e, rest, k = state.lengths, state.extension, state.rest_lengths, network.stiffness
        sigma, K = state.sigma, state.modified_stiffness
        third = state.law.stiffening(e, rest, k)
        self._dK_dh = (third - 3 * K * l) / l**3
        # Tension and stiffness are homogeneous in (|L|, ℓ), of degree one and zero, and proportional to k.
        tension_by_rest = (sigma * l - l * state.edge_stiffness) / rest
        stiffness_by_rest = -l * third / rest
        # ∂σ/∂p and ∂K/∂p for p = ℓ and p = k.
        self._by_parameters = (
            (tension_by_rest / l, (stiffness_by_rest - tension_by_rest / l) / l**2),
            (sigma / k, K / k),
        )
        # Rates of the free components of the cell, and the relaxed motions with each.
        self._free_rates = path_rates(deformation, strain, deformation.gradient(strain), stretch)[0][1:]
        motions = [
            L @ A.T + network.free_incidence @ response.relaxation(strain_components(0.5 * (A + A.T)))
            for A in self._free_rates
        ]
        self._free = np.reshape(motions, (-1, *L.shape))

    def gradients(self, form: Form) -> tuple[Array, Array]:
        """Gradients by ℓ and by k of a quantity that changes by a form of C and S."""
        by_C, by_S = _components(form, self.tensors)
        state, V = self._state, self.tensors.volume
        L, sigma, K, network = state.bond_vectors, state.sigma, state.modified_stiffness, state.network
        W, S = by_C / V, by_S / V
        weighted_rates = np.einsum("ab,bei->aei", W, self._rates)
        weighted_hdots = W @ self._hdots
        SL = L @ S
        # ∂O/∂K and ∂O/∂σ of each edge.
        by_K = np.einsum("ae,ae->e", self._hdots, weighted_hdots)
        by_sigma = np.einsum("aei,aei->e", self._rates, weighted_rates) + np.einsum("ei,ei->e", L, SL)
        by_L = (self._dK_dh * by_K + K * by_sigma)[:, None] * L + 2 * sigma[:, None] * SL
        turned = np.einsum("aij,aej->ei", self._E, weighted_rates)
        by_L += 2 * sigma[:, None] * turned
        by_L += 2 * np.einsum("e,ae,aei->ei", K, weighted_hdots, self._rates + self._affine)
        adjoint = network.free_incidence @ self._solved(-np.asarray(network.divergence @ by_L))
        grown = float(np.vdot(by_C, self.tensors.tensor) + np.vdot(by_S, self.tensors.stress))
        A = self._free_rates
        by_q = np.einsum("ei,mei->m", by_L, self._free) - np.trace(A, axis1=1, axis2=2) * grown
        resistance = np.reshape([self.tensors.second(a, b) for a in A for b in A], (len(A), len(A)))
        adjoint = adjoint - np.einsum("m,mei->ei", np.linalg.solve(V * resistance, by_q), self._free)
        work = np.einsum("ei,ei->e", L, adjoint)
        by_rest, by_k = (K_by * by_K + sigma_by * (by_sigma + work) for sigma_by, K_by in self._by_parameters)
        return by_rest, by_k

    def _solved(self, force: Array) -> Array:
        """H⁻¹ f (n_free, d), refined once."""
        y = self._factor.solve(force.ravel())
        y = y + self._factor.solve(force.ravel() - self._factor.multiply(y))
        return y.reshape(force.shape)
