"""Tensions and pressures that positions determine, with their standard errors."""

import numpy as np
import pytest
from refusals import refused
from scipy.stats import chi2
from tissue_patches import loaded

import critflow_extras.tissue.pressures  # noqa: F401  # a service of it is used
from critflow import CriticalManifold, Status, lattice, voronoi_network
from critflow_extras import nearest_critical, network_from
from critflow_extras.inference import nearest
from studies.tension_inference import traced


def test_planted_tensions_and_pressures_are_recovered():
    deviations = []
    for seed in range(50):
        network, sigma, pressures = loaded(20, seed, 0.05)
        planted = CriticalManifold(network).configuration(sigma, pressures)
        noise = 1e-9 * np.random.default_rng(seed).standard_normal(planted.coordinates.shape)
        found = nearest_critical(network, planted.coordinates + noise, 1e-9, pressures=True)
        assert found.distance < 1e-10
        deviations.append((found.value.sigma - planted.sigma) / found.stress_error)
        deviations.append((found.value.pressures - planted.pressures) / found.pressure_error)
    deviation = np.concatenate(deviations)
    # Standard errors: a mean square of one, with few independent numbers a network, and no far outlier.
    assert np.mean(deviation**2) == pytest.approx(1, abs=0.15)
    assert np.abs(deviation).max() < 5


@pytest.mark.parametrize("pieces", [1, 2])
def test_standard_errors_are_those_of_differences(pieces, monkeypatch):
    known = planted(loaded(8)[0], pieces)
    network, x = known.network, known.coordinates
    found, columns = nearest_critical(network, x, 1e-3, pressures=True), []
    nothing = np.zeros(network.n_edges + network.faces.n_faces), np.zeros(len(found.side_tensions))
    monkeypatch.setattr(nearest, "standard_errors", lambda *arguments: nothing)  # not needed at the differences
    for entry in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[entry] = 1e-5
        ends = [nearest_critical(network, x + sign * step, pressures=True) for sign in (1, -1)]
        # The scales of the standard errors: Σσ is kept, and ΣT.
        scales = [found.value.sigma.sum() / end.value.sigma.sum() for end in ends]
        of_sides = [found.side_tensions.sum() / end.side_tensions.sum() * end.side_tensions for end in ends]
        ends = [
            np.concatenate([end.value.sigma * a, end.value.pressures * a, T])
            for end, a, T in zip(ends, scales, of_sides, strict=True)
        ]
        columns.append((ends[0] - ends[1]) / 2e-5)
    spread = 1e-3 * np.linalg.norm(columns, axis=0)
    assert np.concatenate([found.stress_error, found.pressure_error, found.side_errors]) == pytest.approx(
        spread, rel=1e-5
    )


def patch():
    """The inner sides of a tessellation between fixed vertices, of two edges."""
    whole = voronoi_network(40, seed=1)
    edges = whole.edges[(whole.offsets == 0).all(axis=1)]
    while (hanging := (np.bincount(edges.ravel(), minlength=40)[edges] == 1).any(axis=1)).any():
        edges = edges[~hanging]
    kept, edges = np.unique(edges, return_inverse=True)
    edges = edges.reshape(-1, 2)
    pins = np.flatnonzero(np.bincount(edges.ravel()) == 2)
    return network_from(edges=edges, positions=whole.positions[kept], pins=pins.tolist()).network


def planted(base, pieces, seed=1):
    """A configuration with tensions and pressures on sides of several edges."""
    network, rng = traced(base, pieces), np.random.default_rng(seed)
    sigma = pieces * np.exp(0.2 * rng.standard_normal(network.n_edges))
    pressures = 0.1 * rng.standard_normal(network.faces.n_faces)
    return CriticalManifold(network).configuration(sigma, pressures)


def tension_of(configuration):
    """Of each edge as the length of the force at its end, from the two forces on it."""
    faces, q = configuration.network.faces, np.zeros(configuration.network.n_edges)
    np.add.at(q, faces.edges, faces.signs * np.repeat(configuration.pressures, faces.sizes))
    turned = configuration.bond_vectors @ [[0, 1], [-1, 0]]
    return np.linalg.norm(configuration.sigma[:, None] * configuration.bond_vectors + 0.5 * q[:, None] * turned, axis=1)


BASES = {"periodic": voronoi_network(20, seed=3), "pinned": patch()}


