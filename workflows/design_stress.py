"""Linear response on demand: S/√D of other stresses as targets, and targets beyond the bound.

At the transition C = S⊗S/(V D), so that the d(d + 1)/2 components of S/√D are all that linear elasticity is.  Targets
are attained by random stresses, log-normal with a random spread and stronger in a random direction; infeasible ones lie
outside the ellipsoid of the closed-form bound (S:A)² ≤ V D sup μ_A by up to a third.
"""

import numpy as np

import critflow as cf
from critflow.workflow import Claim

from .shared.checks import voronoi_check
from .shared.reports import duration
from .shared.structure import scaled_stress
from .shared.tables import bounded, network_study, numbers, outcomes, seconds, stacked, timed

NAMES = ("S_xx", "S_yy", "S_xy")


def case(parameters, *, seed):
    """Designs of one network."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    rng = np.random.default_rng([seed, 1])
    cf.design(manifold, {"S_xx": 1.0}, max_steps=1, throw=False)  # patterns of the network, analysed once
    designs = [designed(manifold, attained(manifold, rng)) for _ in range(parameters["targets"])]
    refusals = [beyond(manifold, attained(manifold, rng), rng) for _ in range(parameters["beyond"])]
    return {"status": cf.Status.ok, **stacked(designs), **stacked(refusals)}


def attained(manifold, rng):
    """S/√D of random stresses, stronger in one direction."""
    reference = manifold.balance(np.ones(manifold.network.n_edges)).bond_vectors
    angle = 2 * (np.arctan2(reference[:, 1], reference[:, 0]) - np.pi * rng.random())
    spread, anisotropy = 1.0 * rng.random(), 1.0 * rng.random()
    sigma = np.exp(spread * rng.standard_normal(len(angle)) + anisotropy * np.cos(angle))
    return scaled_stress(manifold.configuration(sigma))


def designed(manifold, S):
    """One design of S/√D, its error and its cost."""
    made, time = timed(cf.design, manifold, dict(zip(NAMES, S, strict=True)), throw=False)
    achieved = scaled_stress(made.value)
    return {
        "requested": S,
        "achieved": achieved,
        "achieved_error_bound": [made.targets[name].error for name in NAMES],
        "error": np.abs(achieved - S).max() / np.linalg.norm(S),
        "distance": made.distance,
        "target_status": made.status,
        "target_seconds": time,
    }


def beyond(manifold, S, rng):
    """Outcome of a target in the direction of S beyond the bound, and whether the note names the bound."""
    S = (1.001 + 0.3 * rng.random()) / bound_ratio(manifold, S) * S
    made = cf.design(manifold, dict(zip(NAMES, S, strict=True)), throw=False)
    return {"beyond_status": made.status, "beyond_named": "bound" in made.note}


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


def claims(ds):
    """Errors, times and refusals."""
    error, time = ds.error.values, ds.target_seconds.values
    reached = (ds.target_status.values == cf.Status.ok) & (error <= 1e-9)
    refused = (ds.beyond_status.values == cf.Status.infeasible) & (ds.beyond_named.values == 1)
    return [
        Claim.tested(
            "design-stress-reached", "S/√D of other stresses is reached to 1e-9", "all",
            f"{reached.sum()} of {reached.size}, largest error {np.nanmax(error):.1e}; {duration(np.nanmedian(time))} "
            f"each in the median, at most {duration(np.nanmax(time))}", reached.all(), "no start reached the others",
            criterion="1e-9 of the norm, every target", sample=f"{reached.size} targets", kind="check",
        ),
        Claim.tested(
            "design-stress-refused", "targets beyond the bound are refused by the bound", "all",
            f"{refused.sum()} of {refused.size}", refused.all(), "the others end at the best compromise",
            criterion="every target", sample=f"{refused.size} targets", kind="check",
        ),
    ]  # fmt: skip


study = network_study(
    name="design_stress",
    title="Linear response on demand",
    parameters={"n_vertices": 1000, "targets": 10, "beyond": 2},
    case=case,
    check=voronoi_check("targets", "beyond"),
    variables=(
        *numbers(("seed", "target", "component"), requested="S_xx, S_yy, S_xy over √D of the target"),
        *bounded(("seed", "target", "component"), achieved="achieved components"),
        *numbers(
            ("seed", "target"),
            error="largest error of a component, relative to the norm of S/√D",
            distance="root mean square change of log σ from σ = 1",
        ),
        *outcomes(("seed", "target"), target_status="outcome of the design"),
        *seconds(("seed", "target"), target_seconds="processor time of the design [s]"),
        *outcomes(("seed", "beyond"), beyond_status="outcome of targets beyond the bound"),
        *numbers(("seed", "beyond"), "i1", beyond_named="whether the note names the bound"),
    ),
    claims=claims,
)
