"""Figures of the critical manifold of the three-bar linkage and of its chart, from the dataset alone."""

import numpy as np
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d import proj3d
from scipy.interpolate import RectBivariateSpline

from critflow.pictures import COLOURS, COMPRESSED

from ..shared.figures import heading, page, readable
from ..shared.reports import parameters
from .surfaces import clipped_polygons, draw_surfaces, surface_quads

ORANGE, PURPLE, GREY, CURVE = "#E69F00", "#8E5BB5", "#A9A9A9", "#C00000"
FAMILIES = {"stretched": ORANGE, "folded": PURPLE, "branch": GREY}
# Largest squared length that is drawn, in squared spans; the sheets are unbounded.
BOX = 2.6
# Arrows cover each other near the cusps, where a component of the unit stress is less than this.
_APART = 0.1


def family(grid):
    """Which kind of sheet a grid follows."""
    return str(grid).split("_")[0]


def span_of(ds):
    return float(parameters(ds)["span"])


def manifold_figure(ds):
    """`3-barlinkage`: examples, stresses on the sphere and in the chart, the manifold, and its rigid part."""
    figure = Figure(figsize=(12.6, 9.6), dpi=120, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.03, h_pad=0.07, wspace=0.02, hspace=0.02)
    top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.3))
    left, middle, right = top.subfigures(1, 3, width_ratios=(1.3, 0.95, 1.1))
    _draw_examples(left, ds)
    _draw_sphere(middle.add_subplot(projection="3d"), ds)
    _draw_chart(right.add_subplot(), ds)
    whole, rigid = bottom.subfigures(1, 2)
    _draw_manifold(whole.add_subplot(projection="3d"), ds, FAMILIES)
    _draw_manifold(rigid.add_subplot(projection="3d"), ds, ("stretched", "folded"))
    title(middle, "D", "all stresses, of any magnitude")
    title(right, "E", "the same in the chart about equal stresses")
    title(whole, "F", "critical manifold: all its sheets")
    title(rigid, "G", "its rigid sheets bound the compatible lengths")
    return figure


def title(part, letter, text):
    part.suptitle(f"$\\bf{{{letter}}}$   {text}", fontsize=10.5, x=0.02, ha="left")


def _draw_examples(part, ds):
    """Linkages on their pins; edges of a line are set apart, and motions that keep all lengths are ghosts."""
    texts = {
        "stretched": "$\\bf{A}$   rigid: every edge under tension",
        "folded": "$\\bf{B}$   rigid: one long edge compressed",
        "branch": "$\\bf{C}$   branch point: two motions cross",
        "floppy": "off the manifold: no self-stress, floppy",
    }
    span = span_of(ds)
    for axes, name in zip(part.subplots(4, 1), texts, strict=True):
        one = ds.isel(example=list(texts).index(name))
        x, motion = one.example_position.values / span, one.example_motion.values / span
        for frame in motion[np.isfinite(motion[:, 0, 0])]:
            axes.plot(*frame.T, color="0.8", linewidth=1.0, marker="o", markersize=2.5, zorder=1)
        sigma = one.example_sigma.values
        line = np.isfinite(sigma).all()
        # Edges on top of each other are drawn next to each other.
        shifts = 0.05 * np.array([-1, 0, 1]) if line and name != "stretched" else np.zeros(3)
        for edge, shift in enumerate(shifts):
            compressed = line and sigma[edge] * sigma.sum() < 0
            axes.plot(
                x[edge : edge + 2, 0], x[edge : edge + 2, 1] + shift, linewidth=3, solid_capstyle="butt", zorder=2,
                color="0.45" if not line else COMPRESSED if compressed else COLOURS[0],
                linestyle=(0, (1.8, 0.8)) if compressed else "-",
            )  # fmt: skip
        for vertex in (1, 2):
            ends = x[vertex, 1] + shifts[vertex - 1 : vertex + 1]
            axes.plot([x[vertex, 0]] * 2, ends, "o-", color="k", markersize=4.5, linewidth=1.4, zorder=3)
        axes.plot(x[[0, 3], 0], [0, 0], "s", color="k", markersize=8, zorder=4)
        axes.set(xlim=(-0.35, 1.55), ylim=(-0.26, 0.36), aspect="equal")
        axes.set_title(texts[name], loc="left", fontsize=10, pad=1)
        axes.add_patch(
            Rectangle((0, 0.08), 0.018, 0.84, transform=axes.transAxes, facecolor={**FAMILIES, "floppy": "w"}[name])
        )
        axes.set_axis_off()
    handles = [
        axes.plot([], [], color=COLOURS[0], linewidth=3, label="tension")[0],
        axes.plot([], [], color=COMPRESSED, linewidth=3, linestyle=(0, (1.8, 0.8)), label="compression")[0],
        axes.plot([], [], color="0.8", linewidth=1.5, label="same lengths, moved")[0],
    ]
    part.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False, handlelength=1.8)


