"""The vocabulary of quantities: one name each, one parser, one table of aliases.

B_0 G_0              bulk and shear modulus at the transition
C_B C_G              their derivatives with respect to volumetric strain past it
V_L V_tau            variances of lengths and of tensions
S_xx S_xy ...        components of S/√D, the stress at the transition
C_xxxx C_xxyy ...    components of the elasticity tensor
modulus[D]           modulus of a deformation D, such as modulus[uniaxial]
stiffening[D]        its derivative with respect to the strain
length[α] area[f]    length of an edge, area of a face

Extras add names, such as onset[D], by their declarations; what they call by other words than D, EDGE and FACE in
brackets goes to the factory as it is written.
"""

from __future__ import annotations

import re
from difflib import get_close_matches

from critflow.arguments import of_kind
from critflow.critical.quantity import Quantity
from critflow.extensions import missing, named, quantities
from critflow.networks.deformation import DEFORMATIONS, strain_basis
from critflow.networks.network import Network
from critflow.result import InputError

_MODULI = "critflow.critical.transition"
_COMPONENTS = "critflow.critical.components:tensor_component"
_VARIANCES = "critflow.critical.variances"
_LENGTHS = "critflow.critical.lengths_and_areas"
_STIFFENING = "critflow.response.stiffening_quantity"

FACTORIES = {
    "B_0": f"{_MODULI}:named_modulus",
    "G_0": f"{_MODULI}:named_modulus",
    "C_B": f"{_STIFFENING}:volumetric_stiffening",
    "C_G": f"{_STIFFENING}:volumetric_stiffening",
    "V_L": f"{_VARIANCES}:variance",
    "V_tau": f"{_VARIANCES}:variance",
    "S_AXES": _COMPONENTS,
    "C_AXES": _COMPONENTS,
    "length[EDGE]": f"{_LENGTHS}:edge_length",
    "area[FACE]": f"{_LENGTHS}:face_area",
    "modulus[D]": f"{_MODULI}:transition_modulus",
    "stiffening[D]": f"{_STIFFENING}:stiffening_along",
}
"""Factories by name, "module:function", of which a module is imported when one of its names is used.

A factory takes the network, and the text in brackets or else the whole name.  AXES are those of a component of a
tensor, EDGE and FACE a number, D the name of a deformation.
"""

ALIASES = {
    "bulk_modulus": "B_0",
    "shear_modulus": "G_0",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
"""Long spellings of names."""

_INDEXED = re.compile(r"(\w+)\[([^\[\]]+)\]")


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
    symbol = ALIASES.get(name, name)
    plain, indexed = _plain(network.dimension), _indexed()
    argument, place = symbol, plain.get(symbol)
    if place is None and (match := _INDEXED.fullmatch(symbol)):
        stem, argument = match.groups()
        kind, factory = indexed.get(stem, ("", ""))
        if factory and _fits(kind, argument):
            place = factory
    if place is None:
        raise InputError(_unknown(network, name))
    found: Quantity = named(place)(network, argument)
    return found


def _fits(kind: str, argument: str) -> bool:
    """Whether the text in brackets is of a kind; that of other kinds is the business of their factories."""
    if kind in ("EDGE", "FACE"):
        return argument.isdecimal()
    return kind != "D" or argument in DEFORMATIONS


def _plain(dimension: int) -> dict[str, str]:
    """Factories of the names without brackets."""
    axes = strain_basis(dimension)[0]
    components = {
        "S_AXES": [f"S_{one}" for one in axes],
        "C_AXES": [f"C_{one}{other}" for a, one in enumerate(axes) for other in axes[a:]],
        "G_0": ["G_0"] * (dimension > 1),
    }
    factories = {name: place for name, place in (FACTORIES | quantities()).items() if "[" not in name}
    return {one: place for name, place in factories.items() for one in components.get(name, [name])}


def _indexed() -> dict[str, tuple[str, str]]:
    """What stands in brackets and the factory, by the part of the name before them."""
    split = [(*name.rstrip("]").partition("["), place) for name, place in (FACTORIES | quantities()).items()]
    return {stem: (kind, place) for stem, _, kind, place in split if kind}


def _unknown(network: Network, name: str) -> str:
    """The sentence for a name that no quantity has."""
    if extra := missing(str(name)):
        return f"{name!r:.40} is of the extra {extra!r} of critflow, which is not installed: install critflow again"
    listed = names(network)
    spellings = [*listed, *(alias for alias, symbol in ALIASES.items() if symbol in listed)]
    same_letters = [spelling for spelling in spellings if spelling.casefold() == str(name).casefold()]
    nearest = same_letters or get_close_matches(str(name), spellings, 1, 0.5)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    plainest = ", ".join(name for name in listed if len(name) < 6 and name[:2] not in ("S_", "C_")) + ", C_B, C_G"
    *deformed, last = [f"{stem}[D]" for stem, (kind, _) in _indexed().items() if kind == "D"]
    indexed = ", ".join(f"{stem}[{kind}]" for stem, (kind, _) in _indexed().items() if kind != "D")
    return (
        f"no quantity is called {name!r:.40}: {hint}choose from {plainest}, S_xx, C_xxyy, {indexed}, "
        f"and {', '.join(deformed)} or {last} of a deformation D: {', '.join(DEFORMATIONS)}"
    )


def names(network: Network) -> list[str]:
    """The names of all quantities, with a placeholder for the number of an edge or face."""
    listed = list(_plain(network.dimension))
    for stem, (kind, _) in _indexed().items():
        listed += [f"{stem}[{name}]" for name in (DEFORMATIONS if kind == "D" else (kind,))]
    return listed
