"""Figures, claims and summary of the onset of rigidity, from its dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.result import Status
from critflow.workflow import Claim

from ..shared.figures import lettered
from ..shared.populations import LABELS, PAPER_POPULATIONS
from ..shared.reports import finite, parameters, series, spread, status_counts

TITLES = {
    "simple_shear": "simple shear",
    "pure_shear": "pure shear",
    "uniaxial": "uniaxial, sides fixed",
    "dilation": "dilation (volumetric)",
}


def onsets_by_coordination(ds, family, deformation):
    """γ_c (z, seed), zero where a network is rigid as built, and the z at which every seed has a network.

    Low coordinations are rare: with most seeds no part that spans the cell has them, and the few that do are atypical.
    """
    one = ds.sel(family=family, deformation=deformation).transpose("z", "seed", ...)
    status = one.strain_status.values
    strain = np.where(status == Status.rigid, 0.0, one.critical_strain.values)
    return strain, np.isfinite(strain).all(axis=1)


def coordination_figure(ds):
    """γ_c and the fraction of taut edges against z, by family, for every deformation."""
    names = list(map(str, ds.deformation.values))
    figure = Figure(figsize=(3.3 * len(names), 6.2), dpi=110, layout="constrained")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)
    for column, name in enumerate(names):
        for axes, variable in zip(panels[:, column], ("critical_strain", "taut_fraction"), strict=True):
            for n, family in enumerate(map(str, ds.family.values)):
                strain, complete = onsets_by_coordination(ds, family, name)
                values = (
                    strain
                    if variable == "critical_strain"
                    else np.where(
                        strain > 0,
                        ds[variable].sel(deformation=name, family=family).transpose("z", "seed").values,
                        np.nan,
                    )
                )
                _draw_family(axes, ds.z.values, values, complete, series(n), family)
            axes.spines[["top", "right"]].set_visible(False)
        panels[0, column].set_title(TITLES.get(name, name))
        panels[1, column].set_xlabel("coordination $z$")
    panels[0, 0].set(ylabel="critical strain $\\gamma_c$", ylim=(0, None))
    panels[1, 0].set(ylabel="part of the edges that are taut", ylim=(0, 1.05))
    panels[0, -1].legend(fontsize=8.5, frameon=False)
    figure.suptitle(
        f"Onset of rigidity of networks as built, $N_v$ = {parameters(ds)['n_vertices']}: "
        f"mean and standard deviation of {ds.sizes['seed']} networks, $\\gamma_c$ = 0 where they are rigid as built\n"
        "open: with some seeds no network that spans the cell has this coordination, so the mean is of others",
        fontsize=10.5,
    )
    return figure


def _draw_family(axes, z, values, complete, style, label):
    """Means over seeds with their deviations up to the first z where every network is rigid; open where some miss."""
    mean = np.array([np.mean(known) if len(known := finite(row)) else np.nan for row in values])
    width = np.array([np.std(known) if len(known := finite(row)) else np.nan for row in values])
    rigid = np.flatnonzero(complete & (mean == 0))
    shown = np.isfinite(mean) & (np.arange(len(z)) <= (rigid[0] if len(rigid) else len(z)))
    if shown.any():
        axes.errorbar(z[shown], mean[shown], width[shown], **style, markersize=4.5, capsize=2, label=label)
        partial = shown & ~complete
        axes.plot(
            z[partial], mean[partial], **style, linestyle="none", markersize=4.5, markerfacecolor="white", zorder=5
        )


def surface_figure(ds):
    """The rigidity surface of each population in the plane of pure shear and dilation, with stresses as normals."""
    one = ds.sel(family="voronoi").isel(seed=0)
    figure = Figure(figsize=(12, 4.4), dpi=110, layout="constrained")
    whole, taut = figure.subplots(1, 2, width_ratios=(1.7, 1))
    angle = 360 * np.arange(ds.sizes["direction"]) / ds.sizes["direction"]
    # From compression along one axis to compression along the other, through dilation.
    order = np.argsort((angle + 90) % 360)
    angle = ((angle + 90) % 360 - 90)[order]
    for n, population in enumerate(PAPER_POPULATIONS):
        points, normals = one.surface_point.values[n][order], one.surface_normal.values[n][order]
        style = {"color": COLOURS[n % len(COLOURS)], "label": LABELS[population]}
        whole.plot(100 * points[:, 0], 100 * points[:, 1], "-", linewidth=1.5, **style)
        taut.plot(angle, 100 * one.surface_taut.values[n][order], ".-", linewidth=1.2, markersize=4, **style)
        if n == 0:
            unit = normals / np.linalg.norm(normals, axis=1)[:, None]
            whole.quiver(
                *100 * points.T, *unit.T, angles="xy", color=style["color"], width=0.002, scale=30, headwidth=4
            )
    whole.plot(0, 0, "k+", markersize=9)
    whole.annotate("floppy, unstrained", (0, 0), (0, -15), textcoords="offset points", fontsize=9, ha="center")
    whole.set(xlabel="pure shear $(F_{xx} - F_{yy})/2$  [%]", ylabel="dilation $(F_{xx} + F_{yy})/2 - 1$  [%]")
    whole.set_aspect("equal")
    whole.margins(0.06, 0.25)
    whole.legend(fontsize=8.5, frameon=False, loc="lower center", ncols=2)
    taut.set(xlabel="direction: 0° pure shear, 90° dilation  [°]", ylabel="taut edges at the onset  [%]")
    taut.set_xticks([-90, -45, 0, 45, 90, 135, 180, 225, 270])
    taut.set_ylim(0, 105)
    lettered(whole, taut)
    excess = parameters(ds)["excess"]
    figure.suptitle(
        f"Rigidity surfaces of one network, rest lengths {100 * excess:g} % above those of each population; "
        "arrows: macroscopic stress",
        fontsize=11,
    )
    return figure


def factors(ds):
    """(G − G_c) γ_c/σ at the onset, (seed, onset): harmonic mean of both directions.

    A finite network is least rigid at a small shear γ_0 instead of at zero.  Then the factor is 3 γ_c/(γ_c ± γ_0), and
    γ_0 cancels in the mean of its inverses.
    """
    one = ds.sel(family="voronoi")
    G, stress = (
        one[name].transpose("seed", "onset", "sign", "strain").values for name in ("past_modulus", "past_stress")
    )
    found = np.full(G.shape[:3], np.nan)
    for place in np.ndindex(found.shape):
        if np.isfinite(G[place]).all():
            # The modulus is smooth in the stress: its derivative at the onset, with the curvature fitted.
            found[place] = np.polyfit(stress[place], G[place], 2)[1] * ds.onset.values[place[1]]
    return 1 / np.mean(1 / found, axis=2)


def stiffening_figure(ds):
    """The shear modulus past onsets against the stress, and the factor of its increase against γ_c."""
    one = ds.sel(family="voronoi").isel(seed=-1)
    figure = Figure(figsize=(9.5, 4.2), dpi=110, layout="constrained")
    growth, universal = figure.subplots(1, 2)
    for n, onset in enumerate(ds.onset.values):
        for sign in range(2):
            at = one.isel(sign=sign).sel(onset=onset)
            G, stress = at.past_modulus.values, at.past_stress.values
            if np.isfinite(G).all():
                first = np.polyfit(stress, G, 2)[2]
                growth.plot(
                    1e4 * stress / onset, 1e4 * (G - first), **series(n), linestyle="none",
                    markerfacecolor=(None, "none")[sign], label=("", "_")[sign] + f"$\\gamma_c$ = {onset:g}",
                )  # fmt: skip
    line = np.array([0.0, 1.05 * 1e4 * float((one.past_stress / one.onset).max())])
    growth.plot(line, 3 * line, "k:", linewidth=1, label="factor 3")
    growth.set(
        xlabel="shear stress $\\sigma_{xy}/\\gamma_c$  [$10^{-4} k$]", ylabel="$G - G_c$  [$10^{-4} k$]",
        xscale="log", yscale="log",
    )  # fmt: skip
    growth.set_xlim(0.5 * 1e4 * float((one.past_stress / one.onset).min()), None)
    growth.legend(fontsize=8.5, frameon=False, title="one network; open: backwards", title_fontsize=8.5)
    values = factors(ds)
    known = np.isfinite(values).any(axis=0)
    universal.axhline(3, color="0.5", linestyle=":")
    at = values[:, known]
    universal.errorbar(
        ds.onset.values[known], np.nanmean(at, 0), np.nanstd(at, 0), fmt="o", color=COLOURS[0], capsize=3,
        label=f"{ds.sizes['seed']} networks, both directions",
    )  # fmt: skip
    universal.set(
        xlabel="onset $\\gamma_c$", ylabel="$(G - G_c)\\,\\gamma_c/\\sigma_{xy}$ at the onset", xlim=(0, None)
    )
    universal.legend(fontsize=8.5, frameon=False, loc="lower left")
    lettered(growth, universal)
    size = parameters(ds)["stiffening_vertices"]
    figure.suptitle(f"Past the onset the shear modulus grows as $3\\sigma/\\gamma_c$ ($N_v$ = {size})", fontsize=11)
    return figure


def claims(ds):
    """The statements on onsets; those on Voronoi networks only where they were run."""
    made = [_bounds(ds), *_order(ds), *_dual(ds)]
    if "voronoi" in ds.family.values and np.isfinite(ds.sel(family="voronoi").surface_strain).any():
        made += [_convex(ds), _normals(ds), _consistent(ds), *_universal(ds)]
    return made


def _bounds(ds):
    gap, counts = float(np.nanmax(ds.strain_gap)), status_counts(ds.strain_status)
    tried = ds.strain_status.values != Status.missing
    found = int(np.isfinite(ds.critical_strain.values).sum())
    return Claim.tested(
        "OnsetBounds", "bounds on the critical strain differ by less than 1e-9", "< 1e-9 (1 + γ_c)",
        f"largest difference {gap:.1g} in {found} of {int(tried.sum())} onsets; outcomes {counts}",
        gap < 2e-9 and not (ds.strain_status == Status.stalled).any(), "some bounds are further apart",
    )  # fmt: skip


def _order(ds):
    """γ_c falls with the coordination, in the mean over the same seeds."""
    deformation = str(ds.deformation.values[0])
    for family in map(str, ds.family.values):
        strain, complete = onsets_by_coordination(ds, family, deformation)
        z, mean = ds.z.values[complete], strain[complete].mean(axis=1)
        some = mean > 0
        if some.sum() > 1:
            left_out = ", ".join(f"{value:g}" for value in ds.z.values[~complete & np.isfinite(strain).any(axis=1)])
            yield Claim.tested(
                f"OnsetCoordination-{family}", f"the critical strain of {family} networks falls with z", "decreasing",
                "γ_c = " + ", ".join(f"{value:.3f}" for value in mean[some])
                + " at z = " + ", ".join(f"{value:g}" for value in z[some]),
                bool((np.diff(mean[some]) < 0).all()), "it does not fall everywhere",
                f"z = {left_out} left out: some seeds have no network there" if left_out else "",
            )  # fmt: skip


def _dual(ds):
    """Voronoi networks with straight dual edges balance tensions, so that they are critical as built."""
    if "voronoi" in ds.family.values and 3.0 in ds.z.values:
        status = ds.strain_status.sel(family="voronoi", z=3.0).values
        yield Claim.tested(
            "OnsetVoronoi", "Voronoi networks are at the transition as built: the dual Delaunay edges are their forces",
            "rigid at zero strain", f"outcomes {status_counts(status)}", bool((status == Status.rigid).all()),
            "some are floppy",
        )  # fmt: skip


def _sides(ds):
    """Largest excess of a point of each surface over a tangent plane, relative to the distance of the plane."""
    one = ds.sel(family="voronoi").transpose("seed", "population", "direction", "component", ...)
    points, normals = one.surface_point.values, one.surface_normal.values
    # Components along orthogonal tensors of squared size 2.
    side = 2 * np.einsum("spni,spmi->spnm", normals, points)
    return np.nanmax(side / np.einsum("spnn->spn", side)[..., None], axis=(2, 3)) - 1


def _convex(ds):
    worst = float(np.nanmax(_sides(ds)))
    return Claim.tested(
        "OnsetConvex", "strains that leave a network floppy are convex, with the stresses as normals", "convex",
        f"no point exceeds a tangent plane by more than {max(worst, 0):.1g} of its distance", worst < 1e-8,
        "some point lies outside a tangent plane",
    )  # fmt: skip


def _normals(ds):
    one = ds.sel(family="voronoi")
    compressive = float((one.surface_normal.isel(component=1) < 0).mean())
    return Claim.tested(
        "OnsetTension", "the stress at every onset of cables has positive pressure of tension", "positive",
        f"{100 * compressive:.2g} % of the normals have negative dilation", compressive == 0, "some have not",
    )  # fmt: skip


def _consistent(ds):
    off = float(np.nanmax(ds.sel(family="voronoi").onset_error))
    return Claim.tested(
        "OnsetConsistent", "lengths that are critical in the sheared cell have their onset at that shear", "0",
        f"within {off:.1g}", off < 1e-12, "the onset is elsewhere",
    )  # fmt: skip


def _universal(ds):
    values, onsets = factors(ds), ds.onset.values
    for n, onset in enumerate(onsets):
        known = finite(values[:, n])
        if len(known):
            error = float(known.std() / np.sqrt(max(len(known) - 1, 1)))
            yield Claim.tested(
                f"OnsetFactor-{onset:g}", f"(G − G_c) γ_c/σ tends to 3 as γ_c → 0, here at γ_c = {onset:g}",
                "3 as γ_c → 0", f"{spread(known)} ({len(known)} networks, both directions)",
                abs(known.mean() - 3) < 3 * error + 8 * onset**2 + 0.02, "it does not approach 3",
                "deviations of order γ_c² are expected",
            )  # fmt: skip


def summary(ds):
    """Means and spreads of the critical strains, and the factors."""
    by_family = {
        str(family): {
            str(name): {
                f"{z:g}": spread(ds.critical_strain.sel(family=family, deformation=name, z=z))
                for z in ds.z.values
                if np.isfinite(ds.critical_strain.sel(family=family, deformation=name, z=z)).any()
            }
            for name in ds.deformation.values
        }
        for family in ds.family.values
    }
    found = {"seeds": ds.seed.values.tolist(), "parameters": parameters(ds), "critical_strain": by_family}
    if "voronoi" in ds.family.values:
        values = factors(ds)
        found["factor"] = {f"{onset:g}": spread(values[:, n]) for n, onset in enumerate(ds.onset.values)}
        found["taut_at_onset"] = spread(ds.sel(family="voronoi").onset_taut)
    return found
