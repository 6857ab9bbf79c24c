"""Reach of linear elasticity at the transition: which S/√D a network attains with positive stresses, and with any.

C = S⊗S/(V D) at one self-stress.  For stresses of any sign the reach is the ellipsoid sᵀ M⁻¹ s ≤ V, whose support
function is `upper_bound`: (s:A)² ≤ V μ_A.  Configurations that attain it are known in closed form.  For positive
stresses the support is found by ascents of the modulus μ_A with the penalty that keeps every stress above about r.

A stretch along x with free sides has Poisson's ratio ν = S_xx/S_yy, which is positive for σ > 0.
"""

import numpy as np
from critflow.studies.shared.figures import counted, legend_below, lettered, panels
from critflow.studies.shared.reports import finite, parameters, series
from critflow.studies.shared.tables import bounded, numbers, stacked

import critflow as cf
from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.quantities import PenalisedModulus, transition_modulus

from ..shared.parts import scaled_stress

# A = cos(angle)·1 + sin(angle)·diag(1, −1): the first component of s is tr S, the second S_xx − S_yy, halved.
MEAN, DIFFERENCE = np.eye(2), np.diag([1.0, -1.0])


def responses(parameters, seed):
    """The support of both reaches of one network, and random stresses."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    rng, sampled = np.random.default_rng([seed, 2]), []
    for _ in range(parameters["samples"]):
        spread = 2.0 ** rng.uniform(-2, 1)
        sampled.append(response(manifold.configuration(np.exp(spread * rng.normal(size=manifold.network.n_edges)))))
    directions = [support(manifold, parameters, angle) for angle in angles(parameters["directions"])]
    values, errors = np.moveaxis(sampled, 1, 0)
    return {"sampled": values, "sampled_error_bound": errors, **stacked(directions)}


def angles(n):
    """Angles of the directions A; S and −S have the same tensor."""
    return np.linspace(-np.pi / 2, np.pi / 2, n, endpoint=False)


def support(manifold, parameters, angle):
    """The largest S:A in one direction: in closed form with any signs, and by ascents of positive stresses."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    A = direction[0] * MEAN + direction[1] * DIFFERENCE
    objective = transition_modulus(manifold.network, A)
    try:
        signed = response(cf.optimize(manifold, objective, "closed_form", signs="any", throw=False).value)
    except cf.InputError:
        signed = np.full((2, 2), np.nan)
    limited = [PenalisedModulus(objective, threshold) for threshold in parameters["thresholds"]]
    steps = parameters["ascent"]
    ascents = [cf.optimize(manifold, one, "lbfgs", max_steps=steps, throw=False) for one in limited]
    tensile = np.array([response(best.value) for best in ascents])
    return {
        "support": np.sqrt(cf.upper_bound(manifold, objective)),
        # Of both signs the one that works on the strain.
        "signed": signed[0] if signed[0] @ direction >= 0 else -signed[0],
        "signed_error_bound": signed[1],
        "tensile": tensile[:, 0],
        "tensile_error_bound": tensile[:, 1],
    }


def response(critical):
    """(½(S_xx + S_yy), ½(S_xx − S_yy))/√(V D) of a configuration, and bounds on its errors; NaN without one."""
    xx, yy, _ = scaled_stress(critical)
    errors = sum(cf.quantity(critical.network, name).error(critical) for name in ("S_xx", "S_yy"))
    return 0.5 * np.array([[xx + yy, xx - yy], [errors, errors]]) / np.sqrt(critical.network.volume)


def poisson_ratio(responses):
    """ν = S_xx/S_yy of responses (..., 2)."""
    mean, difference = np.moveaxis(responses, -1, 0)
    return (mean + difference) / (mean - difference)


def work(ds, responses):
    """S:A/√(V D) of responses (seed, direction, ..., 2) in their directions, (seed, direction, ...)."""
    turn = angles(ds.sizes["direction"])
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return 2 * np.einsum("sd...c,dc->sd...", responses, directions)


def attained(ds):
    """S:A of the ascents over its bound, (seed, direction, threshold)."""
    return np.abs(work(ds, ds.tensile.values)) / ds.support.values[..., None]


def figure(ds):
    """Both reaches of one network, and the part of the support that σ > 0 attains in all."""
    figure, (left, right) = panels(
        2,
        "Stresses of any sign attain every response that the bound allows, positive ones those near\n"
        f"dilation, all with a positive Poisson's ratio ({counted(ds)} of {parameters(ds)['n_vertices']} vertices)",
        height=4.1,
    )
    draw_network_reach(left, ds.isel(seed=0), parameters(ds)["thresholds"])
    draw_parts(right, ds)
    legend_below(figure, left, ncols=3)
    lettered(left, right)
    return figure


