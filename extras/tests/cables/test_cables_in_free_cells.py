"""Cables in a cell with free components, for which `rest` has the unknowns."""

import numpy as np
import pytest
from problems import critical_of

from critflow import Cable, CriticalManifold, Deformation, Status, lattice, spring_state, strain_path
from critflow import voronoi_network as voronoi
from critflow.taut_edges import OnsetState, taut_part
from critflow_extras import critical_strain, fibre_network, packing_network
from critflow_extras.cables.boundary_path import BoundaryPath


@pytest.mark.parametrize(
    "network", [voronoi(24, seed=1), packing_network(24, z=3.6, seed=2), fibre_network("mikado", 40, z=3.4, seed=1)]
)
def test_cables_do_not_hold_free_sides_apart(network):
    # Cables only pull, Σ σ L_y² = 0 leaves those along x taut, whatever the height of the cell.
    lengths = 1.05 * np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, lengths, "uniaxial_free")
    strains = onset.value.strain + np.array([-1e-3, 1e-6, 1e-3, 0.3, 2.0])
    path = strain_path(
        spring_state(network, lengths, network.positions, Cable()), strains, "uniaxial_free", throw=False
    )
    assert path.value.status.tolist() == [Status.ok, Status.floppy, *[Status.missing] * 3]
    assert "free components" in path.note and len(path.value.states) == 1 and path.stats.steps < 100
    # Each strain by itself: at large ones all chains are taut and pull the cell flat.
    for strain in strains[1:]:
        end = strain_path(onset, [strain - onset.value.strain], "uniaxial_free", throw=False)
        assert end.status is Status.floppy and np.isnan(end.value.bulk_modulus).all()


def test_cables_in_tension_pull_a_free_cell_flat():
    network = lattice("triangular", 4, 4)
    state = spring_state(network, np.full(network.n_edges, 0.9), network.positions, Cable())
    end = strain_path(state, [0.0, 0.01], "uniaxial_free", throw=False)
    assert end.status is Status.floppy and "flat" in end.note
    assert strain_path(state, [0.0, 0.01], "uniaxial").ok


def test_a_sheared_cell_that_is_free_resists_beyond_its_onset():
    critical, path = critical_of(voronoi(60, seed=0)), Deformation.uniaxial(2).freeing("xy")
    onset = critical_strain(critical.network, critical.lengths, path)
    assert onset.value.valid_for_springs and 1e-4 < onset.value.strain
    below, above = (strain_path(critical, [factor * onset.value.strain], path, throw=False) for factor in (0.8, 1.5))
    assert below.status is Status.floppy and above.ok
    E = path.free_strains[0]
    rate = E @ np.linalg.inv(np.eye(2) + above.value.free_components[0] * E)
    assert above.value.energy[0] > 1e-8 and abs(np.sum(above.value.stress[0] * rate)) < 1e-14


@pytest.mark.parametrize("length, stress", [(1.0, 1.0), (2.0**30, 1.0), (2.0**-21, 2.0**40)])
def test_the_error_of_a_state_counts_the_stress_of_a_free_component(length, stress):
    # Forces and lengths are right, the shear of the cell is not: Σ σ L_x L_y/Σ σ |L|² is left.
    critical = critical_of(voronoi(40, seed=1))
    manifold = CriticalManifold(critical.network.deformed(length * np.eye(2)))
    path = BoundaryPath(manifold, Deformation.uniaxial(2).freeing("xy"))
    x, sigma = length * critical.coordinates[critical.network.free], stress * critical.sigma
    state = OnsetState(0.0, np.zeros(1), x, sigma, np.ones(len(sigma), bool))
    error = taut_part(path, state.taut).equations(path, length * critical.lengths, state)[0]
    S = critical.bond_vectors.T @ (critical.sigma[:, None] * critical.bond_vectors)
    assert error == pytest.approx(abs(S[0, 1]) / np.trace(S), rel=1e-9) and error > 1e-4
