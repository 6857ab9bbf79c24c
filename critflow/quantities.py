"""Quantities of critical configurations: a value, its partial derivatives, and what else is known about it.

A quantity is a function of a stress σ (N_b,) and the bond vectors L (N_b, d) that it balances on one network.  The
manifold converts its two partial derivatives into a gradient and products with the Hessian of O(σ) = O(σ, L(σ))
(`evaluate`).  No quantity depends on the scale of σ, as the configuration does not.  Quantities hold no network, so
that one of them serves a network and its parts alike.

The derivatives of the partial derivatives p along (σ̇, L̇) are Im p(σ + ihσ̇, L + ihL̇)/h: no difference is taken, so
that h can be tiny and the result exact to rounding.  `evaluate` must be analytic: √ΣL² in place of a norm, sums of
products in place of np.vdot, neither abs, float nor the real part of a number that depends on σ or L.

Each quantity has a natural unit: absolute tolerances hold in it, so that results do not depend on the units of the
user.  A descent minimises ±O over the unit, a target has an error relative to its size, and at least to a hundredth of
the unit.  With the mean stiffness ⟨k⟩ and the length s = (V/N_v)^(1/d), `Network.spacing`, the units are

    ⟨k⟩ s^(2 − d)   moduli: B_0, G_0, C_B, components of the tensor
    √⟨k⟩ s          components S_xx, S_xy, ... of the stress S/√D
    s, s²           lengths of edges, areas of faces
    1               V_L, V_τ

A stress σ has Σσ² = N_b; its scale changes no configuration.  A state of springs has the units of its energy instead,
`SpringState.stiffness_scale` and `length_scale`: the mean stiffness as stretched, and the mean length at rest.

At the largest bulk modulus the Hessian ∂²B_0/∂σ∂σ is negative semidefinite.  Its null space is σ itself, because the
configuration does not depend on the scale of σ, and σ̇ = −σ e/|L| for every isogonal mode e, which keeps the tensions:
N_v/2 directions for a periodic network of three edges a vertex, of which the paper counts N_v/2 − 1, those that
change the configuration (`BulkModulusHessian`).
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from difflib import get_close_matches
from functools import cache, cached_property
from importlib.metadata import EntryPoint
from typing import ClassVar

import numpy as np
import scipy.linalg
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import of_kind, shown
from critflow.calls import running
from critflow.deformation import DEFORMATIONS, Deformable, deformation_of, strain_basis
from critflow.double_double import Extended, add, divide, extended, multiply, total, two_product
from critflow.extensions import EXTRAS, joined, loaded, more
from critflow.manifold import Balance, CriticalConfiguration, CriticalManifold, StressedBonds
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, mean, norms, quasi_random
from critflow.result import InputError, Record, Solution

DIFFERENCE = 1e-5  # relative step of central differences: their error is its square, and rounding leaves as many digits
# Relative step of derivatives by complex numbers: its square vanishes beside one, and no product underflows.
IMAGINARY = 1e-100
# Relative disagreement of a complex step and a difference beyond which a function is not analytic, and the part of the
# function itself below which a derivative is rounding.
DISAGREEMENT, NEGLIGIBLE = 1e-4, 1e-8

Factory = EntryPoint | Callable[[Network, str], "Quantity"]
"""What makes a quantity, or the entry point of it."""
Partials = tuple[Array, Array]
"""∂O/∂σ (N_b,) and ∂O/∂L (N_b, d)."""
Balanced = StressedBonds | CriticalConfiguration
"""What a quantity sees: a stress σ (N_b,), the bond vectors L (N_b, d) that it balances, network and manifold."""


class Quantity(Record, ABC):
    """A function O(σ, L) of a network; derive from this class for a new one.

    A subclass must define `evaluate`, analytic in σ and L, and must not depend on the scale of σ.  The other methods
    are optional.

    maximise         whether the largest value is the best
    one_self_stress  whether the formula is valid only for networks with one self-stress
    elastic          whether it is a response of springs, which pressures in faces would change
    analytic         whether `evaluate` takes complex σ and L, as exact second derivatives need
    """

    maximise: bool = False
    one_self_stress: ClassVar[bool] = False
    elastic: ClassVar[bool] = False
    analytic: ClassVar[bool] = True

    def __repr__(self) -> str:
        return super().__repr__() if is_dataclass(self) else f"{type(self).__name__}()"

    @property
    def name(self) -> str:
        """The name in tables, targets and messages."""
        return type(self).__name__

    @abstractmethod
    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        """O, and ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d), as (O, (∂σ, ∂L)), at the σ and L of a balance."""

    def error(self, critical: CriticalConfiguration) -> float:
        """Error (estimate) of the value at a configuration: |∂O/∂L| times the errors of the bonds, and rounding."""
        value, (by_sigma, by_L) = self.evaluate(critical)
        size = np.linalg.norm(by_L, axis=1)
        rounding = 4 * EPS * float(np.sum(np.abs(by_sigma * critical.sigma)) + size @ critical.lengths + abs(value))
        return float(size @ critical.bond_errors) + rounding

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """The smallest and the largest value that is possible on a network (proof); infinite where none is known.

        positive  whether every stress is positive
        """
        return -np.inf, np.inf

    def best_known(self, manifold: CriticalManifold) -> Solution[CriticalConfiguration] | None:
        """The `Optimum` of positive stresses, with a proof and without a descent; None where none is known."""
        return None

    def unit(self, network: Network) -> float:
        """The natural unit of the values on a network (table of this module): 1 by default."""
        return 1.0

    def preconditioner(self, balance: Balanced) -> Array | float:
        """Diagonal Hessian (N_b,) of a penalty in log σ, of the sign ≥ 0 when minimised: the first matrix of L-BFGS."""
        return 0.0


class SpringResponse(Quantity):
    """A response of springs, such as a modulus, by a formula that is valid for one self-stress only."""

    one_self_stress: ClassVar[bool] = True
    elastic: ClassVar[bool] = True

    def unit(self, network: Network) -> float:
        d = network.dimension
        return mean(network.stiffness) * (1.0 if d == 2 else network.spacing ** (2 - d))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A quantity at one stress, with the factor that products with its Hessian need."""

    quantity: Quantity
    balance: Balance
    value: float  # O
    gradient: Array  # dO/dσ, (N_b,) (`TotalDeriv`)
    adjoint: Array  # g P⁻¹ gᵀ ∂O/∂L, (N_b, d)

    @property
    def residual(self) -> float:
        """The largest component of dO/dσ, in the unit of O."""
        return float(np.abs(self.gradient).max()) / self.quantity.unit(self.balance.network)

    def hessian_product(self, dsigma: Array) -> Array:
        """(∂²O/∂σ∂σ) σ̇, (N_b,), by two solves."""
        balance = self.balance
        dL = balance.tangent(dsigma)
        second = derivatives_along(self.quantity, balance, dsigma, dL)
        return balance.pull_back_tangent(dL, self.adjoint, dsigma, second)

    def hessian_difference(self, dsigma: Array) -> Array:
        """(∂²O/∂σ∂σ) σ̇, (N_b,), to nine digits, by the gradients at two stresses."""
        balance = self.balance
        step = DIFFERENCE / float(np.abs(dsigma / balance.sigma).max())
        ends = [evaluate(balance.manifold.balance(balance.sigma + s * dsigma), self.quantity) for s in (step, -step)]
        return (ends[0].gradient - ends[1].gradient) / (2 * step)


