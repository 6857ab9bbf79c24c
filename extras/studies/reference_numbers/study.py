"""Numbers of the literature on underconstrained networks and vertex models, computed again, none of them adjusted.

Each quantity is a function in `measures.py`; its value in the literature, the source and the rule of comparison are
below.
"""

from typing import NamedTuple

import numpy as np
from critflow.studies.shared.checks import check_network, check_positive
from critflow.studies.shared.figures import TEXT, counted, lettered, panels
from critflow.studies.shared.reports import finite, series, status_counts

from critflow import voronoi_network
from critflow.engine import Axis, Claim, Study, Variable
from critflow.engine.study import plural
from critflow.result import Status, StudyError

from . import measures


def case(parameters, *, seed, quantity):
    """One number, and the curve behind it."""
    found = getattr(measures, quantity)(parameters, seed)
    x, y = np.full((2, measures.POINTS), np.nan)
    x[: len(found.x)], y[: len(found.y)] = found.x, found.y
    return {"value": found.value, "x": x, "y": y, "status": found.status}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "columns", "candidates", "z")
    if len(parameters["onsets"]) > measures.POINTS or not min(parameters["onsets"]) > 0:
        raise StudyError(f"onsets={parameters['onsets']} must be at most {measures.POINTS} positive strains")
    for key in ("n_vertices", "n_vertices_cells"):
        check_network(voronoi_network, parameters[key])


class Quantity(NamedTuple):
    """A number of the literature.

    value    of the literature
    within   distance of our mean from it that counts as agreement: rounding, half of the last printed digit, or one per
             cent of a limit that is read from a fit
    """

    statement: str
    printed: str
    value: float
    within: float
    source: str
    because: str


MOST_PLACES = 6
LENGTH = np.sqrt(4 / (3 * np.sqrt(3)))
LEE = "Lee, Merkel, Soft Matter (2022), doi:10.1039/D2SM00075J"
_TENSION = "exponent of G − G_c in the isotropic tension, "
_CORRECTED = "G is the energy derivative; other conventions subtract the tension"
QUANTITIES = {
    "hexagon_shape": Quantity(
        "critical shape index of regular hexagons", "√(8√3) = 3.72241943…", np.sqrt(8 * np.sqrt(3)), 1e-10,
        "exact: perimeter of the hexagon of unit area", "rounding is larger than expected",
    ),
    "planar_shape": Quantity(
        "critical shape index of the disordered planar vertex model", "3.81", 3.81, 0.005,
        "Bi, Lopez, Schwarz, Manning, Nature Physics 11, 1074 (2015)", "the topologies differ",
    ),
    "honeycomb_length": Quantity(
        "least length of equal edges of the honeycomb at unit area a vertex", "√(4/3√3) = 0.87738267…",
        LENGTH, 1e-10, "exact", "rounding is larger than expected",
    ),
    "honeycomb_shear": Quantity(
        "coefficient of γ² in the least length of the honeycomb in simple shear", "3ℓ₀/8 = 0.32901850…",
        0.375 * LENGTH, 1e-6, "exact", "differences lose more digits than expected",
    ),
    "factor_three": Quantity(
        "(G − G_c) γ_c/σ past an onset in simple shear, for γ_c → 0", "3", 3.0, 0.03,
        "Merkel, Baumgarten, Tighe, Manning, PNAS 116, 6560 (2019)", "the coefficient depends on the network",
    ),
    "tension_honeycomb": Quantity(
        _TENSION + "honeycomb", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_voronoi": Quantity(
        _TENSION + "Voronoi", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_phantom": Quantity(
        _TENSION + "phantom triangular", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_delaunay": Quantity(
        _TENSION + "Delaunay", "1", 1.0, 0.01, LEE, _CORRECTED),
    "onset_self_stresses": Quantity(
        "self-stresses of random networks at their onset in shear", "1", 1.0, 0.0,
        "Vermeulen, Bose, Storm, Ellenbroek, Phys. Rev. E 96, 053003 (2017)", "some onset has several self-stresses",
    ),
    "auxetic": Quantity(
        "least Poisson's ratio of triangular lattices pruned with convex faces", "≃ −1", -1.0, 0.05,
        "Hagh, Thorpe, Phys. Rev. B 98, 100101 (2018)", "pruning ends before this value",
    ),
}  # fmt: skip
TENSIONS = tuple(name for name in QUANTITIES if name.startswith("tension_"))


def measured(ds, name):
    """Finite values of a quantity, one a seed."""
    return finite(ds.value.sel(quantity=name).values)


def shown(values):
    """Mean ± standard deviation, or the number itself where the seeds agree."""
    if len(values) == 0:
        return "no value"
    spread = float(np.std(values))
    if spread < 1e-9 * max(abs(float(np.mean(values))), 1e-300):
        return f"{np.mean(values):.10g}"
    places = min(max(0, 1 - int(np.floor(np.log10(spread)))), MOST_PLACES)
    return f"{np.mean(values):.{places}f} ± {spread:.{places}f}"


def holds(name, values):
    """Whether the mean agrees."""
    known = QUANTITIES[name]
    if len(values) == 0:
        return False
    return abs(float(np.mean(values)) - known.value) <= known.within


