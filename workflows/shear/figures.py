"""Figures and animation of the ascents, and of the shear modulus against size, threshold and starts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from critflow.pictures import COLOURS, COMPRESSED, draw_network

from ..shared.figures import WIDTH, counted, lettered, mean_bars, page, panels, readable, size_axis
from ..shared.populations import LABELS, PAPER_POPULATIONS
from ..shared.reports import exponent, parameters, quoted, series
from ..shared.verification import bond_vectors

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
    """Modulus, longest edge, least tension and compressed length of the ascents, and one network at three steps."""
    ds = recorded(ds)
    figure = page(
        6.1,
        "Free to compress edges, $G_0$ climbs to its bound, and edges grow to the size of the box\n"
        f"({counted(ds)} of {ds.sizes['vertex']:,} vertices; medians; bands hold two thirds)",
    )
    top, bottom = figure.subfigures(2, 1, height_ratios=(1.35, 1))
    (modulus, longest), (tension, length) = top.subplots(2, 2, sharex=True)
    _draw_modulus(modulus, ds)
    _draw_extreme(longest, ds.longest_edge, BLUE, "longest edge / box", 1)
    _draw_extreme(tension, ds.least_tension, COMPRESSED, "least / largest tension", 0)
    _draw_compression(length, ds)
    for axes in (modulus, longest, tension, length):
        _step_axis(axes, ds.step.values[-1])
    for axes in (tension, length):
        axes.set_xlabel("step of the ascent")
    lettered(modulus, longest, tension, length)

    one = ds.isel(seed=0)
    # The first recorded steps beyond the drawn parts of the bound, or the last before the ascent ended.
    parts = one.G_0_ascent.values / float(one.bound)
    places = [int(np.argmax(parts >= part)) if (parts >= part).any() else _last_record(one) for part in SHOWN]
    for axes, letter, place in zip(bottom.subplots(1, 3), "EFG", places, strict=True):
        _draw(axes, one.isel(step=place), width=0.55)
        value = float(one.G_0_ascent[place])
        axes.set_title(
            f"$\\bf{{{letter}}}$  step {int(one.step[place])}, {100 * value / float(one.bound):.0f} % of the bound",
            fontsize=9, loc="left",
        )  # fmt: skip
    handles = [Line2D([], [], color="#1c4f86"), Line2D([], [], color=COMPRESSED, linestyle=(0, (2, 1)))]
    bottom.legend(handles, ["tension", "compression"], loc="outside lower center", ncols=2, fontsize=9, frameon=False)
    return figure


def _last_record(one):
    """The place of the last recorded step before the ascent ended."""
    return int(np.flatnonzero(np.isfinite(one.G_0_ascent.values))[-1])


def _step_axis(axes, last):
    """Steps on a logarithmic axis that begins with step 0."""
    axes.set_xscale("symlog", linthresh=1, linscale=0.3)
    axes.set_xlim(0, 1.1 * max(last, 1))
    axes.set_xticks([step for step in (0, 1, 10, 100, 1000) if step <= last])
    axes.set_xticks([], minor=True)
    axes.xaxis.set_major_formatter("{x:,g}")


def _draw_modulus(axes, ds):
    bound = float(ds.bound.mean())
    axes.axhline(bound, color="0.25", linewidth=1.2, linestyle="--")
    axes.text(0.1, bound * 1.02, "closed-form bound", fontsize=9, color="0.25")
    _band(axes, ds.G_0_ascent, BLUE)
    axes.set(ylabel="shear modulus $G_0$  [k]", ylim=(-0.005, 1.18 * bound))


def _draw_extreme(axes, values, colour, label, level):
    """The longest edge or the least tension, with a line where it reaches the box or compression begins."""
    axes.axhline(level, color="0.6", linewidth=0.8, zorder=0)
    _band(axes, values, colour)
    axes.set(ylabel=label)


def _draw_compression(axes, ds):
    """Total length of the compressed edges."""
    _band(axes, ds.compressed_length / ds.sizes["vertex"], GREEN)
    least = float((ds.least_compressed_length / ds.sizes["vertex"]).mean())
    axes.axhline(least, color=GREEN, linewidth=1.0, linestyle="--")
    axes.text(0.1, least + 0.03, "needed at the bound", fontsize=9, color=GREEN)
    axes.set(ylabel="compressed length / $N_v$", ylim=(0, None))


def animation(ds):
    """One network at every second record of the ascent, with its modulus."""
    one = recorded(ds).isel(seed=0)
    steps, moduli = one.step.values, one.G_0_ascent.values
    for place in reversed(range(_last_record(one), -1, -2)):
        figure = Figure(figsize=(WIDTH, 3.3), dpi=135, layout="constrained")
        network, curve = figure.subplots(1, 2, width_ratios=(1.15, 1))
        _draw(network, one.isel(step=place), width=0.8)
        curve.axhline(float(one.bound), color="0.25", linewidth=1.0, linestyle="--")
        curve.plot(steps, moduli, color="0.8", linewidth=1.2)
        curve.plot(steps[: place + 1], moduli[: place + 1], color=BLUE, linewidth=1.8)
        curve.plot(steps[place], moduli[place], "o", color=BLUE)
        high = 1.1 * float(one.bound)
        curve.set(xlabel="step of the ascent", ylabel="shear modulus $G_0$  [k]", ylim=(-0.01, high))
        _step_axis(curve, steps[-1])
        readable(curve)
        curve.set_title(f"step {int(one.step[place])}", loc="left", fontsize=10)
        yield figure


def _draw(axes, one, width):
    cell, x = one.cell.values, one.position.values.astype(float)
    tension = one.sigma.values.astype(float) * np.linalg.norm(bond_vectors(one), axis=1)
    limits = (0.0, float(np.percentile(np.abs(tension), 98)))
    draw_network(axes, one.edges.values, one.offsets.values, cell, x, tension, limits=limits, width=width)


def _band(axes, values, colour):
    """Median over networks, and the band of two thirds of them, against the step."""
    # All ascents may end before the last records.
    values = values.dropna("step", how="all")
    x = values.step.values
    low, middle, high = np.nanquantile(values.transpose("seed", "step").values, (1 / 6, 0.5, 5 / 6), axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    axes.plot(x, middle, color=colour, linewidth=1.8)


def ascent_parts(ds, name):
    """Label and values (n_sizes, n_networks) at the parts of the bound that most networks of each size reach."""
    for algorithm in map(str, ds.algorithm.values):
        for fraction in ds.fraction.values:
            values = by_size(ds[f"{name}_of_part"].sel(algorithm=algorithm, fraction=fraction))
            if (np.isfinite(values).mean(axis=1) > 0.5).all():
                yield f"{NAME_OF.get(algorithm, algorithm)}, {100 * fraction:.0f} % of the bound", values


NAME_OF = {"fire": "FIRE", "lbfgs": "L-BFGS", "newton": "Newton"}
# The ascents that are drawn: how far and by which method they climb.
DRAWN = ("FIRE, 50 % of the bound", "L-BFGS, 50 % of the bound", "L-BFGS, 95 % of the bound")


def compression_figure(ds):
    """Number, total and mean length of compressed edges against size."""
    ds = detailed(ds)
    number, length = (dict(ascent_parts(ds, name)) for name in ("compressed_edges", "compressed_length"))
    found = "The compressed length grows as $N_v$; how many edges share it depends on the ascent"
    figure, axes = panels(
        3,
        f"{found if number else 'In these steps no ascent reaches one of the parts of the bound at all sizes'}\n"
        f"({counted(ds)} a size; means with their standard errors; dotted: slopes of the paper)",
        height=4.5,
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        each = {label: length[label] / number[label] for label in number}
    quantities = ((number, 0.5, "number"), (length, 1.0, "total length"), (each, 0.5, "mean length"))
    for one, (values, printed, label) in zip(axes, quantities, strict=True):
        _draw_compressed(one, ds.n_vertices.values, values, printed)
        one.set(yscale="log", ylabel=f"{label} of compressed edges")
        size_axis(one, ds.n_vertices.values)
        one.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        one.yaxis.set_major_formatter("{x:,.10g}")
        one.yaxis.set_minor_formatter(NullFormatter())
    sizes, least = ds.n_vertices.values, by_size(ds.least_compressed_length)
    axes[1].plot(sizes, np.nanmean(least, 1), "k--", lw=1.1)
    needed = f"dashed: needed at\nthe bound, {exponent(sizes, least)[0]:.2f}"
    axes[1].text(0.04, 0.97, needed, transform=axes[1].transAxes, fontsize=8.5, va="top")
    for one in axes:
        one.tick_params(axis="x", rotation=45)
        if number:
            one.legend(
                fontsize=8.5, frameon=False, loc="upper center", bbox_to_anchor=(0.45, -0.27), labelspacing=0.25,
                title="exponent [95 %]", title_fontsize=8.5, alignment="left", handletextpad=0.3,
            )  # fmt: skip
        elif one is not axes[1]:
            one.set_axis_off()
    lettered(*axes)
    handles = [Line2D([], [], ls="none", **series(2 * n), label=words) for n, words in enumerate(drawn_of(number))]
    figure.legend(handles=handles, fontsize=9, frameon=False, ncols=3, loc="outside lower center")
    return figure


def drawn_of(values):
    """The ascents of `DRAWN` of which there are values, or the first three."""
    return [label for label in DRAWN if label in values] or list(values)[:3]


def _draw_compressed(axes, sizes, ascents, printed):
    """The means and fitted power laws of one quantity, and the exponent of the paper as a dotted line."""
    for n, words in enumerate(drawn_of(ascents)):
        style, values = series(2 * n), ascents[words]
        fit = exponent(sizes, values)
        means = mean_bars(axes, sizes, values, **style, capsize=2, markersize=5, label=quoted(fit))
        line = np.exp(np.mean(np.log(means)) + fit[0] * (np.log(sizes) - np.log(sizes).mean()))
        axes.plot(sizes, line, color=style["color"], linewidth=1.2)
    low = min((np.nanmean(ascents[words][0]) for words in drawn_of(ascents)), default=np.nan)
    axes.plot(sizes, low / 1.6 * (sizes / sizes[0]) ** printed, color="0.4", linestyle=":", linewidth=1.2)


def scaling_figure(ds):
    """G_0 against size by population, and against the threshold by size with its allowed stresses."""
    figure, (by_size, by_threshold) = panels(
        2,
        "Only networks optimised for it keep a shear modulus; a lower threshold raises it\n"
        f"(A: {counted(ds)} a size, means with their standard errors; B: {counted(detailed(ds))}, mean ± s.d.)",
        height=4.6,
    )
    _draw_sizes(by_size, ds)
    _draw_thresholds(by_threshold, detailed(ds))
    lettered(by_size, by_threshold)
    return figure


def _draw_sizes(axes, ds):
    sizes = ds.n_vertices.values
    shown = [population for population in map(str, ds.population.values) if population in PAPER_POPULATIONS]
    for place, population in enumerate(shown):
        values = by_size(ds.G_0.sel(population=population))
        fit, style = exponent(sizes, values), series(place)
        face = "none" if population == "max_G_0" else style["color"]
        style |= {"elinewidth": 0.8, "markersize": 4, "capsize": 1.5, "markerfacecolor": face}
        mean_bars(
            axes, sizes * (1 + 0.03 * (place - 2.5)), values, **style, label=f"{LABELS[population]}: {quoted(fit)}"
        )
    others = [population for population in shown if population != "max_G_0"]
    last = np.nanmean(ds.G_0.sel(population=others).isel(n_vertices=-1).values)
    axes.plot(sizes, last * sizes[-1] / sizes, color="0.5", linestyle=":", zorder=0)
    axes.text(0.03, 0.03, "dotted: $\\propto 1/N_v$", color="0.35", fontsize=9, transform=axes.transAxes)
    axes.set(yscale="log", ylabel="shear modulus $G_0$  [k]", title="by population")
    size_axis(axes, sizes)
    axes.legend(
        fontsize=9, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=1, handletextpad=0.2,
        labelspacing=0.2, title="exponent of the means [95 %]", title_fontsize=9,
    )  # fmt: skip


def _draw_thresholds(axes, ds):
    sizes = ds.n_vertices.values
    bound = float(ds.bound.mean())
    axes.axhline(bound, color="0.25", linestyle="--", linewidth=1.2)
    axes.text(0.02, 1.02 * bound, "bound for any sign", fontsize=9, transform=axes.get_yaxis_transform())
    # The three sizes of the paper, or the first three of the run.
    shown = [size for size in (100, 500, 1000) if size in sizes] or list(sizes[:3])
    for colour, style, size in zip(COLOURS[::2], STYLES, shown, strict=False):
        values = ds.G_0_of_threshold.sel(n_vertices=size)
        mean, width = values.mean("seed"), values.std("seed")
        axes.fill_between(ds.threshold, mean - width, mean + width, color=colour, alpha=0.2, linewidth=0)
        axes.plot(ds.threshold, mean, style, color=colour, linewidth=1.8, label=f"$N_v$ = {size:,}")
    axes.set(
        xscale="log", xlabel="least stress $r$  (mean square 1)", ylabel="largest $G_0$ with $\\sigma > r$  [k]",
        ylim=(0, 1.15 * bound if np.isfinite(bound) else None), title="by threshold",
    )  # fmt: skip
    axes.set_xticks([0.01, 0.03, 0.1, 0.3, 0.7], ["0.01", "0.03", "0.1", "0.3", "0.7"])
    axes.minorticks_off()
    axes.legend(fontsize=9, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), labelspacing=0.2)
    _draw_allowed(axes.inset_axes((0.22, 0.42, 0.36, 0.36)))


def _draw_allowed(axes):
    """The sphere of stresses of the three-bar linkage, seen along equal stresses, with those above r in green."""
    across = np.array([[-1, 1, 0], [-1, -1, 2]]) / np.sqrt([[2], [6]])
    turn = np.linspace(0, 2 * np.pi, 100)
    axes.fill(*np.sqrt(3) * np.array([np.cos(turn), np.sin(turn)]), facecolor="0.93", edgecolor="0.6", linewidth=0.8)
    axes.fill(*across @ allowed_region(0.0).T, facecolor="0.8", edgecolor="0.4", linewidth=0.8)
    axes.fill(*across @ allowed_region(EXAMPLE).T, facecolor=GREEN, edgecolor="none")
    for n, corner in enumerate(np.sqrt(3) * across.T):
        axes.annotate(f"$\\sigma_{n + 1}$", 1.5 * corner, ha="center", va="center", fontsize=9)
    axes.set_title(f"three bars: $\\sigma > r = {EXAMPLE}$", fontsize=9, pad=0)
    axes.set(xlim=(-2.4, 2.4), ylim=(-2.1, 2.5), aspect="equal")
    axes.axis("off")


def allowed_region(r):
    """Boundary (90, 3) of the stresses σ ≥ r of three edges on their sphere Σσ² = 3: an arc σ_i = r for each edge."""
    rest = np.sqrt(3 - r**2)
    angle = np.linspace(np.arcsin(r / rest), np.arccos(r / rest), 30)
    arc = np.stack([np.full(30, r), rest * np.cos(angle), rest * np.sin(angle)], axis=1)
    return np.concatenate([np.roll(arc, edge, axis=1) for edge in range(3)])
