"""Claims of the ascents, and of the shear modulus against size, threshold and starts; verification of the records."""

import numpy as np

from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.result import Status

from ..paper.statements import Measurement
from ..paper.verdicts import claims_of
from ..shared.population_reports import described
from ..shared.populations import NAMES, PAPER_POPULATIONS
from ..shared.power_laws import exponent, shown
from ..shared.reports import parameters, spread
from ..shared.verification import contradictions
from .figures import ascent_ends, by_size, detailed, recorded

# An objective within this relative distance of the best one found counts as the best.
BEST = 1e-6
BEST_POPULATION = "max_G_0"
# An exponent of fewer networks, or of fewer sizes, has no interval: resampling repeats the same few.
FEWEST_NETWORKS, FEWEST_SIZES = 8, 3


def claims(ds):
    """The statements of the paper on the shear modulus, and what its ascents and bounds are."""
    whole, detail = recorded(ds), detailed(ds)
    good = whole.isel(seed=np.isfinite(whole.bound.values))
    finished = good.isel(seed=np.isfinite(good.G_0_ascent.isel(step=-1).values))
    last = finished.isel(step=-1)
    measured = [_rise(good), *_extremes(last), _onset(good), _compression(good, last), *_thresholds(detail, ds)]
    several = ds.sizes["n_vertices"] > 1
    if several:
        measured += [*_exponents(detail), *_sizes(ds)]
    return [*claims_of(measured), *_found(ds, whole, good, last, detail if several else None)]


def _rise(good):
    start, end = good.G_0_ascent.isel(step=0), good.G_0_end
    return Measurement(
        "G_0-rises", float((end > 10 * start).mean()),
        f"from {described(start)} to {spread(end)} at the end, {spread(100 * end / good.bound, 3)} % of the bound",
    )  # fmt: skip


def _extremes(last):
    median = float(last.longest_edge.median())
    yield Measurement(
        "longest-edge", float(np.log10(median)),
        f"median {median:.2f} of the side, two thirds within {float(last.longest_edge.quantile(1 / 6)):.2f} to "
        f"{float(last.longest_edge.quantile(5 / 6)):.2f}",
    )  # fmt: skip
    strongest = float((last.least_tension <= -1 + 1e-9).mean())
    yield Measurement(
        "negative-tension", float((last.least_tension < 0).mean()),
        f"least over largest tension {spread(last.least_tension, 3)}; −1, the strongest force of all, in "
        f"{100 * strongest:.0f} % of the networks",
    )  # fmt: skip


def _onset(good):
    """Where edges begin to grow and where compression begins, as steps."""
    grown = (good.longest_edge > 2 * good.longest_edge.isel(step=0)).values.argmax(axis=1)
    squeezed = (good.compressed_edges > 0).values.argmax(axis=1)
    share = float(np.mean(np.abs(grown - squeezed) <= 3))
    return Measurement(
        "same-onset", share,
        f"twice the first longest edge at step {_median(good.step.values[grown])}, first compression at step "
        f"{_median(good.step.values[squeezed])} (medians); within three records in {100 * share:.0f} % of the networks",
    )  # fmt: skip


def _compression(good, last):
    n_vertices = good.sizes["vertex"]
    needed = float((good.least_compressed_length / n_vertices).mean())
    return Measurement(
        "tensegrity", float((last.compressed_edges > 0).mean()) if needed > 0 else 0.0,
        f"{float(last.compressed_edges.median()):.0f} edges of total length "
        f"{float(last.compressed_length.median()) / n_vertices:.2f} N_v (medians); at the bound at least "
        f"{needed:.3f} N_v",
    )  # fmt: skip


def _median(values):
    return f"{np.median(values):.0f}"