def draw_parts(axes, ds):
    """The largest S:A over its bound in every direction, from pure shear along y to pure shear along x."""
    turn = 180 * angles(ds.sizes["direction"]) / np.pi
    axes.axhline(100, color=series(0)["color"], lw=1.2)
    axes.text(0, 102, "any sign", fontsize=9, color=series(0)["color"], ha="center", va="bottom")
    for n, part in enumerate(np.moveaxis(100 * attained(ds), 2, 0)):
        style = series(1 + n)
        axes.plot(turn, part.mean(axis=0), ms=3, lw=1, **style)
        axes.fill_between(turn, part.min(axis=0), part.max(axis=0), color=style["color"], alpha=0.2, lw=0)
    axes.set_xticks([-90, 0, 90], ["pure\nshear", "dilation", "pure\nshear"])
    axes.set(ylabel="$S:A$ over its bound  [%]", ylim=(0, 115), title="strains A that they resist")


def draw_network_reach(axes, one, thresholds):
    """The ellipse of the bound, the responses that attain it, and those of positive stresses."""
    turn, support = angles(one.sizes["direction"]), one.support.values
    unit = support[np.argmin(np.abs(turn))] / 2
    # The support function of the ellipse is √(aᵀ Q a): three numbers, known exactly from any three directions.
    a = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    products = np.stack([a[:, 0] ** 2, 2 * a[:, 0] * a[:, 1], a[:, 1] ** 2], axis=1)
    xx, xy, yy = np.linalg.lstsq(products, support**2, rcond=None)[0]
    circle = np.linspace(0, 2 * np.pi, 200)
    ellipse = np.linalg.cholesky([[xx, xy], [xy, yy]]) @ [np.cos(circle), np.sin(circle)] / 2
    axes.plot(*ellipse / unit, color="k", lw=0.8, label="closed-form bound")
    signed = one.signed.values / unit
    axes.scatter(*np.concatenate([signed, -signed]).T, s=14, label="attained, any sign", **series(0))
    axes.scatter(*one.sampled.values.T / unit, s=4, color="0.6", label="random σ > 0")
    for n, threshold in enumerate(thresholds):
        label = f"σ > 0, at least about {threshold:g} r.m.s."
        axes.scatter(*one.tensile.values[:, n].T / unit, s=14, label=label, **series(1 + n))
    edge = np.array([0, 1.15])
    axes.fill_between(edge, -edge, edge, color="0.94", zorder=-1)
    axes.text(-0.9, 0, "shaded:\n$\\nu = S_{xx}/S_{yy} > 0$", fontsize=9, color="0.35", va="center")
    axes.set(
        xlabel="$(S_{xx} + S_{yy})/2\\sqrt{VD}$", ylabel="$(S_{xx} - S_{yy})/2\\sqrt{VD}$",
        xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", title="one network, over its bound",
    )  # fmt: skip


def claims(ds):
    """The part of the reach that positive stresses attain, and their Poisson's ratios."""
    tensile = attained(ds)[..., -1]
    signed, stretched = (finite(poisson_ratio(values)) for values in (ds.signed.values, ds.tensile.values))
    n = plural(ds.sizes["seed"], "network")
    return [
        Claim(
            "reach-positive", "part of the closed-form bound on S:A that positive stresses attain, by direction", "",
            f"{np.nanmin(tensile):.2f} in pure shear to {np.nanmax(tensile):.4f} in dilation", "measured", sample=n,
        ),
        Claim(
            "reach-auxetic", "Poisson's ratios at the transition along the bound", "",
            f"from {stretched.min():.2g} to {stretched.max():.2g} for σ > 0, which is never negative, and from "
            f"{signed.min():.2g} with compressed edges", "measured", sample=n,
        ),
    ]  # fmt: skip


VARIABLES = (
    *numbers(("seed", "direction"), support="largest S:A/√(V D) over all stresses, in closed form [√k]"),
    *bounded(("seed", "direction", "axis"), signed="S/√(V D) there, mean and half the difference [√k]"),
    *bounded(("seed", "direction", "threshold", "axis"), tensile="S/√(V D) of stresses above about r [√k]"),
    *bounded(("seed", "sample", "axis"), sampled="S/√(V D) of random positive stresses [√k]"),
)
