"""Packings: balance of contact forces, the known coordination above jamming, and dilution."""

import numpy as np
import pytest

from critflow_extras import packing_network, pruned
from critflow_extras.graphs.packings import _Packing


@pytest.fixture(scope="module")
def relaxed():
    rng = np.random.default_rng(2)
    radii = rng.permutation(np.where(np.arange(80) % 2, 1.4, 1.0))
    radii *= np.sqrt(0.95 * 80 / np.sum(np.pi * radii**2))
    packing = _Packing(radii, np.sqrt(80))
    return radii, packing.relaxed(rng.random((80, 2)) * np.sqrt(80)), packing


def test_contact_forces_balance(relaxed):
    radii, x, packing = relaxed
    edges, offsets = packing.contacts(x)
    # All pairs through all near images, without lists of neighbours.
    side, force, contacts = np.sqrt(80), np.zeros_like(x), set()
    for image in np.ndindex(3, 3):
        offset = np.array(image) - 1
        apart = x[None] + side * offset - x[:, None]
        distance = np.linalg.norm(apart, axis=2) + 1e3 * np.eye(80) * (not offset.any())
        sums = radii[:, None] + radii[None]
        overlap = np.maximum(1 - distance / sums, 0)
        force -= np.einsum("ij,ijd->id", overlap / sums / distance, apart)
        contacts |= {(i, j, *offset) for i, j in np.argwhere(overlap > 1e-6)}
    assert np.abs(force).max() < 1e-8
    found = {(*edge, *offset) for edge, offset in zip(edges.tolist(), offsets.tolist(), strict=True)}
    found |= {(j, i, -p, -q) for i, j, p, q in found}
    assert found <= contacts
    # Only contacts of particles with too few of them are left out.
    assert len(contacts - found) <= 8


def test_coordination_of_packings():
    # z = z_c + c √(φ − φ_c) with z_c = 4 and c = 3.6 (O'Hern et al. 2003): 5.0 at φ = 0.92.
    network = packing_network(120, z=4.3, seed=1, density=0.92)
    assert abs(2 * network.n_edges / network.n_vertices - 4.3) <= 1 / network.n_vertices + 1e-12
    assert "every edge" in pruned(network).network.note
    particles, contacts = network.note.split()[0], int(network.note.split("without ")[1].split()[2])
    assert 2 * contacts / int(particles) == pytest.approx(5.0, abs=0.25)
    assert network.volume == pytest.approx(120)


def test_spheres():
    network = packing_network(60, z=6.0, seed=1, density=0.75, dimension=3)
    assert network.dimension == 3
    assert abs(2 * network.n_edges / network.n_vertices - 6) <= 1 / network.n_vertices + 1e-12
