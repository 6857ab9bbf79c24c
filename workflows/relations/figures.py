"""Figures of the relations."""

import numpy as np

from critflow.pictures import COLOURS

from ..shared.figures import TEXT, counted, legend_below, lettered, page, panels, points_at, readable
from ..shared.populations import LABELS, POPULATIONS
from ..shared.reports import MARKERS, finite, series
from .medium import NAMES, gap_of_law
from .report import FEW, mean_and_error, of_known_histogram, paid


def medium_figure(ds):
    """|L|² against σ of all laws on the one curve of the theory, and gaps of B_0 against the prediction."""
    title = f"Effective-medium theory gives $B_0$ of independent random stresses without a parameter\n({counted(ds)})"
    figure, (curve, gaps) = panels(2, title, 3.4)
    x = np.geomspace(ds.bin.values.min() / 1.3, ds.bin.values.max() * 1.3, 200)
    curve.plot(x, 1 / (x + 0.5) ** 2, color="k", linewidth=1, label="theory")
    line = np.array([0.04, 1.8])
    gaps.plot(line, line, color="k", linewidth=1)
    for n, law in enumerate(str(one) for one in ds.law.values):
        of_law = ds.sel(law=law)
        count = of_law.square_count.sum("seed")
        ratio = (of_law.square_ratio * of_law.square_count).sum("seed") / count.where(count >= FEW)
        style = {**series(n), "linestyle": "none", "markersize": 4}
        curve.plot(ds.bin, ratio / (ds.bin + 0.5) ** 2, label=NAMES[law], **style)
        for name, coordination, face in (("law_gap", 3, None), ("space_gap", 4, "none")):
            mean, error = mean_and_error(of_law[name])
            gaps.errorbar(gap_of_law(law, coordination), mean, error, **style, markerfacecolor=face or style["color"])
    for face, label in (("0.3", "plane, z = 3"), ("none", "space, z = 4")):
        gaps.plot([], [], "o", color="0.3", markerfacecolor=face, markersize=4, label=label)
    gaps.legend(fontsize=TEXT, frameon=False, loc="upper left")
    curve.set(
        xscale="log", yscale="log", xlabel="stress over that of the medium, $σ/m$",
        ylabel="$⟨|L|^2 \\, | \\, σ⟩$, in the unit of the theory", title="squared length",
    )  # fmt: skip
    gaps.set(
        xscale="log",
        yscale="log",
        xlabel="theory",
        ylabel="measured",
        title="$\\max B_0/B_0 - 1$",
        xlim=line,
        ylim=line,
    )
    for axis in (gaps.xaxis, gaps.yaxis):
        axis.set_ticks([0.05, 0.1, 0.2, 0.5, 1.0], ["0.05", "0.1", "0.2", "0.5", "1"])
        axis.set_ticks([], minor=True)
    lettered(curve, gaps)
    legend_below(figure, curve, ncols=4)
    return figure


def histogram_figure(ds):
    """The gap of each population, of its shuffled stresses, and of its histogram by the theory."""
    gaps = of_known_histogram(ds)
    shown = [p for p in map(str, ds.population.values) if p != "max_B_0" and gaps.gap.sel(population=p).notnull().any()]
    figure = page(0.5 * len(shown) + 1.6, f"$B_0$ is no function of the histogram of the stresses ({counted(ds)})")
    axes = figure.subplots()
    kinds = {"medium_gap": "theory of the histogram", "shuffled_gap": "stresses shuffled", "gap": "as it is"}
    for row, population in enumerate(shown):
        means = []
        for n, (name, label) in enumerate(kinds.items()):
            mean, error = mean_and_error(gaps[name].sel(population=population))
            means.append(mean)
            style = {"marker": "|sD"[n], "markersize": (16, 6, 6)[n], "color": ("k", COLOURS[0], COLOURS[1])[n]}
            if n == 1:
                style["markerfacecolor"] = "none"
            axes.errorbar(
                100 * mean, row, xerr=100 * error, **style, linestyle="none", label="" if row else label, zorder=3 - n
            )
        axes.plot(100 * np.array([means[0], means[2]]), [row, row], color="0.8", linewidth=3, zorder=0)
    axes.set_yticks(range(len(shown)), [LABELS[p] for p in shown])
    axes.set(xlabel="largest $B_0$ above that of the network [%]", xlim=(0, None), ylim=(len(shown) - 0.5, -0.5))
    readable(axes)
    legend_below(figure, axes, ncols=3)
    return figure


