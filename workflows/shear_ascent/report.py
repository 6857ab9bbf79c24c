"""Figure, animation, claims and summary of the unconstrained ascent, read off its dataset alone."""

from __future__ import annotations

import json

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from critflow.plot import COLOURS, COMPRESSED, draw_network
from critflow.result import Status
from critflow.workflow import Claim

# Parts of the bound at which one network is drawn.
SHOWN = (0.1, 0.25, 0.6)
BLUE, GREEN, PURPLE = COLOURS[0], COLOURS[3], COLOURS[5]


def ascent_figure(ds):
    """Modulus, longest edge and least tension along the ascents, and one network on its way."""
    figure = Figure(figsize=(11, 8.2), dpi=95, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.08))
    steps = np.maximum(ds.step.values, 0.5)  # the start has a place on a logarithmic axis
    left, middle, right = top.subplots(1, 3)

    left.axhline(float(ds.bound.mean()), color="0.25", linewidth=1.2, linestyle="--")
    left.text(0.55, float(ds.bound.mean()) * 1.015, "closed-form bound", fontsize=8.5, color="0.25")
    _band(left, steps, ds.shear_modulus, BLUE)
    left.set(ylabel="shear modulus $G_0$  [$k$]", ylim=(-0.005, 1.12 * float(ds.bound.mean())))

    _band(middle, steps, ds.longest_edge, BLUE)
    middle.set(ylabel="longest edge / side of the box")
    middle.axhline(1.0, color="0.7", linewidth=0.8)
    middle.set_ylim(0, None)
    other = middle.twinx()
    _band(other, steps, ds.least_tension, COMPRESSED)
    other.set(ylim=(-1.05, 1.05))
    other.set_ylabel("least / largest tension", color=COMPRESSED)
    other.tick_params(axis="y", colors=COMPRESSED)
    middle.yaxis.label.set_color(BLUE)
    middle.tick_params(axis="y", colors=BLUE)

    _band(right, steps, ds.compressed_edges / ds.sizes["edge"], PURPLE)
    _band(right, steps, ds.compressed_length / ds.sizes["vertex"], GREEN)
    least = float((ds.least_compressed_length / ds.sizes["vertex"]).mean())
    right.axhline(least, color=GREEN, linewidth=1.0, linestyle="--")
    right.text(0.55, least + 0.03, "least length that\nthe bound needs", fontsize=8.5, color=GREEN)
    right.set(ylabel="under compression", ylim=(0, None))
    lines = [Line2D([], [], color=GREEN), Line2D([], [], color=PURPLE)]
    right.legend(lines, ["total length / $N_v$", "part of the edges"], fontsize=8.5, frameon=False, loc="upper left")

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


def animation(ds):
    """One network on its way up, with its modulus."""
    one = ds.isel(seed=0)
    steps, moduli = np.maximum(one.step.values, 0.5), one.shear_modulus.values
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
    """Where on the way the drawn parts of the bound were first reached."""
    parts = one.shear_modulus.values / float(one.bound)
    return [int(np.argmax(parts >= part)) if parts.max() >= part else len(parts) - 1 for part in SHOWN]