def _fields(ds):
    """Stresses and the smaller prestress eigenvalue as smooth functions of the chart coordinates (s_1, s_2)."""
    chart = ds.sel(grid="chart")
    nodes = chart.s.values[0, :, 0]

    def spline(values):
        return RectBivariateSpline(nodes, nodes, values.T)

    return [spline(chart.normal.values[..., k]) for k in range(3)], spline(chart.prestress_eigenvalue.values[..., 0])


def _regions(ds, s_1, s_2):
    """0, 1 or 2 (stretched, folded, branch) at chart coordinates, from the inertia and signs that the chart stores."""
    sigma, eigenvalue = _fields(ds)
    positive = np.min([spline.ev(s_1, s_2) for spline in sigma], axis=0) > 0
    return np.where(eigenvalue.ev(s_1, s_2) < 0, 2, np.where(positive, 0, 1))


def frame(ds):
    """Pole and basis of the chart."""
    basis = ds.basis.values
    pole = np.cross(basis[:, 0], basis[:, 1])
    return pole * np.sign(pole.sum()), basis


def to_chart(ds, sigma):
    """Chart coordinates (..., 2) of stresses (..., 3), of the nearer of both signs."""
    pole, basis = frame(ds)
    unit = sigma / np.linalg.norm(sigma, axis=-1, keepdims=True)
    unit = unit * np.where(unit @ pole < 0, -1, 1)[..., None]
    return 2 * (unit @ basis) / (1 + unit @ pole)[..., None]


def of_chart(ds, s):
    """Unit stresses (..., 3) of chart coordinates (..., 2)."""
    pole, basis = frame(ds)
    quarter = np.sum(s**2, axis=-1, keepdims=True) / 4
    return (s @ basis.T + (1 - quarter) * pole) / (1 + quarter)


def singular_circle(ds):
    """Unit stresses (361, 3) where the prestress matrix is singular: at 1/√3 of the pole."""
    pole, basis = frame(ds)
    turn = np.linspace(0, 2 * np.pi, 361)[:, None]
    return pole / np.sqrt(3) + np.sqrt(2 / 3) * (np.cos(turn) * basis[:, 0] + np.sin(turn) * basis[:, 1])


def sign_changes(n=181):
    """Unit stresses (3, n, 3) where one of the three vanishes."""
    turn = np.linspace(0, 2 * np.pi, n)
    circle = np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=1)
    return np.stack([np.roll(circle, k, axis=1) for k in range(3)])


