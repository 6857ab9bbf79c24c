"""Design of stiffnesses: isotropic tensors reached and verified by explicit relaxation, gradients, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative

from critflow import (
    CritflowError,
    InputError,
    Network,
    SolveError,
    Status,
    delaunay_network,
    lattice,
    spring_state,
    voronoi_network,
)
from critflow_extras import design
from critflow_extras.design_stiffness.stiffnesses import Stiffnesses, isotropic_targets
from critflow_extras.targets.problem import TargetProblem, parse_targets
from critflow_extras.targets.targets import least_change

CELL = delaunay_network(24, seed=2)


def at_rest(network):
    L = network.bond_vectors(network.positions)
    return spring_state(network, np.linalg.norm(L, axis=1), network.positions)


def changed(network, targets, **options):
    return design(at_rest(network), targets, change="stiffness", **options)


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
    found = changed(CELL, isotropic_targets(2, 2.0, ratio))
    C = 2.0 / (1 - ratio**2) * np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]])
    np.testing.assert_allclose(relaxed_tensor(found.value.network), C, rtol=0, atol=1e-9)
    assert found.solved.value.poisson([1, 2], [2, -1]) == pytest.approx(ratio, abs=1e-9)
    assert found.independent and found.stats.residual < 1e-9 and max(one.error for one in found.targets.values()) < 1e-9


@pytest.mark.parametrize("ratio", [-0.8, -0.5, 0.0, 0.9])
def test_poissons_ratio_is_a_target(ratio):
    """By name, without a modulus: C is isotropic, its ratio is that requested, its scale nearest to the start."""
    found = changed(CELL, {"poisson": ratio})
    C = relaxed_tensor(found.value.network)
    isotropic = np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]])
    np.testing.assert_allclose(C / C[0, 0], isotropic, rtol=0, atol=1e-8)
    assert found.reached and found.independent and found.targets["poisson"].value == pytest.approx(ratio, abs=1e-8)
    assert found.distance < changed(CELL, isotropic_targets(2, 5 * found.solved.value.young([1, 0]), ratio)).distance


def test_poissons_ratio_has_limits_a_scale_and_an_extreme():
    inside = changed(CELL, {"poisson": (-0.6, -0.4)})
    assert inside.targets["poisson"].value == pytest.approx(-0.4, abs=1e-6)
    scaled = changed(CELL, {"poisson": -0.4, "C_xxxx": 3.0})
    assert relaxed_tensor(scaled.value.network)[:2, 0] == pytest.approx([3.0, -1.2], abs=1e-8)
    limited = changed(CELL, {"poisson": "smallest"}, within={"stiffness": (0.5, 2.0)}, throw=False)
    assert limited.reached and limited.targets["poisson"].value < 0.25
    assert limited.value.network.stiffness.min() > 0.5 - 1e-6 and limited.value.network.stiffness.max() < 2 + 1e-6


def test_a_design_for_moduli_alone_says_where_it_is_anisotropic():
    found = changed(delaunay_network(30, seed=1), {"B_0": 1.5, "G_0": 0.2})
    C = relaxed_tensor(found.value.network)
    assert f"anisotropic, C_xxxx = {C[0, 0]:.3g}, C_yyyy = {C[1, 1]:.3g}: " in found.note and "'poisson'" in found.note
    sheared = changed(lattice("triangular", 4, 4), {"B_0": 1.0, "modulus[uniaxial]": 2.0})
    assert "anisotropic" in sheared.note
    # Isotropic ones say nothing, nor those of which components are requested.
    ratio = (1.5 - 0.2) / (1.5 + 0.2)
    for targets in ({"B_0": 1.5, "poisson": ratio}, {"B_0": 1.5, "G_0": 0.2, "poisson": ratio}, {"C_xxxx": 3.0}):
        silent = changed(CELL, targets)
        assert silent.status is Status.ok and silent.note == ""
    assert changed(lattice("triangular", 4, 4), {"B_0": 1.5}).note == ""


def test_poissons_ratio_in_space():
    # A face-centred cubic crystal, moved at random: with inversion symmetry the ratio would be that of Cauchy, 1/4.
    x = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    places = np.concatenate([x + np.array([i, j, k]) for i in range(2) for j in range(2) for k in range(2)])
    shifts = 2 * np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    apart = np.linalg.norm(places[None, :, None] + shifts[None, None] - places[:, None, None], axis=-1)
    a, b, s = np.nonzero(apart < 0.75)
    kept = (a < b) | ((a == b) & (s > 13))
    network = Network(np.stack([a, b], 1)[kept], shifts[s[kept]] // 2, 2 * np.eye(3), positions=places)
    network = replace(network, positions=places + 0.1 * np.random.default_rng(1).normal(size=places.shape))
    found = changed(network, {"poisson": 0.2})
    C = found.solved.value
    for direction in ([1, 0, 0], [1, 2, 3]):
        across = np.cross(direction, [0.3, -1, 0.2])
        assert C.poisson(direction, across) == pytest.approx(0.2, abs=1e-7)


@pytest.mark.parametrize(
    ("targets", "options", "word"),
    [
        ({"poisson": 1.5}, {}, "between -1 and 1 in 2 dimensions"),
        ({"poisson": -1.1}, {}, "between -1 and 1 in 2 dimensions"),
        ({"poisson": "low"}, {}, "poisson must be a number"),
        ({"poisson"}, {}, r"such as {'B_0': 0.25}, not a set"),
        ({"B_0": 1.0}, {"within": {"stiffness": (0, 1), "stiffnesses": (0, 2)}}, "stiffnesses are given twice"),
    ],
)
def test_wrong_ratios_are_one_sentence(targets, options, word):
    with pytest.raises(CritflowError, match=word):
        changed(CELL, targets, **options)


def test_a_ratio_of_a_change_that_has_none_names_the_one_that_has():
    with pytest.raises(InputError, match="poisson is a target of change='stiffness', not of change='stress'"):
        design(voronoi_network(16, seed=1), {"poisson": -0.5})


def test_few_self_stresses_have_no_isotropic_tensor():
    few = Stiffnesses(at_rest(CELL))
    few.n_self_stresses = 2
    parsed = parse_targets(CELL, few.all_targets(CELL, {"poisson": 0.1}))
    assert "rank 3, and 2 self-stresses" in few.refusal(parsed)


def test_gradients_agree_with_differences():
    theta = 0.5 * np.random.default_rng(3).normal(size=CELL.n_edges)
    variables = Stiffnesses(at_rest(CELL))
    goals = TargetProblem(variables, least_change(variables), parse_targets(CELL, isotropic_targets(2, 1.0, 0.1)))
    direction = np.random.default_rng(4).normal(size=CELL.n_edges)
    rows = goals.at(theta).rows(np.arange(6))
    constraints = lambda z: goals.at(z).constraints  # noqa: E731
    assert_derivative(constraints, lambda change: rows @ change, theta, [direction], 1e-4, 1e-8, 1e-10)


def test_a_value_that_the_network_has_changes_nothing_and_an_interval_is_entered():
    network = lattice("triangular", 4, 4)
    G = float(np.sqrt(3) / 4)
    found = changed(network, {"shear_modulus": G, "bulk_modulus": (0.5, 2.0)})
    assert found.distance < 1e-10
    entered = changed(network, {"bulk_modulus": (1.0, 2.0)})
    assert entered.targets["bulk_modulus"].value == pytest.approx(1.0, rel=1e-5)
    raised = changed(network, {"bulk_modulus": 1.0})
    # The least change that raises one modulus multiplies all edges of the lattice by the same factor.
    np.testing.assert_allclose(raised.value.network.stiffness, 2 / np.sqrt(3), rtol=1e-8)
    assert raised.targets["bulk_modulus"].multiplier == pytest.approx(
        network.n_edges * np.log(2 / np.sqrt(3)), rel=1e-6
    )


def test_tensors_that_no_springs_have_are_refused():
    targets = isotropic_targets(2, 1.0, 0.2) | {"C_xyxy": -0.1}
    with pytest.raises(SolveError, match="eigenvalue"):
        changed(CELL, targets)
    # In any unit, and not for an eigenvalue that rounding makes negative.
    flat = {"C_xxxx": 1.0, "C_yyyy": 1.0, "C_xxyy": 1 + 1e-14, "C_xyxy": 0.3, "C_xxxy": 0.0, "C_yyxy": 0.0}
    for unit in (1e-9, 1.0, 1e9):
        notes = [
            Stiffnesses(at_rest(CELL)).refusal(parse_targets(CELL, {name: unit * C for name, C in tensor.items()}))
            for tensor in (flat | {"C_xxyy": 1.1}, flat)
        ]
        assert "eigenvalue" in notes[0] and notes[1] == ""
    for name in ("B_0", "modulus[uniaxial]", "C_xyxy"):
        found = changed(CELL, {name: -0.1}, throw=False)
        assert found.status is Status.infeasible and f"{name} of springs at rest is never negative" in found.note
    assert not Stiffnesses(at_rest(CELL)).refusal(parse_targets(CELL, {"C_xxyy": -0.1}))
    variables, targets = Stiffnesses(at_rest(CELL)), parse_targets(CELL, isotropic_targets(2, 1.0, 0.2))
    assert not variables.refusal(targets)
    variables.n_self_stresses = 2
    assert "rank 3" in variables.refusal(targets)
    # B is the mean of three of these components for all stiffnesses.
    contradictory = {"bulk_modulus": 1.0, "C_xxxx": 0.5, "C_yyyy": 0.5, "C_xxyy": 0.1}
    found = changed(CELL, contradictory, throw=False)
    assert found.status is Status.not_reached and not found.reached and not found.independent


def test_bad_input_raises_one_sentence():
    floppy = voronoi_network(24, seed=1)
    for network, targets, word in (
        (CELL, {"V_L": 1.0}, "elasticity tensor"),
        (floppy, {"bulk_modulus": 1.0}, "zero modes"),
        (lattice("square", 3, 3), {"bulk_modulus": 1.0}, "zero modes"),
    ):
        with pytest.raises(InputError, match=word):
            changed(network, targets)
    limited = changed(CELL, {"B_0": 1.5}, within={"stiffnesses": (0.5, 3.0)})
    k = limited.value.network.stiffness
    assert limited.reached and 0.5 <= k.min() * (1 + 1e-9) and k.max() <= 3.0 * (1 + 1e-9)
    for arguments in ((2, 1.0, 1.0), (3, 1.0, 0.5), (2, -1.0, 0.1), (4, 1.0, 0.1)):
        with pytest.raises(InputError):
            isotropic_targets(*arguments)
