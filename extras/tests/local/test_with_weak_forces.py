"""Local responses of states whose Hessian has more than edges: weak forces, and springs on perimeters."""

import numpy as np
import pytest

from critflow import optimize, strain_path, voronoi_network
from critflow_extras import AngleSprings, critical_from_perimeters, local_response
from critflow_extras.weak.weak_equilibrium import weak_equilibrium

NETWORK = voronoi_network(40, seed=2)
CRITICAL = optimize(NETWORK, "B_0").value
PAIRS = (0, 9), [(4, 15), (3, 30)]


def dense(state, found):
    """η by the dense Hessian of the factor of a state."""
    factor, network = state.factorize(), state.network
    H = np.array([factor.multiply(one) for one in np.eye(2 * len(network.free))])
    rows, lengths = [], []
    for pair in (found.source, *found.targets):
        r = state.coordinates[pair.head] - state.coordinates[pair.tail] + np.array(pair.image) @ network.cell
        a = np.zeros_like(state.coordinates)
        a[pair.head], a[pair.tail] = r / np.linalg.norm(r), -r / np.linalg.norm(r)
        rows.append(a[network.free].ravel())
        lengths.append(np.linalg.norm(r))
    moved = np.array(rows) @ np.linalg.solve(H, rows[0])
    return moved[1:] / moved[0] * lengths[0] / np.array(lengths[1:])


@pytest.mark.parametrize("kappa", [1e-3, 1e-5, 1e-7])
def test_states_with_weak_forces(kappa):
    state = weak_equilibrium(CRITICAL, AngleSprings(), [0.0], kappa).value.states[0]
    found = local_response(state, *PAIRS).value
    np.testing.assert_allclose(found.strains, dense(state, found), rtol=0, atol=1e-17 / kappa + 1e-12)
    assert (found.errors < 1e-8).all()


def test_far_above_the_transition_weak_forces_do_not_matter():
    """At the transition they do, however weak: the network is displaced by as much as the stress is small."""
    bare = strain_path(CRITICAL, [1e-3]).value.states[-1]
    expected = local_response(bare, *PAIRS).value.strains
    apart = {
        strain: local_response(weak_equilibrium(CRITICAL, AngleSprings(), [strain], 1e-9).value.states[0], *PAIRS)
        for strain in (0.0, 1e-3)
    }
    assert np.abs(apart[1e-3].value.strains - expected).max() < 1e-5
    assert np.abs(apart[0.0].value.strains - expected).max() > 1e-3


def test_springs_on_perimeters():
    tissue = critical_from_perimeters(NETWORK, np.ones(20)).value
    state = strain_path(tissue, [0.01]).value.states[-1]
    found = local_response(state, *PAIRS, throw=False)
    assert found.ok
    np.testing.assert_allclose(found.value.strains, dense(state, found.value), atol=1e-9)
