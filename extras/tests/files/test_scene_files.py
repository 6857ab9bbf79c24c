"""The files and graphs of the scene and those of the extras are the same, bit by bit."""

import numpy as np
import pytest

import critflow as cf
import critflow_extras as ce

PLANE = cf.voronoi_network(32, seed=1).deformed([[1.0, 0.3], [0.0, 1.2]]).with_stiffness(np.linspace(1, 3, 48))
NETWORKS = {
    "plane": PLANE,
    "space": cf.lattice("diamond", 2, 2, 2),
    "pinned": cf.Network(
        *([[0, 3], [1, 3], [2, 3]], None, None, [1.0, 0.1, 1 / 3], {0: [0, 0], 1: [4, 0], 2: [0, 3]}),
        positions=[[0, 0], [4, 0], [0, 3], [1, 1 / 3]],
        reference_volume=2.5,
    ),
    "images": cf.Network(
        [[0, 1], [1, 0], [0, 1], [1, 1]],
        [[0, 0], [1, 0], [0, 1], [2, 0]],
        [[3.0, 0.0], [-0.7, 2.3]],
        positions=[[0.1, 0.2], [1.1, 0.7]],
    ),
}


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("write", [cf.write_network, ce.write_network])
def test_both_read_what_either_writes(tmp_path, name, write):
    network, path = NETWORKS[name], tmp_path / "n.csv"
    write(network, path)
    graph = cf.to_graph(network)
    for read in (
        cf.read_network(path),
        ce.network_from(path, strict=True).network,
        ce.network_from(cf.to_tables(network), cell=network.cell, volume=network.reference_volume).network,
        ce.network_from(graph, strict=True).network,
    ):
        for field in ("edges", "offsets", "cell", "stiffness", "positions"):
            np.testing.assert_array_equal(getattr(read, field), getattr(network, field))
        assert list(read.pins) == list(network.pins) and read.reference_volume == network.reference_volume


CONFIGURATIONS = {
    "without rest lengths": cf.optimize(PLANE, "B_0").value,
    "of rest lengths": cf.critical_from_lengths(PLANE, np.ones(48)).value,
}


@pytest.mark.parametrize("critical", CONFIGURATIONS.values(), ids=CONFIGURATIONS)
@pytest.mark.parametrize("write", [cf.write_network, ce.write_network])
def test_both_read_the_stresses_and_the_rest_lengths_of_a_configuration(tmp_path, write, critical):
    write(critical, tmp_path / "c.csv")
    for read in (cf.read_critical(tmp_path / "c.csv"), ce.network_from(tmp_path / "c.csv").configuration):
        np.testing.assert_array_equal(read.sigma, critical.sigma)
        np.testing.assert_array_equal(read.coordinates, critical.coordinates)
        np.testing.assert_array_equal(read.rest_lengths, critical.rest_lengths)
