"""Poisson's ratio by the stiffnesses of triangulated cells, and at the transition with and without compressed edges.

Isotropic tensors of the same Young's modulus are designed by the stiffnesses of springs, and checked by a relaxation
that shares no code with the design.  At the transition C = S⊗S/(V D), so a stretch along y with free sides has
ν = S_xx/S_yy: positive for σ > 0.  With compressed edges (S/√D)ᵀ M⁻¹ (S/√D) ≤ 1, with the form M of `upper_bound`
times V, is all that limits S, so that the largest B_0 for each ν is known in closed form.
"""

from __future__ import annotations

import time

import numpy as np

from critflow import InputError, Status, delaunay_network, design_stiffness, optimize, upper_bound, voronoi_network
from critflow.critical.transition import transition_modulus
from critflow.design.stiffnesses import isotropic_targets
from critflow.networks.deformation import strain_basis
from critflow.result import StudyError
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import finite, series
from .panels import limit, panels

PARAMETERS = {
    "sizes": (24, 36, 48, 60, 72, 84, 96, 112, 128, 144),
    "ratios": tuple(round(-0.8 + 1.7 * n / 12, 6) for n in range(13)),
    "n_vertices": 100,
    "directions": 12,
}
VARIABLES = {
    "error": (("ratio",), "largest error of Poisson's ratio over all directions"),
    "checked_error": (("ratio",), "largest error of the relaxed tensor of the check, relative to Young's modulus"),
    "change": (("ratio",), "root mean square change of log k"),
    "contrast": (("ratio",), "largest over smallest stiffness"),
    "design_status": (("ratio",), "outcome of the design"),
    "design_seconds": (("ratio",), "time of the design [s]"),
    "signed_ratio": (("direction",), "Poisson's ratio at the transition, compression allowed"),
    "signed_bulk": (("direction",), "bulk modulus B_0 of the stiffest configuration there [k]"),
    "signed_bound": (("direction",), "its bound in closed form [k]"),
    "tensile_ratio": (("direction",), "Poisson's ratio at the transition for positive stresses"),
    "tensile_bulk": (("direction",), "bulk modulus B_0 there [k]"),
}
ANGLES = np.linspace(0, np.pi, 12, endpoint=False)
BOUND_OF_ERROR, WITHIN = 6e-4, 0.005
ASCENT = 150


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"ratio": len(parameters["ratios"]), "direction": parameters["directions"]}


def check(parameters):
    """Refuse settings that could only fail."""
    if not parameters["directions"] >= 3:
        raise StudyError(f"directions={parameters['directions']} must be at least 3")
    for ratio in parameters["ratios"]:
        if not -1 < ratio < 1:
            raise StudyError(f"ratios={ratio} must lie between -1 and 1")
    check_network(voronoi_network, parameters["n_vertices"], 0)
    for size in parameters["sizes"]:
        check_network(delaunay_network, size, 0)


def case(parameters, seed):
    """All ratios of one triangulated cell, and one network at the transition."""
    network = delaunay_network(parameters["sizes"][seed % len(parameters["sizes"])], seed)
    designed = [stiffnesses(network, ratio) for ratio in parameters["ratios"]]
    found = {name: np.array([one[name] for one in designed]) for name in designed[0]}
    return found | at_transition(voronoi_network(parameters["n_vertices"], seed), parameters["directions"])


def stiffnesses(network, ratio):
    """One design and its check."""
    targets, begun = isotropic_targets(2, 1.0, ratio), time.process_time()
    found = design_stiffness(network, network.positions, targets, throw=False)
    seconds = time.process_time() - begun
    wanted = np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]]) / (1 - ratio**2)
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    across = along[:, ::-1] * [-1, 1]
    ratios = [found.elasticity.poisson(n, t) for n, t in zip(along, across, strict=True)]
    k = found.value.stiffness
    return {
        "error": np.abs(np.array(ratios) - ratio).max(),
        "checked_error": np.abs(relaxed_tensor(found.value) - wanted).max(),
        "change": found.distance,
        "contrast": k.max() / k.min(),
        "design_status": found.status,
        "design_seconds": seconds,
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


def at_transition(network, n_directions):
    """The stiffest configurations in directions of S, with and without compressed edges."""
    V, strains = network.volume, strain_basis(2)[1]
    form = np.array([[upper_bound(network, transition_modulus(network, a + b)) for a in strains] for b in strains])
    single = np.diag(form) / 4
    form = V * 0.5 * (form - single[:, None] - single[None])
    found = {name: np.full(n_directions, np.nan) for name in VARIABLES if name.startswith(("signed", "tensile"))}
    for n, angle in enumerate(np.linspace(-np.pi / 4, 3 * np.pi / 4, n_directions + 1)[:-1] + 0.02):
        # S/√D in the direction (sin, cos, 0), at the boundary of the ellipsoid.
        direction = np.array([np.sin(angle), np.cos(angle), 0.0])
        normal = np.linalg.solve(form, direction)
        length = 1 / np.sqrt(direction @ normal)
        found["signed_bound"][n] = length**2 * (direction[0] + direction[1]) ** 2 / (4 * V)
        strain = np.einsum("a,aij->ij", normal, strains) / np.linalg.norm(normal)
        objective = transition_modulus(network, strain)
        try:
            best = optimize(network, objective, "closed_form", signs="any", throw=False)
            found["signed_ratio"][n], found["signed_bulk"][n] = ratio_and_bulk(best)
        except InputError:
            pass
        best = optimize(network, PenalisedModulus(objective), "lbfgs", max_steps=ASCENT, throw=False)
        found["tensile_ratio"][n], found["tensile_bulk"][n] = ratio_and_bulk(best)
    return found


def ratio_and_bulk(optimum):
    """ν = S_xx/S_yy and B_0 of a configuration; NaN without one."""
    critical = optimum.value
    if not np.isfinite(critical.bond_vectors).all():
        return np.nan, np.nan
    S = (critical.sigma[:, None] * critical.bond_vectors).T @ critical.bond_vectors
    D = np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness)
    return S[0, 0] / S[1, 1], np.trace(S) ** 2 / (4 * critical.network.volume * D)


