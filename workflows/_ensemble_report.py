"""Figures, claims and summary of the ensemble, read off its dataset alone."""

from __future__ import annotations

import json

import numpy as np

from critflow.plot import Drawing, Panel, gallery_figure, panel_figure, unit_pressure_tensions
from critflow.result import Status
from critflow.workflow import Claim

LABELS = {
    "length_variance": "min $V_L$",
    "tension_variance": "min $V_\\tau$",
    "bulk_modulus": "max $B_0$",
    "shear_modulus": "max $G_0$",
    "random_lengths": "random $\\ell$\n$s={spread:g}$",
    "random_stress": "random $\\sigma$",
    "random_lengths_wide": "random $\\ell$\n$s={spread_wide:g}$",
}
# Populations that the paper shows; the wide one follows its printed spread, the other what its text describes.
PAPER = ("length_variance", "tension_variance", "bulk_modulus", "shear_modulus", "random_lengths", "random_stress")
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
    note = f"Red lines: no change with strain. {_DRAWINGS}"
    return panel_figure(
        panels, _labels(ds), "Mechanical response of critical configurations", f"{note} {_wide_note(ds)}"
    )


def gallery(ds):
    """`Networks`, in short: the first network in every population, on one colour scale."""
    drawings = []
    for population in ds.population.values:
        one = ds.isel(seed=0).sel(population=population)
        if np.isfinite(one.sigma.values).all():
            drawings.append(_drawing(one, "", f"$B_0$ = {float(one.bulk_modulus_0):.3f}"))
    title = f"One network of {ds.sizes['vertex']} vertices at the rigidity transition, seven ways"
    return gallery_figure(drawings, title.replace("seven", _NUMBERS.get(len(drawings), str(len(drawings)))))


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven"}


def _labels(ds):
    names = [str(name) for name in ds.population.values]
    return [LABELS[name].format(**_parameters(ds)) for name in names]


def _parameters(ds):
    return json.loads(ds.attrs["parameters"])


def _wide_note(ds):
    if "random_lengths_wide" not in ds.population:
        return ""
    stressed = float(ds.stressed_fraction.sel(population="random_lengths_wide").mean())
    spread = _parameters(ds)["spread_wide"]
    return f"At the printed spread s = {spread:g} only {100 * stressed:.0f} % of the edges are stressed."


def _panel(ds, name, label, log=False, zero_line=False):
    values = ds[name].transpose("population", "seed")
    medians = values.median("seed")
    drawings = []
    if np.isfinite(medians).any():
        for word, population in (("high", medians.idxmax()), ("low", medians.idxmin())):
            of_population = values.sel(population=population)
            seed = np.abs(of_population - of_population.median()).idxmin()
            shown = f"{float(of_population.sel(seed=seed)):.2g}"
            drawings.append(_drawing(ds.sel(population=population, seed=seed), f"{word}: ", shown))
    return Panel(label, list(values.values), drawings, log, zero_line)


def _drawing(one, word, value):
    """One configuration; `one` has neither seed nor population left."""
    sigma, lengths, cell = one.sigma.values, one.length.values, one.cell.values
    tensions = unit_pressure_tensions(sigma, lengths, float(abs(np.linalg.det(cell))))
    name = LABELS[str(one.population.values)].replace("\n", ", ").format(**_parameters(one))
    caption = f"{word}{name}, {value}"
    return Drawing(caption, one.edges.values, one.offsets.values, cell, one.coordinates.values, tensions)


# Claims


def claims(ds):
    """What the paper says beside what this ensemble says; claims whose populations were not run are left out."""
    have = set(ds.population.values)
    found = [claim for needs, make in _CLAIMS if have.issuperset(needs) for claim in make(ds)]
    return found


def _of(ds, name, population):
    values = ds[name].sel(population=population).values
    return values[np.isfinite(values)]


def _spread(values, digits=4):
    return f"{np.mean(values):.{digits}g} ± {np.std(values):.1g}"


def _ratio(ds, name, above, below):
    """Mean and standard deviation over networks of how far one population lies above another, in percent."""
    pair = (ds[name].sel(population=above) / ds[name].sel(population=below) - 1).values
    pair = pair[np.isfinite(pair)]
    return 100 * float(np.mean(pair)), 100 * float(np.std(pair))


def _verdict(holds):
    return "holds" if holds else "differs"


