"""Rest lengths → critical configuration, by the cone program or by straining springs until they are rigid.

Given rest lengths ℓ, shrinking them all alike (the same as expanding the box) drives the network to a critical
configuration.  The cone program finds it at once and says which edges stay slack; the strain protocol of the paper
walks there in steps and stops a little past it, where springs that stayed slack are slightly compressed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.critical.manifold import COLLAPSED, CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.linalg.factor import FixedPattern
from critflow.linalg.matrices import edge_blocks
from critflow.mechanics.equilibrium import equilibrium, relaxation_method
from critflow.mechanics.springs import spring_state
from critflow.networks.network import Array, Network, edge_values
from critflow.result import InputError, NetworkError, Solution, Stats, Status
from critflow.solvers.cone import distance, fit_lengths, polish

# A stress below this part of the mean counts as none.
NO_STRESS = 1e-9

# Tolerances of the cone program that tell slack edges from weakly stressed ones: nearly always, and as good as always.
_TELLS_SLACK = (1e-12, 1e-13)
# With about this tolerance Newton's method, which is far cheaper, does the rest where every edge is stressed.  Tensions
# that balance at the right lengths prove that they are.
_STARTS_NEWTON = 1e-6
# Rest lengths with logarithms that spread by more leave edges slack in most networks: no cheap try.
_EVEN = 0.12
# Relative error of the lengths that Newton must reach on the stressed edges; short edges limit it by rounding.
_FITTED = 1e-9


def critical_from_lengths(
    network: Network | CriticalManifold,
    rest_lengths: ArrayLike,
    method: str = "auto",
    *,
    relaxation: str = "auto",
    strain_step: float = 0.01,
    energy_threshold: float = 1e-4,
    throw: bool = True,
) -> Solution[CriticalConfiguration]:
    """The critical configuration that rest lengths ℓ (N_b,) lead to when the box expands.

    method "conic" (or "auto"): lengths proportional to ℓ on every stressed edge, exactly at the transition.  Edges
    without tension are listed in `stats.details["slack_edges"]`, have σ = 0 and set `Status.slack_edges`.
    `stats.error_bound` bounds the error of every coordinate against the exact configuration with these ratios; where
    edges are slack, coordinates are not determined and it is NaN.  The bounds of the configuration itself are, as
    always, against the exact one of its stress.
    method "strain": ℓ/(1 + γ) with γ in steps of `strain_step` from 0 until the energy reaches `energy_threshold`,
    relaxed by the method `relaxation` of `equilibrium`; the recorded state is then slightly past the transition.
    Where the cone program shows that every edge will be stressed, the end does not depend on the way, and the steps
    of the floppy network are skipped (not by "fire").
    """
    manifold = CriticalManifold.of(network)
    lengths = edge_values(rest_lengths, manifold.network.n_edges, "rest_lengths")
    if method in ("auto", "conic"):
        solution = _by_cone(manifold, lengths)
    elif method == "strain":
        if not (strain_step > 0 and energy_threshold > 0):
            raise InputError("the strain step and the energy threshold must be positive")
        solution = _by_strain(manifold, lengths, relaxation_method(relaxation), strain_step, energy_threshold)
    else:
        raise InputError(f"no method is called {method!r}: choose 'auto', 'conic' or 'strain'")
    return solution.or_raise("these rest lengths have no all-tension critical configuration") if throw else solution


def stressed_fraction(sigma: Array) -> float:
    """Part of the edges that carry tension: σ above rounding of its mean."""
    return float(np.mean(sigma > NO_STRESS * np.mean(np.abs(sigma))))


def _by_cone(manifold: CriticalManifold, lengths: Array) -> Solution[CriticalConfiguration]:
    network, iterations = manifold.network, 0
    if lengths.min() <= COLLAPSED * lengths.mean():
        note = f"edge {lengths.argmin()} is to be so short that rounding of coordinates hides it: lengthen it"
        return Solution(_unknown(network), Status.stalled, Stats("conic", details={"note": note}))
    even = float(np.std(np.log(lengths))) < _EVEN
    for tolerance in (_STARTS_NEWTON, *_TELLS_SLACK) if even else _TELLS_SLACK:
        cone = fit_lengths(network, lengths, tolerance)
        iterations += cone.iterations
        rounds, guess = 8, cone.stressed
        if tolerance == _STARTS_NEWTON:
            rounds, guess = 1, np.ones(network.n_edges, bool)
        elif not cone.solved:
            return Solution(_unknown(network), Status.stalled, Stats("conic", iterations))
        stressed, polished, value, error, steps = _polish_stressed(
            manifold, lengths, guess, cone.coordinates, cone.sigma, rounds
        )
        if error < _FITTED and (stressed.all() or tolerance < _STARTS_NEWTON):
            break
    slack = np.flatnonzero(~stressed)
    status = Status.slack_edges if len(slack) else Status.ok
    ratio = float((value.lengths / lengths)[stressed].mean()) if error < _FITTED else cone.ratio
    details = {"ratio": ratio, "slack_edges": slack, "polish_steps": steps}
    if len(slack):
        details["note"] = (
            f"{len(slack)} of {network.n_edges} edges are slack, edge {slack[0]} among them; narrow the lengths"
        )
    bound, condition = np.nan, polished.condition
    if not error < _FITTED:
        value, status = _unknown(network), Status.stalled
    elif status is Status.ok:
        bound = 2 * distance(manifold.saddle, network, lengths, value.coordinates, value.sigma)
    stats = Stats("conic", iterations, iterations + steps, error, details, condition, bound)
    return Solution(value, status, stats)


def _unknown(network: Network) -> CriticalConfiguration:
    """What stands for a configuration that was not found."""
    shape = (network.n_edges, network.dimension)
    coordinates = np.full((network.n_vertices, network.dimension), np.nan)
    return CriticalConfiguration(network, np.full(network.n_edges, np.nan), coordinates, np.full(shape, np.nan))


def _polish_stressed(
    manifold: CriticalManifold,
    lengths: Array,
    stressed: NDArray[np.bool_],
    coordinates: Array,
    sigma: Array,
    rounds: int,
) -> tuple[NDArray[np.bool_], Stats, CriticalConfiguration, float, int]:
    """Stressed edges, how their balance was found, the configuration, relative error of the lengths and Newton steps.

    Edges whose stress turns out to be none are given up, and where Newton fails, the weakest of those that remain.
    """
    network, candidate, doubtful, taken = manifold.network, stressed, 1e-5, 0
    for _ in range(rounds):
        candidate = _without_hanging(network, candidate)
        try:
            if candidate.all():
                part, vertices = manifold, np.arange(network.n_vertices)
            else:
                cut, vertices = network.part(candidate)
                part = CriticalManifold(cut)
            # A part without pins is grounded at its own first vertex; carry it back to where that vertex was.
            origin = 0.0 if network.pins else coordinates[vertices[0]]
            start = coordinates[vertices] - origin
            _, s, error, steps = polish(part.saddle, part.network, lengths[candidate], start, sigma[candidate])
            taken += steps
            weak = s <= NO_STRESS * s.mean()
            if error < _FITTED and not weak.any():
                # Of lengths and forces, which Newton has brought down together, let the forces be exact.
                balanced = part.solve(s)
                if balanced.ok:
                    value = _with_slack(network, balanced.value, candidate, vertices, coordinates, origin)
                    return candidate, balanced.stats, value, error, taken
                error = np.inf
        except NetworkError:
            error, weak = np.inf, np.zeros(0, bool)
        if not (error < _FITTED and weak.any()):
            weak, doubtful = sigma[candidate] < doubtful * sigma.mean(), 10 * doubtful
        candidate = candidate.copy()
        candidate[np.flatnonzero(candidate)[weak]] = False
        if not candidate.any():
            break
    return stressed, Stats("force density"), _unknown(network), np.inf, taken


def _with_slack(
    network: Network,
    part: CriticalConfiguration,
    stressed: NDArray[np.bool_],
    vertices: NDArray[np.int64],
    coordinates: Array,
    origin: Array | float,
) -> CriticalConfiguration:
    """The configuration of a network from that of its stressed part; the other vertices are where they are."""
    if stressed.all():
        return part
    x, sigma, errors = coordinates.copy(), np.zeros(network.n_edges), np.full(network.n_edges, np.nan)
    x[vertices], sigma[stressed] = part.coordinates + origin, part.sigma
    x = x if network.pins else x - x[0]
    whole = critical_configuration(network, sigma, x)
    # Short edges would lose digits in the rounding of the coordinates.
    whole.bond_vectors[stressed], errors[stressed] = part.bond_vectors, part.bond_errors
    return replace(whole, bond_errors=errors)


def _without_hanging(network: Network, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Drop edges that end at a free vertex with no other edge, again and again: they cannot carry tension."""
    kept = kept.copy()
    pinned = np.zeros(network.n_vertices, bool)
    pinned[list(network.pins or {})] = True
    while True:
        degree = np.bincount(network.edges[kept].ravel(), minlength=network.n_vertices)
        hanging = kept & ((degree == 1) & ~pinned)[network.edges].any(axis=1)
        if not hanging.any():
            return kept
        kept &= ~hanging


