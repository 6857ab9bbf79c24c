"""Deformations: affine paths F(γ) of the boundary, with F(0) = 1.

A deformation maps b → F(γ) b: the cell vectors and the pinned positions.  γ = 0 is the network as given, and γ may have
either sign.  The conventions, with unit vectors e_i:

    dilation        F = (1 + γ)^{1/d} 1               V(γ) = V(0)(1 + γ)
    simple_shear    F = 1 + γ e_i e_jᵀ                x_i → x_i + γ x_j; the volume is constant
    pure_shear      F = diag(1 + γ, 1/(1 + γ))        in the plane (i, j); the volume is constant
    uniaxial        F = 1 + γ e_i e_iᵀ                sides fixed, or free of stress
    linear          F = 1 + γ A                       any A (d, d)
    exponential     F = exp(γ A)                      constant velocity gradient A

The linear strain is the symmetric part of F'(0).  It is ½(e_i e_jᵀ + e_j e_iᵀ) for simple shear (γ is the engineering
strain) and diag(1, −1) for pure shear: an isotropic network has four times the modulus of simple shear there.

Free components of the cell are unknowns q of the equilibrium, b → (1 + Σ_m q_m E_m) F(γ) b with symmetric E_m; the
generalised force ∂E/∂q_m of each is zero, as in a tensile test with free sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from critflow.arguments import Array, floats, of_kind
from critflow.result import InputError

Function = Callable[[float], Array]

AXES = "xyz"
_ORDERS = ("gradient", "rate", "second rate")
# Steps of the difference quotients for paths without given derivatives.  The first leaves errors of 1e-12 in F' and of
# 1e-9 in F''; shorter ones are for paths that bend within it.
_STEPS = (2e-3, 2e-4, 2e-5, 2e-6)
_WEIGHTS = ((1, -8, 0, 8, -1), (-1, 16, -30, 16, -1))
# Change of F'' with half the step, in units of F'' and F'², below which a step is accepted, and above which the path is
# not smooth.
_RESOLVED, _ROUGH = 1e-6, 1e-3
# Errors of the quotients, in units of their change with half the step, and number of samples of their signs.
_DIFFERENCE_MARGIN, _SAMPLES = 10.0, 4
# Distance from γ = 0, and relative deviation from the quotients there, of derivatives that are given.
_NEAR, _CONSISTENT = 1e-6, 1e-2


@dataclass(frozen=True, eq=False)
class Deformation:
    """A path of affine deformations F(γ) (d, d) of the boundary, F(0) = 1, with its first two derivatives.

    name       for labels and files
    dimension  d
    derivative  (γ, n) → the derivative of F of order n = 0, 1 or 2
    linear_in_strain  whether F'' = 0: the onset of rigidity is then one convex program
    free       names of free components of the cell, such as ("yy", "xy")
    perturbed  paths with derivatives that are off by their errors (estimate); none where they are exact

    Construct one by a class method, such as `Deformation.simple_shear(2)`, or from a name, a matrix or a function by
    `deformation_of`.  Methods raise `InputError` where F(γ) does not preserve orientation: det F ≤ 0.
    """

    name: str
    dimension: int
    derivative: Callable[[float, int], Array] = field(repr=False)
    linear_in_strain: bool = False
    free: tuple[str, ...] = ()
    perturbed: tuple[Deformation, ...] = field(default=(), repr=False)

    # Values

    def gradient(self, strain: float) -> Array:
        """F(γ), (d, d)."""
        F = self.matrix(strain, 0)
        if not np.linalg.det(F) > 0:
            raise InputError(
                f"at strain {strain:g} the deformation {self.name} inverts or flattens the cell, det F = "
                f"{np.linalg.det(F):.3g}: choose strains with det F > 0"
            )
        return F

    def rate(self, strain: float) -> Array:
        """F'(γ), (d, d)."""
        return self.matrix(strain, 1)

    def second_rate(self, strain: float) -> Array:
        """F''(γ), (d, d)."""
        return self.matrix(strain, 2)

    def velocity(self, strain: float) -> Array:
        """Velocity gradient F' F⁻¹ relative to the current cell, (d, d)."""
        return np.asarray(self.rate(strain) @ np.linalg.inv(self.gradient(strain)))

    def acceleration(self, strain: float) -> Array:
        """F'' F⁻¹ relative to the current cell, (d, d)."""
        return np.asarray(self.second_rate(strain) @ np.linalg.inv(self.gradient(strain)))

    def error(self, value: Any, of: Callable[[Deformation], Any]) -> Any:
        """Error (estimate) of a value of this path by those of F' and F'': its largest change to a perturbed path."""
        return np.max([np.abs(of(path) - value) for path in self.perturbed], axis=0) if self.perturbed else 0.0

    @property
    def free_strains(self) -> Array:
        """Symmetric strains E_m of the free components, (m, d, d): e_i e_iᵀ, or ½(e_i e_jᵀ + e_j e_iᵀ)."""
        names, strains = strain_basis(self.dimension)
        return strains[np.array([names.index(name) for name in self.free], int)]

    def freeing(self, *components: str) -> Deformation:
        """The same path with free components of the cell, such as "yy" or "xy": zero conjugate stress."""
        axes = AXES[: self.dimension]
        for name in components:
            if not (isinstance(name, str) and len(name) == 2 and set(name) <= set(axes)):
                raise InputError(f"a free component is a pair of the axes {axes}, such as 'yy' or 'xy', not {name!r}")
        names = tuple(dict.fromkeys("".join(sorted(name)) for name in components))
        return replace(self, free=names)

    def matrix(self, strain: float, order: int) -> Array:
        """The derivative of F(γ) of an order, (d, d); `InputError` for other shapes and numbers that are not finite."""
        of_kind(float, strain=strain)
        F = floats(self.derivative(float(strain), order), f"the {_ORDERS[order]} of the deformation {self.name}")
        if F.shape != (self.dimension,) * 2 or not np.isfinite(F).all():
            raise InputError(
                f"at strain {strain:g} the {_ORDERS[order]} of the deformation {self.name} must be a finite "
                f"{self.dimension} × {self.dimension} matrix: choose other strains or correct the path"
            )
        return F

    # Standard paths

    @classmethod
    def dilation(cls, dimension: int) -> Deformation:
        """F = (1 + γ)^{1/d} 1: volumetric strain γ."""
        dimension = _checked(dimension)
        power, one = 1 / dimension, np.eye(dimension)
        factors = 1.0, power, power * (power - 1)

        def derivative(strain: float, order: int) -> Array:
            # A negative volume has no real root; NaN is refused with a sentence.
            volume = 1 + strain if strain > -1 else np.nan
            return np.asarray(factors[order] * volume ** (power - order) * one)

        return cls("dilation", dimension, derivative)

    @classmethod
    def simple_shear(cls, dimension: int, plane: str = "xy") -> Deformation:
        """F = 1 + γ e_i e_jᵀ in the plane (i, j): x_i → x_i + γ x_j."""
        dimension = _checked(dimension)
        i, j = np.eye(dimension)[[*_plane(dimension, plane)]]
        return replace(cls.linear(np.outer(i, j)), name="simple_shear" + f"_{plane}" * (plane != "xy"))

    @classmethod
    def pure_shear(cls, dimension: int, plane: str = "xy") -> Deformation:
        """Stretch 1 + γ along axis i and 1/(1 + γ) along axis j of the plane (i, j)."""
        dimension = _checked(dimension)
        i, j = _plane(dimension, plane)

        def derivative(strain: float, order: int) -> Array:
            F = np.eye(dimension) if order == 0 else np.zeros((dimension, dimension))
            stretch = 1 + strain if strain != -1 else np.nan
            F[i, i] = (stretch, 1.0, 0.0)[order]
            F[j, j] = (1 / stretch, -1 / stretch**2, 2 / stretch**3)[order]
            return F

        return cls("pure_shear" + f"_{plane}" * (plane != "xy"), dimension, derivative)

    @classmethod
    def uniaxial(cls, dimension: int, axis: str = "x", sides: str = "fixed") -> Deformation:
        """F = 1 + γ e_i e_iᵀ; sides "fixed", or "free": the other normal components of the cell are free of stress."""
        dimension = _checked(dimension)
        i = _axis(dimension, axis)
        if sides not in ("fixed", "free"):
            raise InputError(f"the sides of a uniaxial deformation are 'fixed' or 'free', not {sides!r}")
        name = "uniaxial" if sides == "fixed" else "uniaxial_free"
        along = np.diag(np.eye(dimension)[i])
        deformation = replace(cls.linear(along), name=name if axis == "x" else f"{name}_{axis}")
        across = [a + a for a in AXES[:dimension] if a != axis]
        return deformation.freeing(*across) if sides == "free" else deformation

    @classmethod
    def linear(cls, strain: ArrayLike) -> Deformation:
        """F = 1 + γ A for any A (d, d)."""
        A = _square(strain)
        unit = np.eye(len(A))
        return cls("linear", len(A), lambda g, order: (unit + g * A, A, 0 * A)[order], linear_in_strain=True)

    @classmethod
    def exponential(cls, strain: ArrayLike) -> Deformation:
        """F = exp(γ A) for any A (d, d)."""
        A = _square(strain)
        powers = (np.eye(len(A)), A, A @ A)
        return cls("exponential", len(A), lambda g, order: powers[order] @ scipy.linalg.expm(g * A))

    @classmethod
    def path(
        cls, gradient: Function, dimension: int, rate: Function | None = None, second_rate: Function | None = None
    ) -> Deformation:
        """Any path γ → F(γ) with F(0) = 1, and where given its derivatives F'(γ) and F''(γ), (d, d).

        Those that are not given are difference quotients of fourth order, whose errors (estimate) enter those of
        results.  A path with a kink, or one that is defined for γ ≥ 0 alone, needs them: `InputError` where quotients
        by two steps disagree.
        """
        dimension = _checked(dimension)
        of_kind(Callable, gradient=gradient)
        of_kind(Callable, None, rate=rate, second_rate=second_rate)
        start = floats(gradient(0.0), "a deformation F(0)")
        if start.shape != (dimension,) * 2 or not np.allclose(start, np.eye(dimension), rtol=0, atol=1e-14):
            raise InputError(f"a deformation must begin with F(0) = 1, a {dimension} × {dimension} matrix")
        given = [gradient] + [one for one in (rate, second_rate) if one is not None]
        if second_rate is not None and rate is None:
            raise InputError("a deformation with F'' needs F' as well: give rate, or leave out second_rate")
        for order, (below, above) in enumerate(pairwise(given), 1):
            start, slope = floats(below(0.0), "a deformation"), floats(above(0.0), f"its {_ORDERS[order]}")
            allowed = _CONSISTENT * max(1.0, float(np.abs(slope).max()))
            # A path may have a kink at zero, or be defined on one side alone.
            sides = (np.asarray(below(s), float) - start - s * slope for s in (_NEAR, -_NEAR))
            if slope.shape != start.shape or not any(np.abs(off).max() <= _NEAR * allowed for off in sides):
                raise InputError(f"at strain 0 the {_ORDERS[order]} given is not that of the deformation: correct it")

        @lru_cache(maxsize=8)
        def quotients(strain: float) -> tuple[Array, Array]:
            return _quotients(given[-1], dimension, strain)

        def derivative(strain: float, order: int, off: Array | float = 0.0) -> Array:
            if order < len(given):
                return given[order](strain)
            value, change = quotients(strain)
            return np.asarray((value + off * change)[order - len(given)])

        # Errors of the components have any signs.
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (_SAMPLES, 2, dimension, dimension))
        perturbed = tuple(cls("path", dimension, partial(derivative, off=_DIFFERENCE_MARGIN * s)) for s in signs)
        return cls("path", dimension, derivative, perturbed=perturbed if len(given) < 3 else ())


