"""Measurements and summaries of the populations, for the statements of the paper on them.

Medians with the range of 90 % of the networks describe distributions that spread over decades.
"""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from critflow.engine.study import plural
from critflow.result import Status

from ..paper.statements import Measurement
from .populations import NAMES, PAPER_POPULATIONS
from .reports import finite, minus, parameters, status_counts

# Fitted growth of the shear modulus with strain, by the convention of the modulus.
CONVENTIONS = {"C_G_fit": "as printed, (1/V) d²E/dγ²", "C_G_stress_corrected_fit": "stress-corrected, not printed"}
CHANCE = 0.05  # part of all orders of the medians, below which one is not by chance
CLOSE = 1.05  # first over second median that follows closely
METRICS = {"V_L": "V_L", "kappa_phys": "κ_phys", "V_tau": "V_τ", "kappa_force": "κ_force"}
# The two states of random rest lengths that the text admits: in its box, and "at the critical strain".
READINGS = {
    "random_lengths": "box of side √N_b, as the protocol records it",
    "random_lengths_transition": "V = N_v, exactly at the transition",
}
# Spread of random rest lengths that the paper prints as the largest with every edge stressed; others do not test it.
PRINTED_SPREAD = 0.3


def of(ds, name, population):
    """The finite values of a variable in one population, (n,)."""
    return finite(ds[name].sel(population=population).values)


def described(values, unit=""):
    """Median and range of 90 % of the finite values, as text."""
    known = finite(values)
    if not len(known):
        return "undefined"
    low, middle, high = np.quantile(known, (0.05, 0.5, 0.95))
    return f"{middle:.3g}{unit} ({low:.3g} to {high:.3g}{unit})"


def listed(ds, name):
    """The distribution of a variable in each population where it is defined."""
    return "; ".join(f"{NAMES[p]} {described(v)}" for p in PAPER_POPULATIONS if len(v := of(ds, name, p)))


def sample(ds, number):
    """How many of how many networks, as in "99 of 100 networks"."""
    total = plural(ds.sizes["seed"], "network")
    return total if number == ds.sizes["seed"] else f"{number} of {total}"


def counts(ds, name, populations=PAPER_POPULATIONS):
    """How many networks of each population have a value, as a sample; one number where all are equal."""
    n = {p: len(of(ds, name, p)) for p in populations}
    if len(set(n.values())) == 1:
        return f"{sample(ds, n[populations[0]])} each"
    return f"{', '.join(f'{NAMES[p]} {number}' for p, number in n.items())} of {plural(ds.sizes['seed'], 'network')}"


def medians_of(ds, name, populations=PAPER_POPULATIONS):
    """Medians of populations, by default those of the paper, by name, where a network has a value."""
    return {str(p): float(np.median(v)) for p in populations if len(v := of(ds, name, p))}


def _readings(ds):
    """The populations of random rest lengths, a description of each, and whether its spread is the printed one."""
    spread = parameters(ds)["spread"]
    for p, reading in READINGS.items():
        if p in ds.population.values and len(of(ds, "stressed_fraction", p)):
            yield p, f"{reading}, s = {spread:g}", spread == PRINTED_SPREAD


def population_measurements(ds) -> Iterator[Measurement]:
    """The statements on variances, moduli, structure, growth and percolation of all populations of the paper.

    Those on the growth with strain are left out for other deformations than the dilation of the paper.
    """
    yield from percolation_measurements(ds)
    yield from _variances(ds)
    yield from _structure(ds)
    yield from _bulk(ds)
    yield _shear_gain(ds)
    if parameters(ds).get("deformation", "dilation") == "dilation":
        yield from _linear_change(ds)
        yield from _opposed_ranks(ds)
        yield from _signs(ds)


def percolation_measurements(ds) -> Iterator[Measurement]:
    """Whether random rest lengths leave every edge stressed, by a stress of any sign."""
    for p, words, printed in _readings(ds):
        stressed, tense = (of(ds, name, p) for name in ("stressed_fraction", "tension_fraction"))
        whole, under_tension = (int(np.sum(fraction == 1.0)) for fraction in (stressed, tense))
        yield Measurement(
            "full-percolation", whole / len(stressed),
            f"all edges stressed in {whole} of {plural(len(stressed), 'network')}, all under tension in "
            f"{under_tension}; {described(100 * stressed, ' %')} of the edges stressed",
            sample(ds, len(stressed)), words, counts=printed,
        )  # fmt: skip


