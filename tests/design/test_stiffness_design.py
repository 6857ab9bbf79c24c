"""Design of stiffnesses: isotropic tensors reached and verified by explicit relaxation, gradients, refusals."""

import numpy as np
import pytest

from critflow import (
    InputError,
    SolveError,
    Status,
    delaunay_network,
    design_stiffness,
    isotropic_targets,
    square_network,
    triangular_network,
    voronoi_network,
)
from critflow.design.stiffness_design import TensorGoals

CELL = delaunay_network(24, seed=2)


def relaxed_tensor(network):
    """C by least squares over all displacements, which shares no code with the design."""
    L = network.bond_vectors(network.positions)
    unit = L / np.linalg.norm(L, axis=1)[:, None]
    strains = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]]])
    rigidity_matrix = np.zeros((network.n_edges, network.n_vertices, 2))
    for alpha, (tail, head) in enumerate(network.edges):
        rigidity_matrix[alpha, head] += unit[alpha]
        rigidity_matrix[alpha, tail] -= unit[alpha]
    root = np.sqrt(network.stiffness)[:, None]
    load = root * np.einsum("ei,aij,ej->ea", unit, strains, L)
    rows = root * rigidity_matrix.reshape(network.n_edges, -1)
    rest = load - rows @ np.linalg.lstsq(rows, load, rcond=1e-12)[0]
    return rest.T @ rest / network.volume


@pytest.mark.parametrize("ratio", [-0.8, 0.0, 0.9])
def test_an_isotropic_tensor_of_any_poissons_ratio_is_reached(ratio):
    found = design_stiffness(CELL, CELL.positions, isotropic_targets(2, 2.0, ratio))
    C = 2.0 / (1 - ratio**2) * np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]])
    np.testing.assert_allclose(relaxed_tensor(found.value), C, rtol=0, atol=1e-9)
    assert found.elasticity.poisson([1, 2], [2, -1]) == pytest.approx(ratio, abs=1e-9)
    assert found.independent and found.stats.residual < 1e-9 and found.stats.error_bound < 1e-9


def test_gradients_agree_with_differences():
    theta = 0.5 * np.random.default_rng(3).normal(size=CELL.n_edges)
    goals = TensorGoals(CELL, CELL.positions, isotropic_targets(2, 1.0, 0.1), np.ones(CELL.n_edges))
    direction = np.random.default_rng(4).normal(size=CELL.n_edges)
    step = 1e-4
    ahead, behind = (goals.at(theta + s * direction).constraints for s in (step, -step))
    further, before = (goals.at(theta + s * direction).constraints for s in (2 * step, -2 * step))
    difference = (8 * (ahead - behind) - (further - before)) / (12 * step)
    np.testing.assert_allclose(goals.at(theta).rows(np.arange(6)) @ direction, difference, rtol=1e-8, atol=1e-10)


def test_a_value_that_the_network_has_changes_nothing_and_an_interval_is_entered():
    lattice = triangular_network(4, 4)
    G = float(np.sqrt(3) / 4)
    found = design_stiffness(lattice, lattice.positions, {"shear_modulus": G, "bulk_modulus": (0.5, 2.0)})
    assert found.distance < 1e-10
    entered = design_stiffness(lattice, lattice.positions, {"bulk_modulus": (1.0, 2.0)})
    assert entered.achieved["bulk_modulus"] == pytest.approx(1.0, rel=1e-5)
    raised = design_stiffness(lattice, lattice.positions, {"bulk_modulus": 1.0})
    # The least change that raises one modulus multiplies all edges of the lattice by the same factor.
    np.testing.assert_allclose(raised.value.stiffness, 2 / np.sqrt(3), rtol=1e-8)
    assert raised.multipliers["bulk_modulus"] == pytest.approx(lattice.n_edges * np.log(2 / np.sqrt(3)), rel=1e-6)


def test_tensors_that_no_springs_have_are_refused():
    targets = isotropic_targets(2, 1.0, 0.2) | {"C_xyxy": -0.1}
    with pytest.raises(SolveError, match="eigenvalue"):
        design_stiffness(CELL, CELL.positions, targets)
    goals = TensorGoals(CELL, CELL.positions, isotropic_targets(2, 1.0, 0.2), CELL.stiffness)
    assert not goals.excess(3) and "rank 3" in goals.excess(2)
    # B is the mean of three of these components for all stiffnesses.
    contradictory = {"bulk_modulus": 1.0, "C_xxxx": 0.5, "C_yyyy": 0.5, "C_xxyy": 0.1}
    found = design_stiffness(CELL, CELL.positions, contradictory, throw=False)
    assert found.status is Status.infeasible and not found.independent


def test_bad_input_raises_one_sentence():
    floppy = voronoi_network(24, seed=1)
    for network, targets, word in (
        (CELL, {"modulus": 1.0}, "modulus"),
        (CELL, {}, "target"),
        (CELL, {"C_xxxx": (2.0, 1.0)}, "low"),
        (floppy, {"bulk_modulus": 1.0}, "zero modes"),
        (square_network(3, 3), {"bulk_modulus": 1.0}, "zero modes"),
    ):
        with pytest.raises(InputError, match=word):
            design_stiffness(network, network.positions, targets)
    for arguments in ((2, 1.0, 1.0), (3, 1.0, 0.5), (2, -1.0, 0.1), (4, 1.0, 0.1)):
        with pytest.raises(InputError):
            isotropic_targets(*arguments)
