"""Claims of the relations."""

import numpy as np

from critflow.engine import Claim
from critflow.engine.study import plural

from ..shared.populations import NAMES
from ..shared.reports import finite
from .medium import NAMES as LAW_NAMES
from .medium import gap_of_law

WITHIN = 0.1  # part of the predicted value within which a measurement follows effective-medium theory
FEW = 100  # fewer edges of a bin are left out
ROUNDING = 1e-8  # part by which rounding may move a number that a theorem fixes


def mean_and_error(values):
    """Mean and standard error of the finite values over networks; NaN without two."""
    known = finite(values)
    if len(known) < 2:
        return np.nan, np.nan
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(len(known)))


def with_error(values):
    """Mean and standard error as text, as 0.374(3)."""
    mean, error = mean_and_error(values)
    return f"{mean:.3f}({1000 * error:.0f})" if np.isfinite(mean) else "undefined"


def followed(ds, name, coordination):
    """Measured and predicted gap of every law of which log σ deviates by at most 1.2: rows (law, mean, prediction)."""
    laws = [str(law) for law in ds.law.values if law != "log_normal_2"]
    return [(law, mean_and_error(ds[name].sel(law=law))[0], gap_of_law(law, coordination)) for law in laws]


def claims(ds):
    """The verdicts of each relation: a theorem holds for every network, the theory within a tenth."""
    yield from _random(ds)
    yield from _shear(ds)
    yield from _pairs(ds)
    yield from _moduli(ds)


def _random(ds):
    plane, space = followed(ds, "law_gap", 3), followed(ds, "space_gap", 4)
    far = [max(abs(mean / theory - 1) for _, mean, theory in rows) for rows in (plane, space)]
    law, _, theory = plane[0]
    listed = f"{LAW_NAMES[law]} {with_error(ds.law_gap.sel(law=law))}, predicted {theory:.3f}"
    yield Claim.tested(
        "medium-gap", "max B_0/B_0 − 1 of independent random stresses is that of effective-medium theory, which has no "
        "parameter", "", f"{listed}; {plural(len(plane), 'law')} within {100 * far[0]:.0f} % of the prediction in the "
        f"plane and {100 * far[1]:.0f} % in space", max(far) <= WITHIN, "a law is off by more",
        criterion="within a tenth of it for every law up to a deviation of log σ of 1.2, in plane and space",
    )  # fmt: skip
    squares = np.abs(_squares(ds) - 1)
    middle, most = (np.median(squares), squares.max()) if len(squares) else (np.nan, np.nan)
    yield Claim.tested(
        "medium-lengths", "the mean |L|² of the edges of one σ is that of effective-medium theory", "",
        f"off by {100 * middle:.1f} % (median over bins and laws), at most {100 * most:.0f} %",
        middle <= WITHIN / 2 if len(squares) else None, "off by more" if len(squares) else f"no bin has {FEW} edges",
        criterion=f"median of bins of {FEW} edges or more within a twentieth",
    )  # fmt: skip
    gaps = of_known_histogram(ds)
    rows = [
        (NAMES[str(p)], *(gaps[name].sel(population=p) for name in ("gap", "shuffled_gap", "medium_gap")))
        for p in ds.population.values if p not in ("max_B_0", "random_stress")
    ]  # fmt: skip
    excess = [float((gap - medium).min()) for _, gap, _, medium in rows if np.isfinite(gap - medium).any()]
    yield Claim.tested(
        "histogram", "B_0 is not a function of the histogram of the stresses: the populations lie above what "
        "effective-medium theory gives for theirs, and shuffled stresses on it", "",
        "; ".join(
            f"{name} {with_error(gap)}, shuffled {with_error(shuffled)}, theory {with_error(medium)}"
            for name, gap, shuffled, medium in rows
        ), min(excess, default=np.nan) > 0, "one lies below it", criterion="above it in every network",
    )  # fmt: skip


def of_known_histogram(ds):
    """The three gaps of the networks without a compressed edge, of which the theory knows the histogram."""
    gaps = ds[["gap", "shuffled_gap", "medium_gap"]]
    return gaps.where(gaps.medium_gap.notnull())


def _squares(ds):
    """Measured over predicted |L|² of the bins with enough edges in all networks together, (n,)."""
    count = ds.square_count.sum("seed")
    mean = (ds.square_ratio * ds.square_count).sum("seed") / count.where(count >= FEW)
    return finite(mean.values.ravel())


def least(values):
    """The least of the finite values, and their number."""
    known = finite(values.values.ravel())
    return (float(known.min()) if len(known) else np.nan), len(known)


