"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths come
twice, with the spread that the paper prints (0.3, `random_lengths_wide`) and with the largest one that leaves every
edge of these networks stressed (0.1, `random_lengths`).

With `network=FILE` the network is that of a file; seeds are then those of random populations and of random starts.
"""

from __future__ import annotations

import numpy as np

from critflow.figures.plot import unit_pressure_tensions
from critflow.generators.random_networks import check_voronoi
from critflow.paths.strain_path import check_strains
from critflow.result import Status, StudyError
from critflow.workflow import Axis, Claim, Coordinate, Study, decimals

from .shared.checks import check_deformation, check_network, check_positive
from .shared.measurements import DRAWN, planar_member, table, verify
from .shared.own_network import check_own, own_network, with_digest
from .shared.panels import Drawing, Panel, gallery_figure, panel_figure
from .shared.population_reports import (
    CONVENTIONS,
    large_shear,
    largest_bulk,
    linear_change,
    negative_shares,
    of,
    opposed_ranks,
    shear_gain,
    signs_of_bulk,
    signs_of_shear,
    summary,
)
from .shared.populations import LABELS, PAPER_POPULATIONS, POPULATIONS
from .shared.reports import PAPER, finite, parameters, spread


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    return planar_member(parameters, seed=seed, population=population, wanted=wanted)


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "spread_wide", "hard_core", "fit_window")
    if parameters["protocol"] not in ("conic", "strain"):
        raise StudyError(f"protocol={parameters['protocol']} must be conic (exact) or strain (the paper's steps)")
    check_deformation(parameters["deformation"])
    if network := own_network(parameters):
        check_own(network)
    else:
        check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


# The parameter with the spread of the rest lengths of each population.
SPREADS = {"random_lengths": "spread", "random_lengths_wide": "spread_wide"}
STRUCTURE = {
    "length_variance": "length variance $V_L$",
    "anisotropy_physical": "mean face anisotropy $\\langle\\kappa_{phys}\\rangle$",
    "tension_variance": "tension variance $V_\\tau$",
    "anisotropy_force": "mean force anisotropy $\\langle\\kappa_{force}\\rangle$",
}
RESPONSE = {
    "bulk_modulus_0": "bulk modulus at the transition $B_0$  [$k$]",
    "C_B_exact": "its growth with strain $C_B$  [$k$]",
    "shear_modulus_0": "shear modulus at the transition $G_0$  [$k$]",
    "C_G_stress_corrected_exact": "its growth with strain $C_G$, stress-corrected  [$k$]",
}


_DRAWINGS = "Drawings: medians of the highest and lowest population; dark, wide edges carry the most tension."


def structure_figure(ds):
    """`StructuralMetrics`: lengths and faces, tensions and force triangles."""
    log = {"tension_variance"}
    panels = [_panel(ds, name, label, name in log) for name, label in STRUCTURE.items()]
    note = f"{_DRAWINGS} "
    return panel_figure(panels, _labels(ds), "Structure of critical configurations", f"{note} {_wide_note(ds)}")


def response_figure(ds):
    """`ResponseMetrics`: moduli at the transition and how they grow past it."""
    log = {"shear_modulus_0"}
    panels = [_panel(ds, name, label, name in log, name.startswith("C_")) for name, label in RESPONSE.items()]
    note = f"Red lines: no change with strain{_deformation_note(ds)}. {_DRAWINGS}"
    return panel_figure(
        panels, _labels(ds), "Mechanical response of critical configurations", f"{note} {_wide_note(ds)}"
    )


def _deformation_note(ds):
    """The deformation where it is not the dilation of the paper."""
    name = parameters(ds).get("deformation", "dilation")
    return "" if name == "dilation" else f" of the {name.replace('_', ' ')}"


def gallery(ds):
    """`Networks`: the first network in every population, on one colour scale."""
    drawings = []
    for population in ds.population.values:
        one = ds.isel(seed=0).sel(population=population)
        if np.isfinite(one.sigma.values).all():
            drawings.append(_drawing(one, f"{{name}}: $B_0$ = {float(one.bulk_modulus_0):.3f}"))
    title = f"One network of {ds.sizes['vertex']} vertices at the rigidity transition in seven populations"
    return gallery_figure(drawings, title.replace("seven", _NUMBERS.get(len(drawings), str(len(drawings)))))


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven"}


def _label(ds, population):
    if population in SPREADS:
        return f"{LABELS['random_lengths']}\n$s={parameters(ds)[SPREADS[population]]:g}$"
    return LABELS[population]


def _labels(ds):
    return [_label(ds, str(population)) for population in ds.population.values]


def _wide_note(ds):
    if "random_lengths_wide" not in ds.population:
        return ""
    stressed = float(ds.stressed_fraction.sel(population="random_lengths_wide").mean())
    printed = parameters(ds)["spread_wide"]
    return f"At the printed spread s = {printed:g} only {100 * stressed:.0f} % of the edges are stressed."


def _panel(ds, name, label, log=False, zero_line=False):
    values = ds[name].transpose("population", "seed")
    medians = values.median("seed")
    drawings = []
    if np.isfinite(medians).any():
        for word, population in (("high", medians.idxmax()), ("low", medians.idxmin())):
            of_population = values.sel(population=population)
            seed = np.abs(of_population - of_population.median()).idxmin()
            shown = f"{float(of_population.sel(seed=seed)):.2g}"
            drawings.append(_drawing(ds.sel(population=population, seed=seed), f"{word}: {shown}\n{{name}}"))
    return Panel(label, list(values.values), drawings, log, zero_line)


def _drawing(one, caption):
    """One configuration with its caption, which may contain the {name} of its population."""
    sigma, lengths, cell = one.sigma.values, one.length.values, one.cell.values
    tensions = unit_pressure_tensions(sigma, lengths, float(abs(np.linalg.det(cell))))
    name = _label(one, str(one.population.values)).replace("\n", ", ")
    return Drawing(
        caption.replace("{name}", name), one.edges.values, one.offsets.values, cell, one.coordinates.values, tensions
    )


# Claims


def claims(ds):
    """The statements of the paper on the populations; claims on populations without a run are left out.

    So are those on the growth with strain for other deformations than the dilation of the paper, and all for a network
    from a file.
    """
    if "network" in parameters(ds):
        return []
    have = {p for p in ds.population.values if len(of(ds, "C_B_exact", p)) or p == "random_lengths_wide"}
    dilated = parameters(ds).get("deformation", "dilation") == "dilation"
    made = [make for needs, make in _CLAIMS if have.issuperset(needs) and (dilated or make is not _growth)]
    return [claim for make in made for claim in make(ds)]


def _ratio(ds, name, above, below):
    """Mean and standard deviation over networks of how far one population lies above another, in percent."""
    pair = (ds[name].sel(population=above) / ds[name].sel(population=below) - 1).values
    pair = finite(pair)
    return 100 * float(np.mean(pair)), 100 * float(np.std(pair))


def _least_variances(ds):
    V_L = of(ds, "length_variance", "length_variance")
    yield Claim.tested(
        "LengthVariance", "equal lengths are reached up to V_L ≲ 1e-7", "≲ 1e-7", f"at most {V_L.max():.1g}",
        V_L.max() < 1e-7, "at equal lengths some network has slack edges",
    )  # fmt: skip
    V_t = of(ds, "tension_variance", "tension_variance")
    status = ds.status.sel(population="tension_variance").values
    collapsed = int(np.sum(status == Status.edge_collapse))
    note = f"in {collapsed} of {len(status)} networks the infimum is not attained: edges shrink to zero length"
    yield Claim.tested(
        "TensionVariance", "the least tension variance is about 1e-2, not zero", "≈ 1e-2", spread(V_t, 3),
        0.005 < V_t.mean() < 0.02, "small networks come closer to regular ones", note if collapsed else "",
    )  # fmt: skip


def _bulk(ds):
    yield largest_bulk(ds, PAPER_POPULATIONS)
    for population, printed, within in (
        ("length_variance", 10, 5),
        ("shear_modulus", 50, 10),
        ("random_stress", 50, 10),
    ):
        mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
        yield Claim.tested(
            f"ResponseMetrics-A-{population}", f"max B_0 lies about {printed} % above {population}", f"{printed} %",
            f"{mean:.1f} ± {std:.1f} %", abs(mean - printed) <= within,
            "the paper rounds two populations to one number, and this one is the farther from it",
        )  # fmt: skip
    for population, key in SPREADS.items():
        if population in ds.population and len(of(ds, "bulk_modulus_0", population)):
            width = parameters(ds)[key]
            mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
            slack = 100 * (1 - float(np.mean(of(ds, "stressed_fraction", population))))
            yield Claim.tested(
                f"ResponseMetrics-A-{population}",
                f"max B_0 lies about 10 % above random rest lengths (s = {width:g})", "10 %",
                f"{mean:.1f} ± {std:.1f} %", abs(mean - 10) <= 5,
                f"B_0 falls as rest lengths spread, so 10 % belongs to a narrower spread; at s = {width:g}, "
                f"{slack:.2g} % of the edges are slack on average",
            )  # fmt: skip


def _growth(ds):
    def shown(name):
        return "; ".join(f"{p} {spread(of(ds, name, p), 2)}" for p in PAPER_POPULATIONS)

    yield signs_of_bulk(ds, PAPER_POPULATIONS, shown("C_B_exact"))
    for name in CONVENTIONS:
        share = negative_shares(ds, name, PAPER_POPULATIONS)["shear_modulus"]
        because = (
            f"C_G of max G_0 is negative in {100 * share:.0f} % of the networks; its sign depends "
            "on how pressure enters the shear modulus"
        )
        yield signs_of_shear(ds, name, PAPER_POPULATIONS, shown(name), because)
    yield opposed_ranks(ds, PAPER_POPULATIONS)
    yield linear_change(ds, PAPER_POPULATIONS)


def _shear(ds):
    best = spread(of(ds, "shear_modulus_0", "shear_modulus"), 3)
    yield large_shear(shear_gain(ds, PAPER_POPULATIONS), best)
    kappa = of(ds, "anisotropy_force", "shear_modulus")
    yield Claim.tested(
        "StructuralMetrics-force", "⟨κ_force⟩ of max G_0 is close to its maximum of 1", "close to 1", spread(kappa, 3),
        kappa.mean() > 0.8, "the force triangles are less thin",
    )  # fmt: skip


def _alike(ds):
    medians = ds[list(STRUCTURE)].sel(population=list(PAPER_POPULATIONS)).median("seed")
    for one, other, names in (
        ("length_variance", "random_lengths", "min V_L and random rest lengths"),
        ("length_variance", "random_lengths_wide", "min V_L and random rest lengths at the printed spread"),
        ("bulk_modulus", "tension_variance", "max B_0 and min V_τ"),
    ):
        if other not in ds.population:
            continue
        gap = {}
        for metric in STRUCTURE:
            width = float(medians[metric].max() - medians[metric].min())
            apart = float(ds[metric].sel(population=one).median() - ds[metric].sel(population=other).median())
            gap[metric] = 100 * abs(apart) / width
        worst = max(gap, key=gap.__getitem__)
        yield Claim.tested(
            f"StructuralMetrics-{one}-{other}", f"{names} are alike in all structural metrics", "very similar",
            f"medians differ by at most {gap[worst]:.0f} % of the range of all populations ({worst})", gap[worst] < 25,
            "so wide a spread of rest lengths leaves edges slack, and tension gathers on the others",
        )  # fmt: skip


def _percolation(ds):
    for population, key in reversed(SPREADS.items()):
        if population not in ds.population or not len(of(ds, "stressed_fraction", population)):
            continue
        fraction = of(ds, "stressed_fraction", population)
        whole, width = int(np.sum(fraction == 1.0)), parameters(ds)[key]
        yield Claim.tested(
            f"percolation-{key}", f"random rest lengths of spread s = {width:g} leave every edge stressed",
            "full rigidity percolation",
            f"{whole} of {len(fraction)} networks; {100 * fraction.mean():.1f} ± {100 * fraction.std():.1f} % of edges",
            whole >= 0.9 * len(fraction),
            "edges are slack in the other networks: the cone program finds the global optimum",
        )  # fmt: skip


_CLAIMS = (
    (("length_variance", "tension_variance"), _least_variances),
    (PAPER_POPULATIONS, _bulk),
    (PAPER_POPULATIONS, _growth),
    (PAPER_POPULATIONS, _shear),
    (PAPER_POPULATIONS, _alike),
    ((), _percolation),
)


study = Study(
    name="ensemble",
    version=2,
    title="Populations of critical configurations, strained past the rigidity transition",
    references=PAPER,
    axes=(
        Axis("seed", range(100), "seed of the network", noun="networks"),
        Axis("population", POPULATIONS, "population of critical configurations"),
    ),
    parameters={
        "n_vertices": 1000,
        "hard_core": 0.82,
        "threshold": 0.1,
        "spread": 0.1,
        "spread_wide": 0.3,
        "protocol": "conic",
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
        "deformation": "dilation",
        "network": "",
    },
    coordinates=(
        Coordinate("strain", "strains", "strain |γ| past the transition, of the deformation and sign that tightens"),
    ),
    case=case,
    check=check,
    complete=with_digest,
    variables=tuple(table(planar=True)),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    needs={
        "gallery": (*DRAWN, "bulk_modulus_0"),
        "structure": (*DRAWN, *STRUCTURE, "stressed_fraction"),
        "response": (*DRAWN, *RESPONSE, "stressed_fraction"),
        "claims": (*STRUCTURE, *RESPONSE, "C_G_exact", "C_B", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
