"""Reach of linear elasticity at the transition: which S/√D a network attains with positive stresses, and with any.

C = S⊗S/(V D) at one self-stress.  For stresses of any sign the reach is the ellipsoid sᵀ M⁻¹ s ≤ V, whose support
function is `modulus_bound`: (s:A)² ≤ V μ_A.  Configurations that attain it are known in closed form.  For positive
stresses the support is found by ascents of the modulus μ_A with the penalty that keeps every stress above about r.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow import (
    CriticalManifold,
    InputError,
    StudyError,
    modulus_bound,
    optimize,
    transition_modulus,
    voronoi_network,
)
from critflow.critical.objectives import ConstrainedModulus
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import finite, series

PARAMETERS = {"n_vertices": 100, "directions": 24, "thresholds": (0.3, 0.1), "samples": 60, "ascent": 150}
VARIABLES = {
    "support": (("direction",), "largest S:A/√(V D) over stresses of any sign, in closed form [√k]"),
    "signed": (("direction", "axis"), "S/√(V D) attained there, mean and half the difference of xx and yy [√k]"),
    "compressed": (("direction",), "part of the edges that is compressed there"),
    "tensile": (("threshold", "direction", "axis"), "S/√(V D) of positive stresses above about r [√k]"),
    "sampled": (("sample", "axis"), "S/√(V D) of random positive stresses [√k]"),
}
# A = cos(angle)·1 + sin(angle)·diag(1, −1): the first component of s is tr S, the second S_xx − S_yy, halved.
MEAN, DIFFERENCE = np.eye(2), np.diag([1.0, -1.0])


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {
        "direction": parameters["directions"],
        "threshold": len(parameters["thresholds"]),
        "sample": parameters["samples"],
        "axis": 2,
    }


def check(parameters):
    """Refuse settings that could only fail."""
    if parameters["directions"] < 3 or not min(parameters["thresholds"]) > 0:
        raise StudyError("directions must be at least 3, and thresholds positive")
    check_network(voronoi_network, parameters["n_vertices"], 0)


def angles(parameters):
    """Angles of the directions A; S and −S have the same tensor."""
    return np.linspace(-np.pi / 2, np.pi / 2, parameters["directions"], endpoint=False)


def case(parameters, seed):
    """The support of both reaches of one network, and random stresses."""
    network = voronoi_network(parameters["n_vertices"], seed)
    manifold = CriticalManifold(network)
    shape = sizes(parameters)
    found = {name: np.full([shape[dim] for dim in dims], np.nan) for name, (dims, _) in VARIABLES.items()}
    for n, angle in enumerate(angles(parameters)):
        A = np.cos(angle) * MEAN + np.sin(angle) * DIFFERENCE
        found["support"][n] = np.sqrt(modulus_bound(manifold, A))
        objective = transition_modulus(network, A)
        try:
            best = optimize(manifold, objective, "closed_form", signs="any", throw=False)
            found["signed"][n] = oriented(best.value, A)
            found["compressed"][n] = np.mean(best.value.sigma * np.sign(best.value.sigma.sum()) < 0)
        except InputError:
            pass
        for row, threshold in enumerate(parameters["thresholds"]):
            limited = ConstrainedModulus(objective, threshold)
            best = optimize(manifold, limited, "lbfgs", max_steps=parameters["ascent"], throw=False)
            found["tensile"][row, n] = response(best.value)
    rng = np.random.default_rng([seed, 2])
    for n in range(parameters["samples"]):
        spread = 2.0 ** rng.uniform(-2, 1)
        sigma = np.exp(spread * rng.normal(size=network.n_edges))
        found["sampled"][n] = response(manifold.configuration(sigma))
    return found


def response(critical):
    """(½(S_xx + S_yy), ½(S_xx − S_yy))/√(V D) of a configuration; NaN without one."""
    if not np.isfinite(critical.bond_vectors).all():
        return np.full(2, np.nan)
    network = critical.network
    S = (critical.sigma[:, None] * critical.bond_vectors).T @ critical.bond_vectors
    D = np.sum(critical.sigma**2 * critical.lengths**2 / network.stiffness)
    return 0.5 * np.array([S[0, 0] + S[1, 1], S[0, 0] - S[1, 1]]) / np.sqrt(network.volume * D)


def oriented(critical, strain):
    """The response with the sign that works on the strain."""
    s = response(critical)
    work = 2 * s @ [0.5 * np.trace(strain), 0.5 * (strain[0, 0] - strain[1, 1])]
    return s if work >= 0 else -s


def figure(ds, parameters):
    """Both reaches in units of the largest isotropic response, and the part of the support that σ > 0 attains."""
    drawn = Figure(figsize=(10.5, 4.4), dpi=120, layout="constrained")
    left, right = drawn.subplots(1, 2)
    turn = angles(parameters)
    isotropic = int(np.argmin(np.abs(turn)))
    unit = ds.support.transpose("seed", "direction").values[:, isotropic] / 2
    for i in range(ds.sizes["seed"]):
        one = ds.isel(seed=i)
        signed = one.signed.transpose("direction", "axis").values / unit[i]
        closed = np.concatenate([signed, -signed, signed[:1]])
        left.plot(*closed.T, lw=0.8, color=series(0)["color"], label="any sign" if i == 0 else None)
        sampled = one.sampled.transpose("sample", "axis").values / unit[i]
        left.scatter(*sampled.T, s=3, color="0.75", zorder=0, label="random σ > 0" if i == 0 else None)
        for row, threshold in enumerate(parameters["thresholds"]):
            style = series(1 + row)
            points = one.tensile.isel(threshold=row).transpose("direction", "axis").values / unit[i]
            left.scatter(*points.T, s=8, color=style["color"], label=above(threshold) if i == 0 else None)
    edge = np.array([0, 1.1])
    left.fill_between(edge, -edge, edge, color="0.95", zorder=-1)
    left.text(0.62, 0.85, "S positive definite", fontsize=8, color="0.4")
    left.set(
        xlabel="$\\frac{1}{2}(S_{xx} + S_{yy})/\\sqrt{VD}$, over its bound",
        ylabel="$\\frac{1}{2}(S_{xx} - S_{yy})/\\sqrt{VD}$",
        xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), aspect="equal", title="reach of S",
    )  # fmt: skip
    left.legend(fontsize=7.5, frameon=False, loc=(0.1, 0.38))
    for row, threshold in enumerate(parameters["thresholds"]):
        part = attained(ds, parameters, row)
        style = series(1 + row)
        right.plot(turn, part.mean(axis=0), ms=4, lw=1, label=above(threshold), **style)
    right.axhline(1, color=series(0)["color"], lw=1, label="any sign")
    right.set(
        xlabel="angle of A: 0 dilation, ±π/2 pure shear", ylabel="largest S:A over its bound", ylim=(0, 1.05),
        title="part of the bound that positive stresses attain",
    )  # fmt: skip
    right.legend(fontsize=8, frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    return drawn


def above(threshold):
    """Label of the ascents with one threshold."""
    return f"σ > 0, penalty below {threshold:g} r.m.s."


def attained(ds, parameters, row):
    """S:A of the ascents over its bound, (seed, direction)."""
    turn = angles(parameters)
    s = ds.tensile.isel(threshold=row).transpose("seed", "direction", "axis").values
    work = 2 * (s[..., 0] * np.cos(turn) + s[..., 1] * np.sin(turn))
    return np.abs(work) / ds.support.transpose("seed", "direction").values


def claims(ds, parameters):
    """The ellipse is attained and never passed; positive stresses stay inside the cone of definite S."""
    turn = angles(parameters)
    signed = ds.signed.transpose("seed", "direction", "axis").values
    support = ds.support.transpose("seed", "direction").values
    work = 2 * (signed[..., 0] * np.cos(turn) + signed[..., 1] * np.sin(turn))
    error = finite((work / support - 1).ravel())
    positive = np.concatenate(
        [ds.sampled.values.reshape(-1, 2), ds.tensile.transpose(..., "axis").values.reshape(-1, 2)]
    )
    positive = positive[np.isfinite(positive).all(axis=1)]
    definite = bool((np.abs(positive[:, 1]) < positive[:, 0]).all())
    largest = [np.nanmax(attained(ds, parameters, row)) for row in range(len(parameters["thresholds"]))]
    least = attained(ds, parameters, len(parameters["thresholds"]) - 1)
    known = np.isfinite(work)
    # A strain of rank one makes all forces nearly parallel: the bound is then a limit, which others approach.
    uniaxial = np.isclose(np.abs(turn), np.pi / 4)
    return [
        Claim.tested(
            "DesignReach",
            "S/√D of stresses of any sign fills the ellipse of the closed-form bound",
            "equality",
            f"attained to {np.abs(error).max():.0e} in {len(error)} of {support.size} directions; the other "
            f"{np.count_nonzero(~known[:, uniaxial])} are uniaxial strains, where parallel forces make the bound a "
            f"limit; part of σ > 0: {np.nanmin(least):.2f} to {np.nanmax(least):.2f}",
            bool(known[:, ~uniaxial].all() and np.abs(error).max() < 1e-8 and max(largest) < 1 + 1e-9),
            "the bound is not attained in other directions",
        ),
        Claim.tested(
            "DesignTensileReach",
            "S of positive stresses is positive definite",
            "always",
            f"{len(positive)} configurations",
            definite,
            "some stress is indefinite",
        ),
    ]