def _shear(ds):
    ratio, n = least(ds.isotropic_ratio)
    medians = ", ".join(
        f"{float(one.median()):.4g} ({NAMES[str(one.population.item())]})" for one in _each(ds.isotropic_ratio)
    )
    yield Claim.tested(
        "shear-growth", "under tension with G_0 = 0 the mean of C_G over both pure shears is at least B_0", "",
        f"C_G/B_0 at least {ratio:.5f}; medians {medians}", ratio >= 1 - ROUNDING, "a network is below it",
        criterion="in every network", sample=plural(n, "configuration"),
    )  # fmt: skip
    above, n = least(ds.C_G_mean - ds.C_G_bound)
    standing, _ = least(ds.C_G_mean / ds.B_0)
    yield Claim.tested(
        "shear-growth-any", "with any G_0 the mean of C_G is at least its bound by B_0, G_0, C_B and the stress", "",
        f"above the bound by {above:.2g} k or more, where C_G/B_0 is as low as {standing:.3f}", above >= -ROUNDING,
        "a network is below it", criterion="in every network", sample=plural(n, "configuration"),
    )  # fmt: skip
    space, n = least(ds.space_ratio)
    yield Claim.tested(
        "shear-growth-space", "in space the mean of C_G over all five pure shears is at least 5/6 of B_0", "",
        f"at least {space:.3f}", space >= 5 / 6 * (1 - ROUNDING), "a network is below it",
        criterion="in every network", sample=plural(n, "configuration"),
    )  # fmt: skip
    definite = ds.signed_ratio.where(ds.signed_definite == 1)
    (positive, n), (other, m) = least(definite), least(ds.signed_ratio.where(ds.signed_definite == 0))
    yield Claim.tested(
        "shear-growth-signs", "compressed edges leave it valid as long as P is positive definite, and no longer", "",
        f"C_G/B_0 at least {positive:.3f} where P is positive definite, {other:.3g} where it is not",
        None if not (n and m) else positive >= 1 - ROUNDING and other < 1,
        "no network of one kind" if not (n and m) else "the condition does not divide them",
        criterion="at least 1 in every network where P is positive definite, less in one where it is not",
        sample=f"{n} and {plural(m, 'network')}",
    )  # fmt: skip


def _pairs(ds):
    far = float(ds.asymmetry.max())
    yield Claim.tested(
        "pairs", "in the plane the shares λ of lengths in changes of stress come in pairs λ, 1 − λ", "",
        f"sums of pairs are 1 within {far:.0e}", far <= ROUNDING, "pairs are missing", criterion="within 1e-8",
    )  # fmt: skip
    apart = float(np.abs((ds.curvature_C_B - ds.C_B) / ds.B_0).max())
    yield Claim.tested(
        "growth-curvature", "C_B is the curvature of the critical manifold along the dilation", "",
        f"C_B by both within {apart:.0e} B_0", apart <= 1e-6, "they differ", criterion="within 1e-6 of B_0",
    )  # fmt: skip
    part = paid(ds)
    ratio, n = least(1 / part)
    medians = ", ".join(
        f"{100 * float(one.median()):.0f} % ({NAMES[str(one.population.item())]})" for one in _each(part)
    )
    yield Claim.tested(
        "missing-stiffness", "stiffness missing to max B_0 is paid in growth: C_B + B_0/2 is at least its bound", "",
        f"the bound is {medians} of it", ratio >= 1 - ROUNDING, "a network is below it", criterion="in every network",
        sample=plural(n, "configuration"),
    )  # fmt: skip


def _each(values):
    """The values of each population that has any."""
    return [one for one in (values.sel(population=p) for p in values.population) if one.notnull().any()]


def paid(ds):
    """The bound of C_B + B_0/2 by the missing stiffness, as a part of it."""
    return (ds.missing_stiffness_C_B + 0.5 * ds.B_0) / (ds.C_B + 0.5 * ds.B_0)


def _moduli(ds):
    apart = np.abs(ds.largest_B_0 - ds.anisotropy_term - ds.largest_G_0) / ds.largest_B_0
    differ = 1 - ds.largest_G_0 / ds.largest_B_0
    yield Claim.tested(
        "largest-moduli", "the largest G_0, with stresses of any sign, is the largest B_0 less a term of the "
        "anisotropy at σ = k", "",
        f"within {float(apart.max()):.0e}; the term is {float(differ.median()):.1g} of B_0 (median)",
        float(apart.max()) <= ROUNDING, "they differ", criterion="within 1e-8",
    )  # fmt: skip