def _quotients(function: Function, dimension: int, strain: float) -> tuple[Array, Array]:
    """First and second derivative of a function (d, d) of strain, and their changes with half the step, (2, d, d) each.

    A kink of the function, or a step of its first or second derivative, changes one of the two: jumps of the second
    derivative next to the strain change the first one by a part of the step.
    """
    best, least = None, np.inf
    for step in _STEPS:
        near = {n: np.asarray(function(strain + n * step / 2), float) for n in (0, -1, 1, -2, 2, -4, 4)}
        if any(F.shape != (dimension,) * 2 for F in near.values()):
            break
        coarse, fine = (
            np.array(
                [
                    np.sum([w * near[n * k] for n, w in enumerate(weights, -2)], axis=0) / (12 * h**order)
                    for order, weights in enumerate(_WEIGHTS, 1)
                ]
            )
            for k, h in ((2, step), (1, step / 2))
        )
        change = fine - coarse
        change[1] += change[0] / step
        rounding = np.finfo(float).eps * np.abs(near[0]).max() / _DIFFERENCE_MARGIN
        change += np.copysign(rounding / np.array([step, step**2 / 3])[:, None, None], change)
        scale = max(1.0, float(np.abs(coarse[0]).max()) ** 2, float(np.abs(coarse[1]).max()))
        off = max(float(np.abs(change[1]).max()), float(np.abs(change[0]).max()) / step) / scale
        if off < least:
            best, least = (coarse, change), off
        if off <= _RESOLVED:
            break
    if best is None or not least <= _ROUGH:
        raise InputError(
            f"the deformation is not smooth next to strain {strain:g}, as at a kink or at the end of its range, so its "
            f"derivatives are unknown: give them by Deformation.path(F, {dimension}, rate, second_rate)"
        )
    return best


