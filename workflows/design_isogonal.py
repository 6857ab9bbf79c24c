"""Stiffening at a fixed force network: isogonal changes of the lengths move C_B and C_G at the same B_0 and G_0."""

import numpy as np
from matplotlib.figure import Figure

import critflow as cf
from critflow.workflow import Claim, Coordinate
from critflow.workflow.study import plural

from .shared.checks import voronoi_check
from .shared.figures import draw_in_cell, heading, lettered, segments, signed
from .shared.measurements import coefficients
from .shared.reports import parameters, series, status_counts
from .shared.tables import bounded, network_study, numbers, outcomes, seconds, stacked, timed


def case(parameters, *, seed):
    """One force network of random stresses, and a design for each coefficient."""
    network = cf.voronoi_network(parameters["n_vertices"], seed)
    sigma = np.exp(parameters["spread"] * np.random.default_rng(seed).standard_normal(network.n_edges))
    start = cf.CriticalManifold(network).configuration(sigma)
    moduli = cf.elasticity(start).value
    # No positive stress has a smaller coefficient; the compromise is about the least one of the family.
    least = cf.design(start, {"C_B": -moduli.bulk / 2}, change="faces", throw=False).targets["C_B"]
    strains = np.array(parameters["strains"])
    designs = [designed(start, target, strains) for target in parameters["coefficients"]]
    return {
        "status": cf.Status.ok,
        "bulk": moduli.bulk,
        "bulk_error_bound": moduli.errors.bulk,
        "least": least.value,
        "least_error_bound": least.error,
        **stacked(designs),
    }


def designed(start, target, strains):
    """One design: its coefficients, what it keeps, its cost, and its moduli along dilation."""
    made, time = timed(cf.design, start, {"C_B": target}, change="faces", throw=False)
    critical = made.value
    (_, _, C_B, C_G), errors = coefficients(critical)
    path = cf.strain_path(critical, strains, throw=False).value
    return {
        "C_B": C_B,
        "C_B_error_bound": errors[2],
        "C_G": C_G,
        "C_G_error_bound": errors[3],
        "target_error": abs(C_B - target) / max(abs(target), 0.01),
        "distance": made.distance,
        "shortest": critical.lengths.min() / critical.lengths.mean(),
        "design_status": made.status,
        "design_seconds": time,
        "modulus": path.bulk_modulus,
        "modulus_error_bound": path.bulk_modulus_error,
        "lines": segments(critical),
    }


def figure(ds):
    """Networks of one family, their moduli along dilation, and the cost of a target."""
    figure = Figure(figsize=(10, 6.2), dpi=130, layout="constrained")
    pictures, plots = figure.subfigures(2, 1, height_ratios=(1, 1.5))
    one, targets = ds.isel(seed=0), ds.target.values
    met = np.flatnonzero(one.design_status.values == cf.Status.ok)
    panels = pictures.subplots(1, max(len(met), 1), squeeze=False)[0]
    for n, axes in zip(met, panels, strict=False):
        lines = one.lines.values[n]
        draw_in_cell(axes, lines, np.ones(len(lines)), parameters(ds)["n_vertices"], colors=series(n)["color"])
        axes.set_title(f"$C_B$ = {signed(targets[n])} k", fontsize=10)
    heading(pictures, "A", "one network")
    growth, reach = plots.subplots(1, 2)
    for n in met:
        modulus = np.array([float(one.bulk), *one.modulus.values[n]])
        growth.plot([0, *100 * ds.strain.values], modulus, **series(n), markersize=4, label=signed(targets[n]))
    growth.set(xlabel="dilation  [%]", ylabel="bulk modulus  [k]", title="one $B_0$, five designed $C_B$")
    growth.legend(title="$C_B$ designed  [k]", fontsize=8.5, title_fontsize=9, frameon=False)
    for n in range(len(targets)):
        values = ds.isel(target=n).where(ds.design_status.isel(target=n) == cf.Status.ok)
        reach.plot(values.distance, values.C_G, linestyle="none", markersize=5, **series(n))
    reach.set(
        xlabel="change of log lengths (r.m.s.)", ylabel="$C_G$, energy  [k]", xlim=(0, None),
        title=f"cost, and $C_G$ that follows: {ds.sizes['seed']} networks",
    )  # fmt: skip
    lettered(growth, reach, letters="BC")
    figure.suptitle(
        "One force network, one $B_0$ and $G_0$: isogonal changes of the lengths design how it stiffens  "
        f"($N_v$ = {parameters(ds)['n_vertices']})",
        fontsize=11,
    )
    return figure


def claims(ds):
    """The targets that isogonal design meets."""
    met = ds.design_status == cf.Status.ok
    error = float(ds.target_error.where(met).max())
    counts, time = status_counts(ds.design_status.values), float(ds.design_seconds.median())
    every = bool((met | (ds.target <= ds.least + 0.005)).all())
    return [
        Claim.tested(
            "DesignIsogonalTargets",
            "targets of C_B above the least one of each family are met to 1e-9, with edges of at least ⟨L⟩/20",
            "all", f"largest error {error:.1g}, outcomes {counts}, median {time:.2g} s each", error < 1e-9 and every,
            "some are missed", f"{int((~met & (ds.target <= ds.least + 0.005)).sum())} targets are below the least one "
            "that a descent finds, or less than 0.005 k above it", criterion="1e-9, every target that is 0.005 k above "
            "the least one", sample=plural(ds.target_error.size, "target"), kind="check",
        ),
    ]  # fmt: skip


study = network_study(
    name="design_isogonal",
    title="Stiffening designed at a fixed force network",
    parameters={
        "n_vertices": 64,
        "spread": 0.4,
        "coefficients": (-0.08, -0.04, 0.0, 0.1, 0.2),
        "strains": (0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.1),
    },
    coordinates=(
        Coordinate("target", "coefficients", "requested C_B [k]"),
        Coordinate("strain", "strains", "dilation"),
    ),
    case=case,
    check=voronoi_check("spread"),
    variables=(
        *bounded(
            ("seed", "target"),
            C_B="growth of the bulk modulus, from the linear system of the transition",
            C_G="growth of the shear modulus, energy convention",
        ),
        *numbers(
            ("seed", "target"),
            target_error="distance of C_B from its target, relative to the larger of it and 0.01",
            distance="root mean square of the change of log lengths",
            shortest="shortest edge over the mean",
        ),
        *outcomes(("seed", "target"), design_status="outcome of the design"),
        *seconds(("seed", "target"), design_seconds="processor time of the design [s]"),
        *bounded(("seed",), least="least C_B that a descent found in the family", bulk="B_0 of the force network"),
        *bounded(("seed", "target", "strain"), modulus="bulk modulus along dilation [k]"),
        *numbers(("seed", "target", "edge", "end", "axis"), lines="ends of the edges"),
    ),
    figures={"isogonal": figure},
    claims=claims,
)
