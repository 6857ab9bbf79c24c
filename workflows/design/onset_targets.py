"""Onset on demand: rest lengths whose critical shear is prescribed, and the range of onsets at one bulk modulus.

Networks of equal rest lengths, longer than at the isotropic transition by a few per cent, become rigid under simple
shear at some γ_c.  Their rest lengths are changed as little as possible until γ_c has another value.  At rest,
stresses with one B_0 belong to different rest lengths; lengthened alike, they become rigid at different shears.
"""

from __future__ import annotations

import time

import numpy as np

from critflow import CriticalManifold, critical_from_lengths, critical_strain, design, design_onset, voronoi_network
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import series
from .panels import limit, panels, signed
from .parts import undefined

# Smallest error that is drawn.
FLOOR = 1e-17

# Requested onsets over that of equal lengths, and bulk moduli at the transition.
PARAMETERS = {"n_vertices": 100, "excess": 0.05, "factors": (0.6, 1.3, -1.0), "moduli": (0.27, 0.25, 0.22, 0.18)}
VARIABLES = {
    "target": (("factor",), "requested critical shear"),
    "achieved": (("factor",), "critical shear of the designed rest lengths, by critical_strain"),
    "distance": (("factor",), "root mean square change of log rest length"),
    "target_status": (("factor",), "its outcome"),
    "target_seconds": (("factor",), "processor time of one design [s]"),
    "modulus": (("modulus",), "prescribed bulk modulus B_0 at the transition [k]"),
    "shear": (("modulus",), "critical shear of its lengths, lengthened alike"),
    "shear_status": (("modulus",), "its outcome"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"factor": len(parameters["factors"]), "modulus": len(parameters["moduli"])}


def check(parameters):
    """Refuse settings that could only fail."""
    check_network(voronoi_network, parameters["n_vertices"], 0)


def case(parameters, seed):
    """Designs of one network."""
    manifold = CriticalManifold(voronoi_network(parameters["n_vertices"], seed))
    network, longer = manifold.network, 1 + parameters["excess"]
    found = undefined(VARIABLES, sizes(parameters))
    equal = np.ones(network.n_edges)
    lengths = longer * critical_from_lengths(manifold, equal, throw=False).ratio * equal
    onset = critical_strain(network, lengths, "simple_shear")
    for n, factor in enumerate(parameters["factors"]):
        target = factor * onset.strain
        start = time.process_time()
        made = design_onset(network, lengths, target, throw=False)
        found["target_seconds"][n] = time.process_time() - start
        again = critical_strain(network, made.rest_lengths, "simple_shear", direction=int(np.sign(target)), throw=False)
        found["target"][n], found["achieved"][n] = target, again.strain
        found["distance"][n], found["target_status"][n] = made.distance, made.status
    for n, modulus in enumerate(parameters["moduli"]):
        critical = design(manifold, {"B_0": modulus}, throw=False).value
        onset = critical_strain(network, longer * critical.lengths, "simple_shear", throw=False)
        found["modulus"][n], found["shear"][n], found["shear_status"][n] = modulus, onset.strain, onset.status
    return found


def figure(ds, parameters):
    """Changes and errors of the requested onsets, and onsets at given moduli."""
    drawn, (left, middle, right) = panels(
        3,
        f"Onset in simple shear on demand: $N_v$ = {parameters['n_vertices']}, {ds.sizes['seed']} networks, "
        f"lengths {100 * parameters['excess']:g} % above the isotropic transition",
        height=4.0,
    )
    for n, factor in enumerate(parameters["factors"]):
        target, style = ds.target.values[:, n], series(n)
        label = f"{signed(factor)} times the onset of equal rest lengths"
        left.scatter(target, ds.distance.values[:, n], s=18, label=label, **style)
        error = np.abs(ds.achieved.values[:, n] - target)
        middle.scatter(target, np.maximum(error, FLOOR), s=18, **style)
    left.set(
        xlabel="requested onset $\\gamma_c$", ylabel="change of $\\log\\ell$ (r.m.s.)", ylim=(0, None),
        title="change of the rest lengths",
    )  # fmt: skip
    drawn.legend(*left.get_legend_handles_labels(), fontsize=8.5, frameon=False, ncols=3, loc="outside lower center")
    limit(middle, 1e-9, "required")
    middle.set(
        xlabel="requested onset $\\gamma_c$", ylabel="error of the onset", yscale="log", title="error of the onset"
    )
    style = series(0)
    for one, shear in zip(ds.modulus.values, ds.shear.values, strict=True):
        right.plot(one, shear, markersize=4, linewidth=0.8, alpha=0.6, **style)
    right.set(
        xlabel="$B_0$ at the isotropic transition  [k]", ylabel="onset $\\gamma_c$ in simple shear",
        title="onsets at given $B_0$",
    )  # fmt: skip
    return drawn


def claims(ds, parameters):
    """Bar D6."""
    error = np.abs(ds.achieved.values - ds.target.values)
    reached = error <= 1e-9
    return [
        Claim.tested(
            "design-onset-reached",
            "a prescribed critical shear is reached to 1e-9 by rest lengths",
            "all",
            f"{reached.sum()} of {reached.size}, largest error {np.nanmax(error):.1e}",
            reached.all(),
            "the others have no such lengths in these ratios",
        )
    ]


def summary(ds, parameters):
    """Largest error, and times."""
    error = np.abs(ds.achieved - ds.target)
    return {
        "reached": int((error <= 1e-9).sum()),
        "targets": int(error.size),
        "largest_error": float(error.max()),
        "median_seconds": float(ds.target_seconds.median()),
        "critical_shear_by_modulus": {
            f"{modulus:g}": [float(ds.shear[:, n].min()), float(ds.shear[:, n].max())]
            for n, modulus in enumerate(parameters["moduli"])
        },
    }
