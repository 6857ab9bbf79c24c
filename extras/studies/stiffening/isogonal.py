"""Stiffening at a fixed force network: isogonal changes of the lengths move C_B and C_G at the same B_0 and G_0."""

import numpy as np
from critflow.studies.shared.figures import counted, heading, lettered, page
from critflow.studies.shared.measurements import coefficients
from critflow.studies.shared.reports import parameters, series, status_counts
from critflow.studies.shared.tables import bounded, numbers, outcomes, stacked

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim

from ..shared.parts import draw_in_cell, segments, signed


def family(parameters, seed):
    """One force network of random stresses, and a design for each coefficient."""
    network = cf.voronoi_network(parameters["isogonal_vertices"], seed)
    sigma = np.exp(parameters["stress_spread"] * np.random.default_rng(seed).standard_normal(network.n_edges))
    start = cf.CriticalManifold(network).configuration(sigma)
    moduli = cf.elasticity(start).value
    # No positive stress has a smaller coefficient; the compromise is about the least one of the family.
    least = ce.design(start, {"C_B": -moduli.bulk / 2}, change="faces", throw=False).targets["C_B"]
    strains = np.array(parameters["strains"])
    return {
        "family_B_0": moduli.bulk,
        "family_B_0_error_bound": moduli.errors.bulk,
        "least": least.value,
        "least_error_bound": least.error,
        **stacked([designed(start, coefficient, strains) for coefficient in parameters["coefficients"]]),
    }


def designed(start, coefficient, strains):
    """One design: its coefficients, its cost, and its moduli along dilation."""
    made = ce.design(start, {"C_B": coefficient}, change="faces", throw=False)
    critical = made.value
    (_, _, C_B, C_G), errors = coefficients(critical)
    path = cf.strain_path(critical, strains, throw=False).value
    return {
        "isogonal_C_B": C_B,
        "isogonal_C_B_error_bound": errors[2],
        "isogonal_C_G": C_G,
        "isogonal_C_G_error_bound": errors[3],
        "coefficient_error": abs(C_B - coefficient) / max(abs(coefficient), 0.01),
        "length_change": made.distance,
        "isogonal_status": made.status,
        "isogonal_B": path.bulk_modulus,
        "isogonal_B_error_bound": path.bulk_modulus_error,
        "lines": segments(critical),
    }


VARIABLES = (
    *bounded(
        ("seed", "coefficient"),
        isogonal_C_B="growth of the bulk modulus, from the linear system of the transition",
        isogonal_C_G="growth of the shear modulus, energy convention",
    ),
    *numbers(
        ("seed", "coefficient"),
        coefficient_error="distance of C_B from the requested one, relative to the larger of it and 0.01",
        length_change="root mean square of the change of log lengths",
    ),
    *outcomes(("seed", "coefficient"), isogonal_status="outcome of the design"),
    *bounded(("seed",), least="least C_B that a descent reaches in the family", family_B_0="B_0 of the family"),
    *bounded(("seed", "coefficient", "strain"), isogonal_B="bulk modulus along dilation [k]"),
    *numbers(("seed", "coefficient", "edge", "end", "axis"), lines="ends of the edges"),
)


def figure(ds):
    """Networks of one family, their moduli along dilation, and the cost of a target."""
    figure = page(
        5.0,
        "One force network has many growths: isogonal changes set $C_B$ at one $B_0$ and $G_0$\n"
        f"({counted(ds)} of {parameters(ds)['isogonal_vertices']} vertices)",
    )
    pictures, plots = figure.subfigures(2, 1, height_ratios=(1, 1.6))
    one, coefficients = ds.isel(seed=0), ds.coefficient.values
    met = np.flatnonzero(one.isogonal_status.values == cf.Status.ok)
    for n, axes in zip(met, pictures.subplots(1, max(len(met), 1), squeeze=False)[0], strict=False):
        lines = one.lines.values[n]
        draw_in_cell(axes, lines, np.ones(len(lines)), parameters(ds)["isogonal_vertices"], colors=series(n)["color"])
        axes.set_title(f"$C_B$ = {signed(coefficients[n])} k", fontsize=9)
    heading(pictures, "A", "the same tensions, with other lengths: the first network")
    growth, cost = plots.subplots(1, 2)
    for n in met:
        change = 100 * (np.array([float(one.family_B_0), *one.isogonal_B.values[n]]) / float(one.family_B_0) - 1)
        growth.plot([0, *100 * ds.strain.values], change, **series(n), markersize=4, label=signed(coefficients[n]))
    growth.set(xlabel="dilation $\\gamma$  [%]", ylabel="change of $B$  [%]", title="its bulk modulus")
    growth.legend(title="$C_B$  [k]", fontsize=9, title_fontsize=9, frameon=False, labelspacing=0.2)
    for n in range(len(coefficients)):
        values = ds.isel(coefficient=n).where(ds.isogonal_status.isel(coefficient=n) == cf.Status.ok)
        cost.plot(values.length_change, values.isogonal_C_G, linestyle="none", markersize=4.5, **series(n))
    cost.set(xlabel="change of log lengths (r.m.s.)", ylabel="$C_G$, energy convention  [k]", xlim=(0, None))
    cost.set_title("larger $C_B$: larger changes, larger $C_G$")
    lettered(growth, cost, letters="BC")
    return figure


def claims(ds):
    """Growths of each force network."""
    reached = (ds.isogonal_status == cf.Status.ok).sum("coefficient").values
    counts = status_counts(ds.isogonal_status.values)
    span = ds.isogonal_C_B.where(ds.isogonal_status == cf.Status.ok)
    return [
        Claim(
            "stiffening-isogonal", "growths of one force network, at one B_0 and one G_0", "",
            f"C_B from {float(span.min()):.2g} to {float(span.max()):.2g} k, {int(np.median(reached))} of "
            f"{ds.sizes['coefficient']} requested values in the median network; outcomes {counts}; least C_B of a "
            f"family {float(ds.least.min()):.3f} to {float(ds.least.max()):.3f} k", "measured",
        )
    ]  # fmt: skip
