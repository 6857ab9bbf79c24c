"""Values of quantities at a critical configuration, with their errors and exact gradients by stress and stiffness.

The configuration x(σ) does not depend on k, so that dO/dk = ∂O/∂k at constant σ and L.  Gradients by σ take one solve
with P.

At the largest bulk modulus the Hessian ∂²B_0/∂σ∂σ is negative semidefinite.  Its null space is σ itself, because the
configuration does not depend on the scale of σ, and σ̇ = −σ e/|L| for every isogonal mode e, which keeps the tensions:
N_v/2 directions for a periodic network of three edges a vertex, of which the paper counts N_v/2 − 1, those that
change the configuration (`BulkModulusHessian`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.deformation import DEFORMATIONS, strain_basis
from critflow.extensions import missing, named, quantities
from critflow.manifold import CriticalConfiguration, CriticalManifold, require_one_stress_by_count
from critflow.networks import Array, Network
from critflow.quantities import Quantity, evaluate, has_exact_hessian, require_valid
from critflow.result import InputError, Record

# The vocabulary of quantities: one name each.
#
# B_0 G_0          bulk and shear modulus at the transition
# C_B C_G          their derivatives with respect to volumetric strain past it
# V_L V_tau        variances of lengths and of tensions
# modulus[D]       modulus of a deformation D, such as modulus[uniaxial]
# stiffening[D]    its derivative with respect to the strain
#
# Extras add names, such as onset[D], by their declarations.

FACTORIES = {
    "B_0": "critflow.quantities:named_modulus",
    "G_0": "critflow.quantities:named_modulus",
    "C_B": "critflow.growth:volumetric_stiffening",
    "C_G": "critflow.growth:volumetric_stiffening",
    "V_L": "critflow.quantities:variance",
    "V_tau": "critflow.quantities:variance",
    "modulus[D]": "critflow.quantities:transition_modulus",
    "stiffening[D]": "critflow.growth:stiffening_along",
}
"""Factories by name, "module:function", of which a module is imported when one of its names is used.

A factory takes the network, and the text in brackets or else the whole name.  D is the name of a deformation.  In the
names of extras AXES are those of a component of the stress or, after C, of the elasticity tensor, EDGE and FACE a
number; what else stands in brackets goes to the factory as it is written.
"""

ALIASES = {
    "bulk_modulus": "B_0",
    "shear_modulus": "G_0",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
"""Long spellings of names."""


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
    argument, known = ALIASES.get(name, name), names(network)
    factory = "" if "[" in argument else known.get(argument)
    if bracketed := re.fullmatch(r"(\w+)\[([^\[\]]+)\]", argument):
        stem, argument = bracketed.groups()
        kind, factory = _indexed().get(stem, ("", None))
        if (kind == "D" and argument not in DEFORMATIONS) or (kind in ("EDGE", "FACE") and not argument.isdecimal()):
            factory = None
    if not factory:
        raise InputError(_unknown(network, name))
    measured: Quantity = named(factory)(network, argument)
    return measured


def names(network: Network) -> dict[str, str]:
    """The names of all quantities of a network and their factories, with a placeholder for a number in brackets."""
    axes = strain_basis(network.dimension)[0]
    spelled = {
        "S_AXES": [f"S_{one}" for one in axes],
        "C_AXES": [f"C_{one}{other}" for a, one in enumerate(axes) for other in axes[a:]],
        "G_0": ["G_0"] * (network.dimension > 1),
        **{f"{stem}[D]": [f"{stem}[{D}]" for D in DEFORMATIONS] for stem in _indexed()},
    }
    factories = FACTORIES | quantities()
    return {one: factory for name, factory in factories.items() for one in spelled.get(name, [name])}


def _indexed() -> dict[str, tuple[str, str]]:
    """What stands in brackets and the factory, by the part of the name before them."""
    split = [(*name.rstrip("]").partition("["), factory) for name, factory in (FACTORIES | quantities()).items()]
    return {stem: (kind, factory) for stem, _, kind, factory in split if kind}


def _unknown(network: Network, name: str) -> str:
    """The sentence for a name that no quantity has."""
    if extra := missing(re.sub(r"^([SC])_[xyz]+$", r"\1_AXES", name)):
        return f"{name!r:.40} is of the extra {extra!r} of critflow, which is not installed: install critflow again"
    listed, kinds = names(network), {stem: kind for stem, (kind, _) in _indexed().items()}
    spellings = [*listed, *(alias for alias, symbol in ALIASES.items() if symbol in listed)]
    same_letters = [spelling for spelling in spellings if spelling.casefold() == name.casefold()]
    nearest = same_letters or get_close_matches(name, spellings, 1, 0.5)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    short = [one for one in listed if len(one) < 6 and one[:2] not in ("S_", "C_")]
    components = ["S_xx", "C_xxyy"] * ("S_AXES" in quantities())
    numbered = [f"{stem}[{kind}]" for stem, kind in kinds.items() if kind != "D"]
    *deformed, last = [f"{stem}[D]" for stem, kind in kinds.items() if kind == "D"]
    return (
        f"no quantity is called {name!r:.40}: {hint}choose from "
        f"{', '.join([*short, 'C_B', 'C_G', *components, *numbered])}, "
        f"and {', '.join(deformed)} or {last} of a deformation D: {', '.join(DEFORMATIONS)}"
    )


# The largest possible values of quantities over all stresses of a network, in closed form.


@running("upper_bound")
def upper_bound(network: Network | CriticalManifold, name: str | Quantity) -> float:
    """The largest possible value of a quantity under tension on a network in closed form; infinite without one.

    Error bound (proof, up to rounding).  B_0 ≤ (1/d²V) Σ k|L*|² with L* the configuration at σ = k; every other modulus
    at the transition likewise, and for stresses of any sign.  `quantity(network, name).extreme` has the smallest
    possible value too, and those for stresses of any sign.

    >>> import critflow as cf
    >>> round(cf.upper_bound(cf.lattice("honeycomb", 2, 2), 'B_0'), 6)
    0.288675
    """
    network = of_kind(Network, CriticalManifold, network=network)
    name = of_kind(str, Quantity, name=name)
    manifold = CriticalManifold.of(network)
    return quantity(manifold.network, name).extreme(manifold)[1]


FLAT = 1e-9  # eigenvalues of a stress Hessian below this part of the largest are zero; rounding leaves about 1e-13
DENSE_EDGES = 2000  # most edges for all eigenvalues of a stress Hessian: 32 MB and some seconds


@dataclass(frozen=True, eq=False, repr=False)
class Properties(Record):
    """Quantities of a critical configuration and their gradients (N_b,), by name.

    values
    errors        of the values (estimate)
    by_stress     dO/dσ at constant k; orthogonal to σ, whose scale changes nothing.  NaN where edges are slack: a small
                  stress on them would move vertices that nothing holds
    by_stiffness  dO/dk at constant σ
    """

    values: dict[str, float]
    errors: dict[str, float] = field(repr=False)
    by_stress: dict[str, Array] = field(repr=False)
    by_stiffness: dict[str, Array] = field(repr=False)


@running("properties")
def properties(critical: CriticalConfiguration, quantities: Sequence[str | Quantity] | str | Quantity) -> Properties:
    """Quantities of a critical configuration with their errors and exact gradients by σ and by k.

    quantities  names such as "B_0", "C_B", "S_xy" or "stiffening[uniaxial]", or `Quantity` objects

    Raises `InputError` for unknown names, and for networks with several self-stresses where a quantity needs one.

    >>> import critflow as cf
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> bool(abs(cf.properties(best, ['B_0']).by_stress['B_0']).max() < 1e-12)
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    given = [quantities] if isinstance(quantities, str | Quantity) else quantities
    if not isinstance(given, list | tuple) or not given or not all(isinstance(one, str | Quantity) for one in given):
        raise InputError("give a list of at least one quantity, such as ['B_0']")
    parsed = {key if isinstance(key, str) else key.name: quantity(critical.network, key) for key in given}
    if any(one.one_self_stress for one in parsed.values()):
        require_one_stress_by_count(critical.network)
    for one in parsed.values():
        require_valid(one, critical)
    balance = critical.manifold.balance(critical.sigma)
    evaluated = {name: one.evaluate(critical) for name, one in parsed.items()}
    rows = balance.pull_backs([partials for _, partials in evaluated.values()])
    if not critical.sigma.all():
        rows = np.full_like(rows, np.nan)
    return Properties(
        {name: float(value) for name, (value, _) in evaluated.items()},
        {name: one.error(critical) for name, one in parsed.items()},
        dict(zip(parsed, rows, strict=True)),
        {name: one.by_stiffness(critical) for name, one in parsed.items()},
    )