def derivatives_along(quantity: Quantity, balance: Balanced, dsigma: Array, dL: Array) -> Partials:
    """Derivatives of ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d) in the direction (σ̇, L̇), by a complex step."""
    sigma, L = balance.sigma, balance.bond_vectors
    of_dsigma, of_sigma, of_dL, of_L = (float(values.ravel() @ values.ravel()) for values in (dsigma, sigma, dL, L))
    size = float(np.sqrt(of_dsigma / of_sigma + of_dL / of_L))
    if size == 0:
        return np.zeros_like(sigma), np.zeros_like(L)
    h = IMAGINARY / size
    # Two parts, without the products of real + 1j imaginary.
    shifted_sigma, shifted_L = sigma.astype(complex, "C"), L.astype(complex, "C")
    shifted_sigma.imag, shifted_L.imag = h * dsigma, h * dL
    there = StressedBonds(balance.manifold, shifted_sigma, shifted_L)
    # Division by NaN, the derivative of a length that vanishes, warns for complex numbers only.
    with np.errstate(invalid="ignore"):
        _, (by_sigma, by_L) = quantity.evaluate(there)
    return np.imag(by_sigma) / h, np.imag(by_L) / h


def evaluate(balance: Balance, quantity: Quantity) -> Evaluation:
    """Value and gradient of a quantity at a balance, by d solves."""
    value, partials = quantity.evaluate(balance)
    gradient, adjoint = balance.pull_back(*partials)
    return Evaluation(quantity, balance, value, gradient, adjoint)


