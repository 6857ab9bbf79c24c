"""Parts of figures and claims that several studies share."""

import json

import numpy as np

from critflow.engine import stable_rng
from critflow.pictures import COLOURS
from critflow.result import Status

PAPER = (
    "Hain, Santangelo and Manning, Optimizing properties on the critical rigidity manifold of underconstrained "
    "central-force networks (arXiv:2407.13939)"
)
MARKERS = "osD^v<>"
# Resampled ensembles behind a confidence interval.
_RESAMPLED = 1000


def series(n):
    """Colour and marker of the n-th of any number of series."""
    return {"color": COLOURS[n % len(COLOURS)], "marker": MARKERS[n % len(MARKERS)]}


def parameters(ds):
    """The parameters of the run."""
    return json.loads(ds.attrs["parameters"])


def finite(values):
    """The finite values of an array, (n,)."""
    values = np.asarray(values)
    return values[np.isfinite(values)]


def spread(values, digits=4):
    """Mean ± standard deviation of the finite values, as text."""
    known = finite(values)
    return f"{np.mean(known):.{digits}g} ± {float(f'{np.std(known):.1g}'):g}" if len(known) else "undefined"


def status_counts(codes):
    """Number of cases by name of their status."""
    found, counts = np.unique(codes, return_counts=True)
    return {Status(int(code)).name: int(count) for code, count in zip(found, counts, strict=True)}


def duration(seconds, digits=3):
    """Seconds as text, in the unit that leaves few digits."""
    for factor, unit in ((1e6, "µs"), (1e3, "ms"), (1.0, "s")):
        value = seconds * factor
        if value < 999.5 or unit == "s":
            return f"{value:,.0f} {unit}" if value >= 99.5 else f"{value:.{digits}g} {unit}"


def exponent(sizes, values):
    """Exponent p of mean ∝ size^p over networks, values (n_sizes, n_networks), with its 95 % interval by resampling.

    The means are fitted on logarithmic scales, all sizes alike; NaN networks are left out.
    """
    values = np.asarray(values, dtype=float)
    n = values.shape[1]
    picks = stable_rng(n, "exponent").integers(0, n, (_RESAMPLED, n))
    low, high = np.nanquantile(_slopes(sizes, np.nanmean(values[:, picks], axis=2)), (0.025, 0.975))
    return float(_slopes(sizes, np.nanmean(values, axis=1))), float(low), float(high)


def _slopes(sizes, means):
    """Least-squares slopes of log mean against log size over the first dimension; NaN unless all means are positive."""
    lever = np.log(sizes) - np.log(sizes).mean()
    return np.tensordot(lever, np.log(np.where(means > 0, means, np.nan)), 1) / np.sum(lever**2)


def shown(fit):
    """An exponent with its interval, as text."""
    return minus(f"{fit[0]:.2f} (95 %: {fit[1]:.2f} to {fit[2]:.2f})")


def quoted(fit):
    """An exponent with its interval, for a legend."""
    return minus(f"{fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]")


def minus(number):
    """A number as text with the sign of minus in place of the hyphen, as on the axes of figures."""
    return number.replace("-", "−")


def half_point(x, part):
    """The x at which the part (n,) of the networks falls below one half, between two that were run; else NaN."""
    below = np.flatnonzero(part < 0.5)
    if not len(below) or below[0] == 0:
        return np.nan
    last = below[0] - 1
    share = (part[last] - 0.5) / (part[last] - part[last + 1])
    return float(x[last] + share * (x[last + 1] - x[last]))
