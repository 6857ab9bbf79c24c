"""Claims of the ascents, and of the shear modulus against size, threshold and starts; verification of the records."""

import numpy as np

from critflow.result import Status
from critflow.workflow import Claim
from critflow.workflow.study import plural

from ..shared.population_reports import described
from ..shared.populations import NAMES
from ..shared.power_laws import exponent, judged, shown
from ..shared.reports import parameters, spread
from ..shared.verification import contradictions
from .figures import ascent_ends, by_size, detailed, recorded

# An objective within this relative distance of the best one found counts as the best.
BEST = 1e-6
# Part of the bound [points] by which ascents of different sizes may end apart, and an exponent that is none: less than
# a sixth from the smallest to the largest network.
UNEQUAL, INDEPENDENT = 10, 0.05


def claims(ds):
    """The statements of the paper on unconstrained ascents, compressed edges and the constrained shear modulus."""
    return [*_ascent_claims(recorded(ds)), *_compression_claims(detailed(ds)), *_scaling_claims(ds)]


def _ascent_claims(ds):
    good = ds.isel(seed=np.isfinite(ds.bound.values))
    finished = good.isel(seed=np.isfinite(good.G_0_ascent.isel(step=-1).values))
    last = finished.isel(step=-1)
    return [*_bound(good), *_extremes(last), *_onset(good), *_compression(good, last), _singular(ds, good, last)]


def _bound(good):
    yield Claim.tested(
        "ShearModulusSteepestDescent-A", "without constraints the shear modulus keeps rising to a finite value",
        "rises", f"from {described(good.G_0_ascent.isel(step=0))} to {spread(good.G_0_end)} at the end, "
        f"{spread(100 * good.G_0_end / good.bound, 3)} % of the bound",
        bool((good.G_0_end > 10 * good.G_0_ascent.isel(step=0)).all()),
        "so few steps do not lead far", criterion="ten times the start, every network", kind="paper",
    )  # fmt: skip
    gap = float(np.abs(good.closed_form_gap).max())
    exceeded = good.G_0_ascent > good.bound * (1 + 1e-9)
    satisfied = gap < 1e-9 and not bool(exceeded.any())
    yield Claim(
        "ShearModulusSteepestDescent-bound", "no stress of any sign has a larger G_0 than the closed form, which a "
        "configuration attains", "not stated", f"bound {spread(good.bound)}; attained to {gap:.0e}; exceeded by "
        f"{int(exceeded.sum())} of {good.G_0_ascent.size} recorded steps",
        "holds" if satisfied else "differs", "" if satisfied else "some network lies above", "1e-9 of the bound",
        kind="check",
    )  # fmt: skip


def _extremes(last):
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-length", "the longest edge grows to the order of the side of the box",
        "≈ 1", f"median {float(last.longest_edge.median()):.2f}, two thirds within "
        f"{float(last.longest_edge.quantile(1 / 6)):.2f} to {float(last.longest_edge.quantile(5 / 6)):.2f}",
        bool(10**-0.5 < float(last.longest_edge.median()) < 10**0.5), "the longest edges have another size",
        criterion="median nearest to this power of ten", kind="paper",
    )  # fmt: skip
    strongest = float((last.least_tension <= -1 + 1e-9).mean())
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-tension", "the smallest tensions become negative", "< 0",
        f"least over largest tension {spread(last.least_tension, 3)}; −1, the strongest force of all, in "
        f"{100 * strongest:.0f} % of the networks", bool((last.least_tension < 0).all()), "some network has none",
        criterion="every network", kind="paper",
    )  # fmt: skip


def _onset(good):
    """Where edges begin to grow and where compression begins, as steps."""
    grown = (good.longest_edge > 2 * good.longest_edge.isel(step=0)).values.argmax(axis=1)
    squeezed = (good.compressed_edges > 0).values.argmax(axis=1)
    apart = np.abs(grown - squeezed)
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-onset", "edges begin to grow at the point where tensions turn negative",
        "same point", f"twice the first longest edge at step {_median(good.step.values[grown])}, first compression at "
        f"step {_median(good.step.values[squeezed])} (medians); {100 * np.mean(apart <= 3):.0f} % of the networks "
        "within three records", bool(np.mean(apart <= 3) >= 0.95), "the two are apart",
        criterion="within three records in 95 % of the networks", kind="paper",
    )  # fmt: skip


def _compression(good, last):
    n_vertices = good.sizes["vertex"]
    needed = float((good.least_compressed_length / n_vertices).mean())
    yield Claim.tested(
        "ShearModulusSteepestDescent-CE", "final configurations are tensegrities: compressed edges cannot be avoided",
        "compressed edges", f"{float(last.compressed_edges.median()):.0f} edges of total length "
        f"{float(last.compressed_length.median()) / n_vertices:.2f} N_v (medians); at the bound at least "
        f"{needed:.3f} N_v",
        needed > 0 and bool((last.compressed_edges > 0).all()), "no compression was needed",
        criterion="in every network", kind="paper",
    )  # fmt: skip


