"""The strain protocol of the paper: springs are strained in steps until they are rigid.

It stops slightly past the transition that `critical_from_lengths` finds, where slack springs are slightly compressed.
"""

from dataclasses import dataclass, replace

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, equilibrium, spring_state
from critflow.lengths import FromLengths
from critflow.manifold import critical_configuration
from critflow.networks import Array
from critflow.result import Stats
from critflow.sparse import balanced_part
from critflow.taut_edges import NO_STRESS, unknown_configuration

ENERGY_THRESHOLD = 1e-4  # energy above which the paper calls a network rigid, k = 1
STRAIN_STEPS = 2000  # steps after which the protocol stops: a strain of 20 in the default steps


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FromStrain(FromLengths):
    """The critical configuration of rest lengths ℓ by the strain protocol.

    status        `Status.slack_edges` where springs carry nothing, `Status.compressed_edges` where some push alone
    strain        γ of the recorded state, whose rest lengths are ℓ/(1 + γ)
    energy        energy of the recorded state
    rest_lengths  ℓ/(1 + γ), (N_b,)
    """

    strain: float
    energy: float
    rest_lengths: Array


def critical_by_strain(
    manifold: CriticalManifold,
    lengths: Array,
    strain_step: float = 0.01,
    energy_threshold: float = ENERGY_THRESHOLD,
) -> FromStrain:
    """The rigid state of periodic springs with rest lengths ℓ/(1 + γ), and the stress that balances at its coordinates.

    γ grows in steps of `strain_step` from 0 until the energy reaches `energy_threshold`, in units of mean k times
    (V/N_v)^(2/d).  Where the network is not rigid at γ = 0 but every edge will be stressed, the end does not depend on
    the path, and the steps of the floppy network are skipped.
    """
    network = manifold.network
    unit = network.stiffness.mean() * (network.volume / network.n_vertices) ** (2 / network.dimension)
    step = skipped = steps = 0
    threshold, x = energy_threshold * unit, network.positions
    if x is None:
        x = manifold.configuration(network.stiffness).coordinates
    state = spring_state(network, lengths, x)
    while True:
        solution = equilibrium(state, throw=False)
        state, steps = solution.value, steps + solution.stats.steps
        if not solution.ok or state.energy >= threshold:
            break
        if step - skipped >= STRAIN_STEPS:
            solution = replace(solution, status=Status.step_limit, note="take larger strain steps")
            break
        x = state.coordinates
        if step == 0:
            skipped, x = _skipped(manifold, lengths, strain_step, x)
            step = skipped
        step += 1
        state = spring_state(network, lengths / (1 + strain_step * step), x)
    state = equilibrium(state, tolerance=1e-16, max_steps=6, throw=False).value
    # From the coordinates: rounding of many steps separates the bond vectors of the state from them.
    sigma = balanced_part(network, network.bond_vectors(state.coordinates), state.sigma, state.pattern)
    # Edges of a part without stress are at their rest lengths, to rounding.
    sigma = np.where(np.abs(sigma) <= NO_STRESS * np.mean(np.abs(sigma)), 0.0, sigma)
    value = critical_configuration(network, sigma, state.coordinates)
    slack, status = np.flatnonzero(value.sigma == 0), solution.status
    if solution.ok and (value.sigma <= 0).any():
        status = Status.slack_edges if len(slack) else Status.compressed_edges
    return FromStrain(
        value=value if solution.ok else unknown_configuration(network),
        status=status,
        stats=Stats("strain, newton", steps, residual=solution.stats.residual),
        slack_edges=slack,
        strain=strain_step * step,
        energy=state.energy,
        rest_lengths=state.rest_lengths,
        note=solution.note,
    )


def critical_in_printed_box(manifold: CriticalManifold, lengths: Array) -> FromStrain:
    """The state that the strain protocol records in the box that the paper prints, V = N_b, scaled to V of the network.

    Rest lengths ℓ of mean 1 make networks in this box rigid at γ = 0 already, so that the state recorded there is far
    past the transition: edges are about 15 % longer than ℓ, and a few of them may be compressed.  Its stress
    σ = (|L| − ℓ)/|L| balances, so that it is a critical configuration.  It is computed in the box of the network, with
    ℓ smaller by the ratio of the sides and the energy threshold by its square.
    """
    network = manifold.network
    ratio = (network.n_edges / network.volume) ** (1 / network.dimension)
    recorded = critical_by_strain(manifold, lengths / ratio, energy_threshold=ENERGY_THRESHOLD / ratio**2)
    if not np.isfinite(recorded.value.coordinates).all():
        return recorded
    # The same configuration with bounds on its errors, which its stress determines where no edge is slack.
    balance = manifold.solve(recorded.value.sigma) if (recorded.value.sigma > 0).all() else recorded
    if balance.ok:
        return replace(recorded, value=balance.value)
    # As in configurations of a stress, the first vertex is at the origin.
    x = recorded.value.coordinates
    return replace(recorded, value=critical_configuration(network, recorded.value.sigma, x - x[0]))


def _skipped(manifold: CriticalManifold, lengths: Array, strain_step: float, x: Array) -> tuple[int, Array]:
    """The number of strain steps of the floppy network, and coordinates at the transition; 0 and x if edges are slack.

    With all edges stressed the rigid states follow from the unique critical configuration, for any path to it.
    """
    transition = critical_from_lengths(manifold, lengths, throw=False)
    if not transition.ok:
        return 0, x
    return max(0, int(np.floor((1 / transition.ratio - 1) / strain_step))), transition.value.coordinates