def _least_variances(ds):
    V_L = _of(ds, "length_variance", "length_variance")
    V_t = _of(ds, "tension_variance", "tension_variance")
    status = ds.status.sel(population="tension_variance").values
    collapsed = int(np.sum(status == Status.edge_collapse))
    yield Claim(
        "LengthVariance", "equal lengths are reached up to V_L ≲ 1e-7", "≲ 1e-7", f"at most {V_L.max():.1g}",
        _verdict(V_L.max() < 1e-7), "" if V_L.max() < 1e-7 else "some network has slack edges at equal lengths",
    )  # fmt: skip
    yield Claim(
        "TensionVariance", "the least tension variance is about 1e-2, not zero", "≈ 1e-2", _spread(V_t, 3),
        _verdict(0.005 < V_t.mean() < 0.02),
        f"in {collapsed} of {len(status)} networks it is an infimum that is not attained: two edges of a four-sided "
        "face shrink to zero length" if collapsed else "",
    )  # fmt: skip


def _bulk(ds):
    order = {p: float(np.median(_of(ds, "bulk_modulus_0", p))) for p in PAPER}
    ranked = sorted(order, key=order.__getitem__, reverse=True)
    value = ", ".join(f"{p} {order[p]:.3f}" for p in ranked)
    yield Claim(
        "ResponseMetrics-A", "max B_0 has the largest bulk modulus, followed closely by min V_τ", "order", value,
        _verdict(ranked[:2] == ["bulk_modulus", "tension_variance"]), "",
    )  # fmt: skip
    for population, said in (("length_variance", 10), ("shear_modulus", 50), ("random_stress", 50)):
        mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
        holds = abs(mean - said) <= 5 if said == 10 else abs(mean - said) <= 10
        yield Claim(
            f"ResponseMetrics-A-{population}", f"max B_0 lies about {said} % above {population}", f"{said} %",
            f"{mean:.1f} ± {std:.1f} %", _verdict(holds),
            "" if holds else "the paper gives one rounded number for two populations, of which the other comes closer",
        )  # fmt: skip
    spreads = _parameters(ds)
    for population, key in (("random_lengths", "spread"), ("random_lengths_wide", "spread_wide")):
        if population in ds.population:
            mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
            slack = 100 * (1 - float(ds.stressed_fraction.sel(population=population).mean()))
            yield Claim(
                f"ResponseMetrics-A-{population}",
                f"max B_0 lies about 10 % above random rest lengths (s = {spreads[key]:g})", "10 %",
                f"{mean:.1f} ± {std:.1f} %", _verdict(abs(mean - 10) <= 5),
                "" if abs(mean - 10) <= 5 else
                f"B_0 falls as rest lengths spread; at s = {spreads[key]:g}, {slack:.2g} % of the edges are slack on "
                "average; 10 % would belong to a spread near 0.05",
            )  # fmt: skip


def _growth(ds):
    def signs(name):
        return {p: float(np.mean(_of(ds, name, p) < 0)) for p in PAPER if len(_of(ds, name, p))}

    def shown(name):
        return "; ".join(f"{p} {_spread(_of(ds, name, p), 2)}" for p in PAPER if len(_of(ds, name, p)))

    negative = signs("C_B_exact")
    holds = all((share > 0.5) == (p in ("bulk_modulus", "tension_variance")) for p, share in negative.items())
    yield Claim(
        "ResponseMetrics-B", "C_B < 0 for max B_0 and min V_τ, > 0 for all others", "signs", shown("C_B_exact"),
        _verdict(holds), "" if holds else "the signs of the medians are others",
    )  # fmt: skip
    for name, convention in (("C_G_stress_corrected_exact", "stress-corrected"), ("C_G_exact", "energy")):
        negative = signs(name)
        holds = all((share > 0.5) == (p == "shear_modulus") for p, share in negative.items())
        share = 100 * negative["shear_modulus"]
        yield Claim(
            f"ResponseMetrics-D-{convention}", f"C_G < 0 for max G_0 only ({convention} convention)", "signs",
            shown(name), _verdict(holds),
            "" if holds else f"C_G of max G_0 is negative in {share:.0f} % of the networks only; the sign depends on "
            "how pressure enters the shear modulus, and the paper's signs are those of the stress-corrected convention",
        )  # fmt: skip
    order = [float(np.median(_of(ds, "bulk_modulus_0", p))) for p in PAPER]
    slopes = [float(np.median(_of(ds, "C_B_exact", p))) for p in PAPER]
    rank = float(np.corrcoef(np.argsort(np.argsort(order)), np.argsort(np.argsort(slopes)))[0, 1])
    yield Claim(
        "ModulusStrainScaling-ranks", "populations with larger bulk moduli have smaller C_B", "decreasing",
        f"rank correlation {rank:.2f}", _verdict(rank < -0.7), "" if rank < -0.7 else "the ranks are not opposed",
    )  # fmt: skip
    off = np.abs(ds.C_B / ds.C_B_exact - 1).sel(population=list(PAPER)).values
    off = off[np.isfinite(off)]
    yield Claim(
        "ModulusStrainScaling", "moduli grow linearly with strain near the transition", "linear",
        f"a straight line to γ = {_parameters(ds)['fit_window']:g} misses the exact C_B by "
        f"{100 * np.median(off):.1f} % (median), {100 * np.quantile(off, 0.9):.0f} % (90th percentile)",
        _verdict(np.median(off) < 0.2),
        "" if np.median(off) < 0.2 else "the window is too wide for a straight line",
    )  # fmt: skip


