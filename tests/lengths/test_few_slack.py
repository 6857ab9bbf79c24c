"""Few slack edges: found without the cone program, with the answer of it; many are left to it."""

import numpy as np
import pytest

from critflow import Status, critical_from_lengths, voronoi_network
from critflow import lengths as from_lengths


def uneven(network, spread, seed):
    return np.exp(spread * np.random.default_rng(seed + 50).standard_normal(network.n_edges))


def refuse(*_arguments):
    raise AssertionError("another guess is made")


@pytest.mark.parametrize(
    ("size", "seed", "spread", "unused"),
    [
        pytest.param(400, 2, 0.15, ["newton", "fit_lengths"], id="compressed edges"),
        pytest.param(400, 2, 0.2, ["fit_lengths"], id="relaxed cables"),
        pytest.param(400, 5, 0.2, ["fit_lengths"], id="relaxed cables, other network"),
        pytest.param(800, 5, 0.16, ["fit_lengths"], id="two edges that stretch each other only together"),
    ],
)
def test_the_answer_is_that_of_the_cone_program(monkeypatch, size, seed, spread, unused):
    network = voronoi_network(size, seed=seed)
    lengths = uneven(network, spread, seed)
    with monkeypatch.context() as patched:
        patched.setattr(from_lengths, "EVEN", 0.0)
        expected = critical_from_lengths(network, lengths, throw=False)
    for name in unused:
        monkeypatch.setattr(from_lengths, name, refuse)
    found = critical_from_lengths(network, lengths, throw=False)
    assert found.status is expected.status is Status.slack_edges
    assert found.slack_edges.tolist() == expected.slack_edges.tolist()
    assert found.ratio == pytest.approx(expected.ratio, rel=1e-14)
    np.testing.assert_allclose(found.value.sigma, expected.value.sigma, rtol=1e-11, atol=1e-13)
    slack = found.slack_edges
    held = found.value.lengths[slack] <= found.ratio * lengths[slack] * (1 + 1e-8)
    assert held.all()


FEW = from_lengths.FEW


@pytest.mark.parametrize(("few", "programs"), [(FEW, 1), (1.0, 0)])
def test_many_slack_edges_are_left_to_the_cone_program(monkeypatch, few, programs):
    network, solved = voronoi_network(n_vertices=400, seed=6), []
    lengths = uneven(network, 0.245, 6)
    fit = from_lengths.fit_lengths
    monkeypatch.setattr(from_lengths, "FEW", few)
    monkeypatch.setattr(from_lengths, "fit_lengths", lambda *arguments: solved.append(1) or fit(*arguments))
    found = critical_from_lengths(network, lengths, throw=False)
    assert len(solved) == programs and len(found.slack_edges) > FEW * network.n_edges