def claims(ds):
    """Each number of the literature against ours."""
    found = []
    for name in ds.quantity.values:
        known, values = QUANTITIES[str(name)], measured(ds, name)
        outcomes = status_counts(ds.status.sel(quantity=name).values)
        others = ", ".join(f"{n} {status}" for status, n in outcomes.items() if status != "ok")
        found.append(Claim.tested(
            str(name), known.statement, known.printed, shown(values), holds(str(name), values),
            known.because if len(values) else "no network of this run gives a value",
            "; ".join(filter(None, (known.source, f"outcomes: {others}" if others else ""))),
            criterion=f"mean within {known.within:.1g}" if known.within else "equal in every network",
            sample=f"{len(values)} of {plural(ds.sizes['seed'], 'network')}",
        ))  # fmt: skip
    return found


def curves(ds):
    """Past an onset in shear, under isotropic tension, and along the pruning of a lattice."""
    figure, (left, middle, right) = panels(
        3,
        "Numbers of the literature are recovered: the factor 3, G in proportion to T, ν → −1\n"
        f"(up to {counted(ds)} a curve; A: mean ± standard deviation)",
        height=3.1,
    )
    _factor(left, ds)
    _tension(middle, ds)
    _pruned(right, ds)
    lettered(left, middle, right)
    return figure


def _curves(ds, name):
    """Curves of the seeds with a value: x and y, (n, points), without missing points."""
    one = ds.sel(quantity=name)
    has = np.isfinite(one.value.values)
    x, y = one.x.values[has], one.y.values[has]
    known = np.isfinite(x).all(axis=0) & np.isfinite(y).all(axis=0)
    return x[:, known], y[:, known]


def _factor(axes, ds):
    axes.set(xlabel="onset $\\gamma_c$", ylabel="$(G - G_c)\\,\\gamma_c/\\sigma$", title="past an onset in shear")
    if "factor_three" in ds.quantity.values:
        x, y = _curves(ds, "factor_three")
        if x.size:
            axes.errorbar(x[0], y.mean(axis=0), y.std(axis=0), capsize=2, ls="", **series(0))
            fit = np.polyfit(x[0] ** 2, y.mean(axis=0), 1)
            fine = np.linspace(0, x[0].max(), 50)
            axes.plot(fine, np.polyval(fit, fine**2), color="0.5", lw=0.8, label="$a + b\\gamma_c^2$")
    axes.axhline(3, color="k", lw=0.8, ls=":", label="3 (Merkel)")
    axes.legend(fontsize=TEXT, frameon=False, handlelength=1.2, labelspacing=0.2, handletextpad=0.4)


def _tension(axes, ds):
    for n, name in enumerate(each for each in TENSIONS if each in ds.quantity.values):
        x, y = _curves(ds, name)
        if x.size:
            axes.loglog(x[0], y[0], ms=4, lw=0.8, label=name.removeprefix("tension_"), **series(n))
    ends = np.array([1e-6, 1e-5])
    axes.loglog(ends, 0.5 * ends, color="k", lw=0.8, ls=":", label="$\\propto T$")
    axes.set(xlabel="tension $T$  [k]", ylabel="$G - G_c$  [k]", title="past the transition")
    axes.legend(fontsize=TEXT, frameon=False, handlelength=1.2, labelspacing=0.2, handletextpad=0.4)


def _pruned(axes, ds):
    if "auxetic" in ds.quantity.values:
        x, y = _curves(ds, "auxetic")
        for each, ratio in zip(x, y, strict=True):
            axes.plot(each, ratio, lw=0.8, color=series(0)["color"])
    for limit, name in ((-1, "lower bound, −1"), (1 / 3, "whole lattice, 1/3")):
        axes.axhline(limit, color="k", lw=0.8, ls=":")
        axes.annotate(name, (6, limit), (0, 3), textcoords="offset points", fontsize=TEXT, ha="right")
    axes.margins(y=0.1)
    axes.set(xlabel="coordination $z$", ylabel="Poisson's ratio $\\nu$", title="pruned lattices")


study = Study(
    name="reference_numbers",
    title="Numbers of the literature on underconstrained networks and vertex models",
    references="the source of each number is in its claim",
    axes=(
        Axis("seed", range(8), "seed of the networks", noun="network"),
        Axis("quantity", tuple(QUANTITIES), "quantity of the literature", key="quantities"),
    ),
    parameters={
        "n_vertices": 400,
        "n_vertices_cells": 1000,
        "onsets": (0.025, 0.05, 0.1, 0.2),
        "z": 3.4,
        "columns": 6,
        "candidates": 10,
    },
    case=case,
    extras=("response_of_network",),
    check=check,
    variables=(
        Variable("value", ("quantity", "seed"), "f8", long_name="the number that the literature gives"),
        Variable("x", ("quantity", "seed", "point"), "f8", long_name="abscissa of the curve behind the number"),
        Variable("y", ("quantity", "seed", "point"), "f8", long_name="ordinate of the curve behind the number"),
        Variable("status", ("quantity", "seed"), "i1", long_name="outcome", flags=Status),
    ),
    figures={"curves": curves},
    claims=claims,
)