def balanced_part(network: Network, L: Array, sigma: Array, pattern: FixedPattern, shift: float = 1e-13) -> Array:
    """The part of σ that balances on bond vectors L, free of rounding: σ less its part along the columns of R^h.

    Where extensions have few digits, as so close to the transition, or edges are much shorter than the coordinates
    are large, forces that are zero to rounding are not small beside the tensions.
    """
    ones = np.ones(len(sigma))
    factor = pattern.factorize(edge_blocks(ones, L, 0 * ones), shift)
    for _ in range(3):
        force = network.divergence @ (sigma[:, None] * L)
        u = factor.solve(force.ravel()).reshape(force.shape)
        sigma = sigma - np.einsum("ad,ad->a", L, network.free_incidence @ u)
    return sigma


def _by_strain(
    manifold: CriticalManifold, lengths: Array, relaxation: str, strain_step: float, energy_threshold: float
) -> Solution[CriticalConfiguration]:
    network, pattern = manifold.network, manifold.hessian
    x = network.positions
    if x is None:
        x = manifold.configuration(network.stiffness).coordinates
    iterations, step, skipped = 0, 0, 0
    if relaxation == "newton":
        transition = _by_cone(manifold, lengths)
        if transition.ok:
            # All edges stressed: the rigid states follow from the unique critical one, whatever came before.
            step = skipped = max(0, int(np.floor((1 / transition.stats.details["ratio"] - 1) / strain_step)) + 1)
            x = transition.value.coordinates
    state = spring_state(network, lengths / (1 + strain_step * step), x)
    while True:
        solution = equilibrium(state, relaxation, pattern=pattern, throw=False)
        state, iterations = solution.value, iterations + solution.stats.steps
        if not solution.ok or state.energy >= energy_threshold:
            break
        step += 1
        state = spring_state(network, lengths / (1 + strain_step * step), state.coordinates)
    if relaxation == "newton":
        state = equilibrium(state, tolerance=1e-16, max_steps=6, pattern=pattern, throw=False).value
    # From the coordinates that are recorded, since many steps have rounded theirs and the bond vectors apart.
    sigma = balanced_part(network, network.bond_vectors(state.coordinates), state.sigma, pattern)
    value = critical_configuration(network, sigma, state.coordinates)
    slack = np.flatnonzero(value.sigma <= NO_STRESS * np.mean(np.abs(value.sigma)))
    status = solution.status if not solution.ok else Status.slack_edges if len(slack) else Status.ok
    if not solution.ok:
        value = _unknown(network)
    details = {
        "strain": strain_step * step,
        "energy": state.energy,
        "slack_edges": slack,
        "skipped_steps": skipped,
        "rest_lengths": state.rest_lengths,
    }
    return Solution(
        value, status, Stats(f"strain, {relaxation}", iterations, residual=solution.stats.residual, details=details)
    )
