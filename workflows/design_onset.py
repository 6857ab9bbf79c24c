"""Onset on demand: rest lengths whose critical shear is prescribed, and the range of onsets at one bulk modulus.

Networks of equal rest lengths, longer than at the isotropic transition by a few per cent, become rigid under simple
shear at some γ_c.  Their rest lengths are changed as little as possible until γ_c has another value.  At rest,
stresses with one B_0 belong to different rest lengths; lengthened alike, they become rigid at different shears.
"""

import numpy as np

import critflow as cf
from critflow.workflow import Claim

from .shared.checks import voronoi_check
from .shared.figures import legend_below, lettered, panels, signed
from .shared.reports import parameters, series
from .shared.tables import bounded, network_study, numbers, outcomes, seconds, stacked, timed


def case(parameters, *, seed):
    """Designs of one network."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    network, longer = manifold.network, 1 + parameters["excess"]
    equal = np.ones(network.n_edges)
    lengths = longer * cf.critical_from_lengths(manifold, equal, throw=False).ratio * equal
    strain = cf.critical_strain(network, lengths, "simple_shear").value.strain
    designs = [designed(network, lengths, factor * strain) for factor in parameters["factors"]]
    onsets = [onset(manifold, longer, modulus) for modulus in parameters["moduli"]]
    return {"status": cf.Status.ok, **stacked(designs), **stacked(onsets)}


def designed(network, lengths, target):
    """Rest lengths of one onset, computed again from them."""
    start, targets = cf.spring_state(network, lengths, network.positions), {"onset[simple_shear]": target}
    made, time = timed(cf.design, start, targets, change="rest_lengths", throw=False)
    side = int(np.sign(target))
    again = cf.critical_strain(network, made.value.rest_lengths, "simple_shear", direction=side, throw=False)
    return {
        "target": target,
        "achieved": again.value.strain,
        "achieved_error_bound": again.stats.error_bound,
        "distance": made.distance,
        "target_status": made.status,
        "target_seconds": time,
    }


def onset(manifold, longer, modulus):
    """Critical shear of the lengths of a design of B_0, lengthened alike."""
    critical = cf.design(manifold, {"B_0": modulus}, throw=False).value
    onset = cf.critical_strain(manifold.network, longer * critical.lengths, "simple_shear", throw=False)
    return {"shear": onset.value.strain, "shear_error_bound": onset.stats.error_bound, "shear_status": onset.status}


def figure(ds):
    """Changes of the rest lengths for the requested onsets, and onsets at given moduli."""
    figure, (left, right) = panels(
        2,
        f"Onset in simple shear on demand: $N_v$ = {parameters(ds)['n_vertices']}, {ds.sizes['seed']} networks, "
        f"lengths {100 * parameters(ds)['excess']:g} % above the isotropic transition",
        height=4.0,
    )
    for n, factor in enumerate(parameters(ds)["factors"]):
        target, style = ds.target.values[:, n], series(n)
        label = f"{signed(factor)} times the onset of equal rest lengths"
        left.scatter(target, ds.distance.values[:, n], s=18, label=label, **style)
    left.set(
        xlabel="requested onset $\\gamma_c$", ylabel="change of $\\log\\ell$ (r.m.s.)", ylim=(0, None),
        title="change of the rest lengths",
    )  # fmt: skip
    legend_below(figure, left, ncols=3)
    for shear in ds.shear.values:
        right.plot(parameters(ds)["moduli"], shear, markersize=4, linewidth=0.8, alpha=0.6, **series(0))
    right.set(
        xlabel="$B_0$ at the isotropic transition  [k]", ylabel="onset $\\gamma_c$ in simple shear",
        title="onsets at given $B_0$",
    )  # fmt: skip
    lettered(left, right)
    return figure


def claims(ds):
    """Errors of the requested onsets."""
    error = np.abs(ds.achieved.values - ds.target.values)
    reached = error <= 1e-9
    return [
        Claim.tested(
            "design-onset-reached", "a prescribed critical shear is reached to 1e-9 by rest lengths", "all",
            f"{reached.sum()} of {reached.size}, largest error {np.nanmax(error):.1e}", reached.all(),
            "the others have no such lengths in these ratios", criterion="1e-9, every target",
            sample=f"{reached.size} targets", kind="check",
        )
    ]  # fmt: skip


study = network_study(
    name="design_onset",
    title="Onset of rigidity on demand",
    parameters={"n_vertices": 100, "excess": 0.05, "factors": (0.6, 1.3, -1.0), "moduli": (0.27, 0.25, 0.22, 0.18)},
    case=case,
    check=voronoi_check(),
    variables=(
        *numbers(
            ("seed", "factor"),
            target="requested critical shear",
            distance="root mean square change of log rest length",
        ),
        *bounded(("seed", "factor"), achieved="critical shear of the designed rest lengths, by critical_strain"),
        *outcomes(("seed", "factor"), target_status="outcome of the design"),
        *seconds(("seed", "factor"), target_seconds="processor time of the design [s]"),
        *bounded(("seed", "modulus"), shear="critical shear of its lengths, lengthened alike"),
        *outcomes(("seed", "modulus"), shear_status="outcome of its search"),
    ),
    figures={"onset": figure},
    claims=claims,
)