@dataclass(frozen=True, eq=False, repr=False)
class FlatDirections(Record):
    """The directions in stress along which a quantity does not change to second order.

    directions   orthonormal σ̇ of zero curvature, (n_flat, N_b); σ/|σ| lies in their span
    eigenvalues  of the Hessian at Σσ² = N_b, ascending, (N_b,)
    gap          largest |eigenvalue| counted as zero and the next one, relative to the largest of all
    """

    directions: Array
    eigenvalues: Array
    gap: tuple[float, float]

    @property
    def n_flat(self) -> int:
        """The nullity, scaling of σ included."""
        return len(self.directions)


@running("stress_hessian")
def stress_hessian(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> LinearOperator:
    """∂²O/∂σ∂σ at Σσ² = N_b, configuration following σ, as an operator (N_b, N_b) (`BulkModulusHessian`).

    A product costs two solves on the factor of P; the matrix itself is never formed.  Where `evaluate` of the quantity
    does not take complex σ and L, as for C_B and C_G, it is a difference of gradients with nine digits.
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    manifold, goal = critical.manifold, quantity(critical.network, name)
    require_valid(goal, critical)
    evaluation = evaluate(manifold, goal, manifold.configuration(critical.sigma).sigma)
    product = evaluation.hessian_product if has_exact_hessian(manifold, goal) else evaluation.hessian_difference

    def apply(direction: Array) -> Array:
        return product(np.ravel(direction))

    n = critical.network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)


@running("flat_directions")
def flat_directions(
    critical: CriticalConfiguration, name: str | Quantity = "B_0", tolerance: float = FLAT
) -> FlatDirections:
    """Null space of the Hessian of a quantity over stress, by all its eigenvalues.

    tolerance  eigenvalues of at most this part of the largest are zero

    Meant for an optimum: elsewhere ∂²O/∂σ∂σ σ = −dO/dσ, so that not even the scaling of σ is flat.  Raises
    `InputError` for networks of more than 2,000 edges.

    >>> import critflow as cf
    >>> from critflow.quantity_names import flat_directions
    >>> flat_directions(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).n_flat
    4
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    of_kind(float, tolerance=tolerance)
    n = critical.network.n_edges
    if n > DENSE_EDGES:
        raise InputError(f"{n} edges are more than {DENSE_EDGES}: use the products of stress_hessian()")
    operator = stress_hessian(critical, name)
    columns = operator @ np.eye(n)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (columns + columns.T))
    size = np.abs(eigenvalues) / np.abs(eigenvalues).max()
    zero = size <= tolerance
    gap = (float(size[zero].max(initial=0.0)), float(size[~zero].min(initial=np.inf)))
    return FlatDirections(vectors[:, zero].T, eigenvalues, gap)
