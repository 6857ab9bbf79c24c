"""Force densities under loads as the variables of a design: z = log |σ| of the free edges, with the scale of σ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import edge_values
from critflow.manifold import Balance, CriticalManifold
from critflow.networks import Array, Network
from critflow.quantities import Quantity
from critflow.result import InputError
from critflow_extras.design_names.lengths_and_areas import EdgeLength
from critflow_extras.loads.loaded import LoadedConfiguration, LoadedManifold
from critflow_extras.loads.quantities import OF_EDGES, Reaction, Tension, with_loads
from critflow_extras.targets.problem import DesignOptions, Target, Variables, require_all_valid
from critflow_extras.targets.stresses import Stresses


class ForceDensities(Stresses):
    """log |σ| of the free edges (n,), and the configuration under the loads of the start.

    The signs of σ are those of the start, and its scale is one of the unknowns.
    """

    starts = (LoadedConfiguration,)
    limited_quantities = ("lengths",)
    own_targets = tuple(OF_EDGES)
    nearest = 1e-8
    _tension: float  # mean of the start, the unit of forces

    @classmethod
    def all_targets(cls, network: Network, targets: Mapping[Any, Any]) -> Mapping[Any, Any]:
        return with_loads(network, targets)

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        if not isinstance(start, LoadedConfiguration):
            raise InputError("change='force_densities' starts from a network under loads: give loaded(network, ...)")
        options.require_unused("signs")
        sigma = start.sigma
        if options.initial is not None:
            sigma = edge_values(options.initial, len(sigma), "initial", positive=False)
        if not sigma.all():
            raise InputError(f"sigma[{int(np.argmin(np.abs(sigma)))}] is zero, which no factor changes: give it a sign")
        if not isinstance(options.prefer, str) and start.weight is not None:
            raise InputError("nearness to coordinates needs loads that stay as they are: weigh edges of given lengths")
        manifold = LoadedManifold(CriticalManifold(start.network), start.forces, start.weight)
        variables = cls(manifold, sigma, options.free, np.sign(sigma), options.limits(cls))
        variables.start, variables.origin = sigma, np.log(np.abs(sigma[variables.free]))
        variables._tension = float(np.mean(np.abs(start.tensions)))
        return variables

    @property
    def _has_moduli(self) -> bool:
        return False

    def limited_rows(self, state: Balance, indices: NDArray[np.intp]) -> Array:
        lengths = [EdgeLength(int(edge)) for edge in indices % len(state.sigma)]
        return self.values(state, lengths)[1].reshape(-1, len(self.origin))

    def unit_of(self, quantity: Quantity) -> float:
        # Tensions and reactions have no unit of the network.
        return self._tension if isinstance(quantity, Tension | Reaction) else super().unit_of(quantity)

    def refusal(self, targets: Sequence[Target]) -> str:
        for target in targets:
            if target.quantity.elastic or target.quantity.one_self_stress:
                raise InputError(
                    f"{target.name} is a response at the transition, which needs a self-stress, and a network under "
                    "loads has none: give lengths, positions, tensions or reactions"
                )
        require_all_valid(self, targets)
        return ""

    def distance(self, z: Array) -> float:
        return Variables.distance(self, z)