def _draw_sphere(axes, ds):
    view = np.array([1.0, 0.62, 0.5])
    azimuth, height = np.meshgrid(np.linspace(0, 2 * np.pi, 241), np.linspace(0, np.pi, 121))
    sigma = np.stack([np.sin(height) * np.cos(azimuth), np.sin(height) * np.sin(azimuth), np.cos(height)], axis=-1)
    centre = (sigma[:-1, :-1] + sigma[1:, 1:]) / 2
    s = to_chart(ds, centre)
    region = _regions(ds, s[..., 0], s[..., 1]).ravel()
    quads = surface_quads(sigma)
    facing = quads.mean(axis=1) @ view > -0.1
    draw_surfaces(
        axes, [(quads[facing & (region == k)], colour, 1.0) for k, colour in enumerate(FAMILIES.values())], light=view
    )
    for circle in (singular_circle(ds), -singular_circle(ds)):
        _seen(axes, circle, view, color=CURVE, linewidth=2.2)
    for circle in sign_changes():
        _seen(axes, circle, view, color="k", linewidth=0.7)
    for k, end in enumerate(np.eye(3), 1):
        axes.plot(*np.stack([1.02 * end, 1.35 * end], axis=1), color="k", linewidth=1.0, zorder=20)
        axes.text(*(1.5 * end), f"$\\sigma_{k}$", ha="center", va="center", fontsize=11, zorder=21)
    for name, letter in zip(FAMILIES, "ABC", strict=True):
        unit = _example(ds, name)
        unit = unit if unit @ view > 0 else -unit
        axes.text(*(1.04 * unit), letter, fontsize=10, fontweight="bold", ha="center", va="center", zorder=30)
    axes.set(xlim=(-0.9, 0.9), ylim=(-0.9, 0.9), zlim=(-0.85, 0.95), aspect="equal")
    axes.view_init(
        elev=np.degrees(np.arcsin(view[2] / np.linalg.norm(view))), azim=np.degrees(np.arctan2(*view[1::-1]))
    )
    axes.set_axis_off()


def _seen(axes, curve, view, **style):
    """The part of a curve on the unit sphere that is not behind it."""
    shown = np.where((curve @ view > -0.02)[:, None], 1.006 * curve, np.nan)
    axes.plot(*shown.T, zorder=10, **style)


def _example(ds, name):
    """Unit stress of an example, on the side of positive sums."""
    sigma = ds.example_sigma.values[list(FAMILIES).index(name)]
    return sigma / np.linalg.norm(sigma) * np.sign(sigma.sum())


def _draw_chart(axes, ds):
    _paint_chart(axes, ds)
    for name, letter in zip(FAMILIES, "ABC", strict=True):
        axes.text(*to_chart(ds, _example(ds, name)), letter, fontsize=10, fontweight="bold", ha="center", va="center")
    for k in range(3):
        at = to_chart(ds, np.eye(3)[k])
        axes.plot(*at, "o", color="k", markersize=3.5, zorder=5)
        axes.annotate(
            f"$\\sigma_{k + 1}$", at, 1.25 * at, fontsize=8.5, ha="center", va="center", zorder=6,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "w", "edgecolor": "none", "alpha": 0.8},
        )  # fmt: skip
    handles = [
        axes.plot([], [], "s", color=ORANGE, markersize=9, label="rigid, stretched")[0],
        axes.plot([], [], "s", color=PURPLE, markersize=9, label="rigid, folded")[0],
        axes.plot([], [], "s", color=GREY, markersize=9, label="branch points")[0],
        axes.plot([], [], color=CURVE, linewidth=2.2, label="P singular: no configuration")[0],
    ]
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=8, frameon=False,
        columnspacing=1.0, handletextpad=0.4,
    )  # fmt: skip


def chart_lines(axes, ds):
    """Where a stress vanishes (black) and where the prestress matrix is singular (red), in the chart."""
    for circle in sign_changes(721):
        s = to_chart(ds, circle)
        s[np.linalg.norm(s, axis=1) > 1.995] = np.nan
        axes.plot(*s.T, color="k", linewidth=0.7)
    axes.plot(*to_chart(ds, singular_circle(ds)).T, color=CURVE, linewidth=2.2)


