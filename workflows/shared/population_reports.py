"""Claims and summaries of the populations, for networks in two and three dimensions.

Criteria follow from the paper: "about 10 %" and "about 50 %" are numbers of one digit, so a median within 5 points
agrees, "closely" means less than this half digit, and "about 1e-2" is its only digit; a sign is that of a population
if 95 % of its networks have it, and is undecided above one half; "largely similar" medians are apart by no more than a
tenth of a figure's axis.  Medians with the range of 90 % of the networks describe distributions that spread over
decades.
"""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from critflow.result import Status
from critflow.workflow import Claim
from critflow.workflow.study import plural

from .populations import NAMES, PAPER_POPULATIONS, SPREADS
from .reports import finite, parameters, status_counts

# Claims on the sign of the change of the shear modulus with strain, by the convention of the modulus.
CONVENTIONS = {"C_G_stress_corrected": "stress-corrected", "C_G": "energy"}
# How far max B_0 lies above other populations [%], as printed, and half of the last digit.
GAPS, HALF_DIGIT = {"min_V_L": 10, "max_G_0": 50, "random_stress": 50, "random_lengths": 10}, 5
SURE, LIKELY = 0.95, 0.5
LEAST_GAIN, STRAIGHT, SIGNIFICANT = 10, 10, 0.05


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


def counts(ds, name, populations=PAPER_POPULATIONS):
    """Number of networks of each population with a value, as a sample; one number where all are equal."""
    n = {p: len(of(ds, name, p)) for p in populations}
    if len(set(n.values())) == 1:
        return f"{plural(n[populations[0]], 'network')} each"
    return ", ".join(f"{NAMES[p]} {number}" for p, number in n.items())


def population_claims(ds, kind) -> Iterator[Claim]:
    """The statements on variances, moduli, signs and percolation of all populations of the paper.

    Those on the growth with strain are left out for other deformations than the dilation of the paper.
    """
    yield from _variances(ds, kind)
    yield from _bulk(ds, kind)
    if parameters(ds).get("deformation", "dilation") == "dilation":
        yield from _signs(ds, kind)
        yield from _opposed_ranks(ds, kind)
        yield _linear_change(ds, kind)
    yield _shear_gain(ds, kind)
    yield from percolation_claims(ds, kind)


def _variances(ds, kind):
    V_L = of(ds, "V_L", "min_V_L")
    slack = 100 * (1 - of(ds, "stressed_fraction", "min_V_L").mean())
    yield Claim.tested(
        "LengthVariance", "equal lengths are reached up to V_L ≲ 1e-7", "≲ 1e-7",
        f"V_L ≤ 1e-7 in {np.sum(V_L <= 1e-7)}, at most {V_L.max():.1g}", bool((V_L <= 1e-7).all()),
        f"equal lengths leave edges slack ({slack:.1f} % on average), which are shorter than the others",
        criterion="V_L ≤ 1e-7 in every network", sample=plural(len(V_L), "network"), kind=kind,
    )  # fmt: skip
    V_t, status = of(ds, "V_tau", "min_V_tau"), ds.status.sel(population="min_V_tau").values
    missed = int(np.sum(status != Status.ok))
    yield Claim.tested(
        "TensionVariance", "the least tension variance is about 1e-2, not zero", "≈ 1e-2", described(V_t),
        float(f"{np.median(V_t):.0e}") == 1e-2, "it is another number",
        f"{missed} networks do not attain their infimum: edges shrink to zero length" if missed else "",
        criterion="the median rounds to it, one digit", sample=plural(len(V_t), "network"), kind=kind,
    )  # fmt: skip


def _bulk(ds, kind):
    medians = {p: float(np.median(of(ds, "B_0", p))) for p in PAPER_POPULATIONS}
    ranked = sorted(medians, key=medians.__getitem__, reverse=True)
    close = medians["max_B_0"] < (1 + HALF_DIGIT / 100) * medians["min_V_tau"]
    yield Claim.tested(
        "ResponseMetrics-A", "max B_0 has the largest bulk modulus, followed closely by min V_τ", "order",
        ", ".join(f"{NAMES[p]} {medians[p]:.3f}" for p in ranked),
        ranked[:2] == ["max_B_0", "min_V_tau"] and close, "the medians come in another order or lie apart",
        criterion=f"first and second median, less than {HALF_DIGIT} % apart", sample=counts(ds, "B_0"),
        kind=kind,
    )  # fmt: skip
    for p in (*GAPS, "random_lengths_transition"):
        if p not in ds.population or not len(of(ds, "B_0", p)):
            continue
        printed = GAPS[p.removesuffix("_transition")]
        spread = f" (s = {parameters(ds)[SPREADS[p]]:g})" if p in SPREADS else ""
        best, other = (ds.B_0.sel(population=name) for name in ("max_B_0", p))
        above = finite(100 * (best / other - 1))
        slack = 100 * (1 - np.mean(of(ds, "stressed_fraction", p)))
        yield Claim.tested(
            f"ResponseMetrics-A-{p}", f"max B_0 lies about {printed} % above {NAMES[p]}{spread}", f"{printed} %",
            described(above, " %"), abs(np.median(above) - printed) <= HALF_DIGIT,
            f"{slack:.2g} % of the edges are slack on average, and tensions differ: V_τ = "
            f"{np.median(of(ds, 'V_tau', p)):.2g} in the median",
            criterion=f"median within {HALF_DIGIT} points", sample=plural(len(above), "network"), kind=kind,
        )  # fmt: skip


