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
            drawings.append(_drawing(one, f"{{name}}: $B_0$ = {float(one.bulk_modulus_0):.3f}"))
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
            drawings.append(_drawing(ds.sel(population=population, seed=seed), f"{word}: {shown}\n{{name}}"))
    return Panel(label, list(values.values), drawings, log, zero_line)


def _drawing(one, caption):
    """One configuration; the {name} of its population goes into the caption."""
    sigma, lengths, cell = one.sigma.values, one.length.values, one.cell.values
    tensions = unit_pressure_tensions(sigma, lengths, float(abs(np.linalg.det(cell))))
    name = LABELS[str(one.population.values)].replace("\n", ", ").format(**_parameters(one))
    return Drawing(
        caption.replace("{name}", name), one.edges.values, one.offsets.values, cell, one.coordinates.values, tensions
    )


# Claims


def claims(ds):
    """What the paper says beside what this ensemble says; claims whose populations were not run are left out."""
    have = {p for p in ds.population.values if len(_of(ds, "C_B_exact", p)) or p == "random_lengths_wide"}
    return [claim for needs, make in _CLAIMS if have.issuperset(needs) for claim in make(ds)]


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


def _claim(key, statement, paper, value, holds, because, note=""):
    """A claim with its verdict: the reason stands where it differs, a note in any case."""
    if holds:
        return Claim(key, statement, paper, value, "holds", note)
    return Claim(key, statement, paper, value, "differs", "; ".join(filter(None, (because, note))))


def _least_variances(ds):
    V_L = _of(ds, "length_variance", "length_variance")
    yield _claim(
        "LengthVariance", "equal lengths are reached up to V_L ≲ 1e-7", "≲ 1e-7", f"at most {V_L.max():.1g}",
        V_L.max() < 1e-7, "at equal lengths some network has slack edges",
    )  # fmt: skip
    V_t = _of(ds, "tension_variance", "tension_variance")
    status = ds.status.sel(population="tension_variance").values
    collapsed = int(np.sum(status == Status.edge_collapse))
    note = f"in {collapsed} of {len(status)} networks the infimum is not attained: edges shrink to zero length"
    yield _claim(
        "TensionVariance", "the least tension variance is about 1e-2, not zero", "≈ 1e-2", _spread(V_t, 3),
        0.005 < V_t.mean() < 0.02, "small networks come closer to regular ones", note if collapsed else "",
    )  # fmt: skip


def _bulk(ds):
    order = {p: float(np.median(_of(ds, "bulk_modulus_0", p))) for p in PAPER}
    ranked = sorted(order, key=order.__getitem__, reverse=True)
    yield _claim(
        "ResponseMetrics-A", "max B_0 has the largest bulk modulus, followed closely by min V_τ", "order",
        ", ".join(f"{p} {order[p]:.3f}" for p in ranked), ranked[:2] == ["bulk_modulus", "tension_variance"],
        "the medians come in another order",
    )  # fmt: skip
    for population, said, within in (("length_variance", 10, 5), ("shear_modulus", 50, 10), ("random_stress", 50, 10)):
        mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
        yield _claim(
            f"ResponseMetrics-A-{population}", f"max B_0 lies about {said} % above {population}", f"{said} %",
            f"{mean:.1f} ± {std:.1f} %", abs(mean - said) <= within,
            "the paper rounds two populations to one number, and this one is the farther from it",
        )  # fmt: skip
    spreads = _parameters(ds)
    for population, key in (("random_lengths", "spread"), ("random_lengths_wide", "spread_wide")):
        if population in ds.population and len(_of(ds, "bulk_modulus_0", population)):
            mean, std = _ratio(ds, "bulk_modulus_0", "bulk_modulus", population)
            slack = 100 * (1 - float(np.mean(_of(ds, "stressed_fraction", population))))
            yield _claim(
                f"ResponseMetrics-A-{population}",
                f"max B_0 lies about 10 % above random rest lengths (s = {spreads[key]:g})", "10 %",
                f"{mean:.1f} ± {std:.1f} %", abs(mean - 10) <= 5,
                f"B_0 falls as rest lengths spread, so 10 % belongs to a narrower spread; at s = {spreads[key]:g}, "
                f"{slack:.2g} % of the edges are slack on average",
            )  # fmt: skip


