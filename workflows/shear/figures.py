"""Figures and animation of the ascents, and of the shear modulus against size, threshold and starts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.special import comb

from critflow.figures.plot import COLOURS, COMPRESSED, draw_network

from ..shared.figures import lettered
from ..shared.populations import LABELS
from ..shared.power_laws import exponent, quoted
from ..shared.reports import parameters, series

# Parts of the bound at which one network is drawn.
SHOWN = (0.1, 0.25, 0.6)
STYLES = (":", "--", "-", "-.")
EXAMPLE = 0.3  # threshold of the inset, which is as wide to the eye as its margin
BLUE, GREEN = COLOURS[0], COLOURS[3]


def recorded(ds):
    """The recorded ascents: variables without a size, with the bound and the status of the ascent."""
    names = [name for name, values in ds.data_vars.items() if "n_vertices" not in values.dims]
    return ds[names].rename(ascent_bound="bound", ascent_status="status", needed_length="least_compressed_length")


def detailed(ds):
    """The networks with thresholds, starts and ascents at all sizes."""
    return ds.isel(seed=ds.seed.values < parameters(ds)["detailed_seeds"])


def by_size(values):
    """A variable as an array (n_sizes, n_networks)."""
    return values.transpose("n_vertices", "seed").values


def ascent_figure(ds):
    """Modulus, longest edge and least tension of the ascents, and one network at three steps."""
    ds = recorded(ds)
    figure = Figure(figsize=(11, 8.2), dpi=95, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.08))
    left, middle, right = top.subplots(1, 3)
    _draw_modulus(left, ds)
    _draw_extremes(middle, ds)
    _draw_compression(right, ds)
    lettered(left, middle, right)
    for axes in (left, middle, right):
        axes.set(xscale="log", xlabel="step $s$ of the ascent (0 at the left edge)")

    one = ds.isel(seed=0)
    for axes, letter, place in zip(bottom.subplots(1, 3), "DEF", _places(one), strict=True):
        _draw(axes, one.isel(step=place), width=0.9)
        value = float(one.G_0_ascent[place])
        axes.set_title(
            f"$\\bf{{{letter}}}$   step {int(one.step[place])}: $G_0$ = {value:.2g} $k$, "
            f"{100 * value / float(one.bound):.0f} % of the bound",
            fontsize=9.5,
        )
    handles = [Line2D([], [], color="#1c4f86"), Line2D([], [], color=COMPRESSED, linestyle=(0, (2, 1)))]
    figure.legend(handles, ["tension", "compression"], loc="outside lower center", ncols=2, fontsize=9, frameon=False)
    figure.suptitle(
        "Free to compress edges, the shear modulus climbs to its bound while edges grow to the size of the box\n"
        f"({ds.sizes['seed']} networks of {ds.sizes['vertex']} vertices; medians; bands hold two thirds)",
        fontsize=11,
    )
    return figure


def _draw_modulus(axes, ds):
    bound = float(ds.bound.mean())
    axes.axhline(bound, color="0.25", linewidth=1.2, linestyle="--")
    axes.text(0.55, bound * 1.015, "closed-form bound", fontsize=8.5, color="0.25")
    _band(axes, ds.G_0_ascent, BLUE)
    axes.set(ylabel="shear modulus $G_0$  [$k$]", ylim=(-0.005, 1.12 * bound))


def _draw_extremes(axes, ds):
    """The longest edge and the least tension, each relative to its natural unit."""
    for values, colour, label in (
        (ds.longest_edge, BLUE, "longest edge / side of the box"),
        (ds.least_tension, COMPRESSED, "least / largest tension"),
    ):
        _band(axes, values, colour)
        axes.plot([], [], color=colour, label=label)
    for level in (0, 1):
        axes.axhline(level, color="0.7", linewidth=0.8, zorder=0)
    axes.set(ylabel="extremes of the edges")
    axes.margins(y=0.15)
    axes.legend(fontsize=8.5, frameon=False, loc="upper left")


def _draw_compression(axes, ds):
    """Total length of the compressed edges."""
    _band(axes, ds.compressed_length / ds.sizes["vertex"], GREEN)
    least = float((ds.least_compressed_length / ds.sizes["vertex"]).mean())
    axes.axhline(least, color=GREEN, linewidth=1.0, linestyle="--")
    axes.text(0.55, least + 0.03, "least length that\nthe bound needs", fontsize=8.5, color=GREEN)
    axes.set(ylabel="length under compression / $N_v$", ylim=(0, None))


def _on_log_axis(steps):
    """Steps with a finite place for the start on a logarithmic axis."""
    return np.maximum(steps.values, 0.5)


def animation(ds):
    """One network during the ascent, with its modulus."""
    one = recorded(ds).isel(seed=0)
    steps, moduli = _on_log_axis(one.step), one.G_0_ascent.values
    for place in range(len(steps)):
        figure = Figure(figsize=(7.2, 3.7), dpi=72, layout="constrained")
        network, curve = figure.subplots(1, 2, width_ratios=(1.15, 1))
        _draw(network, one.isel(step=place), width=0.8)
        curve.axhline(float(one.bound), color="0.25", linewidth=1.0, linestyle="--")
        curve.plot(steps, moduli, color="0.8", linewidth=1.2)
        curve.plot(steps[: place + 1], moduli[: place + 1], color=BLUE, linewidth=1.8)
        curve.plot(steps[place], moduli[place], "o", color=BLUE)
        curve.set(xscale="log", xlabel="step of the ascent", ylabel="shear modulus $G_0$  [$k$]")
        curve.set_ylim(-0.01, 1.1 * float(one.bound))
        curve.spines[["top", "right"]].set_visible(False)
        curve.set_title(f"step {int(one.step[place])}", loc="left", fontsize=10)
        yield figure


def _draw(axes, one, width):
    cell, sigma = one.cell.values, one.sigma.values.astype(float)
    x = one.position.values.astype(float)
    tail, head = one.edges.values.T
    L = x[head] - x[tail] + one.offsets.values @ cell
    tension = sigma * np.linalg.norm(L, axis=1)
    limits = (0.0, float(np.percentile(np.abs(tension), 98)))
    draw_network(axes, one.edges.values, one.offsets.values, cell, x, tension, limits=limits, width=width)


def _places(one):
    """The first recorded steps beyond the drawn parts of the bound."""
    parts = one.G_0_ascent.values / float(one.bound)
    return [int(np.argmax(parts >= part)) if parts.max() >= part else len(parts) - 1 for part in SHOWN]


def _band(axes, values, colour):
    """Median over networks, and the band of two thirds of them, against the step."""
    x = _on_log_axis(values.step)
    low, middle, high = np.nanquantile(values.transpose("seed", "step").values, (1 / 6, 0.5, 5 / 6), axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    axes.plot(x, middle, color=colour, linewidth=1.8)


def ascent_ends(ds, name):
    """Label and values (n_sizes, n_networks) at the end of FIRE, and at parts of the bound that most networks reach."""
    for algorithm in map(str, ds.algorithm.values):
        one = ds.sel(algorithm=algorithm)
        if algorithm == "fire":
            yield f"FIRE, {parameters(ds)['n_steps']} steps", by_size(one[f"{name}_of_end"])
        for fraction in ds.fraction.values:
            values = by_size(one[f"{name}_of_part"].sel(fraction=fraction))
            if (np.isfinite(values).mean(axis=1) > 0.5).all():
                yield f"{algorithm.upper()}, {100 * fraction:.0f} % of the bound", values


def compression_figure(ds):
    """Number and total length of compressed edges against size."""
    ds = detailed(ds)
    figure = Figure(figsize=(9.8, 5.8), dpi=120, layout="constrained")
    for axes, name, label, expected in zip(
        figure.subplots(1, 2),
        ("compressed_edges", "compressed_length"),
        ("number of compressed edges  $N(\\tau<0)$", "total length of compressed edges  $L(\\tau<0)$"),
        (0.5, 1.0),
        strict=True,
    ):
        _draw_compressed(axes, ds, name, expected)
        axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel=label)
        axes.legend(
            fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14),
            title="exponent [95 %]", title_fontsize=8,
        )  # fmt: skip
    lettered(*figure.axes)
    figure.suptitle(
        f"Few but long: compressed edges on the way to the largest shear modulus ({ds.sizes['seed']} networks a size; "
        "medians, bars hold two thirds)",
        fontsize=11,
    )
    return figure


def _draw_compressed(axes, ds, name, expected):
    """The fitted power laws of one quantity, and the exponent of the paper as a dotted line."""
    sizes = ds.n_vertices.values
    lowest = np.inf
    for n, (words, values) in enumerate(ascent_ends(ds, name)):
        style = series(n)
        # Medians, because the lengths of an ascent near a singular matrix diverge.
        fit = exponent(sizes, values, np.nanmedian)
        low, middle, high = np.nanquantile(values, (1 / 6, 0.5, 5 / 6), axis=1)
        axes.errorbar(
            sizes, middle, (middle - low, high - middle), linestyle="none", **style, capsize=2, markersize=5,
            label=f"{words}: {quoted(fit)}",
        )  # fmt: skip
        line = np.exp(np.nanmean(np.log(middle)) + fit[0] * (np.log(sizes) - np.log(sizes).mean()))
        axes.plot(sizes, line, color=style["color"], linewidth=1.2)
        lowest = min(lowest, middle[0])
    if name == "compressed_length":
        least = by_size(ds.least_compressed_length)
        axes.plot(
            sizes, np.nanmean(least, 1), "k--", linewidth=1.1,
            label=f"least that the bound needs: {exponent(sizes, least)[0]:.3f}",
        )  # fmt: skip
    guide = 0.5 * lowest * (sizes / sizes[0]) ** expected
    axes.plot(sizes, guide, color="0.6", linestyle=":")
    axes.text(sizes[-1], 0.8 * guide[-1], f"$\\propto N_v^{{{expected:g}}}$", color="0.4", ha="right", va="top")


def scaling_figure(ds):
    """G_0 against size by population, against the threshold by size with its allowed stresses, and against starts."""
    figure = Figure(figsize=(13, 5.0), dpi=110, layout="constrained")
    by_size, by_threshold, by_start = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    _draw_sizes(by_size, ds)
    _draw_thresholds(by_threshold, detailed(ds))
    _draw_starts(by_start, detailed(ds))
    lettered(*figure.axes)
    figure.suptitle(
        "Only networks optimised for it keep a shear modulus; lower thresholds raise it, more starts hardly do "
        f"({ds.sizes['seed']} networks a size)",
        fontsize=11,
    )
    return figure


def _draw_sizes(axes, ds):
    sizes = ds.n_vertices.values
    for place, population in enumerate(map(str, ds.population.values)):
        values = by_size(ds.G_0.sel(population=population))
        fit, optimised = exponent(sizes, values, np.nanmedian), population == "max_G_0"
        low, middle, high = np.nanquantile(values, (1 / 6, 0.5, 5 / 6), axis=1)
        style = series(place)
        axes.errorbar(
            sizes * (1 + 0.02 * (place - 3)), middle, (middle - low, high - middle), elinewidth=0.8,
            linestyle="none", **style, markersize=5, capsize=2,
            markerfacecolor="none" if optimised else style["color"],
            label=f"{LABELS[population]}: {quoted(fit)}",
        )  # fmt: skip
    isotropic = [p for p in map(str, ds.population.values) if p != "max_G_0"]
    middle = np.nanmedian(ds.G_0.sel(population=isotropic).isel(n_vertices=-1).values)
    axes.plot(sizes, middle * sizes[-1] / sizes, color="0.5", linestyle=":", zorder=0)
    axes.text(0.03, 0.03, "dotted: $\\propto 1/N_v$", color="0.35", transform=axes.transAxes)
    axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="shear modulus $G_0$  [$k$]")
    axes.legend(
        fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, columnspacing=1.0,
        handletextpad=0.2, title="medians, bars of two thirds; exponent [95 %]", title_fontsize=8,
    )  # fmt: skip


def _draw_thresholds(axes, ds):
    sizes = ds.n_vertices.values
    axes.axhline(float(ds.bound.mean()), color="0.25", linestyle="--", linewidth=1.2)
    axes.text(ds.threshold.values.min(), 1.02 * float(ds.bound.mean()), "bound for any stress", fontsize=8.5)
    for colour, style, size in zip(COLOURS[::2], STYLES, _shown_sizes(sizes), strict=False):
        values = ds.G_0_of_threshold.sel(n_vertices=size)
        mean, width = values.mean("seed"), values.std("seed")
        axes.fill_between(ds.threshold, mean - width, mean + width, color=colour, alpha=0.2, linewidth=0)
        axes.plot(ds.threshold, mean, style, color=colour, linewidth=1.8, label=f"$N_v$ = {size}")
    axes.set(
        xscale="log", xlabel="least stress $r$  (mean square 1)", ylabel="shear modulus $G_0$ of max $G_0$  [$k$]",
        ylim=(0, 1.15 * float(ds.bound.mean())),
    )  # fmt: skip
    axes.set_xticks([0.01, 0.03, 0.1, 0.3, 0.7], ["0.01", "0.03", "0.1", "0.3", "0.7"])
    axes.minorticks_off()
    axes.legend(fontsize=8.5, frameon=False, loc="center right")
    _draw_allowed(axes.inset_axes((0.16, 0.38, 0.4, 0.42)))


def _draw_allowed(axes):
    """The sphere of stresses of the three-bar linkage, seen along equal stresses, with those above r in green."""
    across = np.array([[-1, 1, 0], [-1, -1, 2]]) / np.sqrt([[2], [6]])
    turn = np.linspace(0, 2 * np.pi, 100)
    axes.fill(*np.sqrt(3) * np.array([np.cos(turn), np.sin(turn)]), facecolor="0.93", edgecolor="0.6", linewidth=0.8)
    axes.fill(*across @ allowed_region(0.0).T, facecolor="0.8", edgecolor="0.4", linewidth=0.8)
    axes.fill(*across @ allowed_region(EXAMPLE).T, facecolor=GREEN, edgecolor="none")
    for n, corner in enumerate(np.sqrt(3) * across.T):
        axes.annotate(f"$\\sigma_{n + 1}$", 1.5 * corner, ha="center", va="center", fontsize=8.5)
    axes.set_title(f"three bars: $\\sigma > r = {EXAMPLE}$", fontsize=8.5, pad=0)
    axes.set(xlim=(-2.4, 2.4), ylim=(-2.1, 2.5), aspect="equal")
    axes.axis("off")


def allowed_region(r, n=30):
    """Boundary (3n, 3) of the stresses σ ≥ r of three edges on their sphere Σσ² = 3: an arc σ_i = r for each edge."""
    rest = np.sqrt(3 - r**2)
    angle = np.linspace(np.arcsin(r / rest), np.arccos(r / rest), n)
    arc = np.stack([np.full(n, r), rest * np.cos(angle), rest * np.sin(angle)], axis=1)
    return np.concatenate([np.roll(arc, edge, axis=1) for edge in range(3)])


def _draw_starts(axes, ds):
    sizes = ds.n_vertices.values
    for place, size in enumerate(sizes):
        objectives = ds.sel(n_vertices=size).objective_of_start.values
        deficit = 100 * (1 - expected_best(objectives[np.isfinite(objectives).all(axis=1)]))
        starts = np.arange(1, deficit.shape[1])
        axes.plot(starts, deficit.mean(0)[:-1], **series(place), markersize=4, label=f"$N_v$ = {size}")
    axes.set(xlabel="number of starts", ylabel="mean deficit against the best of all  [%]", yscale="log")
    axes.set_ylim(1e-4, None)
    axes.legend(fontsize=8.5, frameon=False)


def _shown_sizes(sizes):
    """The three sizes of the paper, or the first three sizes of the run."""
    return [size for size in (100, 500, 1000) if size in sizes] or list(sizes[:3])


def expected_best(objectives):
    """Expected best of n random starts over the best of all, (networks, n): the mean over all orders of the starts."""
    order = np.sort(objectives, axis=1)
    rank = np.arange(1, order.shape[1] + 1)
    # Of n starts drawn without return the largest has rank i with probability C(i − 1, n − 1)/C(all, n).
    return order @ (comb(rank[:, None] - 1, rank - 1) / comb(len(rank), rank)) / order[:, -1:]