def _signs(ds, kind):
    statements = {"C_B": ("ResponseMetrics-B", "C_B < 0 for max B_0 and min V_τ, > 0 for all others")}
    for name, word in CONVENTIONS.items():
        statements[name] = (f"ResponseMetrics-D-{word}", f"C_G < 0 for max G_0, > 0 for all others ({word} convention)")
    for name, (key, statement) in statements.items():
        negative = ("max_B_0", "min_V_tau") if name == "C_B" else ("max_G_0",)
        known = {p: v for p in PAPER_POPULATIONS if len(v := of(ds, name, p))}
        share = {p: float(np.mean(v < 0 if p in negative else v > 0)) for p, v in known.items()}
        least = min(share.values())
        other = ", ".join(f"{100 * (1 - part):.0f} % of {NAMES[p]}" for p, part in share.items() if part < SURE)
        yield Claim.tested(
            key, statement, "signs", f"in at least {100 * least:.0f} % of each; {listed(ds, name)}",
            True if least >= SURE else None if least > LIKELY else False,
            f"the other sign in {other}", criterion=f"{100 * SURE:.0f} % of each population; undecided above one half",
            sample=counts(ds, name), kind=kind,
        )  # fmt: skip


def _opposed_ranks(ds, kind):
    """Rank correlations of the medians of moduli and of their growth, and the part of all orders with one as low."""
    for key, modulus, growth, words in (
        ("ranks", "B_0", "C_B", "bulk moduli have smaller C_B"),
        ("ranks-shear", "G_0", "C_G_stress_corrected", "shear moduli have smaller C_G"),
    ):
        names = [p for p in PAPER_POPULATIONS if len(of(ds, growth, p)) and len(of(ds, modulus, p))]
        first, second = (
            np.argsort(np.argsort([np.median(of(ds, name, p)) for p in names])) for name in (modulus, growth)
        )
        orders = np.array(list(permutations(range(len(names))))) @ first
        probability = float(np.mean(orders <= second @ first))
        correlation = np.corrcoef(first, second)[0, 1]
        yield Claim.tested(
            f"ModulusStrainScaling-{key}", f"populations with larger {words}", "decreasing",
            f"rank correlation {correlation:.2f}, p = {probability:.2g}",
            True if probability < SIGNIFICANT else None if correlation < 0 else False,
            "so few medians come in such an order by chance too" if correlation < 0 else "the ranks rise together",
            criterion=f"p < {SIGNIFICANT} of all orders of the medians; undecided where negative",
            sample=plural(len(names), "population"), kind=kind,
        )  # fmt: skip


def _linear_change(ds, kind):
    """The error of C_B from a straight line over the window of strains."""
    key, statement = "ModulusStrainScaling", "moduli grow linearly with strain close to the transition"
    window = f"γ = {parameters(ds)['fit_window']:g}"
    off = 100 * np.abs(ds.C_B_fit / ds.C_B - 1).sel(population=list(PAPER_POPULATIONS))
    medians = {p: float(np.median(known)) for p in PAPER_POPULATIONS if len(known := finite(off.sel(population=p)))}
    if not medians:
        return Claim(key, statement, "linear", f"undefined: no path has three strains up to {window}", "measured")
    bent = ", ".join(NAMES[p] for p, value in medians.items() if value > STRAIGHT)
    return Claim.tested(
        key, statement, "linear", f"a straight line to {window} misses the exact C_B by "
        + ", ".join(f"{NAMES[p]} {value:.2g} %" for p, value in medians.items()) + " (medians)", None if bent else True,
        f"the paper prints no window, and within this one the moduli of {bent} bend",
        criterion=f"{STRAIGHT} % in the median of each population, else undecided", sample=counts(ds, "C_B_fit"),
        kind=kind,
    )  # fmt: skip


def _shear_gain(ds, kind):
    """Median of G_0 at max G_0 over the largest median of the other populations."""
    others = {p: float(np.median(of(ds, "G_0", p))) for p in PAPER_POPULATIONS if p != "max_G_0"}
    best = of(ds, "G_0", "max_G_0")
    gain = float(np.median(best)) / max(*others.values(), 1e-300)
    return Claim.tested(
        "ResponseMetrics-C", "max G_0 networks have a significantly larger G_0 than all others, which are negligible",
        "much larger", f"{described(best)}, {gain:.0f} times the largest other median", gain >= LEAST_GAIN,
        "less than ten times larger", criterion=f"{LEAST_GAIN} times", sample=counts(ds, "G_0"), kind=kind,
    )  # fmt: skip


def percolation_claims(ds, kind) -> Iterator[Claim]:
    """Whether random rest lengths leave every edge stressed."""
    for population, key in SPREADS.items():
        if population in ds.population and len(fraction := of(ds, "stressed_fraction", population)):
            whole = int(np.sum(fraction == 1.0))
            yield Claim.tested(
                f"percolation-{population}", f"{NAMES[population]} (s = {parameters(ds)[key]:g}) stress every edge",
                "full rigidity percolation",
                f"{whole} of {len(fraction)} networks; {described(100 * fraction, ' %')} of the edges",
                whole == len(fraction),
                "some edges are slack, or compressed where the state lies beyond the transition",
                criterion="every network", sample=plural(len(fraction), "network"), kind=kind,
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