def _shear(ds):
    others = [p for p in PAPER if p != "shear_modulus"]
    best = _of(ds, "shear_modulus_0", "shear_modulus")
    rest = max(float(np.median(_of(ds, "shear_modulus_0", p))) for p in others)
    yield Claim(
        "ResponseMetrics-C", "max G_0 networks have a much larger G_0 than all others", "much larger",
        f"{_spread(best, 3)}, {np.median(best) / rest:.0f} times the largest other median",
        _verdict(np.median(best) > 10 * rest), "" if np.median(best) > 10 * rest else "less than ten times larger",
    )  # fmt: skip
    kappa = _of(ds, "anisotropy_force", "shear_modulus")
    yield Claim(
        "StructuralMetrics-force", "⟨κ_force⟩ of max G_0 is close to its maximum of 1", "close to 1", _spread(kappa, 3),
        _verdict(kappa.mean() > 0.8), "" if kappa.mean() > 0.8 else "the force triangles are less thin",
    )  # fmt: skip


def _alike(ds):
    for one, other, name in (
        ("length_variance", "random_lengths", "min V_L and random rest lengths"),
        ("length_variance", "random_lengths_wide", "min V_L and random rest lengths at the printed spread"),
        ("bulk_modulus", "tension_variance", "max B_0 and min V_τ"),
    ):
        if not {one, other}.issubset(ds.population.values):
            continue
        metrics = list(STRUCTURE)
        medians = ds[metrics].sel(population=list(PAPER)).median("seed")
        gap = {}
        for metric in metrics:
            width = float(medians[metric].max() - medians[metric].min())
            apart = float(ds[metric].sel(population=one).median() - ds[metric].sel(population=other).median())
            gap[metric] = abs(apart) / width
        worst = max(gap, key=gap.__getitem__)
        holds = gap[worst] < 0.25
        yield Claim(
            f"StructuralMetrics-{one}-{other}", f"{name} are alike in all structural metrics", "very similar",
            f"medians differ by at most {100 * gap[worst]:.0f} % of the range of all populations ({worst})",
            _verdict(holds), "" if holds else "slack edges change the structure: the spread is too wide",
        )  # fmt: skip


def _percolation(ds):
    spreads = _parameters(ds)
    for population, key in (("random_lengths_wide", "spread_wide"), ("random_lengths", "spread")):
        if population not in ds.population:
            continue
        fraction = _of(ds, "stressed_fraction", population)
        whole = int(np.sum(fraction == 1.0))
        holds = whole >= 0.9 * len(fraction)
        yield Claim(
            f"percolation-{key}", f"random rest lengths of spread s = {spreads[key]:g} leave every edge stressed",
            "full rigidity percolation",
            f"{whole} of {len(fraction)} networks; {100 * fraction.mean():.1f} ± {100 * fraction.std():.1f} % of edges",
            _verdict(holds),
            "" if holds else "the cone program, whose answer is global, leaves edges slack in the other networks; on "
            "these networks a spread near 0.1 is the largest that percolates",
        )  # fmt: skip


_CLAIMS = (
    (("length_variance", "tension_variance"), _least_variances),
    (PAPER, _bulk),
    (PAPER, _growth),
    (PAPER, _shear),
    (PAPER, _alike),
    ((), _percolation),
)


def summary(ds):
    """Scalars for tables: mean, spread and quantiles of every member variable, and how the solves ended."""
    table = {}
    for population in ds.population.values:
        one = ds.sel(population=population)
        rows = {}
        for name, values in one.data_vars.items():
            if values.dims == ("seed",) and values.dtype.kind == "f":
                finite = values.values[np.isfinite(values.values)]
                if len(finite):
                    low, median, high = np.quantile(finite, (0.05, 0.5, 0.95))
                    rows[name] = {
                        "n": len(finite), "mean": float(finite.mean()), "std": float(finite.std()),
                        "q05": float(low), "median": float(median), "q95": float(high),
                    }  # fmt: skip
        codes, counts = np.unique(one.status.values, return_counts=True)
        rows["status"] = {Status(int(code)).name: int(count) for code, count in zip(codes, counts, strict=True)}
        rows["max_force"] = float(one.max_force.max())
        table[str(population)] = rows
    return {"networks": int(ds.sizes["seed"]), "parameters": _parameters(ds), "populations": table}
