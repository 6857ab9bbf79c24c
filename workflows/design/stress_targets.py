"""Linear response on demand: S/√D of other stresses as targets, and targets beyond the bound.

At the transition C = S⊗S/(V D), so that the d(d + 1)/2 components of S/√D are all that linear elasticity is.  Targets
are attained by random stresses, log-normal with a random spread and stronger in a random direction; infeasible ones lie
outside the ellipsoid of the closed-form bound (S:A)² ≤ V D sup μ_A by up to a third.
"""

from __future__ import annotations

import time

import numpy as np

from critflow import CriticalManifold, Status, design, voronoi_network
from critflow.workflow import Claim

from ..shared.checks import check_network, check_positive
from ..shared.reports import series
from .panels import limit, panels, times
from .parts import undefined

PARAMETERS = {"n_vertices": 1000, "targets": 10, "beyond": 2}
VARIABLES = {
    "target": (("target", "component"), "requested S_xx, S_yy, S_xy over √D"),
    "achieved": (("target", "component"), "achieved components"),
    "error": (("target",), "largest error of a component, relative to the norm of S/√D"),
    "distance": (("target",), "root mean square change of log σ from σ = 1"),
    "target_status": (("target",), "its outcome"),
    "target_seconds": (("target",), "processor time of one design [s]"),
    "beyond_status": (("beyond",), "outcome of targets beyond the bound"),
    "beyond_named": (("beyond",), "whether the note names the bound"),
}
NAMES = ("S_xx", "S_yy", "S_xy")
# Smallest error that is drawn.
FLOOR = 1e-17


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"target": parameters["targets"], "beyond": parameters["beyond"], "component": len(NAMES)}


def check(parameters):
    """Refuse settings that could only fail."""
    check_positive(parameters, "targets", "beyond")
    check_network(voronoi_network, parameters["n_vertices"], 0)


def case(parameters, seed):
    """Designs of one network."""
    manifold = CriticalManifold(voronoi_network(parameters["n_vertices"], seed))
    rng = np.random.default_rng([seed, 1])
    found = undefined(VARIABLES, sizes(parameters))
    design(manifold, {"S_xx": 1.0}, max_steps=1, throw=False)  # patterns of the network, analysed once
    for n in range(parameters["targets"]):
        S = response(attained(manifold, rng))
        start = time.process_time()
        made = design(manifold, dict(zip(NAMES, S, strict=True)), throw=False)
        found["target_seconds"][n] = time.process_time() - start
        got = response(made.value)
        found["target"][n], found["achieved"][n] = S, got
        found["error"][n] = np.abs(got - S).max() / np.linalg.norm(S)
        found["distance"][n], found["target_status"][n] = made.distance, made.status
    for n in range(parameters["beyond"]):
        S = response(attained(manifold, rng))
        excess = bound_ratio(manifold, S)
        made = design(manifold, dict(zip(NAMES, (1.001 + 0.3 * rng.random()) / excess * S, strict=True)), throw=False)
        found["beyond_status"][n], found["beyond_named"][n] = made.status, "bound" in made.note
    return found


def attained(manifold, rng):
    """A configuration of random stresses, stronger in one direction."""
    reference = manifold.balance(np.ones(manifold.network.n_edges)).bond_vectors
    angle = 2 * (np.arctan2(reference[:, 1], reference[:, 0]) - np.pi * rng.random())
    spread, anisotropy = 1.0 * rng.random(), 1.0 * rng.random()
    return manifold.configuration(np.exp(spread * rng.standard_normal(len(angle)) + anisotropy * np.cos(angle)))


def response(critical):
    """S_xx, S_yy, S_xy over √D, by their definition."""
    S = np.einsum("a,ai,aj->ij", critical.sigma, critical.bond_vectors, critical.bond_vectors)
    S /= np.sqrt(np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness))
    return np.array([S[0, 0], S[1, 1], S[0, 1]])