def _growth(ds):
    def signs(name):
        return {p: float(np.mean(_of(ds, name, p) < 0)) for p in PAPER}

    def shown(name):
        return "; ".join(f"{p} {_spread(_of(ds, name, p), 2)}" for p in PAPER)

    holds = all((share > 0.5) == (p in ("bulk_modulus", "tension_variance")) for p, share in signs("C_B_exact").items())
    yield _claim(
        "ResponseMetrics-B", "C_B < 0 for max B_0 and min V_τ, > 0 for all others", "signs", shown("C_B_exact"),
        holds, "most networks of some population have the other sign",
    )  # fmt: skip
    for name, convention in (("C_G_stress_corrected_exact", "stress-corrected"), ("C_G_exact", "energy")):
        negative = signs(name)
        yield _claim(
            f"ResponseMetrics-D-{convention}", f"C_G < 0 for max G_0 only ({convention} convention)", "signs",
            shown(name), all((share > 0.5) == (p == "shear_modulus") for p, share in negative.items()),
            f"C_G of max G_0 is negative in {100 * negative['shear_modulus']:.0f} % of the networks; its sign depends "
            "on how pressure enters the shear modulus",
        )  # fmt: skip
    order, slopes = ([float(np.median(_of(ds, name, p))) for p in PAPER] for name in ("bulk_modulus_0", "C_B_exact"))
    rank = float(np.corrcoef(np.argsort(np.argsort(order)), np.argsort(np.argsort(slopes)))[0, 1])
    yield _claim(
        "ModulusStrainScaling-ranks", "populations with larger bulk moduli have smaller C_B", "decreasing",
        f"rank correlation {rank:.2f}", rank < -0.7, "the ranks are not opposed",
    )  # fmt: skip
    off = np.abs(ds.C_B / ds.C_B_exact - 1).sel(population=list(PAPER)).values
    off = 100 * off[np.isfinite(off)]
    yield _claim(
        "ModulusStrainScaling", "moduli grow linearly with strain near the transition", "linear",
        f"a straight line to γ = {_parameters(ds)['fit_window']:g} misses the exact C_B by {np.median(off):.1f} % "
        f"(median), {np.quantile(off, 0.9):.0f} % (90th percentile)", np.median(off) < 20,
        "the window is too wide for a straight line",
    )  # fmt: skip


def _shear(ds):
    best = _of(ds, "shear_modulus_0", "shear_modulus")
    rest = max(float(np.median(_of(ds, "shear_modulus_0", p))) for p in PAPER if p != "shear_modulus")
    times = np.median(best) / max(rest, 1e-300)
    yield _claim(
        "ResponseMetrics-C", "max G_0 networks have a much larger G_0 than all others", "much larger",
        f"{_spread(best, 3)}, {times:.0f} times the largest other median", times > 10, "less than ten times larger",
    )  # fmt: skip
    kappa = _of(ds, "anisotropy_force", "shear_modulus")
    yield _claim(
        "StructuralMetrics-force", "⟨κ_force⟩ of max G_0 is close to its maximum of 1", "close to 1", _spread(kappa, 3),
        kappa.mean() > 0.8, "the force triangles are less thin",
    )  # fmt: skip


def _alike(ds):
    medians = ds[list(STRUCTURE)].sel(population=list(PAPER)).median("seed")
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
        yield _claim(
            f"StructuralMetrics-{one}-{other}", f"{names} are alike in all structural metrics", "very similar",
            f"medians differ by at most {gap[worst]:.0f} % of the range of all populations ({worst})", gap[worst] < 25,
            "so wide a spread of rest lengths leaves edges slack, and tension gathers on the others",
        )  # fmt: skip


def _percolation(ds):
    spreads = _parameters(ds)
    for population, key in (("random_lengths_wide", "spread_wide"), ("random_lengths", "spread")):
        if population not in ds.population or not len(_of(ds, "stressed_fraction", population)):
            continue
        fraction = _of(ds, "stressed_fraction", population)
        whole = int(np.sum(fraction == 1.0))
        yield _claim(
            f"percolation-{key}", f"random rest lengths of spread s = {spreads[key]:g} leave every edge stressed",
            "full rigidity percolation",
            f"{whole} of {len(fraction)} networks; {100 * fraction.mean():.1f} ± {100 * fraction.std():.1f} % of edges",
            whole >= 0.9 * len(fraction),
            "edges are slack in the other networks, which the cone program, whose answer is global, leaves no doubt of",
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
