"""Table, figures and claims of the reference numbers, from the dataset alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from critflow.workflow import Claim

from ..shared.reports import finite, parameters, series, status_counts


class Quantity(NamedTuple):
    """A number of the literature.

    value    of the literature, or the middle of its range
    within   distance of our mean from it that counts as agreement, from the digits of the source or from rounding
    """

    statement: str
    symbol: str
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
        "critical shape index of regular hexagons", "p_0^*", "√(8√3) = 3.72241943…", np.sqrt(8 * np.sqrt(3)), 1e-10,
        "exact: perimeter of the hexagon of unit area", "rounding is larger than expected",
    ),
    "planar_shape": Quantity(
        "critical shape index of the disordered planar vertex model", "p_0^*", "3.81", 3.81, 0.01,
        "Bi, Lopez, Schwarz, Manning, Nature Physics 11, 1074 (2015)", "the topologies differ",
    ),
    "honeycomb_length": Quantity(
        "least length of equal edges of the honeycomb at unit area a vertex", "\\ell_0^*", "√(4/3√3) = 0.87738267…",
        LENGTH, 1e-10, "exact", "rounding is larger than expected",
    ),
    "honeycomb_shear": Quantity(
        "coefficient of γ² in the least length of the honeycomb in simple shear", "b", "3ℓ₀/8 = 0.32901850…",
        0.375 * LENGTH, 1e-6, "exact", "differences lose more digits than expected",
    ),
    "factor_three": Quantity(
        "(G − G_c) γ_c/σ past an onset in simple shear, for γ_c → 0", "(G-G_c)\\gamma_c/\\sigma", "3", 3.0, 0.03,
        "Merkel, Baumgarten, Tighe, Manning, PNAS 116, 6560 (2019)", "the coefficient depends on the network",
    ),
    "tension_honeycomb": Quantity(
        _TENSION + "honeycomb", "d\\ln(G-G_c)/d\\ln T", "1", 1.0, 0.03, LEE, _CORRECTED),
    "tension_voronoi": Quantity(
        _TENSION + "Voronoi", "d\\ln(G-G_c)/d\\ln T", "1", 1.0, 0.03, LEE, _CORRECTED),
    "tension_phantom": Quantity(
        _TENSION + "phantom triangular", "d\\ln(G-G_c)/d\\ln T", "1", 1.0, 0.03, LEE, _CORRECTED),
    "tension_delaunay": Quantity(
        _TENSION + "Delaunay", "d\\ln(G-G_c)/d\\ln T", "1", 1.0, 0.03, LEE, _CORRECTED),
    "onset_self_stresses": Quantity(
        "self-stresses of random networks at their onset in shear", "N_s", "1", 1.0, 0.0,
        "Vermeulen, Bose, Storm, Ellenbroek, Phys. Rev. E 96, 053003 (2017)", "some onset has several self-stresses",
    ),
    "convex_faces": Quantity(
        "all faces of critical planar networks are convex", "convex corners", "all", 1.0, 0.0,
        "Tutte, Proc. London Math. Soc. 13, 743 (1963); Gandikota et al., arXiv:2204.09192", "some corner is reflex",
    ),
    "auxetic": Quantity(
        "Poisson's ratio of pruned lattices with convex faces", "\\nu", "−1 < ν < 1/3", -1 / 3, 2 / 3,
        "Hagh, Thorpe, Phys. Rev. B 98, 100101 (2018)", "pruning went beyond the printed range",
    ),
}  # fmt: skip
TENSIONS = tuple(name for name in QUANTITIES if name.startswith("tension_"))


def measured(ds, name):
    """Finite values of a quantity, one a seed."""
    return finite(ds.value.sel(quantity=name).values)


def shown(values, digits=8):
    """Mean ± standard deviation, or the number itself where the seeds agree."""
    if len(values) == 0:
        return "no value"
    spread = float(np.std(values))
    if spread < 1e-9 * max(abs(float(np.mean(values))), 1e-300):
        return f"{np.mean(values):.{digits + 2}g}"
    places = min(max(0, 1 - int(np.floor(np.log10(spread)))), MOST_PLACES)
    return f"{np.mean(values):.{places}f} ± {spread:.{places}f}"


def holds(name, values):
    """Whether the mean agrees, or, for a range, whether every value lies in it."""
    known = QUANTITIES[name]
    if len(values) == 0:
        return False
    if name == "auxetic":
        return bool(values.min() > -1 and values.max() < 1 / 3)
    return abs(float(np.mean(values)) - known.value) <= known.within


def claims(ds):
    """Each number of the literature against ours."""
    found = []
    for name in ds.quantity.values:
        known, values = QUANTITIES[str(name)], measured(ds, name)
        missing = ds.sizes["seed"] - len(values)
        found.append(Claim.tested(
            str(name), known.statement, known.printed, shown(values), holds(str(name), values),
            known.because if len(values) else "no network of this run gives a value",
            "; ".join(filter(None, (known.source, f"{missing} seeds without a value" if missing else ""))),
        ))  # fmt: skip
    return found


def table(ds):
    """The numbers, ours next to theirs."""
    names = [str(name) for name in ds.quantity.values]
    figure = Figure(figsize=(9.6, 0.8 + 0.42 * len(names)), dpi=150)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    columns = (0.0, 0.45, 0.65, 0.88)
    top = len(names) + 1
    axes.set(xlim=(0, 1), ylim=(-0.3, top + 0.2))
    for at, text in zip(columns, ("quantity", "literature", "here", "agreement"), strict=True):
        axes.text(at, top - 0.4, text, fontweight="bold", fontsize=8.5)
    axes.axhline(top - 0.75, color="0.3", lw=0.8)
    for row, name in enumerate(names):
        known, values = QUANTITIES[name], measured(ds, name)
        y = top - 1.35 - row
        axes.text(columns[0], y, known.statement, fontsize=8)
        axes.text(columns[0], y - 0.38, known.source, fontsize=6, color="0.35")
        axes.text(columns[1], y, known.printed, fontsize=8)
        axes.text(columns[2], y, shown(values), fontsize=8)
        axes.text(columns[3], y, "holds" if holds(name, values) else "differs", fontsize=8)
        axes.axhline(y - 0.55, color="0.85", lw=0.5)
    return figure


def curves(ds):
    """Past an onset in shear, under isotropic tension, and along the pruning of a lattice."""
    figure = Figure(figsize=(9.6, 3.2), dpi=150, layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _factor(left, ds)
    _tension(middle, ds)
    _pruned(right, ds)
    return figure


def _curves(ds, name):
    """Curves of the seeds with a value: x and y, (n, points), without missing points."""
    one = ds.sel(quantity=name)
    has = np.isfinite(one.value.values)
    x, y = one.x.values[has], one.y.values[has]
    known = np.isfinite(x).all(axis=0) & np.isfinite(y).all(axis=0)
    return x[:, known], y[:, known]


def _factor(axes, ds):
    axes.set(
        xlabel="onset $\\gamma_c$", ylabel="$(G - G_c)\\,\\gamma_c/\\sigma$", title="past an onset in simple shear"
    )
    if "factor_three" in ds.quantity.values:
        x, y = _curves(ds, "factor_three")
        if x.size:
            axes.errorbar(x[0], y.mean(axis=0), y.std(axis=0), capsize=2, ls="", label="Voronoi", **series(0))
            fit = np.polyfit(x[0] ** 2, y.mean(axis=0), 1)
            fine = np.linspace(0, x[0].max(), 50)
            axes.plot(fine, np.polyval(fit, fine**2), color="0.5", lw=0.8, label="$a + b\\gamma_c^2$")
    axes.axhline(3, color="k", lw=0.8, ls=":", label="3 (Merkel et al.)")
    axes.legend(fontsize=7)


def _tension(axes, ds):
    for n, name in enumerate(each for each in TENSIONS if each in ds.quantity.values):
        x, y = _curves(ds, name)
        if x.size:
            axes.loglog(x[0], y[0], ms=4, lw=0.8, label=name.removeprefix("tension_"), **series(n))
    ends = np.array([1e-6, 1e-5])
    axes.loglog(ends, 0.5 * ends, color="k", lw=0.8, ls=":", label="$\\propto T$ (Lee, Merkel)")
    axes.set(xlabel="isotropic tension $T$", ylabel="shear modulus $G - G_c$", title="dilation past the transition")
    axes.legend(fontsize=7)


def _pruned(axes, ds):
    if "auxetic" in ds.quantity.values:
        x, y = _curves(ds, "auxetic")
        for each, ratio in zip(x, y, strict=True):
            axes.plot(each, ratio, lw=0.8, color=series(0)["color"])
    for limit in (-1, 1 / 3):
        axes.axhline(limit, color="k", lw=0.8, ls=":")
    axes.invert_xaxis()
    axes.set(xlabel="coordination $z$", ylabel="Poisson's ratio $\\nu$", title="pruned triangular lattices")


def summary(ds):
    """Mean, spread and outcomes of every quantity next to the number of the literature."""
    rows = {}
    for name in ds.quantity.values:
        values, known = measured(ds, name), QUANTITIES[str(name)]
        rows[str(name)] = {
            "literature": known.printed,
            "source": known.source,
            "mean": float(np.mean(values)) if len(values) else None,
            "standard_deviation": float(np.std(values)) if len(values) else None,
            "status": status_counts(ds.status.sel(quantity=name).values),
        }
    return {"seeds": ds.seed.values.tolist(), "parameters": parameters(ds), "quantities": rows}