def figure(ds, parameters):
    """Errors of the designed ratios, their cost, and ratios at the transition."""
    drawn, (left, middle, right) = panels(
        3,
        f"Poisson's ratio on demand by stiffnesses, {min(parameters['sizes'])} to {max(parameters['sizes'])} vertices, "
        "and its range at the transition",
    )
    ratios = np.array(parameters["ratios"])
    floor = 1e-16
    for n, (name, label) in enumerate((("error", "designed"), ("checked_error", "relaxed by another code"))):
        values = np.maximum(ds[name].transpose("seed", "ratio").values, floor)
        left.semilogy(ratios, np.nanmax(values, axis=0), ms=4, lw=1, label=label, **series(n))
    limit(left, BOUND_OF_ERROR, f"required median: {BOUND_OF_ERROR:g}")
    left.set(
        xlabel="requested Poisson's ratio $\\nu$", ylabel="largest error of $\\nu$", ylim=(floor, 1e-1), title="error"
    )
    left.legend(fontsize=8, frameon=False)
    for seed, change in enumerate(ds.change.transpose("seed", "ratio").values):
        size = parameters["sizes"][int(ds.seed.values[seed]) % len(parameters["sizes"])]
        middle.plot(ratios, change, lw=1, color=str(0.75 - 0.6 * size / max(parameters["sizes"])))
    middle.set(
        xlabel="requested Poisson's ratio $\\nu$",
        ylabel="change of $\\log k$ (r.m.s.)",
        title="change of the stiffnesses",
    )
    middle.text(0.5, 0.95, "darker: larger cells", ha="center", fontsize=8.5, transform=middle.transAxes)
    for n, (name, label) in enumerate((("signed", "compression allowed"), ("tensile", "σ > 0"))):
        style = series(n)
        x, y = (ds[f"{name}_{what}"].values.ravel() for what in ("ratio", "bulk"))
        fill = {"facecolors": "none" if name == "signed" else style["color"], "edgecolors": style["color"]}
        right.scatter(x, y, s=30 if name == "signed" else 10, marker=style["marker"], label=label, **fill)
    right.axvline(0, color="0.6", lw=0.8)
    right.set(
        xlabel="$\\nu = S_{xx}/S_{yy}$",
        ylabel="$B_0$  [k]",
        xlim=(-1.5, 5.5),
        ylim=(0, None),
        title="at the transition",
    )
    right.legend(fontsize=8, frameon=False)
    return drawn


def claims(ds, parameters):
    """Errors of the designs against those of the literature, and the sign of ν at the transition."""
    error, checked = finite(ds.error.values), finite(ds.checked_error.values)
    total = ds.error.size
    reached = int(np.count_nonzero(np.maximum(ds.error.values, ds.checked_error.values) < WITHIN))
    seconds = float(np.nansum(ds.design_seconds.values))
    tensile = finite(ds.tensile_ratio.values)
    ratio, bulk, bound = (ds[f"signed_{name}"].values.ravel() for name in ("ratio", "bulk", "bound"))
    known = np.isfinite(bulk)
    attained = known.any() and np.abs(bulk[known] - bound[known]).max() < 1e-8 * bound[known].max()
    outcomes = ", ".join(sorted({Status(int(code)).name for code in finite(ds.design_status.values)}))
    signed = finite(ratio)
    return [
        Claim.tested(
            "DesignPoisson",
            "isotropic Poisson's ratios are designed by stiffnesses in triangulated cells",
            "median error 0.0063, 55 % within 0.05",
            f"median {np.median(error):.0e}, check {np.median(checked):.0e}; {reached} of {total} within {WITHIN:g}",
            reached == total and np.median(error) <= BOUND_OF_ERROR and np.median(checked) <= BOUND_OF_ERROR,
            "some ratio was not reached",
            f"{seconds:.0f} s of processor time; status {outcomes}",
        ),
        Claim.tested(
            "DesignAuxetic",
            "at the transition positive stresses have ν > 0, and compressed edges have either sign",
            "ν > 0 for σ > 0",
            f"ν from {tensile.min():.2g} to {tensile.max():.2g} for σ > 0, from {signed.min():.2g} otherwise",
            bool(tensile.min() > 0 and signed.min() < 0 and attained),
            "the signs differ",
            f"largest B_0 for each ν: difference from the closed form {np.abs(bulk - bound)[known].max():.0e} k",
        ),
    ]