def _variances(ds):
    V_L = of(ds, "V_L", "min_V_L")
    yield Measurement(
        "equal-lengths", float(np.mean(V_L <= 1e-7)),
        f"in {np.sum(V_L <= 1e-7)} of {len(V_L)}, at most {V_L.max():.1g}", sample(ds, len(V_L)),
    )  # fmt: skip
    V_tau, status = of(ds, "V_tau", "min_V_tau"), ds.status.sel(population="min_V_tau").values
    missed = int(np.sum(status == Status.edge_collapse))
    note = f"in {plural(missed, 'network')} the infimum is not attained: edges shrink to zero length"
    yield Measurement(
        "least-V_tau", float(np.median(V_tau)), described(V_tau), sample(ds, len(V_tau)),
        note=note if missed else "",
    )  # fmt: skip
    yield from _fracture(ds)


def _fracture(ds):
    """The pressure at which the largest tension of a network is one, by population."""
    if "sigma" not in ds:
        return
    volume, strength = np.abs(np.linalg.det(ds.cell.transpose("seed", ...).values)), {}
    for p in PAPER_POPULATIONS:
        sigma, length = (ds[name].sel(population=p).transpose("seed", "edge").values for name in ("sigma", "length"))
        pressure = np.sum(sigma * length**2, axis=1) / (2 * volume)
        strength[p] = float(np.nanmedian(pressure / np.abs(sigma * length).max(axis=1)))
    ranked = sorted(strength, key=strength.__getitem__, reverse=True)
    yield Measurement(
        "fracture", float(ranked[0] == "min_V_tau"),
        "pressure over the largest tension: " + ", ".join(f"{NAMES[p]} {strength[p]:.2g}" for p in ranked),
        counts(ds, "V_tau"),
    )  # fmt: skip


def _structure(ds):
    if not all(name in ds and len(medians_of(ds, name)) == len(PAPER_POPULATIONS) for name in METRICS):
        return
    for p, words, printed in _readings(ds):
        yield _alike(ds, "similar-lengths", "min_V_L", p, words, printed)
    yield _alike(ds, "similar-tensions", "max_B_0", "min_V_tau")
    ranked = {name: sorted(m := medians_of(ds, name), key=m.__getitem__) for name in ("V_tau", "kappa_force")}
    yield Measurement(
        "regular-forces", float(np.mean([set(order[:2]) == {"max_B_0", "min_V_tau"} for order in ranked.values()])),
        "; ".join(f"{METRICS[name]}: " + ", ".join(f"{NAMES[p]} {medians_of(ds, name)[p]:.3g}" for p in order)
                  for name, order in ranked.items()), counts(ds, "V_tau"),
    )  # fmt: skip
    kappa = of(ds, "kappa_force", "max_G_0")
    yield Measurement("kappa-force", float(np.median(kappa)), described(kappa), sample(ds, len(kappa)))


def _alike(ds, statement, one, other, words="", printed=True):
    """Distance of the medians of two populations in each metric, in percent of the range of all medians."""
    apart = {}
    for metric in METRICS:
        width = np.ptp(list(medians_of(ds, metric).values()))
        apart[metric] = 100 * abs(np.median(of(ds, metric, one)) - np.median(of(ds, metric, other))) / width
    text = "medians differ by " + ", ".join(f"{METRICS[name]} {value:.3g} %" for name, value in apart.items())
    n = counts(ds, "stressed_fraction", (one, other))
    return Measurement(statement, max(apart.values()), text, n, words, counts=printed)


def _bulk(ds):
    medians = medians_of(ds, "B_0")
    ranked = sorted(medians, key=medians.__getitem__, reverse=True)
    ordered = ranked[:2] == ["max_B_0", "min_V_tau"] and medians["max_B_0"] < CLOSE * medians["min_V_tau"]
    yield Measurement(
        "B_0-order", float(ordered), ", ".join(f"{NAMES[p]} {medians[p]:.3f}" for p in ranked), counts(ds, "B_0")
    )
    for p in ("min_V_L", "max_G_0", "random_stress"):
        yield _above(ds, f"B_0-over-{p}", p)
    for p, words, printed in _readings(ds):
        yield _above(ds, "B_0-over-random_lengths", p, words, printed)