def _exponents(ds):
    """The exponents of compressed edges at the end of FIRE and at parts of the bound.

    Two of them are readings of the "final" networks of the paper: FIRE after equal steps, and the largest part of the
    bound that most ascents by L-BFGS reach.
    """
    edges, lengths = (list(ascent_ends(ds, name)) for name in ("compressed_edges", "compressed_length"))
    with np.errstate(invalid="ignore", divide="ignore"):
        means = [(label, long / count) for (label, count), (_, long) in zip(edges, lengths, strict=True)]
    for name, ends in (("compressed-number", edges), ("compressed-length", lengths), ("compressed-mean", means)):
        nearest_to_bound = [label for label, _ in ends if not label.startswith("FIRE")][-1:]
        for label, values in ends:
            final = "steps" in label or label in nearest_to_bound
            n = plural(int(np.isfinite(values).sum()), "ascent")
            yield _exponent(name, ds.n_vertices.values, values, np.nanmedian, f"{label}, medians", n, final)
            yield _exponent(name, ds.n_vertices.values, values, np.nanmean, f"{label}, means", n, False)


def _exponent(name, sizes, values, middle, variant, n, counts=True, more=""):
    """The measurement of an exponent; it decides nothing where too few sizes or networks leave no interval."""
    fit = exponent(sizes, values, middle)
    enough = len(sizes) >= FEWEST_SIZES and np.isfinite(values).sum(axis=1).min() >= FEWEST_NETWORKS
    value = fit[0] if enough else np.nan
    return Measurement(name, float(value), shown(fit) + more, n, variant, fit[1], fit[2], counts)


def _thresholds(detail, ds):
    """G_0 and the longest edge against the threshold."""
    mean, sizes = detail.G_0_of_threshold.mean("seed"), ds.n_vertices.values
    n = plural(detail.sizes["seed"], "network")
    text = ", ".join(
        f"{float(mean.isel(n_vertices=-1, threshold=n)):.3g} at r = {r:g}"
        for n, r in list(enumerate(ds.threshold.values))[::2]
    )
    falls = float((mean.diff("threshold") < 0).mean())
    yield Measurement("threshold-G_0", falls, f"{text}, N_v = {sizes[-1]}", n)
    edge = detail.longest_edge_of_threshold.mean("seed").isel(n_vertices=-1)
    yield Measurement(
        "threshold-alignment", float((edge.diff("threshold") < 0).mean()),
        f"longest edge over the side of the box {float(edge[0]):.2g} at r = {float(ds.threshold[0]):g}, "
        f"{float(edge[-1]):.2g} at r = {float(ds.threshold[-1]):g}", n,
    )  # fmt: skip


def _sizes(ds):
    """Exponents of G_0 by population; medians of the one that is kept, means of those that spread over decades."""
    sizes = ds.n_vertices.values
    for population in map(str, ds.population.values):
        if population not in PAPER_POPULATIONS:
            continue
        values = by_size(ds.G_0.sel(population=population))
        low, middle, high = np.nanquantile(values[-1], (1 / 6, 0.5, 5 / 6))
        more = f"; {middle:.2g} ({low:.2g} to {high:.2g}, 68 %) at {sizes[-1]}"
        n = f"{plural(int(np.isfinite(values).all(axis=0).sum()), 'network')} a size"
        kept = population == BEST_POPULATION
        name = "G_0-independent-of-size" if kept else "G_0-falls-with-size"
        for word, statistic in (("medians", np.nanmedian), ("means", np.nanmean)):
            counts = (word == "medians") == kept
            variant, spans = f"{NAMES[population]}, {word}", "" if counts and not kept else more
            yield _exponent(name, sizes, values, statistic, variant, n, counts, spans)


# What we found


