"""Arrays of configurations and states cannot be written to, and those of the user stay as they are."""

import copy
import pickle

import numpy as np
import pytest

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    critical_from_lengths,
    optimize,
    spring_state,
    strain_path,
    voronoi_network,
)

NETWORK = voronoi_network(20, seed=1)
ARRAYS = ("sigma", "coordinates", "bond_vectors", "lengths")


def records():
    manifold = CriticalManifold(NETWORK)
    best = optimize(manifold, "B_0").value
    loose = critical_from_lengths(manifold, np.linspace(0.2, 1.8, 30), throw=False).value
    state = spring_state(NETWORK, best.lengths, best.coordinates)
    yield from (best, loose, manifold.configuration(np.ones(30)), state, *strain_path(best, [0.01]).value.states)


@pytest.mark.parametrize(
    "copied",
    [lambda one: one, lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy, copy.copy],
    ids=["itself", "pickled", "deep copy", "copy"],
)
@pytest.mark.parametrize("n", range(5))
def test_arrays_cannot_be_written_to_nor_can_those_of_copies(n, copied):
    one = copied(list(records())[n])
    for holder, names in ((one, ARRAYS), (one.network, ("edges", "cell", "stiffness", "positions"))):
        for name in names:
            with pytest.raises(ValueError, match="read-only"):
                getattr(holder, name)[:] = 1.0


def test_arrays_of_the_user_stay_writeable():
    sigma, x = np.ones(30), NETWORK.positions.copy()
    L = NETWORK.bond_vectors(x)
    critical = CriticalConfiguration(NETWORK, sigma, x, L)
    for array in (sigma, x, L):
        array *= 1.0
    assert not critical.sigma.flags.writeable
