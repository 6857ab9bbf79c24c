"""Claims of the ascents, and of the shear modulus against size, threshold and starts; verification of the records."""

import numpy as np

from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.result import Status

from ..paper.statements import Measurement
from ..paper.verdicts import claims_of
from ..shared.population_reports import described
from ..shared.populations import NAMES, PAPER_POPULATIONS
from ..shared.reports import exponent, parameters, shown, spread
from ..shared.verification import bond_vectors, contradictions
from .figures import ascent_parts, by_size, detailed, recorded

# An objective within this relative distance of the best one found counts as the best.
BEST = 1e-6
BEST_POPULATION = "max_G_0"
# Edges that grow are looked at where an ascent first reaches this part of the bound; LONGEST of them.
CLIMBED, LONGEST = 0.8, 5
FAR = 4  # periods within which crossings are looked for
# An exponent of fewer networks, or of fewer sizes, has no interval: resampling repeats the same few.
FEWEST_NETWORKS, FEWEST_SIZES = 8, 3


def claims(ds):
    """The statements of the paper on the shear modulus, and what its ascents and bounds are."""
    whole, detail = recorded(ds), detailed(ds)
    good = whole.isel(seed=np.isfinite(whole.bound.values))
    finished = good.isel(seed=np.isfinite(good.G_0_ascent.isel(step=-1).values))
    last = finished.isel(step=-1)
    # Every ascent may have ended before the last record.
    extremes, compression = (_extremes(last), [_compression(good, last)]) if last.sizes["seed"] else ([], [])
    measured = [
        *(_rise(good), *extremes, *_long_edges(good), _onset(good), *compression),
        *_thresholds(detail, ds),
    ]
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


def _long_edges(good):
    """Directions of the longest edges of an ascent, and those that wrap around the box at its last record."""
    aligned, wrapping, crossing = [], [], []
    for seed in range(good.sizes["seed"]):
        one = good.isel(seed=seed)
        known = np.flatnonzero(np.isfinite(one.G_0_ascent.values))
        climbed = one.G_0_ascent.values[known] >= CLIMBED * float(one.bound)
        L = bond_vectors(one.isel(step=known[climbed.argmax()] if climbed.any() else known[-1]))
        x, y = L[np.argsort(np.sum(L**2, axis=1))[-LONGEST:]].T
        aligned.append(np.mean(np.abs(2 * x * y) / (x**2 + y**2)))
        n_wrapping, n_crossing = crossings_of_wrapping(one.isel(step=known[-1]))
        wrapping.append(n_wrapping)
        crossing.append(n_crossing)
    yield Measurement(
        "growing-edges", float(np.median(aligned)),
        f"|2L_xL_y|/L² of the {LONGEST} longest edges {described(aligned)}, 0.64 of random directions",
    )  # fmt: skip
    yield Measurement(
        "wrapping", float(np.mean(np.array(crossing) > 0)),
        f"{described(wrapping)} edges reach beyond the nearest image, and cross {described(crossing)} times",
    )  # fmt: skip


def crossings_of_wrapping(one):
    """The number of edges that are longer than half the box in one direction, and of the crossings among them.

    Edges p + tu and q + sv cross in the image m where 0 < t, s < 1 solve tu − sv = q − p + m.
    """
    inverse = np.linalg.inv(one.cell.values)
    u = bond_vectors(one) @ inverse  # in units of the cell
    wraps = np.abs(u).max(axis=1) > 0.5
    p, u = one.position.values.astype(float)[one.edges.values[wraps, 0]] @ inverse, u[wraps]
    i, j = np.triu_indices(len(u), 1)
    apart, area, n_crossings = p[j] - p[i], _cross(u[i], u[j]), 0
    apart -= np.round(apart)
    # Image by image: where lengths diverge, nearly all pairs of edges are looked at.
    for image in np.ndindex(2 * FAR + 1, 2 * FAR + 1):
        r = apart + np.array(image) - FAR
        with np.errstate(divide="ignore", invalid="ignore"):
            t, s = (_cross(r, other) / area for other in (u[j], u[i]))
        n_crossings += int(np.sum((0 < t) & (t < 1) & (0 < s) & (s < 1)))
    return len(u), n_crossings


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


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
    """The exponents of compressed edges at parts of the bound: means over the networks.

    The largest part that most ascents by L-BFGS reach is nearest to the final networks of the paper, where no component
    of the gradient exceeds 1e-12.  No ascent of all sizes goes so far, which leaves that reading open.
    """
    edges, lengths = (list(ascent_parts(ds, name)) for name in ("compressed_edges", "compressed_length"))
    with np.errstate(invalid="ignore", divide="ignore"):
        each = [(label, long / count) for (label, count), (_, long) in zip(edges, lengths, strict=True)]
    for name, parts in (("compressed-number", edges), ("compressed-length", lengths), ("compressed-mean", each)):
        nearest = [label for label, _ in parts if not label.startswith("FIRE")][-1:]
        for label, values in parts:
            n = plural(int(np.isfinite(values).sum()), "ascent")
            yield _exponent(name, ds.n_vertices.values, values, label, n, label in nearest)
        yield Measurement(name, np.nan, "not measured", "0 ascents", "gradients below 1e-12, as in the supplement")