# Variances of lengths and of tensions.


class LengthVariance(Quantity):
    """V_L = ⟨(|L| − ⟨|L|⟩)²⟩/⟨|L|⟩² (`LengthVariance`)."""

    name: ClassVar[str] = "V_L"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        L = balance.bond_vectors
        length = norms(L)
        variance, derivative = _relative_variance(length)
        return variance, (np.zeros_like(length), (derivative / divisors(length))[:, None] * L)

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return 0.0, np.inf


class TensionVariance(Quantity):
    """V_τ = ⟨(τ − ⟨τ⟩)²⟩/⟨τ⟩² of the tensions τ = σ|L| (`TensionVariance`)."""

    name: ClassVar[str] = "V_tau"
    extreme = LengthVariance.extreme

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        sigma, L = balance.sigma, balance.bond_vectors
        length = norms(L)
        variance, derivative = _relative_variance(sigma * length)
        return variance, (derivative * length, (derivative * sigma / divisors(length))[:, None] * L)


VARIANCES = {kind.name: kind() for kind in (LengthVariance, TensionVariance)}  # the same objects at every call


def divisors(length: Array) -> Array:
    """Lengths (N_b,), NaN for an edge without length: there |L| has no derivative."""
    return np.where(length.real > 0, length, np.nan)


def _relative_variance(values: Array) -> tuple[float, Array]:
    """⟨(v − ⟨v⟩)²⟩/⟨v⟩² of numbers v (n,), and its derivatives by them, also of complex numbers."""
    # The bits of `values.mean()`, which takes three times as long for small networks.
    mean = np.add.reduce(values).item() / len(values)
    deviation, square = values - mean, mean * mean  # not a power, whose last bit depends on the units
    variance = np.add.reduce(deviation * deviation).item() / len(values) / square
    return variance, 2 / (len(values) * square) * (deviation - variance * mean)


# Moduli at the transition as quantities.
#
#     W = Σ σ L·A L,   D = Σ σ²|L|²/k,   μ_A = W²/(V D).
# Scalars are squared by products: the power of a number is off by a last bit that depends on its unit.
#
# Virtual work gives Σσ L·A L = Σσ L·A L* with L* the configuration at σ = k, so by the inequality of Cauchy and Schwarz
#     μ_A ≤ (1/V) Σ k|F L*|²,   F = A + W,  Wᵀ = −W,  FM symmetric for the moments M = Σ k L*L*ᵀ,
# for stresses of any sign, with equality for the forces T = kFL*.

ISOTROPIC = 1e-14  # anisotropy of a strain that is a dilation up to rounding
PENALTY_EXPONENT = 10  # of r/s in the penalty of small stresses, even (`ShearMod+Constraint`)
PENALTY_THRESHOLD = 0.1  # r of that penalty unless another one is given


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
        sigma, L, k, volume = balance.sigma, balance.bond_vectors, balance.network.stiffness, balance.network.volume
        AL, square = L @ self.symmetric, sigma * sigma
        hdot, flexibility = dot(L, AL), dot(L, L) / k
        work, cost = (sigma @ hdot).item(), (square @ flexibility).item()
        # ∂μ/∂W = 2W/(V D) and ∂μ/∂D = −W²/(V D²).
        ratio = work / cost
        by_sigma = 2 * ratio * hdot - 2 * ratio * ratio * sigma * flexibility
        by_L = (4 * ratio * sigma)[:, None] * AL - (2 * ratio * ratio * square / k)[:, None] * L
        return work * ratio / volume, (by_sigma / volume, by_L / volume)

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
        power, square = self.powers(balance)
        total = np.add.reduce(power)
        # s scales as σ/|σ|, so the derivative in the direction of σ cancels.
        derivative = PENALTY_EXPONENT * (power / sigma - total * sigma / square) / len(sigma)
        return value - total.item() / len(sigma), (dO_dsigma + derivative, dO_dL)

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return -np.inf, self.modulus.extreme(manifold)[1]

    def preconditioner(self, balance: Balanced) -> Array | float:
        return PENALTY_EXPONENT**2 / len(balance.sigma) * self.powers(balance)[0]

    def powers(self, balance: Balanced) -> tuple[Array, float]:
        """u (s/r)^(−10), (N_b,), and Σσ²."""
        sigma = balance.sigma
        square = (sigma @ sigma).item()
        scale = np.sqrt(len(sigma) / square) / self.threshold
        # By squares, from the digits of half the exponent: a general power is ten times slower.
        power = inverse = 1.0 / (scale * sigma) ** 2
        for digit in f"{PENALTY_EXPONENT // 2:b}"[1:]:
            power = inverse * power**2 if digit == "1" else power**2
        return self.unit(balance.network) * power, square


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


