"""Figures of local responses: capacity, untrained and trained responses, one network at rest and in motion."""

import numpy as np
from critflow.studies.shared.figures import counted, legend_below, lettered, panels
from critflow.studies.shared.populations import LABELS, PAPER_POPULATIONS
from critflow.studies.shared.reports import half_point, parameters, series
from matplotlib.collections import LineCollection
from matplotlib.ticker import LogLocator

from critflow.pictures import periodic_segments
from critflow_extras.local.drawing import add_response, response_legend

from ..shared.parts import NARROW
from .measurements import BINS, KINDS, LIMITED, N_SOURCES, REACHED, STRESSES, STYLES

LOST = 0.1  # error of a response that is lost
FRAMES, SWING = 16, 0.25  # of the movie, and the largest strain of its source


def success(ds):
    """Part of the networks whose designs have all goals, (size, fraction, kind)."""
    return (ds.error < REACHED).mean("seed").values


def thresholds(ds):
    """Conditions over N_b − 1 at which half of the networks have their goals, (size, kind); NaN beyond the range."""
    part, fractions = success(ds), np.array(parameters(ds)["fractions"])
    found = np.full((part.shape[0], len(KINDS)), np.nan)
    for s, k in np.ndindex(*found.shape):
        found[s, k] = half_point(fractions, np.minimum.accumulate(part[s, :, k]))
    return found


def capacity_figure(ds):
    """Success against the number of conditions, and the threshold against size."""
    figure, (left, right) = panels(
        2,
        "The larger a network, the more conditions it meets, but the smaller their part of $N_b - 1$\n"
        f"({N_SOURCES} sources; signs: responses ±1, amplitudes: any between; {counted(ds)} a size)",
        height=4.2,
    )
    fractions, sizes = np.array(parameters(ds)["fractions"]), np.array(parameters(ds)["sizes"])
    part, threshold = success(ds), thresholds(ds)
    for s, size in enumerate(sizes):
        for k, kind in enumerate(KINDS):
            style = {**series(s), "ls": ("-", ":")[k], "label": f"$N_v$ = {size}, {kind}"}
            left.plot(fractions, part[s, :, k], ms=4, **style)
    left.set(xlabel="conditions over $N_b - 1$", ylabel="part of the networks with all goals", ylim=(-0.03, 1.05))
    for k, kind in enumerate(KINDS):
        right.plot(sizes, threshold[:, k] * (1.5 * sizes - 1), ms=5, **series(k), label=f"half succeed, {kind}")
    right.plot(sizes, 1.5 * sizes - 1, "k--", lw=0.8)
    right.text(sizes[-1], 1.5 * sizes[-1], "$N_b - 1$", ha="right", va="bottom", fontsize=9)
    right.plot(sizes, 0.5 * sizes - 1, "k:", lw=0.8)
    right.text(sizes[-1], 0.25 * sizes[-1], "all faces, one source", ha="right", va="top", fontsize=9)
    right.set(xlabel="number of vertices $N_v$", ylabel="number of conditions", xlim=(0, None), ylim=(0, None))
    right.legend(frameon=False, fontsize=9)
    legend_below(figure, left, ncols=3)
    lettered(left, right)
    return figure


