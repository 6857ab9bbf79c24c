"""Moduli at the transition as quantities.

    W = Σ σ L·A L,   D = Σ σ²|L|²/k,   μ_A = W²/(V D).
Scalars are squared by products: the power of a number is off by a last bit that depends on its unit.
All are functions f(W, D), so that ∂O/∂σ = f_W ∂W/∂σ + f_D ∂D/∂σ and likewise for L.
The configuration does not depend on k, and ∂D/∂k = −σ²|L|²/k².

Virtual work gives Σσ L·A L = Σσ L·A L* with L* the configuration at σ = k, so by the inequality of Cauchy and Schwarz
    μ_A ≤ (1/V) Σ k|F L*|²,   F = A + W,  Wᵀ = −W,  FM symmetric for the moments M = Σ k L*L*ᵀ,
for stresses of any sign, with equality for the forces T = kFL*.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.linalg

from critflow.arguments import of_kind
from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Balanced, Partials, SpringResponse
from critflow.linalg.vectors import dot
from critflow.networks.deformation import Deformable, deformation_of
from critflow.networks.network import Array, Network
from critflow.result import InputError

ISOTROPIC = 1e-14  # anisotropy of a strain that is a dilation up to rounding
PENALTY_EXPONENT = 10  # of r/s in the penalty of small stresses, even (`ShearMod+Constraint`)
PENALTY_THRESHOLD = 0.1  # r of that penalty unless another one is given


class WorkAndCost:
    """W and D of one strain at a balance, with their derivatives by σ and L."""

    def __init__(self, balance: Balanced, A: Array):
        self.sigma, self.L, self.k, self.A = balance.sigma, balance.bond_vectors, balance.network.stiffness, A
        self.AL = self.L @ A
        self.hdot = dot(self.L, self.AL)
        self.flexibility = dot(self.L, self.L) / self.k
        self.square = self.sigma * self.sigma
        self.work, self.cost = (self.sigma @ self.hdot).item(), (self.square @ self.flexibility).item()

    def partials(self, f_W: float, f_D: float) -> Partials:
        """∂O/∂σ and ∂O/∂L of f(W, D)."""
        by_sigma = f_W * self.hdot + 2 * f_D * self.sigma * self.flexibility
        by_L = (2 * f_W * self.sigma)[:, None] * self.AL + (2 * f_D * self.square / self.k)[:, None] * self.L
        return by_sigma, by_L

    @property
    def by_stiffness(self) -> Array:
        """−∂D/∂k, (N_b,)."""
        return np.asarray(self.square * self.flexibility / self.k)


@dataclass(frozen=True, eq=False, repr=False)
class TransitionModulus(SpringResponse):
    """Modulus at the transition for b → (1 + γA) b: μ_A = (Σ σḣ)²/(V Σ σ²|L|²/k), ḣ = L·A L (`GenericModulus`).

    strain  (d, d) the affine strain A; only its symmetric part matters
    name    in tables, targets and messages
    """

    strain: Array
    name: str = "modulus"

    maximise = True

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        terms, volume = WorkAndCost(balance, self.symmetric), balance.network.volume
        ratio = terms.work / terms.cost
        by_sigma, by_L = terms.partials(2 * ratio, -ratio * ratio)
        return terms.work * ratio / volume, (by_sigma / volume, by_L / volume)

    def by_stiffness(self, balance: Balanced) -> Array:
        terms = WorkAndCost(balance, self.symmetric)
        ratio = terms.work / terms.cost
        return terms.by_stiffness * (ratio * ratio) / balance.network.volume

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return 0.0, largest_value(manifold, self.symmetric)

    @property
    def is_bulk(self) -> bool:
        """Whether the strain is the dilation of B_0."""
        return np.array_equal(self.symmetric, dilation(len(self.strain)))

    @cached_property
    def symmetric(self) -> Array:
        """The symmetric part of A, (d, d): rotations do not change the modulus."""
        return 0.5 * (self.strain + self.strain.T)


@dataclass(frozen=True, eq=False, repr=False)
class PenalisedModulus(SpringResponse):
    """μ_A − (u/N_b) Σ (s_α/r)^(−10), s = σ scaled to Σs² = N_b (`ShearMod+Constraint`): keeps every s above about r.

    u is the unit of moduli, so that the optimum does not depend on the units of stiffness and length.
    """

    modulus: TransitionModulus
    threshold: float = PENALTY_THRESHOLD

    maximise = True

    def __post_init__(self) -> None:
        if not 0 < self.threshold < np.inf:
            raise InputError(f"the threshold must be positive and finite, not {self.threshold}: stresses stay above it")

    @property
    def name(self) -> str:
        return self.modulus.name

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        value, (dO_dsigma, dO_dL) = self.modulus.evaluate(balance)
        sigma = balance.sigma
        power, square = self._powers(balance)
        total = np.add.reduce(power)
        # s scales as σ/|σ|, so the derivative in the direction of σ cancels.
        derivative = PENALTY_EXPONENT * (power / sigma - total * sigma / square) / len(sigma)
        return value - total.item() / len(sigma), (dO_dsigma + derivative, dO_dL)

    def by_stiffness(self, balance: Balanced) -> Array:
        # The unit is proportional to the mean stiffness.
        return self.modulus.by_stiffness(balance) - self._powers(balance)[0].mean() / balance.network.stiffness.sum()

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return -np.inf, self.modulus.extreme(manifold)[1]

    def preconditioner(self, balance: Balanced) -> Array | float:
        return PENALTY_EXPONENT**2 / len(balance.sigma) * self._powers(balance)[0]

    def _powers(self, balance: Balanced) -> tuple[Array, float]:
        """u (s/r)^(−10), (N_b,), and Σσ²."""
        sigma = balance.sigma
        square = (sigma @ sigma).item()
        scale = np.sqrt(len(sigma) / square) / self.threshold
        return self.unit(balance.network) * _power(1.0 / (scale * sigma) ** 2, PENALTY_EXPONENT // 2), square


def _power(x: Array, n: int) -> Array:
    """xⁿ of an integer n ≥ 1 by squares, since a general power is ten times slower."""
    if n == 1:
        return x
    half = _power(x, n // 2) ** 2
    return x * half if n % 2 else half


def is_dilation(A: Array) -> bool:
    """Whether a strain A (d, d) is a dilation up to rounding."""
    return bool(np.abs(A - A[0, 0] * np.eye(len(A))).max() <= ISOTROPIC * np.abs(A).max())


def largest_value(manifold: CriticalManifold, A: Array) -> float:
    """The largest modulus for the symmetric strain A (d, d), over all stresses of any sign."""
    F, moment = force_map(manifold.network, manifold.balance(manifold.network.stiffness).bond_vectors, A)
    return float(np.trace(F @ moment @ F.T)) / manifold.network.volume


def force_map(network: Network, L_star: Array, A: Array) -> tuple[Array, Array]:
    """F = A + W of the best force network T = kFL*, and the moments M = Σ k L*L*ᵀ: F M is symmetric."""
    M = (network.stiffness[:, None] * L_star).T @ L_star
    if is_dilation(A):
        return A, M
    W = scipy.linalg.solve_sylvester(M, M, M @ A - A @ M)
    return A + 0.5 * (W - W.T), M


def vanishes(F: Array, moment: Array, A: Array) -> bool:
    """Whether the bound Σk|FL*|² is zero up to rounding: the strain A (d, d) changes no length to first order."""
    return bool(np.trace(F @ moment @ F.T) <= ISOTROPIC**2 * np.sum(A**2) * np.trace(moment))


def dilation(dimension: int) -> Array:
    """The affine strain of dV/V = γ to first order, A = 1/d: its modulus is B_0 (`BulkModulus`)."""
    return np.eye(dimension) / dimension


def pure_shear(dimension: int) -> Array:
    """The pure shear A = ½(e_x e_yᵀ + e_y e_xᵀ): its modulus is G_0 (`ShearModulus`)."""
    if dimension < 2:
        raise InputError("a shear needs at least two dimensions")
    A = np.zeros((dimension, dimension))
    A[0, 1] = A[1, 0] = 0.5
    return A


def named_modulus(network: Network, name: str) -> TransitionModulus:
    """B_0 or G_0."""
    return _moduli(network.dimension)[name]


@cache
def _moduli(d: int) -> dict[str, TransitionModulus]:
    """The same objects at every call: those of one name are equal."""
    bulk = {"B_0": TransitionModulus(dilation(d), "B_0")}
    return bulk | ({"G_0": TransitionModulus(pure_shear(d), "G_0")} if d > 1 else {})


def transition_modulus(network: Network, strain: Deformable) -> TransitionModulus:
    """The modulus at the transition for the affine strain A (d, d), or for the start of a deformation.

    Raises `InputError` for a deformation with free components, which follow without resistance at the transition.

    >>> import critflow as cf
    >>> from critflow.critical.transition import transition_modulus
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.optimize(network, transition_modulus(network, 'dilation'), 'closed_form')
    >>> abs(found.objective - cf.upper_bound(network, 'B_0')) < 1e-9
    True
    """
    network = of_kind(Network, network=network)
    deformation = deformation_of(strain, network.dimension)
    if deformation.free:
        raise InputError(f"free components leave no modulus at the transition: fix those of {deformation.name}")
    return TransitionModulus(deformation.rate(0.0), f"modulus[{deformation.name}]")
