"""Three networks of one topology and one B_0 that soften, keep and stiffen past the transition.

C_B is prescribed to −0.05, 0 and 0.3 at B_0 = 0.25, and each is strained to γ = 0.1.  `peers.py` recomputes the
energies of these paths by LAMMPS.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, Status, design, strain_path, voronoi_network
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import series
from .panels import panels, signed
from .parts import undefined

MODULUS = 0.25
GROWTH = {"softens": -0.05, "keeps": 0.0, "stiffens": 0.3}
STRAINS = np.concatenate([[1e-4, 1e-3], np.linspace(0.005, 0.1, 20)])

PARAMETERS = {"n_vertices": 400}
VARIABLES = {
    "growth": (("kind",), "prescribed C_B [k]"),
    "strain": (("strain",), "strain of dilation"),
    "bulk_modulus": (("kind", "strain"), "bulk modulus [k]"),
    "shear_modulus": (("kind", "strain"), "shear modulus, energy convention [k]"),
    "energy": (("kind", "strain"), "energy [k length²]"),
    "kind_status": (("kind",), "outcome of the design"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"kind": len(GROWTH), "strain": len(STRAINS)}


def check(parameters):
    """Refuse settings that could only fail."""
    check_network(voronoi_network, parameters["n_vertices"], 0)


def designs(parameters, seed):
    """The three designs of one network."""
    manifold = CriticalManifold(voronoi_network(parameters["n_vertices"], seed))
    return [design(manifold, {"B_0": MODULUS, "C_B": growth}, throw=False) for growth in GROWTH.values()]


def case(parameters, seed):
    """Strain paths of the three designs."""
    found = undefined(VARIABLES, sizes(parameters))
    found["strain"][:] = STRAINS
    for n, (growth, made) in enumerate(zip(GROWTH.values(), designs(parameters, seed), strict=True)):
        path = strain_path(made.value, STRAINS, throw=False).value
        found["growth"][n], found["kind_status"][n] = growth, made.status
        for name in ("bulk_modulus", "shear_modulus", "energy"):
            found[name][n, : len(path.strains)] = getattr(path, name)
    return found


def figure(ds, parameters):
    """Moduli against strain."""
    drawn, (left, right) = panels(
        2,
        f"One topology and one $B_0$ = {MODULUS:g} k, three designed $C_B$: $N_v$ = {parameters['n_vertices']}, "
        f"{ds.sizes['seed']} networks",
    )
    for axes, name, label, title in (
        (left, "bulk_modulus", "$B$  [k]", "the bulk modulus differs by design"),
        (right, "shear_modulus", "$G$  [k]", "the shear modulus hardly does"),
    ):
        for n, (kind, growth) in enumerate(GROWTH.items()):
            color, legend = series(n)["color"], f"{kind}: $C_B$ = {signed(growth)} k"
            for i, row in enumerate(ds[name].values[:, n]):
                axes.plot(
                    ds.strain.values[0], row, color=color, linewidth=1.2, alpha=0.7, label=legend if i == 0 else None
                )
        axes.set(xlabel="dilation $\\gamma$", ylabel=label, xlim=(0, None), title=title)
    left.axhline(MODULUS, color="0.5", linewidth=0.8, linestyle=":")
    left.legend(fontsize=9, frameon=False, loc="lower left")
    return drawn


def claims(ds, parameters):
    """The order of the three curves."""
    start = ds.bulk_modulus.values[:, :, 0]
    end = ds.bulk_modulus.values[:, :, np.argmin(np.abs(STRAINS - 0.01))]
    equal = np.abs(start - MODULUS).max()
    ordered = (end[:, 0] < end[:, 1]) & (end[:, 1] < end[:, 2]) & (end[:, 0] < MODULUS) & (end[:, 2] > MODULUS)
    return [
        Claim.tested(
            "design-curves",
            "networks of one topology and one B_0 soften, keep and stiffen on demand",
            "all",
            f"{ordered.sum()} of {len(ordered)} networks at γ = 0.01; B at γ = 1e-4 within {equal:.1e} of {MODULUS}",
            ordered.all() and (ds.kind_status.values != Status.infeasible).all(),
            "the growth changes within this strain",
        )
    ]