def pure_shears(dimension: int) -> list[Array]:
    """All (d − 1)(d + 2)/2 pure shears, symmetric and without trace, orthogonal and with A:A = ½."""
    _, strains = strain_basis(dimension)
    diagonals = [np.diag([1.0] * i + [-i] + [0.0] * (dimension - 1 - i)) for i in range(1, dimension)]
    return [*strains[dimension:], *(A / np.sqrt(2 * np.sum(A**2)) for A in diagonals)]


@cache
def named_modulus(dimension: int, name: str) -> TransitionModulus:
    """B_0 or G_0: the same object at every call, since those of one name are equal."""
    return TransitionModulus((dilation if name == "B_0" else pure_shear)(dimension), name)


def transition_modulus(network: Network, strain: Deformable) -> TransitionModulus:
    """The modulus at the transition for the affine strain A (d, d), or for the start of a deformation.

    Raises `InputError` for a deformation with free components, which follow without resistance at the transition.

    >>> import critflow as cf
    >>> from critflow.quantities import transition_modulus
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


# Error of a modulus at the transition: of its bond vectors, of the rounding of σ, and of its sums.
#
# Errors δL of the bond vectors and the rounding of σ change a modulus by its partial derivatives, to first order, and
# by a second order that is bounded in closed form; the rounding of its sums is measured in extended precision.  The
# errors are proved for bond vectors whose `bond_errors` are; where those are estimates (stresses of both signs) so are
# they.


def transition_modulus_error(
    A: Array, critical: CriticalConfiguration, volume: float | None = None, roundings: int = 1
) -> float:
    """Error of one modulus μ_A = w²/(Vc), w = Σσḣ, c = Σσ²|L|²/k, at a configuration, for a symmetric strain A.

    roundings  how often σ was scaled
    """
    sigma, L, dL = critical.sigma, critical.bond_vectors, critical.bond_errors
    k, V = critical.network.stiffness, critical.network.volume if volume is None else volume
    size, AL = np.abs(sigma), L @ A
    length, stretch = critical.lengths, np.linalg.norm(AL, axis=1)
    hdot = np.abs(dot(L, AL))
    work, cost = sigma @ dot(L, AL), sigma**2 @ (length**2 / k)
    ratio = float(work / cost)

    value, (dO_dsigma, dO_dL) = TransitionModulus(A).evaluate(critical)
    scale = critical.network.volume / V
    value, dO_dsigma, dO_dL = value * scale, dO_dsigma * scale, dO_dL * scale
    # σ is rounded from the stress that was solved for.
    first = np.linalg.norm(dO_dL, axis=1) @ dL + 0.5 * roundings * EPS * (np.abs(dO_dsigma) @ size)
    # f = w²/c changes by its first order and, exactly, (δw − f_w δc/2)²/(c + δc) more; w and c are quadratic in L.
    second_work = float(np.linalg.norm(A, 2) * (size @ dL**2))
    second_cost = float((sigma**2 / k) @ dL**2)
    dwork = 2 * (size * stretch) @ dL + 0.5 * EPS * (size @ hdot) + second_work
    dcost = 2 * (sigma**2 * length / k) @ dL + EPS * cost + second_cost
    if dcost >= cost:
        return np.inf
    change = dwork + abs(ratio) * dcost
    curved = 2 * abs(ratio) * second_work + ratio * ratio * second_cost + change * change / (cost - dcost)
    return float(first + curved / V + _sum_rounding(A, critical, V, value) + _input_rounding(critical, value))


def _sum_rounding(A: Array, critical: CriticalConfiguration, volume: float, value: float) -> float:
    """|μ − w²/(Vc)| with w and c of the same σ and L in extended precision."""
    sigma, L, k = critical.sigma, critical.bond_vectors, critical.network.stiffness
    stress, components = extended(sigma), [np.ascontiguousarray(axis) for axis in L.T]
    hdot, square = (Extended(np.zeros_like(sigma), np.zeros_like(sigma)) for _ in range(2))
    for i, j in np.ndindex(A.shape):
        product = two_product(components[i], components[j])
        if A[i, j]:
            hdot = add(hdot, multiply(extended(np.full_like(sigma, A[i, j])), product))
        if i == j:
            square = add(square, product)
    tension = multiply(multiply(stress, stress), square)
    work = total(multiply(stress, hdot))
    cost = total(divide(tension, extended(k)))
    exact = divide(multiply(work, work), multiply(cost, extended(np.array([volume]))))
    return float(abs((value - exact.high[0]) - exact.low[0]))


def _input_rounding(critical: CriticalConfiguration, value: float) -> float:
    """Error of a modulus by the rounding of the volume, a determinant, and of the strain, 1/d."""
    cell = critical.network.cell
    if cell is None:
        return 2 * EPS * abs(value)
    skew = float(np.prod(np.linalg.norm(cell, axis=1))) / critical.network.volume
    return EPS * abs(value) * (2 + 2 * len(cell) * skew)


# Checks of classes of users: numbers, shapes and derivatives, and whether `evaluate` takes complex numbers.


def own(quantity: Quantity) -> bool:
    """Whether the class of a quantity is one of critflow or critflow-extras, which have tests of their own."""
    return type(quantity).__module__.partition(".")[0] in ("critflow", EXTRAS)


def require_valid(quantity: Quantity, balance: Balanced) -> None:
    """Raise `InputError` where `evaluate` of a class of the user returns no finite number, or not its derivatives.

    A call asks this once: for numbers and shapes at its first stress, where all edges have a length, and for the
    derivatives at a stress without symmetry.
    """
    if own(quantity):
        return
    kind, L = type(quantity), balance.bond_vectors
    if not np.isfinite(L).all() or not (norms(L) > 0).all():
        return
    with np.errstate(all="ignore"):
        returned = quantity.evaluate(balance)
    try:
        value, (by_sigma, by_L) = returned
    except (TypeError, ValueError):
        raise InputError(f"{kind.__name__}.evaluate must return (O, (∂O/∂σ, ∂O/∂L)), not {shown(returned)}") from None
    if not (isinstance(value, int | float | np.number) or np.shape(value) == ()) or not np.isfinite(value):
        raise InputError(f"{kind.__name__}.evaluate must return a finite number O first, not {shown(value)}")
    for name, partial, shape in (("∂O/∂σ", by_sigma, L.shape[:1]), ("∂O/∂L", by_L, L.shape)):
        if np.shape(partial) != shape:
            raise InputError(
                f"{kind.__name__}.evaluate must return {name} as an array of shape {shape}, not {np.shape(partial)}"
            )
        finite = np.isfinite(partial).reshape(len(L), -1).all(axis=1)
        if not finite.all():
            raise InputError(f"{kind.__name__}.evaluate returns {name} that is not finite at edge {finite.argmin()}")
    if isinstance(balance.manifold, CriticalManifold):
        _require_derivatives(quantity, balance.manifold)


def _require_derivatives(quantity: Quantity, manifold: CriticalManifold) -> None:
    """Raise `InputError` where a value depends on the scale of σ, or dO/dσ differs from differences of the value."""
    name, here = type(quantity).__name__, _without_symmetry(manifold)
    sigma, direction = here.sigma, here.sigma * (0.5 + quasi_random(len(here.sigma))[::-1])

    def value(stress: Array) -> float:
        return float(quantity.evaluate(manifold.balance(stress))[0])

    def by_difference(step: Array) -> float:
        return (value(sigma + step) - value(sigma - step)) / (2 * DIFFERENCE)

    with np.errstate(all="ignore"):
        known = evaluate(here, quantity)
        doubled, step = value(2 * sigma), DIFFERENCE * direction
        if abs(doubled - known.value) > DISAGREEMENT * max(abs(doubled), abs(known.value)):
            raise InputError(
                f"{name}.evaluate returns {known.value:.6g} at σ and {doubled:.6g} at 2σ: the scale of σ changes no "
                "configuration, divide by the mean of σ or of σ|L|"
            )
        parts = known.gradient * direction
        tolerance = DISAGREEMENT * float(np.linalg.norm(parts)) + NEGLIGIBLE * abs(known.value)
        slope = by_difference(step)
        # Near a point without derivatives, or with values of few digits, differences decide nothing.
        if not abs(parts.sum() - slope) > tolerance or not abs(10 * by_difference(0.1 * step) - slope) < tolerance:
            return
        edges = np.arange(len(sigma))
        while len(edges) > 1:
            halves = [np.isin(np.arange(len(sigma)), half) for half in np.array_split(edges, 2)]
            edges = np.flatnonzero(max(halves, key=lambda half: abs(parts[half].sum() - by_difference(half * step))))
        edge = int(edges[0])
        found = by_difference(np.where(np.arange(len(sigma)) == edge, step, 0.0)) / direction[edge]
    raise InputError(
        f"{name}.evaluate returns derivatives that its values do not have: dO/dσ of edge {edge} is "
        f"{known.gradient[edge]:.6g} by ∂O/∂σ and ∂O/∂L, and {found:.6g} by differences of O"
    )


def _without_symmetry(manifold: CriticalManifold) -> Balance:
    """A balance at stresses between e^−1.5 and e^1.5, at which terms that vanish at σ = 1 do not."""
    return manifold.balance(np.exp(3 * quasi_random(manifold.network.n_edges) - 1.5))


def has_exact_hessian(manifold: CriticalManifold, quantity: Quantity) -> bool:
    """Whether `Evaluation.hessian_product` holds; for the classes of critflow tests know."""
    return quantity.analytic and (own(quantity) or takes_complex_steps(manifold, quantity))


def takes_complex_steps(manifold: CriticalManifold, quantity: Quantity) -> bool:
    """Whether a complex step agrees with differences of partial derivatives.

    A norm or an absolute value takes complex numbers and loses the derivative; other functions refuse them.  That is a
    property of the code of `evaluate`, so that one direction shows it, at a stress where no term vanishes.
    """
    here = _without_symmetry(manifold)
    sigma, L = here.sigma, here.bond_vectors
    dsigma, dL = sigma * (0.5 + quasi_random(len(sigma))), L * (0.5 + quasi_random(L.size)[::-1].reshape(L.shape))
    with np.errstate(all="ignore"):
        try:
            exact = derivatives_along(quantity, here, dsigma, dL)
        except InputError:  # which would meet real numbers as well
            raise
        except (TypeError, ValueError, np.exceptions.ComplexWarning):
            return False
        above, below = (
            quantity.evaluate(StressedBonds(manifold, sigma + step * dsigma, L + step * dL))[1]
            for step in (DIFFERENCE, -DIFFERENCE)
        )
        for derivative, up, down in zip(exact, above, below, strict=True):
            difference = (up - down) / (2 * DIFFERENCE)
            change, size = (np.abs(values[np.isfinite(values)]).max(initial=0.0) for values in (difference, up))
            tolerance = DISAGREEMENT * change + NEGLIGIBLE * size
            if not np.allclose(derivative, difference, rtol=0, atol=tolerance, equal_nan=True):
                return False
        return True


def require_exact_hessian(manifold: CriticalManifold, quantity: Quantity) -> None:
    """Raise `InputError` where products with the Hessian are not exact, which Newton's method needs."""
    name = quantity.name
    if not quantity.analytic:
        raise InputError(f"Newton's method needs second derivatives, and {name} has none: choose method='lbfgs'")
    if not has_exact_hessian(manifold, quantity):
        raise InputError(
            f"Newton's method evaluates {name} at complex stresses and bond vectors, which its evaluate does not take: "
            "write np.sqrt((L*L).sum(axis=1)) for lengths, without norm, abs, float, vdot or .real, or choose 'lbfgs'"
        )


