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
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import shown
from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import mean, norms, quasi_random
from critflow.networks.network import Array, Network
from critflow.result import InputError, Record

DIFFERENCE = 1e-5  # relative step of central differences: their error is its square, and rounding leaves as many digits
# Relative step of derivatives by complex numbers: its square vanishes beside one, and no product underflows.
IMAGINARY = 1e-100
# Relative disagreement of a complex step and a difference beyond which a function is not analytic, and the part of the
# function itself below which a derivative is rounding.
DISAGREEMENT, NEGLIGIBLE = 1e-4, 1e-8

Mask = NDArray[np.bool_]
Partials = tuple[Array, Array]
"""∂O/∂σ (N_b,) and ∂O/∂L (N_b, d)."""


class Balanced(Protocol):
    """A stress σ (N_b,) and bond vectors L (N_b, d) of one network: a `Balance` or a `CriticalConfiguration`."""

    @property
    def network(self) -> Network: ...
    @property
    def sigma(self) -> Array: ...
    @property
    def bond_vectors(self) -> Array: ...
    @property
    def manifold(self) -> CriticalManifold: ...


@dataclass(frozen=True, eq=False)
class StressedBonds:
    """A stress σ (N_b,) and bond vectors L (N_b, d) without coordinates: a `Balanced` where P is not needed."""

    manifold: CriticalManifold
    sigma: NDArray[Any]
    bond_vectors: NDArray[Any]

    @property
    def network(self) -> Network:
        return self.manifold.network


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

    @property
    def name(self) -> str:
        """The name in tables, targets and messages."""
        return type(self).__name__

    @abstractmethod
    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        """O, and ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d), as (O, (∂σ, ∂L)), at the σ and L of a balance."""

    def by_stiffness(self, balance: Balanced) -> Array:
        """∂O/∂k (N_b,) at constant σ and L; by central differences unless a subclass knows better."""
        network, rows = balance.network, np.empty(balance.network.n_edges)
        for edge, k in enumerate(network.stiffness):
            ends = []
            for sign in (1, -1):
                stiffness = network.stiffness.copy()
                stiffness[edge] = k * (1 + sign * DIFFERENCE)
                changed = network.with_stiffness(stiffness)
                there = StressedBonds(CriticalManifold.of(changed), balance.sigma, balance.bond_vectors)
                ends.append(self.evaluate(there)[0])
            rows[edge] = (ends[0] - ends[1]) / (2 * DIFFERENCE * k)
        return rows

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

    def best_stress(self, manifold: CriticalManifold) -> Array | None:
        """σ (N_b,) at which the best value over positive stresses is attained (proof), or None where none is known."""
        return None

    def in_part(self, network: Network, kept: Mask) -> Quantity | None:
        """The same quantity of the part of a network with the kept edges (N_b,), which has numbers of its own.

        None where the part has lost an edge or a face that the quantity names by its number.  A quantity that names
        none, as by default, is itself.
        """
        return self

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
        ends = [evaluate(balance.manifold, self.quantity, balance.sigma + s * dsigma) for s in (step, -step)]
        return (ends[0].gradient - ends[1].gradient) / (2 * step)


def only_positive(signs: str) -> bool:
    """Whether stresses are positive; `InputError` for other words than "positive" and "any"."""
    if signs not in ("positive", "any"):
        raise InputError(f"signs must be 'positive' or 'any', not {signs!r}")
    return signs == "positive"


def own(quantity: Quantity) -> bool:
    """Whether the class of a quantity is one of critflow, which has tests of its own."""
    return type(quantity).__module__.partition(".")[0] == __name__.partition(".")[0]


def require_valid(quantity: Quantity, balance: Balanced) -> None:
    """Raise `InputError` where `evaluate` of a class of the user returns no finite number and partials of these shapes.

    A call asks this once, at its first stress; where edges have no length, derivatives may not exist.
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


def derivatives_along(quantity: Quantity, balance: Balanced, dsigma: Array, dL: Array) -> Partials:
    """Derivatives of ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d) in the direction (σ̇, L̇), by a complex step."""
    sigma, L = balance.sigma, balance.bond_vectors
    size = float(np.sqrt(_square(dsigma) / _square(sigma) + _square(dL) / _square(L)))
    if size == 0:
        return np.zeros_like(sigma), np.zeros_like(L)
    h = IMAGINARY / size
    there = StressedBonds(balance.manifold, _complex(sigma, h * dsigma), _complex(L, h * dL))
    # Division by NaN, the derivative of a length that vanishes, warns for complex numbers only.
    with np.errstate(invalid="ignore"):
        _, (by_sigma, by_L) = quantity.evaluate(there)
    return np.imag(by_sigma) / h, np.imag(by_L) / h


def _square(values: Array) -> float:
    """The sum of squares."""
    flat = values.ravel()
    return float(flat @ flat)


def _complex(real: Array, imaginary: Array) -> NDArray[np.complex128]:
    """Complex numbers of two parts, without the products of real + 1j imaginary."""
    numbers = np.empty(real.shape, complex)
    numbers.real, numbers.imag = real, imaginary
    return numbers


def has_exact_hessian(manifold: CriticalManifold, quantity: Quantity) -> bool:
    """Whether `Evaluation.hessian_product` holds; for the classes of critflow tests know."""
    return quantity.analytic and (own(quantity) or takes_complex_steps(manifold, quantity))


def takes_complex_steps(manifold: CriticalManifold, quantity: Quantity) -> bool:
    """Whether a complex step agrees with differences of partial derivatives.

    A norm or an absolute value takes complex numbers and loses the derivative; other functions refuse them.  That is a
    property of the code of `evaluate`, so that one direction at σ = 1 shows it.
    """
    here = manifold.balance(np.ones(manifold.network.n_edges))
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
        return all(_agrees(*three) for three in zip(exact, above, below, strict=True))


def _agrees(exact: Array, above: Array, below: Array) -> bool:
    """Whether a derivative is the difference of values at two points, up to the error of that difference."""
    difference = (above - below) / (2 * DIFFERENCE)
    tolerance = DISAGREEMENT * _largest(difference) + NEGLIGIBLE * _largest(above)
    return np.allclose(exact, difference, rtol=0, atol=tolerance, equal_nan=True)


def _largest(values: Array) -> float:
    """The largest finite size of a component."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


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


def evaluate(manifold: CriticalManifold, quantity: Quantity, sigma: Array) -> Evaluation:
    """Value and gradient of a quantity at a stress σ (N_b,), unchecked, by one factorisation and 2d solves."""
    return evaluate_at(manifold.balance(sigma), quantity)


def evaluate_at(balance: Balance, quantity: Quantity) -> Evaluation:
    """Value and gradient of a quantity at a balance, by d solves."""
    value, partials = quantity.evaluate(balance)
    gradient, adjoint = balance.pull_back(*partials)
    return Evaluation(quantity, balance, value, gradient, adjoint)