def bound_ratio(manifold, S):
    """|S/√D| over its bound in the same direction: (S:A)² ≤ V sup μ_A for every strain A, as L* minimises Σk|L|²."""
    network = manifold.network
    L = manifold.balance(network.stiffness).bond_vectors
    M = np.einsum("a,ai,aj->ij", network.stiffness, L, L)
    values, vectors = np.linalg.eigh(M)
    # V sup μ_A = min_W tr (A + W) M (A + W)ᵀ is diagonal in the frame of M: A_ii² M_i, and 4 A_ij²/(1/M_i + 1/M_j).
    matrix = vectors.T @ np.array([[S[0], S[2]], [S[2], S[1]]]) @ vectors
    square = matrix[0, 0] ** 2 / values[0] + matrix[1, 1] ** 2 / values[1]
    return float(np.sqrt(square + matrix[0, 1] ** 2 * (1 / values[0] + 1 / values[1])))


def figure(ds, parameters):
    """Anisotropy against size of the targets, their errors and times."""
    drawn, (left, middle, right) = panels(
        3,
        f"Linear response on demand: {ds.error.size} designs of {ds.sizes['seed']} networks, "
        f"$N_v$ = {parameters['n_vertices']:,}",
    )
    S = ds.target.values.reshape(-1, 3)
    status, trace = ds.target_status.values.ravel(), S[:, 0] + S[:, 1]
    bulk, anisotropy = trace**2 / (4 * parameters["n_vertices"]), np.hypot(S[:, 0] - S[:, 1], 2 * S[:, 2]) / trace
    for n, (mask, label) in enumerate(((status == Status.ok, "reached"), (status != Status.ok, "not reached"))):
        if mask.any():
            left.scatter(bulk[mask], anisotropy[mask], s=14, label=label, **series(n))
    left.set(
        xlabel="$B_0$ of the target  [k]",
        ylabel="anisotropy $|S_1 - S_2|/(S_1 + S_2)$",
        ylim=(0, None),
        title="targets $S/\\sqrt{D}$",
    )
    left.legend(fontsize=9, frameon=False)
    error = np.maximum(ds.error.values.ravel(), FLOOR)
    middle.hist(np.log10(error[np.isfinite(error)]), bins=20, color=series(0)["color"])
    middle.axvline(-9, color="k", linewidth=0.8, linestyle=":")
    middle.text(-9.1, 0.97, "required", ha="right", va="top", fontsize=8.5, transform=middle.get_xaxis_transform())
    middle.yaxis.get_major_locator().set_params(integer=True)
    middle.set(
        xlabel="$\\log_{10}$ of the relative error", ylabel="number of designs", title="largest error of $S/\\sqrt{D}$"
    )
    times(right, ds.distance.values.ravel(), ds.target_seconds.values.ravel(), **series(0))
    limit(right, 0.3, "required: 0.3 s")
    right.set_ylim(0, None)
    return drawn


def claims(ds, parameters):
    """Bar D1."""
    error, seconds = ds.error.values.ravel(), ds.target_seconds.values.ravel()
    reached = (ds.target_status.values.ravel() == Status.ok) & (error <= 1e-9)
    refused = (ds.beyond_status.values == Status.infeasible) & (ds.beyond_named.values == 1)
    return [
        Claim.tested(
            "design-stress-reached",
            "S/√D of other stresses is reached to 1e-9",
            "all",
            f"{reached.sum()} of {reached.size}, largest error {np.nanmax(error):.1e}",
            reached.all(),
            "no start reached the others",
        ),
        Claim.tested(
            "design-stress-time",
            "one design takes at most 0.3 s of processor time",
            "0.3 s",
            f"median {np.nanmedian(seconds):.2f} s, longest {np.nanmax(seconds):.2f} s",
            (seconds <= 0.3).all(),
            "some targets are far from σ = 1",
        ),
        Claim.tested(
            "design-stress-refused",
            "targets beyond the bound are refused by the bound",
            "all",
            f"{refused.sum()} of {refused.size}",
            refused.all(),
            "the others end at the best compromise",
        ),
    ]


def summary(ds, parameters):
    """Largest error, and times."""
    return {
        "reached": int(((ds.target_status == Status.ok) & (ds.error <= 1e-9)).sum()),
        "targets": int(ds.error.size),
        "largest_error": float(ds.error.max()),
        "median_seconds": float(ds.target_seconds.median()),
        "longest_seconds": float(ds.target_seconds.max()),
    }