_NAMED: dict[str, Callable[[int], Deformation]] = {
    "dilation": Deformation.dilation,
    "simple_shear": Deformation.simple_shear,
    "pure_shear": Deformation.pure_shear,
    "uniaxial": Deformation.uniaxial,
    "uniaxial_free": lambda dimension: Deformation.uniaxial(dimension, sides="free"),
}
DEFORMATIONS: tuple[str, ...] = tuple(_NAMED)
"""Names of deformations that `deformation_of` knows."""


def deformation_of(value: Deformation | str | ArrayLike | Function, dimension: int) -> Deformation:
    """A deformation from itself, its name, a matrix A for F = 1 + γA, or a function γ → F(γ).

    Raises `InputError` for unknown names and for other dimensions.

    >>> from critflow.deformation import deformation_of
    >>> deformation_of('simple_shear', 2).gradient(0.1)
    array([[1. , 0.1],
           [0. , 1. ]])
    """
    value = of_kind(np.ndarray, str, Deformation, Callable, value=value)
    dimension = _checked(dimension)
    if isinstance(value, str):
        if value not in _NAMED:
            raise InputError(f"no deformation is called {value!r}: choose one of {', '.join(_NAMED)}")
        return _NAMED[value](dimension)
    if callable(value):
        return Deformation.path(value, dimension)
    deformation = value if isinstance(value, Deformation) else Deformation.linear(value)
    if deformation.dimension != dimension:
        raise InputError(
            f"the deformation {deformation.name} is for {deformation.dimension} dimensions and the network has "
            f"{dimension}: construct it for {dimension}"
        )
    return deformation


