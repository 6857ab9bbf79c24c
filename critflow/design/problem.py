"""The constrained problem of a design: a preference and the targets as functions of its variables.

minimise  preference(z)  subject to  l_i ≤ O_i(z) ≤ u_i  and limits of what is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.critical.manifold import Balance, CriticalConfiguration
from critflow.critical.quantity import Quantity
from critflow.critical.variances import LengthVariance, TensionVariance
from critflow.design.limits import Target
from critflow.design.stresses import Stresses
from critflow.design.variables import Variables
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.quantities.vocabulary import ALIASES
from critflow.result import InputError
from critflow.solvers.constrained import Point

# Component of the gradient of a preference along the surface of the targets, relative to 1 plus the largest component
# of the gradient, below which it is least.
TARGET_OPTIMAL = 1e-3

PREFERENCES: dict[str, type[Quantity]] = {"V_L": LengthVariance, "V_tau": TensionVariance}
"""Preferences that are quantities, by name."""


class Preference:
    """What selects among the values of the variables with the targets, as a function of z to be minimised."""

    name = "change"

    def __init__(self, variables: Variables):
        self.variables, self.tolerance = variables, variables.tolerance

    def at(self, state: Any, z: Array) -> tuple[float, Array]:
        """The value and its gradient by z, (n,)."""
        return self.variables.change(state, z)

    def shown(self, value: float) -> float:
        """A value of the function, or its derivative, in the units of the user."""
        return value


class BestValue(Preference):
    """V_L, V_τ, or a target that is to be largest or smallest, times its sign and the number of edges."""

    def __init__(self, variables: Variables, quantity: Quantity, name: str, sign: float):
        self.variables, self.quantity, self.name, self.sign = variables, quantity, name, sign
        self.tolerance = TARGET_OPTIMAL
        self._n_edges = getattr(variables, "n_edges", len(variables.origin))

    def at(self, state: Any, z: Array) -> tuple[float, Array]:
        values, rows = self.variables.values(state, [self.quantity])
        # Times the number of edges, so that components of the gradient are of order one.
        size = self.sign * self._n_edges
        return size * float(values[0]), size * rows[0]

    def shown(self, value: float) -> float:
        return self.sign * value / self._n_edges


class Nearness(Preference):
    """½Σ|x + c − x̂|² over the number of vertices, with the translation c of periodic networks."""

    name = "distance"

    def __init__(self, variables: Stresses, coordinates: Array):
        self.stresses, self.positions, self.tolerance = variables, coordinates, TARGET_OPTIMAL

    def at(self, state: Balance, z: Array) -> tuple[float, Array]:
        network = state.network
        apart = network.all_coordinates(state.coordinates) - self.positions
        if not network.pins:
            apart -= apart.mean(axis=0)
        y = state.factor.solve(apart[network.free])
        by_sigma = -np.einsum("ad,ad->a", state.bond_vectors, network.free_incidence @ y) / len(apart)
        return 0.5 * float(np.sum(apart**2)) / len(apart), self.stresses.gradients(by_sigma, state.sigma)


def preference_of(
    variables: Variables, network: Network, prefer: str | CriticalConfiguration | ArrayLike, goal: Target | None
) -> Preference:
    """The preference of the arguments of `design`; `InputError` for unknown ones."""
    least_change = isinstance(prefer, str) and prefer == "least_change"
    if goal is not None:
        if not least_change:
            word = {1: "smallest", -1: "largest"}[goal.goal]
            raise InputError(f"{goal.name} is to be {word}, which leaves no choice: omit prefer")
        return BestValue(variables, goal.quantity, goal.name, float(goal.goal))
    if least_change:
        return Preference(variables)
    if not isinstance(variables, Stresses):
        raise InputError("other preferences than 'least_change' are those of a change of stress: omit prefer")
    if isinstance(prefer, str):
        name = ALIASES.get(prefer, prefer)
        if name not in PREFERENCES:
            names = ", ".join(("least_change", *PREFERENCES))
            raise InputError(f"no preference is called {prefer!r:.40}: choose from {names}, or give coordinates")
        return BestValue(variables, PREFERENCES[name](), name, 1.0)
    x = prefer.coordinates if isinstance(prefer, CriticalConfiguration) else prefer
    return Nearness(variables, validated_coordinates(network, x))


class TargetProblem:
    """A preference and targets as a `critflow.solvers.constrained.Problem`, in units of their sizes.

    The first constraints are the targets with limits, the others the limits of what is changed.
    """

    def __init__(self, variables: Variables, preference: Preference, targets: Sequence[Target]):
        self.variables, self.preference = variables, preference
        self.targets = [target for target in targets if not target.goal]
        self.sizes = variables.sizes(self.targets)
        low, high = (np.array([getattr(t, end) for t in self.targets]) for end in ("low", "high"))
        self.low = np.concatenate([low / self.sizes, variables.low])
        self.high = np.concatenate([high / self.sizes, variables.high])

    def at(self, z: Array) -> Point:
        state, n = self.variables.at(z), len(self.targets)
        with np.errstate(all="ignore"):
            # Trial values far from the solution may not be finite, and are refused.
            value, gradient = self.preference.at(state, z)
            values, rows = self.variables.values(state, [target.quantity for target in self.targets])
            limited = self.variables.limited(state)
        rows = rows / self.sizes[:, None]

        def of(indices: NDArray[np.intp]) -> Array:
            limits = self.variables.limited_rows(state, indices[indices >= n] - n)
            return np.concatenate([rows[indices[indices < n]], limits])

        return Point(z, value, gradient, np.concatenate([values / self.sizes, limited]), of)
