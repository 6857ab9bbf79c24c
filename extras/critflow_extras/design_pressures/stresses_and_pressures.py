"""Stresses and pressures as the variables of a design, z = (log σ, p): lengths, areas and tensions of a tissue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values
from critflow.networks import Array, Network
from critflow.quantities import Quantity
from critflow.result import InputError
from critflow_extras.targets.problem import DesignOptions, DesignResult, Target, Variables, require_all_valid
from critflow_extras.targets.stresses import Stresses
from critflow_extras.tissue.pressures import PressureBalance, PressureManifold, PressurisedConfiguration


class StressesAndPressures(Variables):
    """log σ (N_b,) and pressures p (N_f,), from stresses and pressures of a scale at which ⟨σ²⟩ = 1.

    Configurations whose matrix P + iQ is not positive definite are outside the domain.
    """

    starts = (PressurisedConfiguration,)
    longest, tolerance = Stresses.longest, Stresses.tolerance

    def __init__(self, network: Network, sigma: ArrayLike | None = None, pressures: ArrayLike | None = None):
        self.network, self.manifold = network, PressureManifold(network)
        self.n_edges, n_faces = self.manifold.jumps.shape
        stress = np.ones(self.n_edges) if sigma is None else edge_values(sigma, self.n_edges, "sigma")
        p = np.zeros(n_faces) if pressures is None else edge_values(pressures, n_faces, "pressures", False, "face")
        scale = np.sqrt(np.mean(stress**2))
        self.origin = np.concatenate([np.log(stress / scale), p / scale])

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        options.limits(cls)
        options.require_unused("signs", "free")
        sigma = getattr(start, "sigma", None) if options.initial is None else options.initial
        return cls(options.network, sigma, getattr(start, "pressures", None))

    @property
    def size(self) -> int:
        return self.n_edges

    def at(self, z: Array) -> PressureBalance:
        balance = self.manifold.balance(np.exp(z[: self.n_edges]), z[self.n_edges :])
        if balance.factor.indefinite:
            return replace(balance, bond_vectors=np.full_like(balance.bond_vectors, np.nan))
        return balance

    def values(self, state: PressureBalance, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        values, rows = np.empty(len(quantities)), np.empty((len(quantities), len(self.origin)))
        for n, quantity in enumerate(quantities):
            values[n], partials = quantity.evaluate(state)  # type: ignore[arg-type]
            by_stress, by_pressure = state.pull_back(*partials)
            rows[n] = np.concatenate([state.sigma * by_stress, by_pressure])
        return values, rows

    def refusal(self, targets: Sequence[Target]) -> str:
        elastic = [target.name for target in targets if target.quantity.elastic]
        if elastic:
            raise InputError(f"{elastic[0]} is a response of springs, which pressures change: give lengths or areas")
        require_all_valid(self, targets)
        return ""

    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        solved = self.manifold.solve(np.exp(z[: self.n_edges]), z[self.n_edges :])
        return self.at_configuration(solved, z, quantities)