@cache
def strain_basis(dimension: int) -> tuple[tuple[str, ...], Array]:
    """Names and symmetric strains (m, d, d) of all m = d(d + 1)/2 components: normal ones first, in Voigt's order.

    Normal strains are e_i e_iᵀ, shear strains ½(e_i e_jᵀ + e_j e_iᵀ): engineering shears.
    """
    pairs = [(i, i) for i in range(dimension)]
    # Voigt's order yz, xz, xy.
    pairs += [(i, j) for i, j in ((1, 2), (0, 2), (0, 1)) if j < dimension]
    names = tuple(AXES[i] + AXES[j] for i, j in pairs)
    products = [np.outer(*np.eye(dimension)[[i, j]]) for i, j in pairs]
    strains = np.array([0.5 * (one + one.T) for one in products])
    strains.flags.writeable = False
    return names, strains


def strain_components(A: Array) -> Array:
    """The components (m,) of a symmetric strain A (d, d) in `strain_basis`: engineering shears are doubled."""
    components: Array = _component_weights(len(A)) @ A.ravel()
    return components


@cache
def _component_weights(dimension: int) -> Array:
    """The matrix (m, d²) from the entries of a strain to its components."""
    strains = strain_basis(dimension)[1]
    doubled = np.where(np.einsum("nii->n", strains) > 0, 1, 2)
    return np.asarray(strains.reshape(len(strains), -1) * doubled[:, None])


def _square(strain: ArrayLike) -> Array:
    A = floats(strain, "an affine strain")
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not 1 <= len(A) <= 3 or not np.isfinite(A).all():
        raise InputError(f"an affine strain must be a finite square matrix of 1, 2 or 3 rows, not of shape {A.shape}")
    return A


def _checked(dimension: int) -> int:
    dimension = of_kind(int, dimension=dimension)
    if dimension < 1:
        raise InputError(f"a deformation needs a dimension of at least 1, not {dimension}")
    return dimension


def _axis(dimension: int, axis: str) -> int:
    if not (isinstance(axis, str) and len(axis) == 1 and axis in AXES[:dimension]):
        raise InputError(f"an axis is one of {', '.join(AXES[:dimension])}, not {axis!r}")
    return AXES.index(axis)


def _plane(dimension: int, plane: str) -> tuple[int, int]:
    if dimension < 2:
        raise InputError("a shear needs at least two dimensions")
    if not (isinstance(plane, str) and len(plane) == 2 and plane[0] != plane[1]):
        raise InputError(f"the plane of a shear is a pair of two axes, such as 'xy', not {plane!r}")
    return _axis(dimension, plane[0]), _axis(dimension, plane[1])


Deformable = Deformation | str | ArrayLike | Function
"""What `deformation_of` accepts."""
