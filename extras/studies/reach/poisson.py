"""Poisson's ratio by the stiffnesses of triangulated cells.

Isotropic tensors of the same Young's modulus are designed by the stiffnesses of springs, and checked by a relaxation
that shares no code with the design.  `support` has the ratios of networks at the transition.
"""

import numpy as np
from critflow.studies.shared.figures import counted, panels, readable
from critflow.studies.shared.reports import finite, parameters
from critflow.studies.shared.tables import numbers, outcomes, stacked
from matplotlib import colormaps

import critflow as cf
import critflow_extras as ce
from critflow.deformation import strain_basis
from critflow.engine import Claim
from critflow.engine.study import plural
from critflow_extras.design_stiffness.stiffnesses import isotropic_targets

from ..shared.parts import seconds, timed

ANGLES = np.linspace(0, np.pi, 12, endpoint=False)
BOUND_OF_ERROR, WITHIN = 6e-4, 0.005  # a tenth of the errors of the literature


def ratios(parameters, seed):
    """All ratios of one triangulated cell."""
    network = cf.delaunay_network(parameters["sizes"][seed % len(parameters["sizes"])], seed)
    return stacked([designed(network, ratio) for ratio in parameters["ratios"]])


def designed(network, ratio):
    """One design and its check."""
    start = cf.spring_state(network, np.linalg.norm(network.bond_vectors(network.positions), axis=1), network.positions)
    made, time = timed(ce.design, start, isotropic_targets(2, 1.0, ratio), change="stiffness", throw=False)
    target = np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]]) / (1 - ratio**2)
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    across = along[:, ::-1] * [-1, 1]
    found = [made.solved.value.poisson(n, t) for n, t in zip(along, across, strict=True)]
    return {
        "ratio_error": np.abs(np.array(found) - ratio).max(),
        "ratio_checked_error": np.abs(relaxed_tensor(made.value.network) - target).max(),
        "stiffness_change": made.distance,
        "ratio_status": made.status,
        "ratio_seconds": time,
    }


def relaxed_tensor(network):
    """C (3, 3) by dense least squares over all displacements."""
    L = network.bond_vectors(network.positions)
    unit = L / np.linalg.norm(L, axis=1)[:, None]
    root = np.sqrt(network.stiffness)[:, None]
    rows = root * (network.incidence.toarray()[:, :, None] * unit[:, None, :]).reshape(len(L), -1)
    load = root * np.einsum("ei,aij,ej->ea", unit, strain_basis(2)[1], L)
    rest = load - rows @ np.linalg.lstsq(rows, load, rcond=1e-13)[0]
    return rest.T @ rest / network.volume


def figure(ds):
    """Change of the stiffnesses that a ratio needs, by the size of the cell."""
    ratios, sizes = ds.ratio.values, np.array(parameters(ds)["sizes"])[ds.seed.values % len(parameters(ds)["sizes"])]
    figure, (axes,) = panels(
        1,
        "Stiffnesses alone give any Poisson's ratio, with the least change near 1/3\n"
        f"({counted(ds)}: triangulated cells of {sizes.min()} to {sizes.max()} vertices, errors below {WITHIN:g})",
        height=3.2,
    )
    shades = colormaps["viridis_r"]
    for n in np.argsort(sizes):
        colour = shades(0.1 + 0.85 * n / max(len(sizes) - 1, 1))
        axes.plot(ratios, ds.stiffness_change.values[n], "o-", ms=3, lw=1, color=colour, label=f"{sizes[n]}")
    axes.axvline(1 / 3, color="0.5", lw=0.8, ls=":")
    axes.annotate(
        "$\\nu = 1/3$: affine central forces", (1 / 3, 0.98), (-6, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", ha="right", va="top", fontsize=9, color="0.3",
    )  # fmt: skip
    axes.set(xlabel="requested Poisson's ratio $\\nu$", ylabel="change of $\\log k$ (r.m.s.)", ylim=(0, None))
    axes.legend(
        title="vertices", fontsize=9, title_fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5),
        labelspacing=0.2,
    )  # fmt: skip
    readable(axes)
    return figure


def claims(ds):
    """Errors of the designs against those of the literature."""
    error, checked = finite(ds.ratio_error.values), finite(ds.ratio_checked_error.values)
    reached = int(np.count_nonzero(np.maximum(ds.ratio_error.values, ds.ratio_checked_error.values) < WITHIN))
    outcomes = ", ".join(sorted({cf.Status(int(code)).name for code in ds.ratio_status.values.ravel()}))
    return [
        Claim.tested(
            "reach-poisson", "isotropic Poisson's ratios are designed by stiffnesses in triangulated cells",
            "median error 0.0063, 55 % within 0.05",
            f"median {np.median(error):.0e}, check {np.median(checked):.0e}; {reached} of {ds.ratio_error.size} within "
            f"{WITHIN:g}",
            reached == ds.ratio_error.size and max(np.median(error), np.median(checked)) <= BOUND_OF_ERROR,
            "some ratio was not reached",
            f"{float(ds.ratio_seconds.sum()):.0f} s of processor time; status {outcomes}",
            criterion=f"median {BOUND_OF_ERROR:g}, every design within {WITHIN:g}",
            sample=plural(ds.ratio_error.size, "design"),
        ),
    ]  # fmt: skip


VARIABLES = (
    *numbers(
        ("seed", "ratio"),
        ratio_error="largest error of Poisson's ratio over all directions",
        ratio_checked_error="largest error of the relaxed tensor of the check, relative to Young's modulus",
        stiffness_change="root mean square change of log k",
    ),
    *outcomes(("seed", "ratio"), ratio_status="outcome of the design"),
    *seconds(("seed", "ratio"), ratio_seconds="processor time of the design [s]"),
)