def _band(axes, x, values, colour):
    """Median over networks, and the band that holds two thirds of them."""
    low, middle, high = np.nanquantile(values.transpose("seed", "step").values, (1 / 6, 0.5, 5 / 6), axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    axes.plot(x, middle, color=colour, linewidth=1.8)


def claims(ds):
    """What the paper says about the unconstrained ascent beside what these ascents say."""
    good = ds.isel(seed=np.isfinite(ds.bound.values))
    finished = good.isel(seed=np.isfinite(good.shear_modulus.isel(step=-1).values))
    last, runaway = finished.isel(step=-1), int((ds.status == Status.singular).sum())
    yield _claim(
        "ShearModulusSteepestDescent-A", "without constraints the shear modulus keeps rising to a finite value",
        "rises", f"from {_spread(good.shear_modulus.isel(step=0))} to {_spread(good.shear_modulus_end)} at the end, "
        f"{_spread(100 * good.shear_modulus_end / good.bound, 3)} % of the bound",
        bool((good.shear_modulus_end > 100 * good.shear_modulus.isel(step=0)).mean() > 0.5),
        "so few steps do not lead far",
    )  # fmt: skip
    gap = float(np.abs(good.closed_form_gap).max())
    yield _claim(
        "ShearModulusSteepestDescent-bound", "no stress of any sign has a larger G_0 than the closed form, which a "
        "configuration attains", "not stated", f"bound {_spread(good.bound)}; attained to {gap:.0e}; exceeded by "
        f"{int((good.shear_modulus > good.bound * (1 + 1e-9)).sum())} of {good.shear_modulus.size} recorded steps",
        gap < 1e-9 and not bool((good.shear_modulus > good.bound * (1 + 1e-9)).any()), "some network lies above",
    )  # fmt: skip
    yield _claim(
        "ShearModulusSteepestDescent-B-length", "the longest edge grows to about the side of the box",
        "≈ 1", f"median {float(last.longest_edge.median()):.2f}, two thirds within "
        f"{float(last.longest_edge.quantile(1 / 6)):.2f} to {float(last.longest_edge.quantile(5 / 6)):.2f}",
        bool(0.5 < float(last.longest_edge.median()) < 3),
        "the longest edges have another size",
    )  # fmt: skip
    yield _claim(
        "ShearModulusSteepestDescent-B-tension", "the strongest force ends as a compression in many networks "
        "(least over largest tension near −1)", "towards −1", _spread(last.least_tension, 3),
        bool(float(last.least_tension.mean()) < -0.5), "compression stays weaker than tension",
    )  # fmt: skip
    # Where edges begin to grow and where compression begins, as steps.
    grown = (good.longest_edge > 2 * good.longest_edge.isel(step=0)).values.argmax(axis=1)
    squeezed = (good.compressed_edges > 0).values.argmax(axis=1)
    apart = np.abs(grown - squeezed)
    yield _claim(
        "ShearModulusSteepestDescent-B-onset", "edges begin to grow at the point where tensions turn negative",
        "same point", f"twice the first longest edge at step {_median(good.step.values[grown])}, first compression at "
        f"step {_median(good.step.values[squeezed])} (medians); {100 * np.mean(apart <= 3):.0f} % of the networks "
        "within three records", bool(np.mean(apart <= 3) > 0.5), "the two are apart",
    )  # fmt: skip
    needed = float((good.least_compressed_length / ds.sizes["vertex"]).mean())
    yield _claim(
        "ShearModulusSteepestDescent-CE", "final configurations are tensegrities: compressed edges cannot be avoided",
        "compressed edges", f"{float(last.compressed_edges.median()):.0f} edges of total length "
        f"{float(last.compressed_length.median()) / ds.sizes['vertex']:.2f} N_v (medians); at the bound at least "
        f"{needed:.3f} N_v",
        needed > 0.1 and bool((last.compressed_edges > 0).all()), "no compression was needed",
    )  # fmt: skip
    yield _claim(
        "singular-prestress", "the way crosses stresses whose prestress matrix is singular, and may end at one",
        "not stated", f"{_spread(good.crossings, 3)} steps cross; {_spread(good.negative_pivots, 3)} negative "
        f"eigenvalues at the end; {runaway} of {ds.sizes['seed']} ascents end at a singular matrix, where lengths grow "
        f"without end and the modulus has a limit ({_limit(good)}); the others balance to "
        f"{float(last.residual.max()):.0e} at the last step", True, "",
    )  # fmt: skip


def summary(ds):
    """Scalars for tables: the ends of the ascents."""
    last = ds.isel(step=-1)
    names = [name for name, values in last.data_vars.items() if values.dims == ("seed",) and name != "status"]
    codes, counts = np.unique(ds.status.values, return_counts=True)
    return {
        "networks": ds.sizes["seed"],
        "parameters": json.loads(ds.attrs["parameters"]),
        "status": {Status(int(code)).name: int(count) for code, count in zip(codes, counts, strict=True)},
        "end": {name: {"mean": last[name].mean(), "std": last[name].std(), "max": last[name].max()} for name in names},
    }


def _claim(key, statement, paper, value, holds, because):
    if paper == "not stated" and holds:
        return Claim(key, statement, paper, value, "measured")
    return Claim(key, statement, paper, value, "holds" if holds else "differs", "" if holds else because)


def _limit(good):
    part = (100 * good.shear_modulus_end / good.bound).where(good.status == Status.singular)
    return f"{_spread(part, 3)} % of the bound" if np.isfinite(part).any() else "none here"


def _spread(values, digits=4):
    return f"{float(values.mean()):.{digits}g} ± {float(values.std()):.1g}"


def _median(values):
    return f"{np.median(values):.0f}"