@pytest.mark.parametrize("pieces", [2, 4])
@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
def test_traced_sides_return_planted_tensions_and_pressures(base, pieces):
    known = planted(base, pieces)
    found = nearest_critical(known.network, known.coordinates, pressures=True)
    # One for each vertex on a side, less three components that straight sides of the patch leave undetermined.
    assert found.ok and found.freedom == base.n_edges * (pieces - 1) - 3 * bool(base.pins)
    np.testing.assert_allclose(found.value.sigma, known.sigma, rtol=1e-12, atol=0)
    np.testing.assert_allclose(found.value.pressures, known.pressures, rtol=0, atol=1e-12)
    # One tension along a side, whatever the stresses of its edges.
    np.testing.assert_array_equal(found.sides, np.arange(known.network.n_edges) // pieces)
    np.testing.assert_allclose(found.side_tensions[found.sides], tension_of(known), rtol=1e-12, atol=0)


def test_noise_of_traced_sides_gives_the_stated_errors_and_chi_squared():
    known, ratios, chi_squared = planted(BASES["periodic"], 3), [], []
    tensions = tension_of(known)[::3]
    for seed in range(20):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(known.coordinates.shape)
        found = nearest_critical(known.network, known.coordinates + noise, 1e-3, pressures=True)
        scale = tensions.sum() / found.side_tensions.sum()
        ratios.append(np.abs(scale * found.side_tensions - tensions) / found.side_errors)
        chi_squared.append(found.chi_squared)
        assert found.note == ""
    assert 0.5 < np.median(ratios) < 0.9  # 0.67 of a normal distribution
    assert np.mean(np.square(ratios)) == pytest.approx(1, abs=0.3)
    low, high = chi2.ppf([0.005, 0.995], found.freedom)
    assert low < min(chi_squared) and max(chi_squared) < high
    assert nearest_critical(known.network, known.coordinates + noise, pressures=True).error == pytest.approx(
        1e-3, rel=0.2
    )


def with_bending(known):
    """Sides with an inflection, as a stiff film has them next to its ends."""
    x = np.array(known.coordinates)
    inner = np.arange(known.network.n_edges // 4)[:, None] * 3 + BASES["periodic"].n_vertices
    normal = known.bond_vectors[::4] @ [[0, 1], [-1, 0]]
    for place, sign in ((0, 1), (2, -1)):
        x[inner[:, 0] + place] += sign * 0.02 * normal
    return known.network, x


def with_a_missing_cell(known):
    """Without the side between two cells, which then are one."""
    network = known.network
    kept, edges = np.unique(network.edges[4:], return_inverse=True)
    x = known.coordinates[kept]
    picture = network_from(edges=edges.reshape(-1, 2), positions=x, cell=network.cell, offsets=network.offsets[4:])
    return picture.network, x


def too_exact(known):
    return known.network, known.coordinates


@pytest.mark.parametrize(
    "picture, word",
    [(with_bending, "does not explain"), (with_a_missing_cell, "does not explain"), (too_exact, "more exact")],
)
def test_a_model_that_does_not_fit_is_said_by_chi_squared(picture, word):
    network, x = picture(planted(BASES["periodic"], 4))
    noise = 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    found = nearest_critical(network, x + noise, 2e-4 if word == "more exact" else 1e-4, pressures=True)
    assert found.ok and "χ²" in found.note and word in found.note


def test_straight_lines_through_vertices_of_four_edges_determine_no_tensions():
    network = traced(lattice("square", 3, 3), 2)
    x = network.positions + 1e-3 * np.random.default_rng(0).standard_normal(network.positions.shape)
    found = nearest_critical(network, x, 1e-3, pressures=True, throw=False)
    assert found.status is Status.ill_conditioned and "standard error" in found.note and found.freedom > 0


def test_sides_have_the_numbers_that_are_given():
    known = planted(BASES["periodic"], 2)
    numbers = np.random.default_rng(0).permutation(30)
    plain = nearest_critical(known.network, known.coordinates, pressures=True)
    found = nearest_critical(known.network, known.coordinates, pressures=True, sides=np.repeat(numbers, 2))
    np.testing.assert_array_equal(found.side_tensions[numbers], plain.side_tensions)


def with_sides(change, pressures=True):
    known = planted(BASES["periodic"], 2)
    sides = np.arange(60) // 2
    sides[: len(change)] = change
    return lambda: nearest_critical(known.network, known.coordinates, pressures=pressures, sides=sides)


def of_four_edges_a_vertex():
    return nearest_critical(lattice("square", 3, 3), lattice("square", 3, 3).positions, pressures=True)


def with_a_start():
    network, sigma, _ = loaded()
    return nearest_critical(network, network.positions, start=sigma, pressures=True)


def without_cells():
    star = network_from(edges=[[0, 1], [0, 2], [0, 3]], positions=[[0, 0], [1, 0], [-1, 1], [-1, -1]], pins=[1, 2, 3])
    return nearest_critical(star.network, star.positions, pressures=True)


def of_other_sides():
    return nearest_critical(BASES["periodic"], BASES["periodic"].positions, pressures=True, sides=[0, 1])


test_bad_input_raises_one_sentence = refused(
    {
        "four edges a vertex": (of_four_edges_a_vertex, "trace the sides"),
        "no closed cell": (without_cells, "trace whole cells"),
        "a start": (with_a_start, "needs no start"),
        "a side with two tensions": (with_sides([30]), "edges 0 and 1 are of one side"),
        "two sides of one number": (with_sides([1, 1, 1, 1]), "edges 0 and 2 are of two sides"),
        "sides of straight springs": (with_sides([], pressures=False), "pressures=True"),
        "too few numbers": (of_other_sides, "30 edges"),
    }
)
