"""The onset of rigidity under a deformation as a quantity, by the name onset[D]."""

from __future__ import annotations

from dataclasses import dataclass

from critflow.deformation import Deformation, deformation_of
from critflow.networks import Network
from critflow.quantities import Balanced, Partials, Quantity
from critflow.result import InputError


@dataclass(frozen=True, eq=False, repr=False)
class OnsetStrain(Quantity):
    """The critical strain of a deformation for given rest lengths: a quantity of rest lengths, not of a stress."""

    deformation: Deformation

    @property
    def name(self) -> str:
        return f"onset[{self.deformation.name}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        raise InputError(f"{self.name} is a quantity of rest lengths: design it with change='rest_lengths'")


def onset(network: Network, deformation: str) -> OnsetStrain:
    """onset[D] of a deformation D."""
    return OnsetStrain(deformation_of(deformation, network.dimension))
