"""The vocabulary of quantities: one name each, one parser, one table of aliases.

B_0 G_0              bulk and shear modulus at the transition
C_B C_G              their derivatives with respect to volumetric strain past it
V_L V_tau            variances of lengths and of tensions
S_xx S_xy ...        components of S/√D, the stress at the transition
C_xxxx C_xxyy ...    components of the elasticity tensor
modulus[D]           modulus of a deformation D, such as modulus[uniaxial]
stiffening[D]        its derivative with respect to the strain
length[α] area[f]    length of an edge, area of a face
onset[D]             critical strain of given rest lengths
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache

from critflow.arguments import checked
from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Balanced, Partials, Quantity
from critflow.critical.transition import (
    StressComponent,
    TensorComponent,
    TransitionModulus,
    dilation,
    pure_shear,
    transition_modulus,
)
from critflow.critical.variances import EdgeLength, FaceArea, LengthVariance, TensionVariance
from critflow.networks.deformation import DEFORMATIONS, Deformation, deformation_of, strain_basis
from critflow.networks.network import Network
from critflow.response.stiffening_quantity import Stiffening
from critflow.result import InputError

ALIASES = {
    "bulk_modulus": "B_0",
    "shear_modulus": "G_0",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
"""Long spellings of names."""

_INDEXED = re.compile(r"(\w+)\[(\w+)\]")


@dataclass(frozen=True, eq=False)
class OnsetStrain(Quantity):
    """The critical strain of a deformation for given rest lengths: a quantity of rest lengths, not of a stress."""

    deformation: Deformation

    @property
    def name(self) -> str:
        return f"onset[{self.deformation.name}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        raise InputError(f"{self.name} is a quantity of rest lengths: design it with change='rest_lengths'")


@checked
def quantity(network: Network, name: str | Quantity) -> Quantity:
    """The quantity of a name, or the given quantity itself.

    network  that it is of, or what holds one; only its dimension, edges and faces matter

    Raises `InputError` for unknown names, with the nearest right one and the list.

    >>> import critflow as cf
    >>> cf.quantity(cf.lattice("honeycomb", 2, 2), 'bulk_modulus').name
    'B_0'
    """
    if isinstance(name, Quantity):
        return name
    symbol = ALIASES.get(name, name)
    plain = _plain(network.dimension)
    if symbol in plain:
        return plain[symbol]
    if match := _INDEXED.fullmatch(symbol):
        kind, index = match.groups()
        if kind in _COUNTED and index.isdecimal():
            n_faces = 0 if network.faces is None else network.faces.n_faces
            count = {"length": network.n_edges, "area": n_faces}[kind]
            if int(index) >= count:
                noun = {"length": "edges", "area": "faces"}[kind]
                raise InputError(f"{symbol} does not exist: the network has {count} {noun}, counted from 0")
            return _COUNTED[kind](int(index))
        if kind in _DEFORMED and index in DEFORMATIONS:
            return _DEFORMED[kind](network, index)
    listed = names(network)
    spellings = [*listed, *(alias for alias, symbol in ALIASES.items() if symbol in listed)]
    same_letters = [spelling for spelling in spellings if spelling.casefold() == str(name).casefold()]
    nearest = same_letters or get_close_matches(str(name), spellings, 1, 0.5)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    plainest = ", ".join(name for name in listed if len(name) < 6 and name[:2] not in ("S_", "C_")) + ", C_B, C_G"
    raise InputError(
        f"no quantity is called {name!r:.40}: {hint}choose from {plainest}, S_xx, C_xxyy, length[EDGE], area[FACE], "
        f"and modulus[D], stiffening[D] or onset[D] of a deformation D: {', '.join(DEFORMATIONS)}"
    )


@checked
def upper_bound(network: Network | CriticalManifold, name: str | Quantity, signs: str = "positive") -> float:
    """The largest possible value of a quantity over all stresses of a network in closed form; infinite without one.

    Error bound (proof, up to rounding).  B_0 ≤ (1/d²V) Σ k|L*|² with L* the configuration at σ = k; every other modulus
    at the transition likewise.  `quantity(network, name).extreme` has the smallest possible value too.

    signs  "positive", or "any" for stresses of both signs

    >>> import critflow as cf
    >>> round(cf.upper_bound(cf.lattice("honeycomb", 2, 2), 'B_0'), 6)
    0.288675
    """
    manifold = CriticalManifold.of(network)
    return quantity(manifold.network, name).extreme(manifold, only_positive(signs))[1]


def only_positive(signs: str) -> bool:
    """Whether stresses are positive; `InputError` for other words than "positive" and "any"."""
    if signs not in ("positive", "any"):
        raise InputError(f"signs must be 'positive' or 'any', not {signs!r}")
    return signs == "positive"


def names(network: Network) -> list[str]:
    """The names of all quantities, with a placeholder for the number of an edge or face."""
    deformed = [f"{kind}[{name}]" for kind in _DEFORMED for name in DEFORMATIONS]
    return [*_plain(network.dimension), "length[EDGE]", "area[FACE]", *deformed]


@cache
def _plain(d: int) -> dict[str, Quantity]:
    """The quantities without an index, by name."""
    stress = [StressComponent(strain, f"S_{axes}") for axes, strain in zip(*strain_basis(d), strict=True)]
    every: list[Quantity] = [
        TransitionModulus(dilation(d), "B_0"),
        *([TransitionModulus(pure_shear(d), "G_0")] if d > 1 else []),
        *(Stiffening(), Stiffening(of_shear=True), LengthVariance(), TensionVariance(), *stress),
        *(TensorComponent(first, second) for a, first in enumerate(stress) for second in stress[a:]),
    ]
    return {one.name: one for one in every}


_COUNTED: dict[str, Callable[[int], Quantity]] = {"length": EdgeLength, "area": FaceArea}

_DEFORMED: dict[str, Callable[[Network, str], Quantity]] = {
    "modulus": transition_modulus,
    "stiffening": lambda network, name: Stiffening(deformation_of(name, network.dimension)),
    "onset": lambda network, name: OnsetStrain(deformation_of(name, network.dimension)),
}