def growth_figure(ds):
    """C_G over its bound by population: as the networks are, and where G_0 = 0."""
    figure, (standing, isotropic) = panels(
        2,
        f"Under tension, where $G_0 = 0$, the shear modulus grows at least as $B_0 \\, γ$ ({counted(ds)})",
        3.2,
        sharey=True,
    )
    shown = [p for p in map(str, ds.population.values) if np.isfinite(ds.isotropic_ratio.sel(population=p)).any()]
    panel = {standing: ds.C_G_mean / ds.C_G_bound, isotropic: ds.isotropic_ratio}
    for axes, ratio in panel.items():
        axes.axhline(1.0, color="#C00000", linewidth=1.0, zorder=0)
        for place, population in enumerate(shown):
            values = finite(ratio.sel(population=population))
            points_at(axes, place, values[values > 0], POPULATIONS[population].colour)
        names = [LABELS[p] for p in shown]
        axes.set_xticks(range(len(shown)), names, rotation=35, ha="right", rotation_mode="anchor")
        axes.set(yscale="log", xlim=(-0.6, len(shown) - 0.4))
    ticks = [1, 1.2, 1.5, 2, 3, 4]
    standing.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    standing.set_yticks([], minor=True)
    standing.set(
        ylabel="mean $C_G$ of both shears over its bound", title="as they are: bound of any $G_0$", ylim=(0.95, None)
    )
    isotropic.set(title="affine images in which $G_0 = 0$: bound $B_0$")
    lettered(standing, isotropic)
    return figure


def pairs_figure(ds):
    """Densities of the shares by population, and growth against its bound by missing stiffness."""
    figure, (spectrum, growth) = panels(
        2, f"Shares of length and tension come in pairs; missing stiffness is paid in growth ({counted(ds)})", 3.4
    )
    edges = np.linspace(0, 1, 41)
    inner = slice(1, ds.sizes["edge"] * 2 // 3 + 1)  # without the scale of the stress and the isogonal modes
    line = np.array([1e-3, 1e2])
    growth.plot(line, line, color="#C00000", linewidth=1)
    for n, population in enumerate(map(str, ds.population.values)):
        one, colour = ds.sel(population=population), POPULATIONS[population].colour
        shares = one.shares.transpose("seed", "edge").values[:, inner]
        if np.isfinite(shares).any():
            density, _ = np.histogram(finite(shares.ravel()), edges, density=True)
            spectrum.stairs(density, edges, color=colour, linewidth=1.3, label=LABELS[population])
        bound = (one.missing_stiffness_C_B + 0.5 * one.B_0) / one.B_0
        marker = MARKERS[n % len(MARKERS)]
        growth.plot(bound, bound / paid(one), marker, color=colour, markersize=4, alpha=0.7, markeredgewidth=0)
    spectrum.axvline(0.5, color="0.4", linestyle=":", linewidth=1)
    spectrum.set(xlabel="share $λ$ of the lengths, $1 - λ$ of the tensions", ylabel="density of modes", xlim=(0, 1))
    spectrum.set_title("symmetric about ½; at 1 isogonal modes, left out")
    growth.set(
        xscale="log", yscale="log", xlabel="its bound by the missing stiffness", ylabel="$(C_B + B_0/2)/B_0$",
        title="growth of $B$ above the least possible", xlim=(1e-2, 20), ylim=(1e-2, 20),
    )  # fmt: skip
    lettered(spectrum, growth)
    legend_below(figure, spectrum, ncols=6)
    return figure
