"""Figure, claims and verification of the gallery, from its dataset alone."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from critflow.engine.study import plural
from critflow.faces import planar_faces
from critflow.pictures import COMPRESSED, draw_network, face_polygons, periodic_segments, shade_faces
from critflow.result import Status

from ..paper.statements import Measurement
from ..paper.verdicts import claims_of
from ..shared.populations import LABELS
from ..shared.reports import parameters
from ..shared.verification import bond_vectors, configuration, contradictions

# Name and characteristic number of every panel, in the order of the letters.
CAPTIONS = {
    "min_V_L": (LABELS["min_V_L"], "$V_L$ {V_L}, all $L$ = {length:.3f}"),
    "min_V_tau": (LABELS["min_V_tau"], "$V_\\tau$ = {V_tau:.5f}, $V_L$ = {V_L}"),
    "min_V_tau_inflated": ("B, some faces inflated", "$V_\\tau$ = {V_tau:.5f}, $V_L$ = {V_L}"),
    "max_B_0": ("max $B_0$, $\\sigma = k$", "$B_0$ = {B_0:.5f} $k$, $V_L$ = {V_L}"),
    "max_B_0_wave": ("D after a smooth mode", "$B_0$ = {B_0:.5f} $k$, $V_L$ = {V_L}"),
    "max_B_0_designed": ("D, some faces largest", "$B_0$ = {B_0:.5f} $k$, $V_L$ = {V_L}"),
    "max_G_0_1": ("max $G_0$, $r$ = {thresholds[0]:g}", "$G_0$ = {G_0:.3f} $k$"),
    "max_G_0_2": ("max $G_0$, $r$ = {thresholds[1]:g}", "$G_0$ = {G_0:.3f} $k$"),
    "max_G_0_3": ("max $G_0$, $r$ = {thresholds[2]:g}", "$G_0$ = {G_0:.3f} $k$"),
    "random_lengths": (
        f"{LABELS['random_lengths']}, as recorded",
        "$B_0$ = {B_0:.3f} $k$, {stressed} % stressed",
    ),
    "random_lengths_transition": (
        LABELS["random_lengths_transition"],
        "$B_0$ = {B_0:.3f} $k$, {stressed} % stressed",
    ),
    "random_stress_1": (LABELS["random_stress"], "$B_0$ = {B_0:.3f} $k$"),
    "random_stress_2": (f"{LABELS['random_stress']}, again", "$B_0$ = {B_0:.3f} $k$"),
}
PANELS = tuple(CAPTIONS)
ISOGONAL = {
    "min_V_tau_inflated": "min_V_tau",
    "max_B_0_wave": "max_B_0",
    "max_B_0_designed": "max_B_0",
}
SHADED = ("min_V_tau", "min_V_tau_inflated", "max_B_0", "max_B_0_designed")
ROWS = (
    (
        PANELS[0:3],
        "Least variance",
        "Lengths can be made all equal (A), tensions not (B).  C keeps every direction and every tension of B, so its "
        "$V_\\tau$ is the same.  Shaded: the faces that were inflated.",
    ),
    (
        PANELS[3:6],
        "Largest bulk modulus",
        "D is stressed as its springs are stiff.  E and F keep the directions and tensions of D, and with them $B_0$.",
    ),
    (
        PANELS[6:9],
        "Largest shear modulus",
        "The stress of no edge falls much below $r$.  The lower $r$, the more edges line up with the shear and the "
        "larger is $G_0$.",
    ),
    (PANELS[9:13], "Random", ""),  # no place for a note
)
NO_TENSION, EXACT = 1e-9, 1e-12
NOTE_WIDTH = 28  # characters of a line


def gallery(ds):
    """`Networks`: the panels of the first network on one page, on one colour scale of the tension at unit pressure."""
    one = ds.isel(seed=0)
    shown = [panel for panel in PANELS if panel in one.panel.values]
    tension = np.abs(one.tension.sel(panel=shown).values)
    limits = (0.0, float(np.nanpercentile(tension, 98)))
    figure = Figure(figsize=(7.2, 9.0), dpi=200)
    number = "thirteen" if len(shown) == len(PANELS) else len(shown)
    title = f"One network of {ds.sizes['vertex']:,} vertices at the rigidity transition, {number} configurations"
    figure.text(0.5, 0.985, title, ha="center", va="top", fontsize=11)
    grid = figure.add_gridspec(4, 4, left=0.012, right=0.988, bottom=0.072, top=0.925, wspace=0.06, hspace=0.22)
    lines = None
    for row, (panels, heading, note) in enumerate(ROWS):
        for column, panel in enumerate(panels):
            if panel in shown:
                axes = figure.add_subplot(grid[row, column])
                lines = _draw(axes, one.sel(panel=panel), ds, limits) or lines
        if note:
            axes = figure.add_subplot(grid[row, 3])
            axes.set_axis_off()
            axes.text(0.06, 0.98, heading, fontsize=8.5, fontweight="bold", va="top", transform=axes.transAxes)
            axes.text(0.06, 0.87, _wrapped(note), fontsize=7.5, va="top", linespacing=1.35, transform=axes.transAxes)
    if lines is not None:
        bar = figure.colorbar(
            lines, cax=figure.add_axes((0.25, 0.042, 0.5, 0.011)), orientation="horizontal", extend="max"
        )
        bar.set_label("edge tension $\\tau$ at unit pressure", fontsize=8, labelpad=2)
        handles = [
            Line2D([], [], color="0.55", linewidth=0.6, linestyle=(0, (1, 1.2)), label="no tension"),
            Line2D([], [], color=COMPRESSED, linestyle=(0, (2, 1)), label="compression"),
        ]
        figure.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.79, 0.018), fontsize=7.5, frameon=False)
        bar.ax.tick_params(labelsize=7, length=2, pad=1.5)
    return figure


def _draw(axes, one, ds, limits):
    panel, letter = str(one.panel.values), "ABCDEFGHIJKLM"[PANELS.index(str(one.panel.values))]
    name, number = (text.format(**_numbers(one, ds)) for text in CAPTIONS[panel])
    status = Status(int(one.status))
    if status not in (Status.ok, Status.slack_edges, Status.compressed_edges):
        number += f" ({status.name.replace('_', ' ')})"
    axes.set_title(f"$\\bf{{{letter}}}$  {name}\n{number}", fontsize=7.5, pad=3, linespacing=1.25)
    if not np.isfinite(one.sigma.values).all():
        axes.set_axis_off()
        return None
    edges, offsets, cell, x = (one[name].values for name in ("edges", "offsets", "cell", "position"))
    tension = one.tension.values
    slack = np.abs(tension) <= NO_TENSION * np.abs(tension).mean()
    lines = draw_network(axes, edges[~slack], offsets[~slack], cell, x, tension[~slack], limits=limits, width=0.95)
    if slack.any():
        pieces, _ = periodic_segments(edges[slack], offsets[slack], cell, x)
        dotted = LineCollection(pieces, colors="0.55", linewidths=0.6, linestyles=(0, (1, 1.2)), zorder=1)
        axes.add_collection(dotted)
        dotted.set_clip_path(lines.get_clip_path())
    if panel in SHADED:
        L = bond_vectors(one)
        polygons = face_polygons(planar_faces(edges, L, len(x)), edges, x, L)
        shade_faces(axes, [p for p, inflated in zip(polygons, one.chosen.values, strict=True) if inflated], cell)
    return lines


def _numbers(one, ds):
    V_L = float(one.V_L)
    return {
        **parameters(ds),
        "V_L": f"{V_L:.3f}" if V_L > 1e-3 else "< $10^{" + f"{int(np.ceil(np.log10(max(V_L, 1e-30))))}" + "}$",
        "length": float(one.length.mean()), "V_tau": float(one.V_tau),
        "B_0": float(one.B_0), "G_0": float(one.G_0),
        "stressed": f"{100 * float(one.stressed_fraction):.3g}",
    }  # fmt: skip


def _wrapped(text):
    lines, line = [], ""
    for word in text.split():
        # Mathematics is shorter in print than in letters.
        if len((line + word).replace("$", "").replace("\\tau", "t")) > NOTE_WIDTH:
            lines.append(line)
            line = ""
        line += word + " "
    return "\n".join([*lines, line])


# Claims


def claims(ds):
    """The statements of the paper on isogonal changes; those on panels without a run are left out."""
    if "network" in parameters(ds):
        return []
    have = {panel for panel in ds.panel.values if np.isfinite(ds.B_0.sel(panel=panel)).all()}
    return claims_of(one for needs, measure in _MEASURES if have.issuperset(needs) for one in measure(ds))


def _values(ds, name, *panels):
    return ds[name].sel(panel=list(panels)).transpose("panel", "seed").values


def _equal_tension_variance(ds):
    V_tau = _values(ds, "V_tau", "min_V_tau", "min_V_tau_inflated")
    V_L = _values(ds, "V_L", "min_V_tau", "min_V_tau_inflated")
    apart = np.abs(np.diff(V_tau, axis=0)).max()
    status = ds.status.sel(panel="min_V_tau").values
    lost = int(np.sum(status == Status.edge_collapse))
    yield Measurement(
        "V_tau-degenerate", float(apart) if (V_L[0] != V_L[1]).all() else np.inf,
        f"V_τ = {V_tau[0, 0]:.6f} of both, within {_bound(apart)}; V_L = {V_L[0, 0]:.3f} and {V_L[1, 0]:.3f}",
        note=f"in {lost} of {plural(len(status), 'network')} edges shrink to zero length towards the least V_τ"
        if lost else "",
    )  # fmt: skip


def _moduli_of_forces(ds):
    off = 0.0
    for panel, origin in ISOGONAL.items():
        for name in ("B_0", "G_0"):
            one, other = _values(ds, name, panel, origin)
            # A shear modulus may be zero but for the shape of the cell, so both are measured by B_0.
            off = max(off, float(np.abs((one - other) / _values(ds, "B_0", origin)[0]).max()))
    yield Measurement(
        "B_0-of-tensions", off, f"B_0 and G_0 change by less than {_bound(off)} B_0 from B to C, where neither is at "
        "its maximum, and from D to E and F",
    )  # fmt: skip


def _equal_bulk_modulus(ds):
    B_0 = _values(ds, "B_0", *_STIFFEST)
    V_L = _values(ds, "V_L", *_STIFFEST)
    off = float(np.abs(B_0 / ds.B_0_bound.values - 1).max())
    yield Measurement(
        "B_0-degenerate", off, f"B_0 = {B_0[0, 0]:.6f} k at V_L = {V_L[0, 0]:.3f}, {V_L[1, 0]:.3f} and "
        f"{V_L[2, 0]:.3f}, which is the largest value of any stress, within {_bound(off)}",
    )  # fmt: skip
    parted = _values(ds, "B_0_affine", *_STIFFEST) / B_0 - 1
    affine = (np.abs(parted[0]) < EXACT) & (parted[1:] > 0).all(axis=0)
    yield Measurement(
        "B_0-affine", float(np.mean(affine)),
        f"(B_aff − B_0)/B_0 is below {_bound(np.abs(parted[0]).max())} at σ = k, {parted[1, 0]:.3f} and "
        f"{parted[2, 0]:.3f} after isogonal changes",
    )  # fmt: skip
    flat = _values(ds, "flat_directions", *_STIFFEST)
    if not np.isfinite(flat).all():
        return
    zero, curved = _values(ds, "flat_largest", *_STIFFEST).max(), _values(ds, "curved_smallest", *_STIFFEST).min()
    half = ds.sizes["vertex"] // 2
    yield Measurement(
        "B_0-flat-directions", float(np.mean(flat == half)),
        f"{int(flat.min())} of {half} polygons at D, E and F, eigenvalues below {_bound(zero)} and above {curved:.1g} "
        "of the largest",
        note=f"{half - 1} of them are isogonal and one is the scale of σ; the paper prints N_v/2 − 1 = N_f, but "
        f"N_f = N_v/2 = {half}",
    )  # fmt: skip


_STIFFEST = ("max_B_0", "max_B_0_wave", "max_B_0_designed")
_MEASURES = (
    (("min_V_tau", "min_V_tau_inflated"), _equal_tension_variance),
    ((*ISOGONAL, *ISOGONAL.values()), _moduli_of_forces),
    (_STIFFEST, _equal_bulk_modulus),
)


def _bound(value):
    """A power of ten that a small number does not exceed, at least the rounding error of numbers of order one."""
    return f"1e{int(np.ceil(np.log10(max(float(value), 1e-16))))}"


# Verification


def verify(ds):
    """A line for each stored configuration that the numbers next to it, or those of its isogonal origin, contradict."""

    def checks(one):
        if np.isfinite(one.residual):
            yield from _checks(one)
            origin = ISOGONAL.get(str(one.panel.values))
            if origin in ds.panel.values:
                yield "directions and tensions", _parallel(one, ds.sel(panel=origin, seed=one.seed))

    return contradictions(ds, ("panel", "seed"), checks)


def _checks(one):
    length, area = one.length.values, abs(np.linalg.det(one.cell.values))
    tension = one.sigma.values * length
    yield from configuration(one)
    yield "tension", np.allclose(tension * 2 * area / np.sum(tension * length), one.tension, rtol=1e-9, atol=1e-12)
    yield "B_0_affine", np.isclose(np.sum(length**2) / (4 * area), one.B_0_affine, rtol=1e-10)


def _parallel(one, origin):
    unit = [bond_vectors(each) / each.length.values[:, None] for each in (one, origin)]
    tension = [each.tension.values / each.tension.values.mean() for each in (one, origin)]
    return np.allclose(*unit, rtol=0, atol=1e-9) and np.allclose(*tension, rtol=1e-9)