def _singular(ds, good, last):
    runaway = int((ds.status == Status.singular).sum())
    return Claim(
        "singular-prestress", "the ascent crosses stresses with a singular prestress matrix, and may end at one",
        "not stated", f"{spread(good.crossings, 3)} steps cross; {spread(good.negative_pivots, 3)} negative "
        f"eigenvalues at the end; {runaway} of {ds.sizes['seed']} ascents end at a singular matrix, where lengths "
        f"diverge and the modulus has a limit ({_limit(good)}); the others balance to "
        f"{float(last.residual.max()):.0e} at the last step", "measured",
    )  # fmt: skip


def _limit(good):
    part = (100 * good.G_0_end / good.bound).where(good.status == Status.singular)
    return f"{spread(part, 3)} % of the bound" if np.isfinite(part).any() else "none here"


def _median(values):
    return f"{np.median(values):.0f}"


def _compression_claims(ds):
    """The exponents of the paper and those measured, by method and part of the bound."""
    return [*_exponents(ds), *_bounds(ds)] if ds.sizes["n_vertices"] > 1 else []


def _exponents(ds):
    sizes = ds.n_vertices.values
    for name, key, printed, words in (
        ("compressed_edges", "F", 0.5, "the number of compressed edges of final networks grows as √N_v"),
        ("compressed_length", "G", 1.0, "the total length of compressed edges of final networks grows as N_v"),
    ):
        for label, values in ascent_ends(ds, name):
            algorithm, end = label.lower().split(", ")
            holds, text = judged(sizes, values, printed)
            part = (100 * ds.G_0_ascent_of_end / ds.bound).sel(algorithm=algorithm).median("seed").values
            unequal = "steps" in end and np.ptp(part) > UNEQUAL
            yield Claim.tested(
                f"ShearModulusSteepestDescent-{key}-{algorithm}-{end.split()[0]}", f"{words} ({label})",
                f"exponent {printed:g}", text, None if unequal else holds,
                f"the ascents end at {part.max():.0f} to {part.min():.0f} % of the bound: sizes are at other stages"
                if unequal else _REASON,
                criterion="in both 95 % intervals; undecided in one, or at unequal parts of the bound",
                sample=plural(int(np.isfinite(values).sum()), "ascent"), kind="paper",
            )  # fmt: skip


def _bounds(ds):
    """The part of the bound that the ascents reach, and the compressed length of configurations at the bound."""
    sizes = ds.n_vertices.values
    part = (100 * ds.G_0_ascent_of_end / ds.bound).mean("seed")
    reached = (
        f"{algorithm} {float(part.sel(algorithm=algorithm, n_vertices=size)):.0f} % at N_v = {size}"
        for algorithm in map(str, ds.algorithm.values)
        for size in sizes
    )
    statement = "how much of the bound the ascents reach"
    yield Claim("ShearModulusSteepestDescent-end", statement, "not stated", ", ".join(reached), "measured")
    least = by_size(ds.least_compressed_length)
    fit = exponent(sizes, least)
    yield Claim(
        "ShearModulusSteepestDescent-G-bound",
        "at the bound itself a compressed length ∝ N_v cannot be avoided (linear program over all configurations)",
        "not stated", f"at least {np.nanmean(least / sizes[:, None]):.3f} N_v, exponent {shown(fit)}", "measured",
    )  # fmt: skip


_FLAT = f"|exponent of medians| < {INDEPENDENT}, a change by less than a sixth from the smallest to the largest network"
_REASON = "the exponent depends on how far an ascent climbs and, by few diverging ones, on the statistic"


def _scaling_claims(ds):
    """The statements of the paper on the constrained shear modulus."""
    sizes, detail = ds.n_vertices.values, detailed(ds)
    if len(sizes) > 1:
        yield from _size_claims(ds, sizes)
    mean = detail.G_0_of_threshold.mean("seed")
    falling = bool((mean.diff("threshold") < 0).all())
    text = ", ".join(
        f"{float(mean.isel(n_vertices=-1, threshold=n)):.3g} at r = {r:g}"
        for n, r in list(enumerate(ds.threshold.values))[::2]
    )
    yield Claim.tested(
        "ShearModulusScaling-B", "a lower threshold gives a larger shear modulus", "decreasing in r", text, falling,
        "the means are not in that order", criterion="means fall at every step of r, at every size",
        sample=plural(detail.sizes["seed"], "network"), kind="paper",
    )  # fmt: skip
    edge = detail.longest_edge_of_threshold.mean("seed").isel(n_vertices=-1)
    yield Claim.tested(
        "ShearModulusScaling-alignment", "a lower threshold lets the network align further: its longest edge grows",
        "increasing alignment", f"longest edge over the side of the box {float(edge[0]):.2g} at "
        f"r = {float(ds.threshold[0]):g}, {float(edge[-1]):.2g} at r = {float(ds.threshold[-1]):g}",
        bool((edge.diff("threshold") < 0).all()), "the longest edges do not grow at every step",
        criterion="means fall at every step of r", sample=plural(detail.sizes["seed"], "network"), kind="paper",
    )  # fmt: skip
    if detail.sizes["start"] > 1 and detail.sizes["seed"]:
        yield _start_claim(detail)
    if "max_G_0" in ds.population.values:
        part = 100 * ds.G_0.sel(population="max_G_0") / ds.bound
        yield Claim(
            "ShearModulusScaling-bound", "how far the constrained optimum stays below the closed-form bound",
            "not stated", f"at r = {parameters(ds)['threshold']:g} it has {spread(part, 3)} % of the bound; "
            f"{spread(100 * ds.G_0_of_threshold.isel(threshold=0) / ds.bound, 3)} % at "
            f"r = {float(ds.threshold[0]):g}", "measured",
        )  # fmt: skip


