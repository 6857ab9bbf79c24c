"""Poisson's ratio as a target: the springs become isotropic, and ν is that of their tensor.

The isotropic part of a tensor has the constants λ and μ that leave both traces, C_iijj and C_ijij:
    C_iijj = d²λ + 2dμ,   C_ijij = dλ + d(d + 1)μ,   ν = λ/((d − 1)λ + 2μ),
so ν is a ratio of two linear forms of C, and so are the differences of components, over the bulk modulus, that vanish
where C is isotropic.  None of these depends on the scale of the stiffnesses, which a target of a component may fix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from critflow.deformation import strain_basis
from critflow.networks import Array, Network
from critflow.quantities import Balanced, Partials, Quantity
from critflow.result import InputError
from critflow_extras.targets.problem import Target

NAME = "poisson"
"""The name of the target."""


@dataclass(frozen=True, eq=False, repr=False)
class TensorRatio(Quantity):
    """W:C / U:C of the elasticity tensor C (m, m) of springs at rest, in the order of `strain_basis`.

    above, below  W and U, (m, m) symmetric
    name          in tables, targets and messages
    """

    above: Array
    below: Array
    name: str = "ratio"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        raise InputError(f"{self.name} is that of springs at rest: change='stiffness' sets it")

    def unit(self, network: Network) -> float:
        return 1.0

    def of_tensor(self, C: Array) -> tuple[float, Array]:
        """The value, and its derivative by C, (m, m)."""
        below = float(np.sum(self.below * C))
        value = float(np.sum(self.above * C)) / below
        return value, (self.above - value * self.below) / below


def poisson_targets(dimension: int, value: Any) -> dict[Any, Any]:
    """Targets of an isotropic tensor whose Poisson's ratio has a value, limits, or is largest or smallest."""
    names = strain_basis(dimension)[0]
    d, m = dimension, len(names)
    trace = np.zeros((m, m))
    trace[:d, :d] = 1.0
    other = np.diag(np.repeat([1.0, 2.0], [d, m - d]))
    shear = (d * other - trace) / (d * (d + 2) * (d - 1))
    lame = (trace - 2 * d * shear) / d**2
    ratio = TensorRatio(lame, (d - 1) * lame + 2 * shear, NAME)
    zeros = {
        TensorRatio(_weights(m, form), trace / d**2, "".join(_term(names, *part) for part in form).lstrip("+")): 0.0
        for form in _vanishing(d, m)
    }
    return {ratio: value, **zeros}


def _vanishing(d: int, m: int) -> list[list[tuple[int, int, float]]]:
    """Independent sums of components (a, b, factor) that vanish for isotropic tensors, m(m + 1)/2 − 2."""
    normal = [(a, b) for a in range(d) for b in range(a + 1, d)]
    forms = [[(a, b, 1.0)] for a in range(m) for b in range(max(a + 1, d), m)]
    forms += [[(a, a, 1.0), (0, 0, -1.0)] for a in range(1, d)]
    forms += [[(a, b, 1.0), (0, 1, -1.0)] for a, b in normal[1:]]
    forms += [[(s, s, 1.0), (d, d, -1.0)] for s in range(d + 1, m)]
    return [*forms, [(0, 0, 1.0), (0, 1, -1.0), (d, d, -2.0)]]


def _weights(m: int, form: Sequence[tuple[int, int, float]]) -> Array:
    W = np.zeros((m, m))
    for a, b, factor in form:
        W[a, b] += 0.5 * factor
        W[b, a] += 0.5 * factor
    return W


def _term(names: Sequence[str], a: int, b: int, factor: float) -> str:
    """A component with its sign and factor, such as -2C_xyxy."""
    size = "" if abs(factor) == 1 else f"{abs(factor):g}"
    return f"{'-' if factor < 0 else '+'}{size}C_{names[a]}{names[b]}"


def with_poisson(dimension: int, targets: Mapping[Any, Any]) -> dict[Any, Any]:
    """The targets with those of an isotropic tensor in place of Poisson's ratio."""
    if NAME in targets and dimension < 2:
        raise InputError("Poisson's ratio needs two or three dimensions")
    parts = (poisson_targets(dimension, value) if key == NAME else {key: value} for key, value in targets.items())
    return {key: value for part in parts for key, value in part.items()}


def poisson_refusal(dimension: int, targets: Sequence[Target], n_self_stresses: int) -> str:
    """A sentence where no springs have the ratio: a positive definite C has −1 < ν < 1/(d − 1) and full rank."""
    ratio = next((target for target in targets if target.name == NAME), None)
    if ratio is None:
        return ""
    highest = 1 / (dimension - 1)
    if ratio.low > highest or ratio.high < -1:
        return f"Poisson's ratio is between -1 and {highest:g} in {dimension} dimensions: change it"
    rank = dimension * (dimension + 1) // 2
    if n_self_stresses < rank and ratio.low > -1 and ratio.high < highest:
        return f"an isotropic tensor has rank {rank}, and {n_self_stresses} self-stresses give at most that rank"
    return ""
