"""The study of reference numbers end to end, small: exact numbers, signs of disagreement, figures."""

import numpy as np
import pytest
from problems import SQRT3
from workflows.reference_numbers import measures

from critflow import lattice, voronoi_network
from critflow.engine.code_digest import load_study

STUDY = "reference_numbers"


def value(dataset, quantity):
    return dataset.value.sel(quantity=quantity).values


def test_exact_numbers(dataset):
    np.testing.assert_allclose(value(dataset, "hexagon_shape"), np.sqrt(8 * SQRT3), rtol=1e-12)
    length = np.sqrt(4 / (3 * SQRT3))
    np.testing.assert_allclose(value(dataset, "honeycomb_length"), length, rtol=1e-12)
    np.testing.assert_allclose(value(dataset, "honeycomb_shear"), 3 / 8 * length, rtol=1e-6)
    assert ((value(dataset, "auxetic") > -1) & (value(dataset, "auxetic") < 1 / 3)).all()


def test_claims_follow_the_stored_values(dataset):
    claims = load_study(STUDY).study.claims
    verdicts = {claim.key: claim.verdict for claim in claims(dataset)}
    assert verdicts["hexagon_shape"] == verdicts["tension_voronoi"] == "holds"
    worse = dataset.copy(deep=True)
    worse["value"] = dataset.value + 1
    assert {claim.verdict for claim in claims(worse)} == {"differs"}


def test_reflex_corners():
    network = voronoi_network(20, seed=1)
    L = network.bond_vectors(network.positions)
    assert not measures.reflex(network.faces, L).any()
    # A vertex at distance from its three neighbours sees them in a half-plane, which leaves a reflex corner.
    moved = network.positions.copy()
    moved[0] += 3.0
    assert measures.reflex(network.faces, network.bond_vectors(moved)).any()


def test_poissons_ratio_of_the_triangular_lattice():
    assert measures.poisson(lattice("triangular", 4, 4)) == pytest.approx(1 / 3, rel=1e-12)