def _found(ds, whole, good, last, detail):
    yield _bound(good)
    yield _singular(whole, good, last)
    if detail is not None:
        yield from _bounds(detail)
        if detail.sizes["start"] > 1 and detail.sizes["seed"]:
            yield _starts(detail)
    if BEST_POPULATION in ds.population.values:
        part = 100 * ds.G_0.sel(population=BEST_POPULATION) / ds.bound
        yield Claim(
            "G_0-constrained-part", "how far the constrained optimum stays below the closed-form bound", "",
            f"at r = {parameters(ds)['threshold']:g} it has {spread(part, 3)} % of the bound; "
            f"{spread(100 * ds.G_0_of_threshold.isel(threshold=0) / ds.bound, 3)} % at "
            f"r = {float(ds.threshold[0]):g}", "measured",
        )  # fmt: skip


def _bound(good):
    gap = float(np.abs(good.closed_form_gap).max())
    exceeded = good.G_0_ascent > good.bound * (1 + 1e-9)
    return Claim.tested(
        "G_0-bound", "no stress of any sign has a larger G_0 than the closed form, which a configuration attains", "",
        f"bound {spread(good.bound)}; attained to {gap:.0e}; exceeded by {int(exceeded.sum())} of "
        f"{good.G_0_ascent.size} recorded steps",
        gap < 1e-9 and not bool(exceeded.any()), "some network lies above", criterion="1e-9 of the bound",
    )  # fmt: skip


def _singular(ds, good, last):
    runaway = int((ds.status == Status.singular).sum())
    return Claim(
        "singular-prestress", "the ascent crosses stresses with a singular prestress matrix, and may end at one", "",
        f"{spread(good.crossings, 3)} steps cross; {spread(good.negative_pivots, 3)} negative eigenvalues at the end; "
        f"{runaway} of {ds.sizes['seed']} ascents end at a singular matrix, where lengths diverge and the modulus has "
        f"a limit ({_limit(good)}); the others balance to {float(last.residual.max()):.0e} at the last step",
        "measured",
    )  # fmt: skip


def _limit(good):
    part = (100 * good.G_0_end / good.bound).where(good.status == Status.singular)
    return f"{spread(part, 3)} % of the bound" if np.isfinite(part).any() else "none here"


def _bounds(ds):
    """The part of the bound that the ascents reach, and the compressed length of configurations at the bound."""
    sizes = ds.n_vertices.values
    part = (100 * ds.G_0_ascent_of_end / ds.bound).mean("seed")
    reached = (
        f"{algorithm} {float(part.sel(algorithm=algorithm, n_vertices=size)):.0f} % at N_v = {size}"
        for algorithm in map(str, ds.algorithm.values)
        for size in sizes
    )
    yield Claim("G_0-reached", "how much of the bound the ascents reach", "", ", ".join(reached), "measured")
    least = by_size(ds.least_compressed_length)
    yield Claim(
        "G_0-needed-compression",
        "at the bound itself a compressed length ∝ N_v cannot be avoided (linear program over all configurations)",
        "", f"at least {np.nanmean(least / sizes[:, None]):.3f} N_v, exponent {shown(exponent(sizes, least))}",
        "measured",
    )  # fmt: skip


def _starts(ds):
    known = ds.dropna("seed", subset=["objective_of_start"])
    objectives = known.objective_of_start.transpose("n_vertices", "seed", "start").values
    best = objectives.max(axis=2, keepdims=True)
    share = 100 * np.mean(objectives > best * (1 - BEST), axis=(1, 2))
    widest = 100 * np.mean((best - objectives.min(axis=2, keepdims=True)) / best, axis=(1, 2))
    first = 100 * np.mean((best[..., 0] - objectives[..., 0]) / best[..., 0], axis=1)
    text = "; ".join(
        f"N_v = {size}: {part:.0f} % of starts reach the best, they differ by {wide:.1f} % at most, σ = 1 lies "
        f"{gap:.2f} % below it"
        for size, part, wide, gap in zip(ds.n_vertices.values, share, widest, first, strict=True)
    )
    return Claim(
        "G_0-starts", "how many starts find the best local optimum", "",
        f"of {ds.sizes['start']} starts (means over {plural(known.sizes['seed'], 'network')}) {text}", "measured",
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