def _size_claims(ds, sizes):
    for population in map(str, ds.population.values):
        values = by_size(ds.G_0.sel(population=population))
        kept = population == "max_G_0"
        holds, text = judged(sizes, values, 0 if kept else -1)
        low, middle, high = np.nanquantile(values[-1], (1 / 6, 0.5, 5 / 6))
        if kept:  # so many networks resolve changes of a few per cent over all sizes
            holds, word = abs(exponent(sizes, values, np.nanmedian)[0]) < INDEPENDENT, _FLAT
        else:
            word = "in both 95 % intervals; undecided in one"
        yield Claim.tested(
            f"ShearModulusScaling-A-{population}",
            f"the shear modulus of {NAMES[population]} " + ("is independent of size" if kept else "falls as 1/N_v"),
            f"exponent {0 if kept else -1}", f"{text}; {middle:.2g} ({low:.2g} to {high:.2g}, 68 %) at {sizes[-1]}",
            holds, "values spread over decades among networks, so few of them rule the mean", criterion=word,
            sample=f"{plural(int(np.isfinite(values).all(axis=0).sum()), 'network')} a size", kind="paper",
        )  # fmt: skip


def _start_claim(ds):
    known = ds.dropna("seed", subset=["objective_of_start"])
    objectives = known.objective_of_start.transpose("n_vertices", "seed", "start").values
    best = objectives.max(axis=2, keepdims=True)
    share = 100 * np.mean(objectives > best * (1 - BEST), axis=(1, 2))
    spread = 100 * np.mean((best - objectives.min(axis=2, keepdims=True)) / best, axis=(1, 2))
    first = 100 * np.mean((best[..., 0] - objectives[..., 0]) / best[..., 0], axis=1)
    text = "; ".join(
        f"N_v = {size}: {part:.0f} % of starts reach the best, they differ by {wide:.1f} % at most, σ = 1 lies "
        f"{gap:.2f} % below it"
        for size, part, wide, gap in zip(ds.n_vertices.values, share, spread, first, strict=True)
    )
    return Claim(
        "ShearModulus+Constraint-starts", "how many starts find the best local optimum", "not stated",
        f"of {ds.sizes['start']} starts (means over {known.sizes['seed']} networks) {text}", "measured",
    )  # fmt: skip


# Verification


def verify(ds):
    """A line for each network whose moduli, lengths, tensions or compressed edges contradict its arrays."""
    return contradictions(recorded(ds), ("seed",), _checks)


def _checks(one):
    tail, head = one.edges.values.T
    sigma, x = one.sigma.values.astype(float), one.position.values.astype(float)
    L = x[:, head] - x[:, tail] + one.offsets.values @ one.cell.values
    square, area = np.sum(L**2, axis=2), abs(np.linalg.det(one.cell.values))
    length, compressed = np.sqrt(square), sigma < 0
    tension, squeezed = sigma * length, np.sum(length * compressed, axis=1)
    modulus = np.sum(sigma * L[..., 0] * L[..., 1], axis=1) ** 2 / np.sum(sigma**2 * square, axis=1) / area
    longest, least = length.max(axis=1) / np.sqrt(area), tension.min(axis=1) / np.abs(tension).max(axis=1)
    # The relative error 1e-7 of single precision grows with the lengths near a singular prestress matrix.
    stored = np.isfinite(one.G_0_ascent.values) & (longest < 10)
    yield "G_0_ascent", np.allclose(modulus[stored], one.G_0_ascent.values[stored], rtol=2e-3)
    yield "longest_edge", np.allclose(longest[stored], one.longest_edge.values[stored], rtol=1e-4)
    yield "least_tension", np.allclose(least[stored], one.least_tension.values[stored], rtol=1e-3, atol=1e-6)
    yield "compressed_edges", (np.sum(compressed, axis=1)[stored] == one.compressed_edges.values[stored]).all()
    yield "compressed_length", np.allclose(squeezed[stored], one.compressed_length.values[stored], rtol=1e-3)
    yield "bound", not (one.G_0_ascent.values > float(one.bound) * (1 + 1e-9)).any()
