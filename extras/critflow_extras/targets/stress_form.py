"""Quantities of linear elasticity alone: functions of S/√D at the transition, linear ones of the tensor at rest."""

from __future__ import annotations

from functools import singledispatch
from typing import NamedTuple

import numpy as np

from critflow.deformation import strain_basis, strain_components
from critflow.networks import Array
from critflow.quantities import Quantity, TransitionModulus
from critflow.result import InputError
from critflow_extras.design_names.components import StressComponent, TensorComponent


class StressForm(NamedTuple):
    """A function of S/√D: S:A/√D, or its square over V (`squared`), A (d, d) symmetric."""

    strain: Array
    squared: bool


@singledispatch
def stress_form(quantity: Quantity) -> StressForm | None:
    """The function of S/√D that a quantity is, or None."""
    return None


@stress_form.register
def _(quantity: TransitionModulus) -> StressForm:
    return StressForm(quantity.symmetric, True)


@stress_form.register
def _(quantity: StressComponent) -> StressForm:
    return StressForm(quantity.strain, False)


def same(one: Quantity, other: Quantity) -> bool:
    """Whether two quantities are the same by name or, for moduli and components of stress, by their strain."""
    if one.name == other.name:
        return True
    form, second = stress_form(one), stress_form(other)
    if form is None or second is None or form.squared != second.squared:
        return False
    return form.strain.shape == second.strain.shape and np.allclose(form.strain, second.strain, rtol=0, atol=1e-14)


@singledispatch
def tensor_weights(quantity: Quantity, dimension: int) -> Array:
    """W (m, m) of a quantity that is linear in the elasticity tensor, W:C, in the order of `strain_basis`."""
    raise InputError(f"{quantity.name} is not linear in the elasticity tensor, so stiffnesses at rest cannot set it")


@tensor_weights.register
def _(quantity: TransitionModulus, dimension: int) -> Array:
    components = strain_components(quantity.symmetric)
    return np.outer(components, components)


@tensor_weights.register
def _(quantity: TensorComponent, dimension: int) -> Array:
    names = [f"S_{name}" for name in strain_basis(dimension)[0]]
    W = np.zeros((len(names), len(names)))
    a, b = names.index(quantity.first.name), names.index(quantity.second.name)
    W[a, b] += 0.5
    W[b, a] += 0.5
    return W