def _exponent(name, sizes, values, variant, n, counts=True, more=""):
    """The measurement of an exponent; it decides nothing where too few sizes or networks leave no interval."""
    fit = exponent(sizes, values)
    enough = len(sizes) >= FEWEST_SIZES and np.isfinite(values).sum(axis=1).min() >= FEWEST_NETWORKS
    value = fit[0] if enough else np.nan
    return Measurement(name, float(value), shown(fit) + more, n, variant, fit[1], fit[2], counts)


def _thresholds(detail, ds):
    """G_0 and the order of the edges against the threshold."""
    mean, sizes = detail.G_0_of_threshold.mean("seed"), ds.n_vertices.values
    n = plural(detail.sizes["seed"], "network")
    text = ", ".join(
        f"{float(mean.isel(n_vertices=-1, threshold=n)):.3g} at r = {r:g}"
        for n, r in list(enumerate(ds.threshold.values))[::2]
    )
    falls = float((mean.diff("threshold") < 0).mean())
    yield Measurement("threshold-G_0", falls, f"{text}, N_v = {sizes[-1]}", n)
    order = detail.alignment_of_threshold.mean("seed")
    last = order.isel(n_vertices=-1).values
    text = ", ".join(f"{value:.2g} at r = {r:g}" for value, r in zip(last, ds.threshold.values, strict=True))
    falls = float((order.diff("threshold") < 0).mean())
    yield Measurement("threshold-alignment", falls, f"{text}, N_v = {sizes[-1]}", n)


def _sizes(ds):
    """Exponents of the mean G_0 by population."""
    sizes = ds.n_vertices.values
    for population in map(str, ds.population.values):
        if population not in PAPER_POPULATIONS:
            continue
        values = by_size(ds.G_0.sel(population=population))
        name = "G_0-independent-of-size" if population == BEST_POPULATION else "G_0-falls-with-size"
        more = f"; {np.nanmean(values[-1]):.2g} at {sizes[-1]}"
        n = f"{plural(int(np.isfinite(values).all(axis=0).sum()), 'network')} a size"
        yield _exponent(name, sizes, values, NAMES[population], n, True, more)


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
    part = (100 * good.G_0_end / good.bound).where(good.status == Status.singular)
    balanced = (
        f"; the others balance to {float(last.residual.max()):.0e} at the last step" if last.sizes["seed"] else ""
    )
    limit = f"{spread(part, 3)} % of the bound" if np.isfinite(part).any() else "none here"
    return Claim(
        "singular-prestress", "the ascent crosses stresses with a singular prestress matrix, and may end at one", "",
        f"{spread(good.crossings, 3)} steps cross; {spread(good.negative_pivots, 3)} negative eigenvalues at the end; "
        f"{runaway} of {ds.sizes['seed']} ascents end at a singular matrix, where lengths diverge and the modulus has "
        f"a limit ({limit}){balanced}",
        "measured",
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
    sigma = one.sigma.values.astype(float)
    L = np.stack([bond_vectors(one.isel(step=record)) for record in range(len(sigma))])
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