def _above(ds, name, population, words="", printed=True):
    """How far max B_0 lies above another population in the same networks [%]."""
    best, other = (ds.B_0.sel(population=p) for p in ("max_B_0", population))
    above = finite(100 * (best / other - 1))
    return Measurement(
        name, float(np.median(above)), described(above, " %"), sample(ds, len(above)), words, counts=printed
    )


def _shear_gain(ds):
    """Median of G_0 at max G_0 over the largest median of the other populations."""
    medians = medians_of(ds, "G_0")
    gain = medians.pop("max_G_0") / max(*medians.values(), 1e-300)
    return Measurement(
        "G_0-gain", gain, f"{described(of(ds, 'G_0', 'max_G_0'))}, {gain:.0f} times the largest other median",
        counts(ds, "G_0"),
    )  # fmt: skip


def _linear_change(ds):
    """How far the growth over the smallest strain is from the exact coefficient, in percent."""
    first = ds.isel(strain=0)
    grown = (first.B - ds.B_0) / first.strain
    off = 100 * np.abs(grown / ds.C_B - 1)
    for p in PAPER_POPULATIONS:
        if len(known := finite(off.sel(population=p))):
            text = f"{described(known, ' %')} at γ = {float(first.strain):g}"
            yield Measurement("linear-growth", float(np.median(known)), text, sample(ds, len(known)), NAMES[p])


def _opposed_ranks(ds):
    """Whether larger medians of a modulus come with smaller ones of its fitted growth.

    Bulk: the part of all orders that are as opposed.  Shear: whether the one population with a modulus has the least.
    """
    for growth in ("C_B_fit", *CONVENTIONS):
        moduli, growths = medians_of(ds, "B_0" if growth == "C_B_fit" else "G_0"), medians_of(ds, growth)
        names = [p for p in PAPER_POPULATIONS if p in growths and p in moduli]
        if growth != "C_B_fit":
            ranked = sorted(names, key=growths.__getitem__)
            text = "C_G " + ", ".join(f"{NAMES[p]} {growths[p]:.2g}" for p in ranked)
            yield Measurement(
                "opposed-ranks", float(ranked[:1] == ["max_G_0"]), minus(text), plural(len(names), "population"),
                f"G, {CONVENTIONS[growth]}",
            )  # fmt: skip
            continue
        first, second = (np.argsort(np.argsort([of_all[p] for p in names])) for of_all in (moduli, growths))
        probability = float(np.mean(np.array(list(permutations(range(len(names))))) @ first <= second @ first))
        text = f"rank correlation {np.corrcoef(first, second)[0, 1]:.2f}, p = {probability:.2g}"
        yield Measurement(
            "opposed-ranks", float(probability < CHANCE), minus(text), plural(len(names), "population"), "B"
        )


def _signs(ds):
    for name in ("C_B_fit", *CONVENTIONS):
        negative = ("max_G_0",) if name in CONVENTIONS else ("max_B_0", "min_V_tau")
        share = {
            p: float(np.mean(v < 0 if p in negative else v > 0)) for p in PAPER_POPULATIONS if len(v := of(ds, name, p))
        }
        if not share:
            continue
        least = min(share, key=share.__getitem__)
        where = f" ({NAMES[least]})" if share[least] < 1 else ""
        yield Measurement(
            "C_G-signs" if name in CONVENTIONS else "C_B-signs", share[least],
            f"in at least {100 * share[least]:.0f} % of each{where}; {minus(listed(ds, name))}", counts(ds, name),
            CONVENTIONS.get(name, ""),
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
        rows["valid"] = int((one.valid == 1).sum())
        rows["status"] = status_counts(one.status.values)
        rows["max_force"] = float(one.max_force.max())
        table[str(population)] = rows
    return {"networks": int(ds.sizes["seed"]), "parameters": parameters(ds), "populations": table}
