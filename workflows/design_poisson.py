"""Poisson's ratio by the stiffnesses of triangulated cells.

Isotropic tensors of the same Young's modulus are designed by the stiffnesses of springs, and checked by a relaxation
that shares no code with the design.  `design_reach` has the ratios of networks at the transition.
"""

import numpy as np

import critflow as cf
from critflow.extras.design_stiffness.stiffnesses import isotropic_targets
from critflow.networks.deformation import strain_basis
from critflow.result import StudyError
from critflow.workflow import Claim, Coordinate
from critflow.workflow.study import plural

from .shared.checks import check_network
from .shared.figures import panels
from .shared.reports import finite, parameters
from .shared.tables import network_study, numbers, outcomes, seconds, stacked, timed

ANGLES = np.linspace(0, np.pi, 12, endpoint=False)
BOUND_OF_ERROR, WITHIN = 6e-4, 0.005  # a tenth of the errors of the literature


def case(parameters, *, seed):
    """All ratios of one triangulated cell."""
    network = cf.delaunay_network(parameters["sizes"][seed % len(parameters["sizes"])], seed)
    return {"status": cf.Status.ok, **stacked([designed(network, ratio) for ratio in parameters["ratios"]])}


def designed(network, ratio):
    """One design and its check."""
    start = cf.spring_state(network, np.linalg.norm(network.bond_vectors(network.positions), axis=1), network.positions)
    made, time = timed(cf.design, start, isotropic_targets(2, 1.0, ratio), change="stiffness", throw=False)
    target = np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]]) / (1 - ratio**2)
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    across = along[:, ::-1] * [-1, 1]
    ratios = [made.solved.value.poisson(n, t) for n, t in zip(along, across, strict=True)]
    return {
        "error": np.abs(np.array(ratios) - ratio).max(),
        "checked_error": np.abs(relaxed_tensor(made.value.network) - target).max(),
        "change": made.distance,
        "design_status": made.status,
        "design_seconds": time,
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


def check(parameters, axes):
    """Refuse settings that could only fail."""
    for ratio in parameters["ratios"]:
        if not -1 < ratio < 1:
            raise StudyError(f"ratios={ratio} must lie between -1 and 1")
    for size in parameters["sizes"]:
        check_network(cf.delaunay_network, size, 0)


def figure(ds):
    """Change of the stiffnesses that a ratio needs."""
    ratios, sizes = ds.ratio.values, parameters(ds)["sizes"]
    figure, (axes,) = panels(1, f"Poisson's ratio designed by stiffnesses, {min(sizes)} to {max(sizes)} vertices")
    for seed, change in zip(ds.seed.values, ds.change.values, strict=True):
        size = sizes[int(seed) % len(sizes)]
        axes.plot(ratios, change, lw=1, color=str(0.75 - 0.6 * size / max(sizes)))
    axes.set(xlabel="requested Poisson's ratio $\\nu$", ylabel="change of $\\log k$ (r.m.s.)")
    axes.text(0.5, 0.95, "darker: larger cells", ha="center", fontsize=8.5, transform=axes.transAxes)
    return figure


def claims(ds):
    """Errors of the designs against those of the literature."""
    error, checked = finite(ds.error.values), finite(ds.checked_error.values)
    reached = int(np.count_nonzero(np.maximum(ds.error.values, ds.checked_error.values) < WITHIN))
    outcomes = ", ".join(sorted({cf.Status(int(code)).name for code in ds.design_status.values.ravel()}))
    return [
        Claim.tested(
            "DesignPoisson", "isotropic Poisson's ratios are designed by stiffnesses in triangulated cells",
            "median error 0.0063, 55 % within 0.05",
            f"median {np.median(error):.0e}, check {np.median(checked):.0e}; {reached} of {ds.error.size} within "
            f"{WITHIN:g}",
            reached == ds.error.size and max(np.median(error), np.median(checked)) <= BOUND_OF_ERROR,
            "some ratio was not reached",
            f"{float(ds.design_seconds.sum()):.0f} s of processor time; status {outcomes}",
            criterion=f"median {BOUND_OF_ERROR:g}, every design within {WITHIN:g}",
            sample=plural(ds.error.size, "design"),
        ),
    ]  # fmt: skip


study = network_study(
    name="design_poisson",
    title="Poisson's ratio on demand",
    parameters={
        "sizes": (24, 36, 48, 60, 72, 84, 96, 112, 128, 144),
        "ratios": tuple(round(-0.8 + 1.7 * n / 12, 6) for n in range(13)),
    },
    coordinates=(Coordinate("ratio", "ratios", "requested Poisson's ratio"),),
    case=case,
    check=check,
    variables=(
        *numbers(
            ("seed", "ratio"),
            error="largest error of Poisson's ratio over all directions",
            checked_error="largest error of the relaxed tensor of the check, relative to Young's modulus",
            change="root mean square change of log k",
        ),
        *outcomes(("seed", "ratio"), design_status="outcome of the design"),
        *seconds(("seed", "ratio"), design_seconds="processor time of the design [s]"),
    ),
    figures={"poisson": figure},
    claims=claims,
)