def response_figure(ds):
    """Untrained responses by distance; deviations of trained ones by stress."""
    figure, (left, right) = panels(
        2,
        "Untrained responses fall with the distance; trained ones are ±1 at their stress\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices, medians; random ℓ: s = {NARROW['spread']:g})",
        height=4.4,
    )
    middles = 0.5 * (BINS[1:] + BINS[:-1])
    for n, population in enumerate(PAPER_POPULATIONS):
        left.semilogy(middles, ds.typical[:, n].mean("seed"), ms=4, **series(n), label=LABELS[population])
    left.set(xlabel="distance [$\\sqrt{V/N_v}$]", ylabel="median |η|", title="untrained")
    left.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    left.yaxis.set_minor_formatter("{x:g}")
    left.yaxis.set_major_formatter("{x:g}")
    low, high = left.get_ylim()
    left.set_ylim(low * (low / high) ** 0.8, high)  # room for the names
    left.legend(frameon=False, fontsize=8, ncols=2, loc="lower center", columnspacing=0.6, handlelength=1)
    loads = parameters(ds)["loads"]
    for s, style in enumerate(STYLES):
        for n in sorted({len(loads) // 3, len(loads) - 1}):
            text = {"free": "", "limited": f", σ > {LIMITED:g}⟨σ⟩", "stressed": ", for t = $10^{-3}$ k"}[style]
            kind = {**series(n), "ls": ("-", ":", "--")[s], "label": f"{loads[n]:.0%} of the faces{text}", "ms": 4}
            reached = (ds.trained_error[:, s, n] < REACHED).values
            if len(rows := ds.past_error[:, s, n].values[reached]):
                right.loglog(STRESSES, np.median(rows, axis=0), **kind)
    right.axhline(LOST, color="0.7", lw=0.8)
    right.set(xlabel="stress t  [k]", ylabel="largest deviation from ±1", title="trained, under stress; grey: lost")
    legend_below(figure, right, ncols=2)
    lettered(left, right)
    return figure


def network_figure(ds):
    """One network before and after training: widths by tension, displacements, source and targets."""
    figure, axes = panels(
        2,
        "A design makes eight targets grow or shrink by as large a part as their source\n"
        "(in the stiffest network they change less)",
        height=4.4,
    )
    one = ds.isel(seed=0)
    for n, (ax, title) in enumerate(zip(axes, ("stiffest network", "trained"), strict=True)):
        draw_stage(ax, one, n)
        ax.set_title(title)
    lettered(*axes)
    figure.legend(handles=response_legend(), frameon=False, ncols=3, fontsize=9, loc="outside lower center")
    return figure


def draw_stage(axes, one, n, strain=0.0):
    """The network before (0) or after training (1) at a strain of the source, its source, targets and motion.

    Arrows are drawn at no strain alone, where nothing moves.
    """
    x, u, L = one.places.values[n], one.moves.values[n], one.bonds.values[n]
    cell, edges = one.cell.values, one.edges.values
    x, L = x + strain * u, L + strain * (u[edges[:, 1]] - u[edges[:, 0]])
    offsets = np.round((L - x[edges[:, 1]] + x[edges[:, 0]]) @ np.linalg.inv(cell)).astype(int)
    lines, owner = periodic_segments(edges, offsets, cell, x)
    tension = one.stress.values[n] * np.linalg.norm(L, axis=1)
    axes.add_collection(LineCollection(list(lines), linewidths=(0.4 + tension / tension.mean())[owner], colors="0.7"))
    shown = one.shown.values.astype(int)
    shown = shown[shown[:, 0] >= 0]
    ends, images = shown[:, :2], shown[:, 2:]
    r = x[ends[:, 1]] - x[ends[:, 0]] + images @ cell
    strains = np.sum((u[ends[:, 1]] - u[ends[:, 0]]) * r, axis=1) / np.sum(r**2, axis=1)
    add_response(axes, cell, x, u if strain == 0 else np.zeros_like(u), ends, images, strains)


def movie(ds):
    """The stiffest and the trained network while the source opens and closes: frames of one period."""
    one = ds.isel(seed=0)
    for phase in np.linspace(0, 2 * np.pi, FRAMES, endpoint=False):
        figure, axes = panels(2, f"The source opens and closes by {SWING:.0%}", height=4.6)
        for n, (ax, title) in enumerate(zip(axes, ("stiffest network", "trained"), strict=True)):
            draw_stage(ax, one, n, SWING * np.sin(phase))
            ax.set_title(title)
        figure.legend(handles=response_legend()[:3], frameon=False, ncols=3, fontsize=9, loc="outside lower center")
        figure.set(size_inches=(7.2, 4.2), dpi=72)
        yield figure
