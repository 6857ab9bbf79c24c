"""Components and lengths: errors and gradients in sixty digits, in other units, and next to an edge without length."""

from functools import partial

import numpy as np
import pytest
from problems import NETWORKS, random_stress, voronoi_3d, with_random_stiffness
from units import in_units, same_in_units

from critflow import CriticalManifold, Network, Status, lattice, optimize, quantity, voronoi_network
from critflow.quantities import StressedBonds, derivatives_along
from critflow_extras import properties
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, dot, numbers, roots

NETWORK = with_random_stiffness(voronoi_network(n_vertices=8, seed=1), seed=2)
SIGMA = random_stress(NETWORK.n_edges, seed=5)
STEP = MP.mpf(10) ** -15


def closed_forms(sigma, k):
    """Quantities by their definitions in sixty digits."""
    L = reference.configuration(NETWORK, sigma).bond_vectors
    stress, D = (sigma[:, None] * L).T @ L, (sigma**2 * dot(L, L) / k).sum()
    return {
        "S_xy": stress[0, 1] / MP.sqrt(D),
        "S_xx": stress[0, 0] / MP.sqrt(D),
        "C_xxxy": stress[0, 0] * stress[0, 1] / (reference.volume(NETWORK) * D),
        "length[3]": roots(dot(L, L))[3],
    }


def test_gradients_by_stress_and_stiffness_agree_with_differences_in_sixty_digits():
    critical = CriticalManifold(NETWORK).configuration(SIGMA)
    sigma, k, direction = numbers(SIGMA), numbers(NETWORK.stiffness), np.random.default_rng(7).normal(size=len(SIGMA))
    change = numbers(direction)
    by_stress = [closed_forms(sigma + h * change, k) for h in (STEP, -STEP)]
    by_stiffness = [closed_forms(sigma, k + h * change) for h in (STEP, -STEP)]
    names = list(by_stress[0])
    found = properties(critical, names)
    for name in names:
        stress, stiffness = (float((a[name] - b[name]) / (2 * STEP)) for a, b in (by_stress, by_stiffness))
        gradient = found.by_stress[name] * critical.sigma[0] / SIGMA[0]
        assert gradient @ direction == pytest.approx(stress, rel=1e-12, abs=1e-15)
        assert found.by_stiffness[name] @ direction == pytest.approx(stiffness, rel=1e-12, abs=1e-15)


def test_errors_are_those_of_sixty_digits_or_larger():
    for seed in range(5):
        critical = CriticalManifold(NETWORK).configuration(random_stress(NETWORK.n_edges, seed))
        exact = closed_forms(numbers(critical.sigma), numbers(NETWORK.stiffness))
        found = properties(critical, list(exact))
        for name, value in exact.items():
            error = abs(MP.mpf(found.values[name]) - value)
            assert error <= found.errors[name] < 1e4 * np.finfo(float).eps * max(1.0, abs(float(value))), name


# The power of the unit of stiffness and of length that they have in d dimensions.
POWERS = {
    **dict.fromkeys(("C_xxyy", "C_xyxy"), lambda d: (1, 2 - d)),
    **dict.fromkeys(("S_xx", "S_xy"), lambda d: (0.5, 1)),
    "length[3]": lambda d: (0, 1),
    "area[2]": lambda d: (0, 2),
}


def quantities(network, units, signed=False):
    manifold, sigma = CriticalManifold(network), random_stress(network.n_edges, 1)
    sigma[::6] *= -0.3 if signed else 1
    critical = manifold.configuration(sigma)
    names = [name for name in POWERS if name != "area[2]" or network.faces is not None]
    found, one = properties(critical, names), {}
    for name in names:
        k, length = POWERS[name](network.dimension)
        unit, goal = units.stiffness**k * units.length**length, quantity(network, name)
        numbers = (found.values[name], found.errors[name], found.by_stress[name], goal.unit(network))
        one[name] = np.concatenate([np.ravel(value) / unit for value in (*numbers, goal.extreme(manifold, not signed))])
        one[f"{name} by stiffness"] = found.by_stiffness[name] * (units.stiffness / unit)
    return {"number": [*one.values()]}


PLANE, SPACE = NETWORKS["voronoi, random stiffness"], lambda: with_random_stiffness(voronoi_3d(), 4)
test_in_other_units = same_in_units(
    {"plane": (quantities, PLANE), "signed": (partial(quantities, signed=True), PLANE), "space": (quantities, SPACE)},
    rtol=1e-14,
)


@pytest.mark.parametrize("name, of_length, of_root", [("S_xx", 1, 1), ("C_xxyy", 0, 2)])
def test_bits_do_not_depend_on_units(name, of_length, of_root):
    """Scalars are squared by products; the power of a number is off by a last bit once in some thousand cases."""
    network, random = voronoi_network(8, seed=0), np.random.default_rng(0)
    units = [(2.0**-20, 2.0**3), (2.0**-3, 2.0**-9), (2.0**5, 2.0), (2.0**13, 2.0**-4), (2.0**20, 1.0)]
    plain, measured = CriticalManifold(network), quantity(network, name)
    scaled = [CriticalManifold(in_units(network, root**2, length)) for length, root in units]
    for n in range(4000):
        sigma, L = 0.3 + random.random(12), random.standard_normal((12, 2))
        (length, root), manifold = units[n % len(units)], scaled[n % len(units)]
        stiffness, unit = root * root, length**of_length * root**of_root
        here, there = StressedBonds(plain, sigma, L), StressedBonds(manifold, stiffness * sigma, length * L)
        (value, (by_sigma, by_L)), (other, (other_by_sigma, other_by_L)) = map(measured.evaluate, (here, there))
        assert other == value * unit
        assert (other_by_sigma == by_sigma * (unit / stiffness)).all()
        assert (other_by_L == by_L * (unit / length)).all()
        assert (measured.by_stiffness(there) == measured.by_stiffness(here) * (unit / stiffness)).all()


def test_an_edge_between_twins_has_a_length_without_derivative():
    edges = [[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4], [3, 4]]
    network = Network(edges, pins={0: [0.0, 0.0], 1: [4.0, 0.0], 2: [0.0, 3.0]}).with_volume(6.0)
    best = optimize(network, "bulk_modulus").value
    found = properties(best, "length[6]")
    assert found.values["length[6]"] == 0 and np.isnan(found.by_stress["length[6]"]).any()
    second = derivatives_along(quantity(network, "length[6]"), best, np.ones(7), best.bond_vectors)
    assert np.isnan(second[1]).any()


def test_a_value_that_tends_to_zero_stands_where_its_stresses_are_too_different():
    # C_xxyy = S_xx S_yy/(V D) tends to zero as the stress becomes uniaxial; chains then hang on vanishing stresses.
    network = lattice("honeycomb", 2, 2)
    assert quantity(network, "C_xxyy").extreme(CriticalManifold(network))[0] == 0
    found = optimize(network, "C_xxyy", throw=False)
    assert found.status is Status.stalled and "too different to resolve" in found.note
    assert 0 <= found.objective < 1e-15 and np.isfinite(found.value.coordinates).all()


def test_edges_too_short_to_resolve_are_those_of_any_unit_of_length():
    lengths = (1.0, 2.0**21, 2.0**-21)
    networks = [in_units(lattice("honeycomb", 2, 2), 1.0, length) for length in lengths]
    found = [optimize(network, "C_xxyy", "newton", throw=False) for network in networks]
    assert {one.status for one in found} == {Status.stalled} and len({one.note for one in found}) == 1
    # Which of the two comes first depends on rounding.
    assert found[0].note.startswith(("edges become too short to resolve", "stresses fade"))
