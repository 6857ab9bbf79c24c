"""Parts of figures and claims that several studies share."""

import json

import numpy as np

from critflow.pictures import COLOURS
from critflow.result import Status

PAPER = (
    "Hain, Santangelo and Manning, Optimizing properties on the critical rigidity manifold of underconstrained "
    "central-force networks (arXiv:2407.13939)"
)
MARKERS = "osD^v<>"
MISSED = (Status.infeasible, Status.not_reached)  # outcomes of designs without their targets


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
