"""Figure, animation, claims and summary of the unconstrained ascent, from its dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from critflow.figures.plot import COLOURS, COMPRESSED, draw_network
from critflow.result import Status
from critflow.workflow import Claim

from ..shared.reports import parameters, spread, status_counts

# Parts of the bound at which one network is drawn.
SHOWN = (0.1, 0.25, 0.6)
BLUE, GREEN, PURPLE = COLOURS[0], COLOURS[3], COLOURS[5]


def ascent_figure(ds):
    """Modulus, longest edge and least tension of the ascents, and one network at three steps."""
    figure = Figure(figsize=(11, 8.2), dpi=95, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.08))
    left, middle, right = top.subplots(1, 3)
    _draw_modulus(left, ds)
    _draw_extremes(middle, ds)
    _draw_compression(right, ds)
    for axes, letter in zip((left, middle, right), "ABC", strict=True):
        axes.set_xscale("log")
        axes.set_xlabel("step $s$ of the ascent (0 at the left edge)")
        axes.set_title(letter, loc="left", fontweight="bold")
        axes.spines["top"].set_visible(False)

    one = ds.isel(seed=0)
    for axes, letter, place in zip(bottom.subplots(1, 3), "DEF", _places(one), strict=True):
        _draw(axes, one.isel(step=place), width=0.9)
        value = float(one.shear_modulus[place])
        axes.set_title(
            f"{letter}   step {int(one.step[place])}: $G_0$ = {value:.2g} $k$, "
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
    _band(axes, ds.shear_modulus, BLUE)
    axes.set(ylabel="shear modulus $G_0$  [$k$]", ylim=(-0.005, 1.12 * bound))


def _draw_extremes(axes, ds):
    """The longest edge, and on a second axis the least tension."""
    _band(axes, ds.longest_edge, BLUE)
    axes.set(ylabel="longest edge / side of the box")
    axes.axhline(1.0, color="0.7", linewidth=0.8)
    axes.set_ylim(0, None)
    second = axes.twinx()
    _band(second, ds.least_tension, COMPRESSED)
    second.set(ylim=(-1.05, 1.05))
    second.set_ylabel("least / largest tension", color=COMPRESSED)
    second.tick_params(axis="y", colors=COMPRESSED)
    axes.yaxis.label.set_color(BLUE)
    axes.tick_params(axis="y", colors=BLUE)


def _draw_compression(axes, ds):
    """Number and total length of the compressed edges."""
    _band(axes, ds.compressed_edges / ds.sizes["edge"], PURPLE)
    _band(axes, ds.compressed_length / ds.sizes["vertex"], GREEN)
    least = float((ds.least_compressed_length / ds.sizes["vertex"]).mean())
    axes.axhline(least, color=GREEN, linewidth=1.0, linestyle="--")
    axes.text(0.55, least + 0.03, "least length that\nthe bound needs", fontsize=8.5, color=GREEN)
    axes.set(ylabel="under compression", ylim=(0, None))
    lines = [Line2D([], [], color=GREEN), Line2D([], [], color=PURPLE)]
    axes.legend(lines, ["total length / $N_v$", "part of the edges"], fontsize=8.5, frameon=False, loc="upper left")


def _on_log_axis(steps):
    """Steps with a finite place for the start on a logarithmic axis."""
    return np.maximum(steps.values, 0.5)


def animation(ds):
    """One network during the ascent, with its modulus."""
    one = ds.isel(seed=0)
    steps, moduli = _on_log_axis(one.step), one.shear_modulus.values
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
    x = one.coordinates.values.astype(float)
    tail, head = one.edges.values.T
    L = x[head] - x[tail] + one.offsets.values @ cell
    tension = sigma * np.linalg.norm(L, axis=1)
    limits = (0.0, float(np.percentile(np.abs(tension), 98)))
    draw_network(axes, one.edges.values, one.offsets.values, cell, x, tension, limits=limits, width=width)


def _places(one):
    """The first recorded steps beyond the drawn parts of the bound."""
    parts = one.shear_modulus.values / float(one.bound)
    return [int(np.argmax(parts >= part)) if parts.max() >= part else len(parts) - 1 for part in SHOWN]


def _band(axes, values, colour):
    """Median over networks, and the band of two thirds of them, against the step."""
    x = _on_log_axis(values.step)
    low, middle, high = np.nanquantile(values.transpose("seed", "step").values, (1 / 6, 0.5, 5 / 6), axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    axes.plot(x, middle, color=colour, linewidth=1.8)


def claims(ds):
    """The statements of the paper on the unconstrained ascent, tested on these ascents."""
    good = ds.isel(seed=np.isfinite(ds.bound.values))
    finished = good.isel(seed=np.isfinite(good.shear_modulus.isel(step=-1).values))
    last = finished.isel(step=-1)
    return [*_bound(good), *_extremes(last), *_onset(good), *_compression(good, last), _singular(ds, good, last)]


def _bound(good):
    yield Claim.tested(
        "ShearModulusSteepestDescent-A", "without constraints the shear modulus keeps rising to a finite value",
        "rises", f"from {spread(good.shear_modulus.isel(step=0))} to {spread(good.shear_modulus_end)} at the end, "
        f"{spread(100 * good.shear_modulus_end / good.bound, 3)} % of the bound",
        bool((good.shear_modulus_end > 100 * good.shear_modulus.isel(step=0)).mean() > 0.5),
        "so few steps do not lead far",
    )  # fmt: skip
    gap = float(np.abs(good.closed_form_gap).max())
    exceeded = good.shear_modulus > good.bound * (1 + 1e-9)
    satisfied = gap < 1e-9 and not bool(exceeded.any())
    yield Claim(
        "ShearModulusSteepestDescent-bound", "no stress of any sign has a larger G_0 than the closed form, which a "
        "configuration attains", "not stated", f"bound {spread(good.bound)}; attained to {gap:.0e}; exceeded by "
        f"{int(exceeded.sum())} of {good.shear_modulus.size} recorded steps",
        "measured" if satisfied else "differs", "" if satisfied else "some network lies above",
    )  # fmt: skip


def _extremes(last):
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-length", "the longest edge grows to about the side of the box",
        "≈ 1", f"median {float(last.longest_edge.median()):.2f}, two thirds within "
        f"{float(last.longest_edge.quantile(1 / 6)):.2f} to {float(last.longest_edge.quantile(5 / 6)):.2f}",
        bool(0.5 < float(last.longest_edge.median()) < 3),
        "the longest edges have another size",
    )  # fmt: skip
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-tension", "the strongest force ends as a compression in many networks "
        "(least over largest tension near −1)", "towards −1", spread(last.least_tension, 3),
        bool(float(last.least_tension.mean()) < -0.5), "compression stays weaker than tension",
    )  # fmt: skip


def _onset(good):
    """Where edges begin to grow and where compression begins, as steps."""
    grown = (good.longest_edge > 2 * good.longest_edge.isel(step=0)).values.argmax(axis=1)
    squeezed = (good.compressed_edges > 0).values.argmax(axis=1)
    apart = np.abs(grown - squeezed)
    yield Claim.tested(
        "ShearModulusSteepestDescent-B-onset", "edges begin to grow at the point where tensions turn negative",
        "same point", f"twice the first longest edge at step {_median(good.step.values[grown])}, first compression at "
        f"step {_median(good.step.values[squeezed])} (medians); {100 * np.mean(apart <= 3):.0f} % of the networks "
        "within three records", bool(np.mean(apart <= 3) > 0.5), "the two are apart",
    )  # fmt: skip


def _compression(good, last):
    n_vertices = good.sizes["vertex"]
    needed = float((good.least_compressed_length / n_vertices).mean())
    yield Claim.tested(
        "ShearModulusSteepestDescent-CE", "final configurations are tensegrities: compressed edges cannot be avoided",
        "compressed edges", f"{float(last.compressed_edges.median()):.0f} edges of total length "
        f"{float(last.compressed_length.median()) / n_vertices:.2f} N_v (medians); at the bound at least "
        f"{needed:.3f} N_v",
        needed > 0.1 and bool((last.compressed_edges > 0).all()), "no compression was needed",
    )  # fmt: skip


def _singular(ds, good, last):
    runaway = int((ds.status == Status.singular).sum())
    return Claim(
        "singular-prestress", "the ascent crosses stresses with a singular prestress matrix, and may end at one",
        "not stated", f"{spread(good.crossings, 3)} steps cross; {spread(good.negative_pivots, 3)} negative "
        f"eigenvalues at the end; {runaway} of {ds.sizes['seed']} ascents end at a singular matrix, where lengths "
        f"diverge and the modulus has a limit ({_limit(good)}); the others balance to "
        f"{float(last.residual.max()):.0e} at the last step", "measured",
    )  # fmt: skip


def summary(ds):
    """Scalars for tables: the ends of the ascents."""
    last = ds.isel(step=-1)
    names = [name for name, values in last.data_vars.items() if values.dims == ("seed",) and name != "status"]
    return {
        "networks": ds.sizes["seed"],
        "parameters": parameters(ds),
        "status": status_counts(ds.status.values),
        "end": {name: {"mean": last[name].mean(), "std": last[name].std(), "max": last[name].max()} for name in names},
    }


def _limit(good):
    part = (100 * good.shear_modulus_end / good.bound).where(good.status == Status.singular)
    return f"{spread(part, 3)} % of the bound" if np.isfinite(part).any() else "none here"


def _median(values):
    return f"{np.median(values):.0f}"
