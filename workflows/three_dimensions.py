"""Six populations of critical configurations of networks in three dimensions, strained past the transition.

The study tests which findings of the paper on planar populations (`ResponseMetrics`) are valid for periodic Voronoi
networks in three dimensions, where four edges meet at every vertex.  Equal lengths often leave edges slack, so that the
least length variance is not attained; the population then contains the configuration of the cone program, with equal
lengths on all stressed edges.  The least tension variance is not attained either, because edges shrink to zero length:
the stored configuration is a near one, with edges of a hundredth of the mean length.
"""

import numpy as np
from matplotlib.figure import Figure

from critflow import foam_network
from critflow.figures.plot import draw_in_depth, unit_pressure_tensions
from critflow.generators.random_networks import FOAM_HARD_CORE, check_foam
from critflow.paths.strain_path import check_strains
from critflow.workflow import Axis, Claim, Coordinate, Study, decimals
from critflow.workflow.study import plural

from .shared.checks import check_network, check_positive
from .shared.figures import violins
from .shared.measurements import DRAWN, identified, measured, table, verify
from .shared.population_reports import described, of, summary
from .shared.populations import LABELS, MEANING, NAMES, PAPER_POPULATIONS, POPULATION_LABELS, configuration, prepared
from .shared.reports import PAPER


def case(parameters, *, seed, population, wanted):
    """A critical configuration, and its moduli at the transition and along the strain path."""
    manifold = prepared(foam_network, parameters["n_vertices"], seed, parameters["hard_core"])
    # The least length variance of most foams is not attained: its limit is the optimum of the cone program.
    method = "conic" if population == "min_V_L" else "auto"
    found = configuration(manifold, parameters, seed, population, method)
    if not np.isfinite(found.value.coordinates).all():
        return identified(manifold.network, found)
    return measured(manifold, found, parameters, wanted)


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "hard_core", "fit_window")
    check_network(check_foam, parameters["n_vertices"], parameters["hard_core"])


PANELS = {
    "B_0": "bulk modulus $B_0$  [$k$ / length]",
    "C_B": "its growth with strain $C_B$  [$k$ / length]",
    "G_0": "shear modulus $G_0$  [$k$ / length]",
    "C_G_stress_corrected": "its growth $C_G$, stress-corrected  [$k$ / length]",
}
LEAST_SHOWN = 1e-8


def response_figure(ds):
    """`ResponseMetrics` in three dimensions: two networks in projection, moduli and their growth."""
    figure = Figure(figsize=(12.5, 8.0), dpi=110, layout="constrained")
    figure.suptitle("Critical networks in three dimensions", fontsize=13)
    left, right = figure.subfigures(1, 2, width_ratios=(1, 2.15))
    seed = int(ds.seed[0])
    for axes, population in zip(left.subplots(2, 1), ("max_B_0", "max_G_0"), strict=True):
        one = ds.sel(seed=seed)
        if population in ds.population and np.isfinite(one.sel(population=population).sigma).all():
            _draw(axes, one.sel(population=population))
            axes.set_title(f"{LABELS[population]}, {ds.sizes['vertex']} vertices", fontsize=10)
        axes.set_axis_off()
    names = [str(name) for name in ds.population.values]
    for axes, letter, (name, label) in zip(right.subplots(2, 2).flat, "ABCD", PANELS.items(), strict=True):
        values = ds[name].transpose("population", "seed").values
        if name.startswith("C_"):
            axes.axhline(0.0, color="#C00000", linewidth=1.0, zorder=0)
            values = _without_outliers(axes, values)
        # A shear modulus that vanishes to rounding has no place on a logarithmic axis.
        values = np.maximum(values, LEAST_SHOWN) if name == "G_0" else values
        shown = [LABELS[name].replace("random ", "random\n") for name in names]
        violins(axes, list(values), shown, log=name == "G_0")
        axes.set_ylabel(label, fontsize=10)
        axes.set_title(letter, loc="left", fontweight="bold", fontsize=12)
    figure.supxlabel(
        f"{ds.sizes['seed']} networks. Dark, wide edges carry the most tension and far ones fade. Red lines: no change "
        "with strain. $G_0$: shear of $x$ and $y$; below "
        f"{LEAST_SHOWN:g} drawn there.\nmin $V_L$: equal lengths on all stressed edges. min $V_\\tau$ is not attained: "
        "values of near configurations. ↑: values beyond the axis.",
        fontsize=8.5, color="0.25",
    )  # fmt: skip
    return figure


def _without_outliers(axes, values):
    """Set the axis to all but extreme values (populations, networks), which are left out and marked by an arrow."""
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, (0.02, 0.98)) if len(finite) else (0.0, 1.0)
    high, low = high + 0.25 * (high - low), low - 0.25 * (high - low)
    inside = ~((values > high) | (values < low))
    for place, outside in enumerate((~inside).sum(axis=1)):
        if outside:
            most = values[place][np.nanargmax(np.abs(values[place]))]
            axes.text(
                place, 0.98, f"↑ one: {most:.2g}" if outside == 1 and most > high else f"{outside} outside",
                transform=axes.get_xaxis_transform(), ha="center", va="top", fontsize=8, color="0.25",
            )  # fmt: skip
    axes.set_ylim(low, high)
    # Values that are not finite are counted below the label; outliers are marked above.
    return [group[keep] for group, keep in zip(values, inside, strict=True)]


def _draw(axes, one):
    tensions = unit_pressure_tensions(one.sigma.values, one.length.values, float(abs(np.linalg.det(one.cell.values))))
    draw_in_depth(axes, one.edges.values, one.offsets.values, one.cell.values, one.position.values, tensions)


MEASURED = {
    "B_0": "B_0 [k / length]",
    "C_B": "C_B [k / length]",
    "G_0": "G_0 of shear of x and y [k / length]",
    "C_G": "C_G, energy convention [k / length]",
    "C_G_stress_corrected": "C_G, stress-corrected [k / length]",
    "V_L": "V_L",
    "V_tau": "V_τ",
    "stressed_fraction": "part of the edges under tension",
}


def claims(ds):
    """Measured values of every population: the paper has no statement on three dimensions."""
    for name, words in MEASURED.items():
        values = {p: of(ds, name, p) for p in map(str, ds.population.values)}
        text = "; ".join(f"{NAMES[p]} {described(known)}" for p, known in values.items() if len(known))
        yield Claim(
            f"three-dimensions-{name}", f"{words}, median and range of 90 %", "", text or "undefined", "measured",
            sample=f"{plural(ds.sizes['seed'], 'network')} of each population",
        )  # fmt: skip


study = Study(
    name="three_dimensions",
    version=2,
    title="Populations of critical configurations in three dimensions, strained past the rigidity transition",
    references=f"{PAPER}, whose networks are planar",
    axes=(
        Axis("seed", range(20), "seed of the network", noun="network"),
        Axis("population", PAPER_POPULATIONS, MEANING, labels=POPULATION_LABELS),
    ),
    parameters={
        "n_vertices": 400,
        "hard_core": FOAM_HARD_CORE,
        "threshold": 0.1,
        "spread": 0.1,
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "volumetric strain past the transition"),),
    case=case,
    check=check,
    variables=tuple(table(planar=False)),
    figures={"response": response_figure},
    needs={
        "response": (*DRAWN, *PANELS),
        "claims": (*PANELS, "C_G", "C_B_fit", "V_L", "V_tau", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
