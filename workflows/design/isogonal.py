"""Stiffening at a fixed force network: isogonal changes of the lengths move C_B and C_G at the same B_0 and G_0."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from critflow import CriticalManifold, Status, elasticity, isogonal_design, stiffening, strain_path, voronoi_network
from critflow.workflow import Claim

from ..shared.checks import check_network, check_positive
from ..shared.reports import series, spread, status_counts
from .panels import signed
from .parts import undefined

PARAMETERS = {
    "n_vertices": 64,
    "spread": 0.4,
    "coefficients": (-0.08, -0.04, 0.0, 0.1, 0.2),
    "strains": (0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.1),
}
VARIABLES = {
    "C_B": (("target",), "growth of the bulk modulus, from the linear system of the transition"),
    "C_G": (("target",), "growth of the shear modulus, energy convention"),
    "target_error": (("target",), "distance of C_B from its target, relative to the larger of it and 0.01"),
    "bulk_error": (("target",), "relative change of B_0 by the design"),
    "shear_error": (("target",), "relative change of G_0 by the design"),
    "distance": (("target",), "root mean square of the change of log lengths"),
    "shortest": (("target",), "shortest edge over the mean"),
    "design_status": (("target",), "outcome of the design"),
    "design_seconds": (("target",), "time of the design [s]"),
    "least": ((), "least C_B that a descent found in the family"),
    "modulus": (("target", "strain"), "bulk modulus along dilation [k]"),
    "bulk": ((), "B_0 of the force network"),
    "lines": (("target", "edge", "end", "axis"), "ends of the edges"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {
        "target": len(parameters["coefficients"]),
        "strain": len(parameters["strains"]),
        "edge": 3 * parameters["n_vertices"] // 2,
        "end": 2,
        "axis": 2,
    }


def check(parameters):
    """Refuse settings that could only fail."""
    check_positive(parameters, "spread")
    check_network(voronoi_network, parameters["n_vertices"], 0)


def case(parameters, seed):
    """One force network of random stresses, and a design for each coefficient."""
    network = voronoi_network(parameters["n_vertices"], seed)
    sigma = np.exp(parameters["spread"] * np.random.default_rng(seed).standard_normal(network.n_edges))
    start = CriticalManifold(network).configuration(sigma)
    found, before = undefined(VARIABLES, sizes(parameters)), elasticity(start).value
    found["bulk"] = before.bulk
    # No positive stress has a smaller coefficient; the compromise is about the least one of the family.
    found["least"] = isogonal_design(start, {"C_B": -before.bulk / 2}, throw=False).achieved["C_B"]
    for n, target in enumerate(parameters["coefficients"]):
        begin = perf_counter()
        made = isogonal_design(start, {"C_B": target}, throw=False)
        found["design_seconds"][n] = perf_counter() - begin
        found["design_status"][n] = made.status
        after, exact = elasticity(made.value).value, stiffening(made.value, throw=False).value
        found["C_B"][n], found["C_G"][n] = exact.C_B, exact.C_G
        found["target_error"][n] = abs(exact.C_B - target) / max(abs(target), 0.01)
        found["bulk_error"][n] = abs(after.bulk / before.bulk - 1)
        found["shear_error"][n] = abs(after.shear / before.shear - 1)
        found["distance"][n], found["shortest"][n] = made.distance, made.value.lengths.min() / made.value.lengths.mean()
        path = strain_path(made.value, np.array(parameters["strains"]), throw=False).value
        found["modulus"][n] = path.bulk_modulus
        tail = made.value.coordinates[network.edges[:, 0]]
        tail = (tail @ np.linalg.inv(network.cell) % 1.0) @ network.cell
        found["lines"][n] = np.stack([tail, tail + made.value.bond_vectors], axis=1)
    return found


def figure(ds, parameters):
    """Networks of one family, their moduli along dilation, and the cost of a target."""
    drawn = Figure(figsize=(10, 6.2), dpi=130, layout="constrained")
    pictures, plots = drawn.subfigures(2, 1, height_ratios=(1, 1.5))
    one = ds.isel(seed=0).transpose("target", ...)
    met = np.flatnonzero(one.design_status.values == Status.ok)
    panels = pictures.subplots(1, max(len(met), 1), squeeze=False)[0]
    for n, axes in zip(met, panels, strict=False):
        axes.add_collection(LineCollection(one.lines.values[n], colors=series(n)["color"], linewidths=1.0))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_anchor("N")
        axes.set_axis_off()
        axes.set_title(f"$C_B$ = {signed(parameters['coefficients'][n])} k", fontsize=10)
    growth, reach = plots.subplots(1, 2)
    for n in met:
        strains = np.array([0.0, *parameters["strains"]])
        modulus = np.array([float(one.bulk), *one.modulus.values[n]])
        style = series(n)
        growth.plot(100 * strains, modulus, **style, markersize=4, label=signed(parameters["coefficients"][n]))
    growth.set(xlabel="dilation  [%]", ylabel="bulk modulus  [k]", title="one $B_0$, five designed $C_B$")
    growth.legend(title="$C_B$ designed  [k]", fontsize=8.5, title_fontsize=9, frameon=False)
    for n in range(len(parameters["coefficients"])):
        values = ds.isel(target=n).where(ds.design_status.isel(target=n) == Status.ok)
        reach.plot(values.distance, values.C_G, linestyle="none", markersize=5, **series(n))
    reach.set(
        xlabel="change of log lengths (r.m.s.)", ylabel="$C_G$  [k]", xlim=(0, None),
        title=f"cost, and $C_G$ that follows: {ds.sizes['seed']} networks",
    )  # fmt: skip
    for axes in (growth, reach):
        axes.spines[["top", "right"]].set_visible(False)
    drawn.suptitle(
        "One force network, one $B_0$ and $G_0$: isogonal changes of the lengths design how it stiffens  "
        f"($N_v$ = {parameters['n_vertices']})",
        fontsize=11,
    )
    return drawn


def claims(ds, parameters):
    """What isogonal design keeps and reaches."""
    met = ds.design_status == Status.ok
    error, kept = float(ds.target_error.where(met).max()), float(ds.bulk_error.max())
    sheared = float(ds.shear_error.max())
    counts = status_counts(ds.design_status.values)
    low = (ds.least / ds.bulk).values
    reached = np.array([parameters["coefficients"]]) > ds.least.values[:, None] + 0.005
    every = bool((met.transpose("seed", "target").values | ~reached).all())
    return [
        Claim.tested(
            "DesignIsogonalKeeps",
            "isogonal designs keep B_0 and G_0 to rounding",
            "< 1e-12",
            f"largest relative change {kept:.1g} of B_0, {sheared:.1g} of G_0",
            kept < 1e-12 and sheared < 1e-9,
            "they change",
        ),
        Claim.tested(
            "DesignIsogonalTargets",
            "targets of C_B above the least one of each family are met to 1e-9, with edges of at least ⟨L⟩/20",
            "all",
            f"largest error {error:.1g}, outcomes {counts}, median {float(ds.design_seconds.median()):.2g} s each",
            error < 1e-9 and every,
            "some are missed",
        ),
        Claim.tested(
            "DesignIsogonalReach",
            "no member of a family softens more than C_B = −B_0/2",
            "≥ −1/2",
            f"least C_B/B_0 found in each family {spread(low)}, least {low.min():.4g}",
            bool((low >= -0.5 - 1e-9).all()),
            "some do",
        ),
    ]