# Names of quantities, their largest possible values, and their Hessians over stress

# The vocabulary of quantities: one name each.
#
# B_0 G_0       bulk and shear modulus at the transition
# V_L V_tau     variances of lengths and of tensions
# modulus[D]    modulus of a deformation D, such as modulus[uniaxial]

ALIASES = {
    "bulk_modulus": "B_0",
    "shear_modulus": "G_0",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
"""Long spellings of names."""

# Names of what elasticity has by direction, and its method.
_BY_DIRECTION = {
    **dict.fromkeys(("nu", "ν", "poisson", "poissons_ratio"), "poisson"),
    **dict.fromkeys(("E", "young", "youngs_modulus"), "young"),
}


def quantity(network: Network, name: str | Quantity) -> Quantity:
    """The quantity of a name, or the given quantity itself.

    network  of the quantity, or an object that has one; only its dimension, edges and faces matter

    Raises `InputError` for unknown names, with the nearest right one and the list.

    >>> import critflow as cf
    >>> cf.quantity(cf.lattice("honeycomb", 2, 2), 'bulk_modulus').name
    'B_0'
    """
    network = of_kind(Network, network=network)
    name = of_kind(str, Quantity, name=name)
    if isinstance(name, Quantity):
        return name
    argument, known = ALIASES.get(name, name), names(network)
    factory = None if "[" in argument else known.get(argument)
    if bracketed := re.fullmatch(r"(\w+)\[([^\[\]]+)\]", argument):
        stem, argument = bracketed.groups()
        kind, factory = _indexed().get(stem, ("", None))
        if (kind == "D" and argument not in DEFORMATIONS) or (kind in ("EDGE", "FACE") and not argument.isdecimal()):
            factory = None
    if not factory:
        raise InputError(_unknown(network, name))
    # An entry point may be of the package importlib_metadata, which dask imports.
    measured: Quantity = (factory if callable(factory) else loaded(factory))(network, argument)
    return measured


def names(network: Network) -> Mapping[str, Factory]:
    """The names of all quantities of a network and their factories, with a placeholder for a number in brackets."""
    axes = strain_basis(network.dimension)[0]
    spelled = {
        "S_AXES": [f"S_{one}" for one in axes],
        "C_AXES": [f"C_{one}{other}" for a, one in enumerate(axes) for other in axes[a:]],
        "G_0": ["G_0"] * (network.dimension > 1),
        **{f"{stem}[D]": [f"{stem}[{D}]" for D in DEFORMATIONS] for stem in _indexed()},
    }
    return {one: factory for name, factory in _factories().items() for one in spelled.get(name, [name])}


def _factories() -> Mapping[str, Factory]:
    """Factories by name: those of this module and the entry points `critflow.quantities`.

    A factory takes the network, and the text in brackets or else the whole name.  D is the name of a deformation.
    AXES are those of a component of the stress or, after C, of the elasticity tensor, EDGE and FACE a number; what else
    stands in brackets goes to the factory as it is written.
    """
    moduli = dict.fromkeys(("B_0", "G_0"), lambda network, name: named_modulus(network.dimension, name))
    variances = dict.fromkeys(VARIANCES, lambda _, name: VARIANCES[name])
    return {**moduli, **variances, "modulus[D]": transition_modulus, **joined("quantities")}


def _indexed() -> dict[str, tuple[str, Factory]]:
    """What stands in brackets and the factory, by the part of the name before them."""
    split = [(*name.rstrip("]").partition("["), factory) for name, factory in _factories().items()]
    return {stem: (kind, factory) for stem, _, kind, factory in split if kind}


def _unknown(network: Network, name: str) -> str:
    """The sentence for a name that no quantity has."""
    if name in _BY_DIRECTION:
        return f"no quantity is called {name!r}: elasticity(...).value.{_BY_DIRECTION[name]}(direction) has it"
    listed, kinds = names(network), {stem: kind for stem, (kind, _) in _indexed().items()}
    spellings = [*listed, *(alias for alias, symbol in ALIASES.items() if symbol in listed)]
    same_letters = [spelling for spelling in spellings if spelling.casefold() == name.casefold()]
    nearest = same_letters or get_close_matches(name, spellings, 1, 0.5)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    short = [one for one in listed if len(one) < 6 and not one.startswith("S_")]
    components = ["S_xx", "C_xxyy"] * ("S_AXES" in _factories())
    numbered = [f"{stem}[{kind}]" for stem, kind in kinds.items() if kind != "D"]
    *deformed, last = [f"{stem}[D]" for stem, kind in kinds.items() if kind == "D"]
    return (
        f"no quantity is called {name!r:.40}: {hint}choose from "
        f"{', '.join([*short, *components, *numbered])}, and "
        f"{' or '.join([', '.join(deformed)] * bool(deformed) + [last])} of a deformation D: {', '.join(DEFORMATIONS)}"
        f"{more('quantities, such as C_B and onset[D]')}"
    )


# The largest possible values of quantities over all stresses of a network, in closed form.


@running("upper_bound")
def upper_bound(network: Network | CriticalManifold, name: str | Quantity) -> float:
    """The largest possible value of a quantity under tension on a network in closed form; infinite without one.

    Error bound (proof, up to rounding).  B_0 ≤ (1/d²V) Σ k|L*|² with L* the configuration at σ = k; every other modulus
    at the transition likewise, and for stresses of any sign.  `quantity(network, name).extreme` has the smallest
    possible value too, and those for stresses of any sign.

    >>> import critflow as cf
    >>> round(cf.upper_bound(cf.lattice("honeycomb", 2, 2), 'B_0'), 6)
    0.288675
    """
    manifold = CriticalManifold.of(network)
    return quantity(manifold.network, name).extreme(manifold)[1]


FLAT = 1e-9  # eigenvalues of a stress Hessian below this part of the largest are zero; rounding leaves about 1e-13
DENSE_EDGES = 2000  # most edges for all eigenvalues of a stress Hessian: 32 MB and some seconds


@dataclass(frozen=True, eq=False, repr=False)
class FlatDirections(Record):
    """The directions in stress along which a quantity does not change to second order.

    directions   orthonormal σ̇ of zero curvature, (n_flat, N_b); σ/|σ| lies in their span
    eigenvalues  of the Hessian at Σσ² = N_b, ascending, (N_b,)
    gap          largest |eigenvalue| counted as zero and the next one, relative to the largest of all
    """

    directions: Array
    eigenvalues: Array
    gap: tuple[float, float]

    @property
    def n_flat(self) -> int:
        """The nullity, scaling of σ included."""
        return len(self.directions)


@running("stress_hessian")
def stress_hessian(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> LinearOperator:
    """∂²O/∂σ∂σ at Σσ² = N_b, configuration following σ, as an operator (N_b, N_b) (`BulkModulusHessian`).

    A product costs two solves on the factor of P; the matrix itself is never formed.  Where `evaluate` of the quantity
    does not take complex σ and L, as for C_B and C_G, it is a difference of gradients with nine digits.
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    manifold, goal = critical.manifold, quantity(critical.network, name)
    require_valid(goal, critical)
    evaluation = evaluate(manifold.balance(manifold.configuration(critical.sigma).sigma), goal)
    product = evaluation.hessian_product if has_exact_hessian(manifold, goal) else evaluation.hessian_difference

    def apply(direction: Array) -> Array:
        return product(np.ravel(direction))

    n = critical.network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)


@running("flat_directions")
def flat_directions(
    critical: CriticalConfiguration, name: str | Quantity = "B_0", tolerance: float = FLAT
) -> FlatDirections:
    """Null space of the Hessian of a quantity over stress, by all its eigenvalues.

    tolerance  eigenvalues of at most this part of the largest are zero

    Meant for an optimum: elsewhere ∂²O/∂σ∂σ σ = −dO/dσ, so that not even the scaling of σ is flat.  Raises
    `InputError` for networks of more than 2,000 edges.

    >>> import critflow as cf
    >>> from critflow.quantities import flat_directions
    >>> flat_directions(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).n_flat
    4
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    of_kind(float, tolerance=tolerance)
    n = critical.network.n_edges
    if n > DENSE_EDGES:
        raise InputError(f"{n} edges are more than {DENSE_EDGES}: use the products of stress_hessian()")
    operator = stress_hessian(critical, name)
    columns = operator @ np.eye(n)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (columns + columns.T))
    size = np.abs(eigenvalues) / np.abs(eigenvalues).max()
    zero = size <= tolerance
    gap = (float(size[zero].max(initial=0.0)), float(size[~zero].min(initial=np.inf)))
    return FlatDirections(vectors[:, zero].T, eigenvalues, gap)