def _paint_chart(axes, ds, alpha=1.0):
    fine = np.linspace(-2.02, 2.02, 600)
    s_1, s_2 = np.meshgrid(fine, fine)
    region = _regions(ds, s_1, s_2).astype(float)
    region[s_1**2 + s_2**2 > 4] = np.nan
    axes.imshow(
        region, extent=(-2.02, 2.02, -2.02, 2.02), origin="lower", cmap=ListedColormap(list(FAMILIES.values())), vmin=0,
        vmax=2, alpha=alpha, interpolation="nearest",
    )  # fmt: skip
    chart_lines(axes, ds)
    turn = np.linspace(0, 2 * np.pi, 361)
    axes.plot(2 * np.cos(turn), 2 * np.sin(turn), color="0.4", linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set(
        xlim=(-2.06, 2.06),
        ylim=(-2.06, 2.06),
        aspect="equal",
        xlabel="$s_1$",
        ylabel="$s_2$",
        xticks=range(-2, 3),
        yticks=range(-2, 3),
    )
    axes.spines[["top", "right"]].set_visible(False)


def _sheets(ds, families, box=BOX):
    """Polygons of squared lengths, in squared spans, of the sheets of some families."""
    for grid in ds.grid.values:
        if family(grid) in families:
            squares = (ds.length.sel(grid=grid).values / span_of(ds)) ** 2
            yield family(grid), clipped_polygons(surface_quads(squares), box)


def _draw_manifold(axes, ds, families):
    opacity = {"stretched": 1.0, "folded": 1.0, "branch": 0.38}
    draw_surfaces(axes, [(polygons, FAMILIES[kind], opacity[kind]) for kind, polygons in _sheets(ds, families)])
    for name, letter in zip(FAMILIES, "ABC", strict=True):
        if name in families:
            x = ds.example_position.values[list(FAMILIES).index(name), :, 0]
            at = (np.diff(x) / span_of(ds)) ** 2
            axes.plot(*at[:, None], "o", color="k", markersize=4, zorder=30)
            axes.text(*(at + 0.12), letter, fontsize=10, fontweight="bold", zorder=31)
    _box(axes)
    if "branch" not in families:
        _note(axes, (0.3, 1.9, 1.35), (0.3, 1.9, 1.35), "in front, compatible\nwith the pins: floppy", COLOURS[3])
        _note(axes, (0.02, 0.02, 0.5), (1.75, 0.3, 1.75), "behind: all edges\nare too short", CURVE)
        _note(axes, (0.0, 0.0, 2.45), (0.0, 1.75, 2.5), "within: one edge\nis too long", CURVE)


def _note(axes, point, place, text, colour):
    """A note at a place in space about a point, with an arrow where they differ."""
    (x, y), (u, v) = (proj3d.proj_transform(*at, axes.get_proj())[:2] for at in (point, place))
    arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.2} if point != place else None
    axes.annotate(
        text, (x, y), (u, v), fontsize=9.5, color=colour, ha="center", va="center", arrowprops=arrow, zorder=40,
        bbox={"boxstyle": "round,pad=0.25", "facecolor": "w", "edgecolor": colour, "alpha": 0.9},
    )  # fmt: skip


def _box(axes, box=BOX):
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_ticks([tick for tick in (0, 0.5, 1, 2) if tick < box and (box < 2 or tick != 0.5)])
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
    labels = {f"{axis}label": f"$L_{k}^2/D^2$" for k, axis in enumerate("xyz", 1)}
    axes.set(xlim=(0, box), ylim=(0, box), zlim=(0, box), aspect="equal", **labels)
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90)
    axes.tick_params(labelsize=8, pad=0)
    axes.view_init(elev=24, azim=38)


def stretched(ds, s):
    """Unit stresses and squared lengths, in squared spans, (..., 3) of stretched bars at chart coordinates (..., 2).

    The force is the same in all bars, r_α ∝ 1/σ_α, and their lengths add up to the span; NaN where one is compressed.
    """
    sigma = of_chart(ds, s)
    sigma = np.where(sigma.min(axis=-1, keepdims=True) > 0, sigma, np.nan)
    return sigma, (1 / sigma / np.sum(1 / sigma, axis=-1, keepdims=True)) ** 2


def grid_lines(across):
    """Lines (2001, 2) of one constant chart coordinate, from border to border of the chart."""
    for constant in 0.1 * np.arange(-12, 13):
        line = np.stack([np.full(2001, constant), np.linspace(-1.2, 1.2, 2001)], axis=1)
        yield line if across == 0 else line[:, ::-1]


