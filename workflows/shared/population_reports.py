"""Claims and summaries of the populations, for networks in two and three dimensions."""

from __future__ import annotations

import numpy as np

from critflow.workflow import Claim

from .reports import finite, parameters, status_counts

# Claims on the sign of the change of the shear modulus with strain, by the convention of the modulus.
CONVENTIONS = {"C_G_stress_corrected_exact": "stress-corrected", "C_G_exact": "energy"}


def of(ds, name, population):
    """The finite values of a variable in one population, (n,)."""
    return finite(ds[name].sel(population=population).values)


def negative_shares(ds, name, populations):
    """Share of the networks of each population with a negative value, of populations where it is defined."""
    known = {p: of(ds, name, p) for p in populations}
    return {p: float(np.mean(values < 0)) for p, values in known.items() if len(values)}


def largest_bulk(ds, populations):
    """The order of the medians of B_0."""
    order = {p: float(np.median(of(ds, "bulk_modulus_0", p))) for p in populations}
    ranked = sorted(order, key=order.__getitem__, reverse=True)
    return Claim.tested(
        "ResponseMetrics-A", "max B_0 has the largest bulk modulus, followed closely by min V_τ", "order",
        ", ".join(f"{p} {order[p]:.3f}" for p in ranked), ranked[:2] == ["bulk_modulus", "tension_variance"],
        "the medians come in another order",
    )  # fmt: skip


def signs_of_bulk(ds, populations, value):
    """The signs of C_B; `value` is the text that is measured."""
    shares = negative_shares(ds, "C_B_exact", populations)
    return Claim.tested(
        "ResponseMetrics-B", "C_B < 0 for max B_0 and min V_τ, > 0 for all others", "signs", value,
        all((share > 0.5) == (p in ("bulk_modulus", "tension_variance")) for p, share in shares.items()),
        "most networks of some population have the other sign",
    )  # fmt: skip


def signs_of_shear(ds, name, populations, value, because):
    """The signs of C_G in one convention; `value` is the text that is measured."""
    shares = negative_shares(ds, name, populations)
    return Claim.tested(
        f"ResponseMetrics-D-{CONVENTIONS[name]}", f"C_G < 0 for max G_0 only ({CONVENTIONS[name]} convention)", "signs",
        value, all((share > 0.5) == (p == "shear_modulus") for p, share in shares.items()), because,
    )  # fmt: skip


def opposed_ranks(ds, populations):
    """The rank correlation of the medians of B_0 and C_B."""
    populations = [p for p in populations if len(of(ds, "C_B_exact", p)) and len(of(ds, "bulk_modulus_0", p))]
    ranks = [
        np.argsort(np.argsort([float(np.median(of(ds, name, p))) for p in populations]))
        for name in ("bulk_modulus_0", "C_B_exact")
    ]
    correlation = float(np.corrcoef(*ranks)[0, 1])
    return Claim.tested(
        "ModulusStrainScaling-ranks", "populations with larger bulk moduli have smaller C_B", "decreasing",
        f"rank correlation {correlation:.2f}", correlation < -0.7, "the ranks are not opposed",
    )  # fmt: skip


def linear_change(ds, populations):
    """The error of C_B from a straight line over the window of strains."""
    key, statement = "ModulusStrainScaling", "moduli grow linearly with strain near the transition"
    window = f"γ = {parameters(ds)['fit_window']:g}"
    off = 100 * finite(np.abs(ds.C_B / ds.C_B_exact - 1).sel(population=list(populations)).values)
    if not len(off):
        return Claim(key, statement, "linear", f"undefined: no path has three strains up to {window}", "measured")
    return Claim.tested(
        key, statement, "linear",
        f"a straight line to {window} misses the exact C_B by {np.median(off):.1f} % (median), "
        f"{np.quantile(off, 0.9):.0f} % (90th percentile)", np.median(off) < 20,
        "the window is too wide for a straight line",
    )  # fmt: skip


def shear_gain(ds, populations):
    """Median of G_0 at max G_0 over the largest median of the other populations."""
    best = np.median(of(ds, "shear_modulus_0", "shear_modulus"))
    others = max(float(np.median(of(ds, "shear_modulus_0", p))) for p in populations if p != "shear_modulus")
    return best / max(others, 1e-300)


def large_shear(gain, value):
    """The gain in G_0; `value` is the text of the largest G_0."""
    return Claim.tested(
        "ResponseMetrics-C", "max G_0 networks have a much larger G_0 than all others", "much larger",
        f"{value}, {gain:.0f} times the largest other median", gain > 10, "less than ten times larger",
    )  # fmt: skip


def summary(ds):
    """Mean, spread and quantiles of every scalar of a population, its statuses and its largest residual force."""
    table = {}
    for population in ds.population.values:
        one = ds.sel(population=population)
        rows = {}
        for name, values in one.data_vars.items():
            if values.dims == ("seed",) and values.dtype.kind == "f" and len(known := finite(values)):
                low, median, high = np.quantile(known, (0.05, 0.5, 0.95))
                rows[name] = {
                    "n": len(known), "mean": float(known.mean()), "std": float(known.std()),
                    "q05": float(low), "median": float(median), "q95": float(high),
                }  # fmt: skip
        rows["status"] = status_counts(one.status.values)
        rows["max_force"] = float(one.max_force.max())
        table[str(population)] = rows
    return {"networks": int(ds.sizes["seed"]), "parameters": parameters(ds), "populations": table}
