"""The curvature of the three-bar linkage in closed form, and its figure.

On a line the signed lengths r_α ∝ 1/σ_α add up to the span D, so that every sheet is a level set of f = Σ ±√(2h) with
gradient 1/r and Hessian −1/r³.
"""

import numpy as np
from matplotlib.figure import Figure

from critflow.pictures import COLOURS

from .figures import CURVE, chart_lines, of_chart, span_of, title


def _closed_curvatures(r, normal, span):
    """Gaussian and mean curvature towards σ of the level set, each (...).

    K = D/((r₁r₂r₃)³(Σr⁻²)²) by the adjugate of the Hessian; 2H is the trace of η Hess f/|∇f| on the tangent plane, in
    pairs so that nothing cancels, with η = ±1 as σ points along ∇f or against it.
    """
    gradient = np.sum(r**-2.0, axis=-1)
    side = np.sign(np.sum(r * normal, axis=-1))
    trace = np.sum(r**-3.0 * (np.roll(r, 1, axis=-1) ** -2.0 + np.roll(r, -1, axis=-1) ** -2.0), axis=-1)
    return span / (np.prod(r, axis=-1) ** 3 * gradient**2), side * trace / gradient**1.5 / 2


def curvature_figure(ds):
    """Curvature over the chart and along a line in it."""
    figure = Figure(figsize=(11.6, 4.6), dpi=120, layout="constrained")
    left, right = figure.subfigures(1, 2, wspace=0.03)
    _draw_curvature(left, ds)
    _draw_cut(right.add_subplot(), ds)
    title(right, "B", "principal curvatures along s₂ = 0")
    return figure


def _draw_curvature(part, ds):
    """Logarithm of the Gaussian curvature over the chart in closed form, in one colour scale for each sign."""
    axes = part.add_subplot()
    fine = np.linspace(-2.1, 2.1, 421)
    s = np.stack(np.meshgrid(fine, fine), axis=-1)
    gauss = np.where(np.sum(s**2, axis=-1) < 4.1, _closed_on_chart(ds, s)[0] * span_of(ds) ** 4, np.nan)
    low, high = -3, 5
    for sign, name, colours in ((1, "elliptic, $c_1 c_2 > 0$", "Oranges"), (-1, "saddle, $c_1 c_2 < 0$", "Blues")):
        shown = np.where(sign * gauss > 0, np.log10(np.maximum(np.abs(gauss), 1e-300)), np.nan)
        mesh = axes.pcolormesh(s[..., 0], s[..., 1], shown, cmap=colours, vmin=low - 2, vmax=high)
        bar = part.colorbar(mesh, ax=axes, shrink=0.75, pad=0.02, extend="both")
        bar.ax.set_ylim(low, high)
        bar.set_label(f"{name}:  $\\log_{{10}} |c_1 c_2| D^4$", fontsize=9)
    chart_lines(axes, ds)
    axes.set(xlim=(-2.1, 2.1), ylim=(-2.1, 2.1), aspect="equal", xlabel="$s_1$", ylabel="$s_2$")
    title(part, "A", "Gaussian curvature: rigid is elliptic, a branch point a saddle")


def _closed_on_chart(ds, s):
    """Gaussian and mean curvature in closed form at points s (..., 2) of the chart."""
    span, sigma = span_of(ds), of_chart(ds, s)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _closed_curvatures(span / sigma / np.sum(1 / sigma, axis=-1, keepdims=True), sigma, span)


def _draw_cut(axes, ds):
    span, s_1 = span_of(ds), np.linspace(-2.1, 2.1, 4001)
    gauss, mean = _closed_on_chart(ds, np.stack([s_1, 0 * s_1], axis=-1))
    with np.errstate(invalid="ignore"):
        root = np.sqrt(np.maximum(mean**2 - gauss, 0))
    for sign in (1, -1):
        curve = (mean + sign * root) * span**2
        curve[1:][np.abs(np.diff(np.arcsinh(curve))) > 1] = np.nan
        axes.plot(s_1, curve, color="0.25", linewidth=1.0, zorder=2, label="closed form" if sign > 0 else None)
    for grid in ("chart", "middle"):
        one = ds.sel(grid=grid)
        row = one.isel(row=int(np.argmin(np.abs(one.s.values[:, 0, 1]))))
        for mode, colour, name in ((1, COLOURS[0], "$c_2$"), (0, COLOURS[2], "$c_1$")):
            axes.plot(
                row.s.values[:, 0], row.principal_curvature.values[:, mode] * span**2, "o", color=colour,
                markersize=3.8, zorder=3, label=name if grid == "chart" else None,
            )  # fmt: skip
    axes.axhline(0, color="0.6", linewidth=0.8, zorder=1)
    for circle in (np.sqrt(6) - np.sqrt(2)) * np.array([-1, 1]):
        axes.axvline(circle, color=CURVE, linewidth=2.2, zorder=1)
    axes.set_yscale("symlog", linthresh=1e-2, linscale=0.6)
    axes.set(xlim=(-2.1, 2.1), ylim=(-3e3, 3e3), xlabel="$s_1$", ylabel="principal curvatures  $c D^2$")
    axes.legend(fontsize=8.5, loc="lower right", frameon=True)
    axes.text(np.sqrt(2) - np.sqrt(6) + 0.04, -4e2, "P singular", color=CURVE, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
