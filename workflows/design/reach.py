"""Reach of linear elasticity at the transition: which S/√D a network attains with positive stresses, and with any.

C = S⊗S/(V D) at one self-stress.  For stresses of any sign the reach is the ellipsoid sᵀ M⁻¹ s ≤ V, whose support
function is `modulus_bound`: (s:A)² ≤ V μ_A.  Configurations that attain it are known in closed form.  For positive
stresses the support is found by ascents of the modulus μ_A with the penalty that keeps every stress above about r.
"""

from __future__ import annotations

import numpy as np

from critflow import (
    CriticalManifold,
    InputError,
    StudyError,
    modulus_bound,
    optimize,
    transition_modulus,
    voronoi_network,
)
from critflow.critical.quantity import ConstrainedModulus
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import finite, series
from .panels import panels
from .parts import undefined

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
    found = undefined(VARIABLES, sizes(parameters))
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
    """Both reaches of one network, and the part of the support that σ > 0 attains in all."""
    drawn, (left, right) = panels(
        2,
        f"Linear response that a network can have at the transition: $N_v$ = {parameters['n_vertices']}, "
        f"{ds.sizes['seed']} networks",
        height=4.6,
    )
    _one_network(left, ds.isel(seed=0), parameters)
    turn = angles(parameters) / np.pi
    right.axhline(1, color=series(0)["color"], lw=1)
    right.text(-0.5, 1.01, "any sign", fontsize=8.5, color=series(0)["color"])
    for row in range(len(parameters["thresholds"])):
        part = attained(ds, parameters, row)
        style = series(1 + row)
        right.plot(turn, part.mean(axis=0), ms=4, lw=1, **style)
        right.fill_between(turn, part.min(axis=0), part.max(axis=0), color=style["color"], alpha=0.2, lw=0)
    right.set(
        xlabel="direction A: 0 dilation, ±½ pure shear  [π]", ylabel="largest $S:A$ over its bound", ylim=(0, 1.09),
        title="part that positive stresses attain: mean and range",
    )  # fmt: skip
    drawn.legend(*left.get_legend_handles_labels(), fontsize=8.5, frameon=False, ncols=3, loc="outside lower center")
    return drawn


def _one_network(axes, one, parameters):
    """The ellipse of the bound, the responses that attain it, and those of positive stresses."""
    turn, support = angles(parameters), one.support.values
    unit = support[np.argmin(np.abs(turn))] / 2
    # The support function of the ellipse is √(aᵀ Q a): three numbers, known exactly from any three directions.
    a = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    products = np.stack([a[:, 0] ** 2, 2 * a[:, 0] * a[:, 1], a[:, 1] ** 2], axis=1)
    xx, xy, yy = np.linalg.lstsq(products, support**2, rcond=None)[0]
    circle = np.linspace(0, 2 * np.pi, 200)
    ellipse = np.linalg.cholesky([[xx, xy], [xy, yy]]) @ [np.cos(circle), np.sin(circle)] / 2
    axes.plot(*ellipse / unit, color="k", lw=0.8, label="closed-form bound")
    signed = one.signed.transpose("direction", "axis").values / unit
    axes.scatter(*np.concatenate([signed, -signed]).T, s=14, label="attained, any sign", **series(0))
    sampled = one.sampled.transpose("sample", "axis").values / unit
    axes.scatter(*sampled.T, s=4, color="0.6", label="random σ > 0")
    for row, threshold in enumerate(parameters["thresholds"]):
        points = one.tensile.isel(threshold=row).transpose("direction", "axis").values / unit
        axes.scatter(*points.T, s=14, label=above(threshold), **series(1 + row))
    edge = np.array([0, 1.15])
    axes.fill_between(edge, -edge, edge, color="0.94", zorder=-1)
    axes.text(0.12, 0, "S positive\ndefinite", fontsize=8.5, color="0.35", va="center")
    axes.set(
        xlabel="$(S_{xx} + S_{yy})/2\\sqrt{VD}$, over its bound", ylabel="$(S_{xx} - S_{yy})/2\\sqrt{VD}$",
        xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", title="one network",
    )  # fmt: skip


def above(threshold):
    """Label of the ascents with one threshold."""
    return f"σ > 0, at least about {threshold:g} r.m.s."


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
    return [
        Claim.tested(
            "DesignReach",
            "S/√D of stresses of any sign fills the ellipse of the closed-form bound",
            "equality",
            f"attained to {np.abs(error).max():.0e} in {len(error)} of {support.size} directions; part of σ > 0: "
            f"{np.nanmin(least):.2f} to {np.nanmax(least):.2f}",
            bool(known.all() and np.abs(error).max() < 1e-8 and max(largest) < 1 + 1e-9),
            "the bound is not attained in some directions",
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