def geometry_figure(ds):
    """`CriticalManifoldGeometry`: even grid lines of the chart on the stretched sheet, and the stress normal to it."""
    figure = page(4.7, "The stress is normal to the critical manifold: stretched bars of the three-bar linkage")
    small, middle = figure.subfigures(1, 2, width_ratios=(1, 1.9))
    left, right = small.subfigures(2, 1, height_ratios=(1.15, 1))
    chart, axes = left.add_subplot(), middle.add_subplot(projection="3d", computed_zorder=False)
    _paint_chart(chart, ds, alpha=0.35)
    chart.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), xticks=(-1, 0, 1), yticks=(-1, 0, 1))
    pale = tuple(0.45 * np.array(to_rgb(ORANGE)) + 0.55)
    draw_surfaces(axes, [(polygons, pale, 1.0) for _, polygons in _sheets(ds, ("stretched",), 1.1)]).set_zorder(1)
    _box(axes, 1.1)
    axes.view_init(elev=18, azim=-14)
    axes.set_box_aspect((1, 1, 1), zoom=0.86)
    for across, colour in ((0, PURPLE), (1, COLOURS[3])):
        for line in grid_lines(across):
            sigma, squares = stretched(ds, line)
            on = np.isfinite(sigma[:, :1])
            chart.plot(*np.where(on, line, np.nan).T, color=colour, linewidth=0.8)
            axes.plot(*squares.T, color=colour, linewidth=0.6, zorder=3)
    s = np.stack(np.meshgrid(np.arange(-0.4, 0.9, 0.4), np.arange(-0.4, 0.9, 0.4)), axis=-1).reshape(-1, 2)
    sigma, squares = stretched(ds, s)
    rooted = np.nan_to_num(sigma.min(axis=1)) > _APART
    arrows = {"length": 0.22, "color": COMPRESSED, "linewidth": 2.2, "arrow_length_ratio": 0.35, "zorder": 4}
    axes.quiver(*squares[rooted].T, *sigma[rooted].T, **arrows)
    chart.plot(*s[rooted].T, "o", color=COMPRESSED, markersize=3)
    chart.plot([], [], color=PURPLE, label="$s_1$ = const")
    chart.plot([], [], color=COLOURS[3], label="$s_2$ = const")
    _draw_section(right.add_subplot(), ds)
    heading(left, "A", "chart of the stresses")
    heading(middle, "C", "squared lengths, stresses (arrows)")
    heading(right, "B", "where $L_1 = L_2$: 90°")
    readable(chart)
    chart.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=9, frameon=False, ncols=2, columnspacing=0.8,
        handlelength=1, handletextpad=0.4,
    )  # fmt: skip
    return figure


def _draw_section(axes, ds):
    """The stretched sheet where two bars are alike, with the stress, which lies in this plane, and its right angle."""
    part = np.linspace(1e-3, 1 - 1e-3, 400)  # of the span, by both bars together
    squares = np.stack([part**2 / 4, part**2 / 4, (1 - part) ** 2], axis=1)
    # Along the diagonal of the first two squared lengths, so that angles are those of space.
    plane = np.array([[1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    axes.plot(*plane @ squares.T, color=COLOURS[0], linewidth=1.8)
    for at in (0.25, 0.5, 2 / 3, 0.85):
        sigma = 1 / np.array([at / 2, at / 2, 1 - at])
        n = plane @ sigma / np.linalg.norm(sigma)
        root, tangent = plane @ [at**2 / 4, at**2 / 4, (1 - at) ** 2], np.array([-n[1], n[0]])
        axes.annotate(
            "", root + 0.3 * n, root, arrowprops={"arrowstyle": "-|>", "color": COMPRESSED, "lw": 1.6, "shrinkA": 0}
        )
        corner = root + 0.05 * np.array([n, n + tangent, tangent])
        axes.plot(*corner.T, color="k", linewidth=0.8)
    axes.set(
        xlim=(0, 0.72), ylim=(0, 1.25), aspect="equal", xlabel="$(L_1^2 + L_2^2)/\\sqrt{2}D^2$", ylabel="$L_3^2/D^2$"
    )
    readable(axes)
