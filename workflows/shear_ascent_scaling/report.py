"""Figure, claims and summary of the compressed edges against size, from the dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.workflow import Claim

from ..shared.power_laws import exponent, shown
from ..shared.reports import parameters, series, status_counts


def _curves(ds, name):
    """Label and values (n_sizes, n_networks) at the end of FIRE and at each part of the bound."""
    for algorithm in map(str, ds.algorithm.values):
        one = ds.sel(algorithm=algorithm)
        if algorithm == "fire":
            values = one[f"{name}_end"].transpose("n_vertices", "seed").values
            yield f"FIRE, {parameters(ds)['n_steps']} steps", values
        else:
            for fraction in ds.fraction.values:
                values = one[name].sel(fraction=fraction).transpose("n_vertices", "seed").values
                yield f"{algorithm.upper()}, {100 * fraction:.0f} % of the bound", values


def scaling_figure(ds):
    """Number and total length of compressed edges against size."""
    figure = Figure(figsize=(9.8, 4.4), dpi=120, layout="constrained")
    for axes, name, label, expected in zip(
        figure.subplots(1, 2),
        ("compressed_edges", "compressed_length"),
        ("number of compressed edges  $N(\\tau<0)$", "total length of compressed edges  $L(\\tau<0)$"),
        (0.5, 1.0),
        strict=True,
    ):
        _draw_scaling(axes, ds, name, expected)
        axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel=label)
        axes.legend(fontsize=8, frameon=False, loc="upper left", title="exponent [95 %]", title_fontsize=8)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high * 12)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        f"Few but long: compressed edges on the way to the largest shear modulus ({ds.sizes['seed']} networks a size; "
        "medians, bars hold two thirds)",
        fontsize=11,
    )
    return figure


def _draw_scaling(axes, ds, name, expected):
    """The fitted power laws of one quantity, and the exponent of the paper as a dotted line."""
    sizes = ds.n_vertices.values
    lowest = np.inf
    for n, (words, values) in enumerate(_curves(ds, name)):
        style = series(n)
        # Medians, because the lengths of an ascent near a singular matrix diverge.
        fit = exponent(sizes, values, np.nanmedian)
        low, middle, high = np.nanquantile(values, (1 / 6, 0.5, 5 / 6), axis=1)
        axes.errorbar(
            sizes, middle, (middle - low, high - middle), linestyle="none", **style, capsize=2, markersize=5,
            label=f"{words}: {fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]",
        )  # fmt: skip
        line = np.exp(np.nanmean(np.log(middle)) + fit[0] * (np.log(sizes) - np.log(sizes).mean()))
        axes.plot(sizes, line, color=style["color"], linewidth=1.2)
        lowest = min(lowest, middle[0])
    if name == "compressed_length":
        least = _least(ds)
        axes.plot(
            sizes, np.nanmean(least, 1), "k--", linewidth=1.1,
            label=f"least that the bound needs: {exponent(sizes, least)[0]:.3f}",
        )  # fmt: skip
    guide = 0.5 * lowest * (sizes / sizes[0]) ** expected
    axes.plot(sizes, guide, color="0.6", linestyle=":")
    axes.text(sizes[-1], 0.8 * guide[-1], f"$\\propto N_v^{{{expected:g}}}$", color="0.4", ha="right", va="top")


def claims(ds):
    """The exponents of the paper and those measured, by method and part of the bound."""
    return [*_exponents(ds), *_bounds(ds)] if ds.sizes["n_vertices"] > 1 else []


def _exponents(ds):
    sizes = ds.n_vertices.values
    for name, key, printed, words in (
        ("compressed_edges", "F", 0.5, "the number of compressed edges of final networks grows as √N_v"),
        ("compressed_length", "G", 1.0, "the total length of compressed edges of final networks grows as N_v"),
    ):
        for label, values in _curves(ds, name):
            fit = exponent(sizes, values, np.nanmedian)
            yield Claim.tested(
                f"ShearModulusSteepestDescent-{key}-{label.split(' ')[0].rstrip(',').lower()}-{_place(label)}",
                f"{words} ({label})", f"exponent {printed:g}", f"exponent {shown(fit)}",
                fit[1] - 0.05 <= printed <= fit[2] + 0.05, _REASON,
            )  # fmt: skip


def _bounds(ds):
    """The part of the bound that the ascents reach, and the compressed length of configurations at the bound."""
    sizes = ds.n_vertices.values
    part = (100 * ds.shear_modulus_end / ds.bound).mean("seed")
    reached = (
        f"{algorithm} {float(part.sel(algorithm=algorithm, n_vertices=size)):.0f} % at N_v = {size}"
        for algorithm in map(str, ds.algorithm.values)
        for size in sizes
    )
    yield Claim(
        "ShearModulusSteepestDescent-end",
        "how much of the bound the ascents reach",
        "not stated",
        ", ".join(reached),
        "measured",
    )
    fit, least = exponent(sizes, _least(ds)), _least(ds)
    yield Claim(
        "ShearModulusSteepestDescent-G-bound",
        "at the bound itself a compressed length ∝ N_v cannot be avoided (linear program over all configurations)",
        "not stated", f"at least {np.nanmean(least / sizes[:, None]):.3f} N_v, exponent {shown(fit)}", "measured",
    )  # fmt: skip


_REASON = (
    "the exponent depends on the method and on how far it climbs: FIRE, the paper's method, has the first row; L-BFGS "
    "climbs farther and compresses more and shorter edges, whose total length grows as N_v"
)


def _place(label):
    return label.split(", ")[1].split(" ")[0]


def _least(ds):
    return ds.least_compressed_length.isel(algorithm=0).transpose("n_vertices", "seed").values


def summary(ds):
    """Scalars for tables: means by method and size."""
    names = ("bound", "shear_modulus_end", "longest_edge_end", "compressed_edges_end", "compressed_length_end")
    return {
        "networks": ds.sizes["seed"],
        "parameters": parameters(ds),
        "status": status_counts(ds.status.values),
        "n_vertices": ds.n_vertices.values,
        "algorithms": {
            str(a): {name: ds[name].sel(algorithm=a).mean("seed").values for name in names} for a in ds.algorithm.values
        },
    }
