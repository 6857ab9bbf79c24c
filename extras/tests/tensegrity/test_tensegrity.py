"""Tensegrities with known stresses and stability: Snelson's X, prisms, a pentagon, a lattice under pressure."""

import numpy as np
import pytest
from problems import random_stress
from refusals import refused_changes

from critflow import CriticalManifold, Network, SolveError, Status, lattice, voronoi_network
from critflow.manifold import critical_configuration
from critflow_extras import rigidity, stability
from critflow_extras.tensegrity.signed_stress import signed_stress


def snelson_x(pins=(0, 1)) -> tuple[Network, np.ndarray]:
    """A square of four cables with two struts crossing; the self-stress is 1 on cables, −1 on struts."""
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    edges = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]]
    return Network(edges, pins={i: x[i] for i in pins}, positions=x), np.array([1, 1, 1, 1, -1, -1])


def prism(twist: float, n: int = 3, height: float = 1.3, pinned: int = 0) -> tuple[Network, np.ndarray]:
    """A prism of n struts on a pinned polygon, its upper one turned by `twist` from the feet of the struts.

    Cables: the upper polygon, and from each foot to the vertex that the next strut carries; edges between pins are left
    out.  A stress exists at twist π/2 + π/n alone, with vertical cables 2 sin(π/n) times the polygon's.
    """
    angle = 2 * np.pi * np.arange(n) / n
    lower = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    upper = np.stack([np.cos(angle + twist), np.sin(angle + twist), height + 0 * angle], axis=1)
    i, x = np.arange(n), np.concatenate([lower, upper])
    edges = np.concatenate(
        [np.stack(pair, axis=1) for pair in ((n + i, n + (i + 1) % n), ((i + 1) % n, n + i), (i, n + i))]
    )
    signs = np.repeat([1, 1, -1], n)
    pins = {k: x[k] for k in range(n + pinned)}
    return Network(edges, pins=pins, positions=x), signs


def braced_squares(n: int) -> tuple[Network, np.ndarray]:
    """The square lattice of cables with a strut along one diagonal of every square."""
    plain = lattice("square", n, n)
    cells = np.array(list(np.ndindex(n, n)))
    image, there = np.divmod(cells + 1, n)
    struts = np.stack([np.arange(n * n), there @ [n, 1]], axis=1)
    network = Network(
        np.concatenate([plain.edges, struts]), np.concatenate([plain.offsets, image]), plain.cell,
        positions=plain.positions,
    )  # fmt: skip
    return network, np.repeat([1, 1, -1], n * n)


@pytest.mark.parametrize("pins", [(0, 1), (0, 1, 2)])
def test_snelson_x(pins):
    network, signs = snelson_x(pins)
    found = signed_stress(network, network.positions, signs)
    assert found.status is Status.ok
    np.testing.assert_allclose(found.value.critical.sigma, signs, atol=1e-12)
    assert found.value.least == pytest.approx(1, rel=1e-12)
    result = stability(found.value.critical)
    assert result.super_stable and result.prestress_stable
    # Two pins leave the affine maps that fix their line.
    assert (result.n_negative, result.n_null, result.n_affine) == (0, 3 - len(pins), 3 - len(pins))


@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_prisms_have_a_stress_at_one_twist_only(n):
    right = np.pi / 2 + np.pi / n
    network, signs = prism(right, n)
    found = signed_stress(network, network.positions, signs)
    assert found.status is Status.ok
    ratio = 2 * np.sin(np.pi / n)
    expected = np.repeat([1, ratio, -ratio], n)
    sigma = found.value.critical.sigma
    np.testing.assert_allclose(sigma / sigma[0], expected, atol=1e-10)
    assert found.value.critical.residual < 1e-13
    result = stability(found.value.critical)
    assert result.super_stable and result.prestress_stable and result.n_affine == 1
    for wrong in (right - 0.02, right + 0.02, right - 1.0):
        network, signs = prism(wrong, n)
        refused = signed_stress(network, network.positions, signs, throw=False)
        assert refused.status is Status.floppy and refused.value.critical is None


@pytest.mark.parametrize("twist", [1.0, 2.0, 2.6, 3.0])
def test_the_reason_is_a_motion_that_loosens(twist):
    network, signs = prism(twist)
    found = signed_stress(network, network.positions, signs, throw=False)
    motion = found.value.motion
    np.testing.assert_array_equal(motion[:3], 0)
    L = network.bond_vectors(network.positions)
    elongation = np.sum(L * (network.incidence @ motion), axis=1)
    # No cable stretches and no strut shortens, some do the opposite: virtual work rules every such stress out.
    loosening = -signs * elongation
    assert loosening.min() > -1e-9 and loosening.max() == pytest.approx(1, rel=1e-9)
    np.testing.assert_array_equal(found.value.loosened, np.flatnonzero(loosening > 1e-7))
    assert f"edge {found.value.loosened[0]} " in found.note
    with pytest.raises(SolveError, match="no self-stress has these signs: a motion loosens"):
        signed_stress(network, network.positions, signs)


@pytest.mark.parametrize("side", [-1, 1])
def test_bars_do_either(side):
    # Turned a little too far in one sense a brace must pull, in the other it must push; a bar does either.
    network, signs = prism(5 * np.pi / 6 + 0.05 * side)
    braced = Network(np.concatenate([network.edges, [[0, 4]]]), pins=network.pins, positions=network.positions)
    found = {sign: signed_stress(braced, network.positions, np.append(signs, sign), throw=False) for sign in (-1, 0, 1)}
    needed = int(np.sign(found[0].value.critical.sigma[-1]))
    assert found[0].status is found[needed].status is Status.ok
    assert found[-needed].status is Status.floppy
    # The brace runs from foot 0 to the vertex ahead, so it resists the excess rotation.
    assert needed == side


@pytest.mark.parametrize("n", [3, 4, 5, 7])
def test_a_lattice_with_struts_loses_its_stability_where_its_softest_wave_does(n):
    """P on plane waves: 4 − 2cos k_x − 2cos k_y − 2q(1 − cos(k_x + k_y)) vanishes first at k_x = k_y = 2π/n."""
    network, signs = braced_squares(n)
    k = 2 * np.pi * np.arange(n) / n
    kx, ky = (axis.ravel()[1:] for axis in np.meshgrid(k, k))
    diagonal = 1 - np.cos(kx + ky)
    critical = np.min((2 - np.cos(kx) - np.cos(ky))[diagonal > 1e-9] / diagonal[diagonal > 1e-9])
    manifold = CriticalManifold(network)
    for q in (0.3 * critical, critical * (1 - 1e-5), critical * (1 + 1e-5), 1.9 * critical):
        solution = manifold.solve(np.where(signs > 0, 1.0, -q))
        waves = 4 - 2 * np.cos(kx) - 2 * np.cos(ky) - 2 * q * diagonal
        assert solution.status is Status.ok
        assert solution.negative_pivots == np.count_nonzero(waves < 0)
        result = stability(solution.value)
        assert result.n_negative == np.count_nonzero(waves < 0) and result.n_null == result.n_affine == 0
        assert result.super_stable == (q < critical)
        # The squares stay squares: every line has an independent stress.
        np.testing.assert_allclose(solution.value.lengths[signs > 0], 1.0, rtol=1e-8)
    assert signed_stress(network, network.positions, signs).value.least == pytest.approx(1, rel=1e-9)


def test_a_given_configuration_gives_its_stress_back():
    # Underconstrained, so the stress is the only one: signs of a solution lead to the solution.
    network = voronoi_network(40, seed=1)
    sigma = random_stress(network.n_edges, 4)
    sigma[[3, 17]] *= -0.05
    critical = CriticalManifold(network).configuration(sigma)
    found = signed_stress(network, critical.coordinates, np.sign(sigma)).value
    np.testing.assert_allclose(found.critical.sigma, critical.sigma, rtol=1e-9)
    assert found.least == pytest.approx(np.abs(sigma).min() / np.abs(sigma).max(), rel=1e-9)
    assert signed_stress(network, critical.coordinates, np.ones(60), throw=False).status is Status.floppy


def test_an_affine_flex_is_no_super_stability():
    # A cross of two straight lines, stressed independently, rotates like scissors: an affine map that keeps all lengths
    # although P has no zero eigenvalue but that of the affine maps.
    x = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    network = Network([[0, 2], [2, 1], [2, 3], [2, 4], [3, 4]], pins={0: x[0], 1: x[1]}, positions=x)
    critical = signed_stress(network, x, [1, 1, 1, 1, -1]).value.critical
    np.testing.assert_allclose(critical.sigma / critical.sigma[2], [1, 1, 1, 1, -0.5], atol=1e-12)
    result = stability(critical)
    assert (result.n_negative, result.n_null, result.n_affine) == (0, 1, 1)
    assert not result.super_stable and not result.prestress_stable


def test_a_frame_that_turns_about_one_pin_is_still_super_stable():
    # Rigid motions about the pins keep lengths as they must, and are no flex.
    network, signs = snelson_x((0,))
    result = stability(signed_stress(network, network.positions, signs).value.critical)
    assert (result.n_negative, result.n_null, result.n_affine) == (0, 2, 2)
    assert result.super_stable and not result.prestress_stable


X = snelson_x()[0]
test_bad_input = refused_changes(
    lambda **changes: signed_stress(X, **({"coordinates": X.positions, "signs": snelson_x()[1]} | changes)),
    ({"signs": np.ones(5)}, r"\+1 \(cable\)"),
    ({"signs": np.zeros(6)}, "not all 0"),
    ({"signs": 0.5 * np.ones(6)}, r"-1 \(strut\)"),
    ({"coordinates": np.zeros((3, 2))}, r"shape \(4, 2\)"),
    ({"coordinates": np.full((4, 2), np.nan)}, "finite"),
    ({"coordinates": np.array([[0, 0], [1, 0], [1, 1], [1, 1.0]])}, "edge 2 has no length"),
)


@pytest.mark.parametrize("weak", [1e-8, 1e-10])
def test_a_weak_tension_is_a_tension(weak):
    # Two vertices connected to the rest by weak edges alone.
    network = voronoi_network(40, seed=2)
    sigma = np.ones(network.n_edges)
    sigma[(network.edges < 2).any(axis=1)] = weak
    inner = (network.edges < 2).all(axis=1)
    sigma[inner] = 1.0
    result = stability(CriticalManifold(network).configuration(sigma))
    assert result.ok and result.super_stable and result.prestress_stable and result.n_null == 0


def test_a_long_chain_in_tension_is_super_stable():
    n = 20_000
    chain = Network(np.stack([np.arange(n), np.arange(1, n + 1)], axis=1), pins={0: (0.0, 0.0), n: (1.0, 0.0)})
    result = stability(CriticalManifold(chain).configuration(np.ones(n)))
    # The distance from the line is an affine function that vanishes on the pins, and on all vertices.
    assert result.ok and result.super_stable and result.n_affine == 0


@pytest.mark.parametrize("distance", [1e-5, 3e-5, 1e-4])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_small_singular_value_is_no_flex(distance, sign):
    # Three bars at a vertex, nearly in line: rigid to first order, so that no stress can make it unstable.
    x = np.array([[0.0, distance], [-1.0, -distance / 3], [2.0, 0.0], [3.0, 0.0]])
    network = Network([[0, 1], [0, 2], [0, 3]], pins={vertex: x[vertex] for vertex in (1, 2, 3)})
    stress = rigidity(network, x).value.self_stresses[0]
    result = stability(critical_configuration(network, sign * stress, x))
    assert result.ok and result.prestress_stable
    assert result.super_stable == (sign * stress.sum() > 0)


def test_a_null_eigenvalue_without_an_affine_map_decides_nothing():
    # A vertex between three pins whose stresses sum to zero, up to the margin.
    x = np.array([[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    network = Network([[0, 1], [0, 2], [0, 3], [0, 4]], pins={vertex: x[vertex] for vertex in (1, 2, 3, 4)})
    result = stability(critical_configuration(network, np.array([1.0, 1.0, -1.0, -1.0]), x))
    assert result.status is Status.undecided
    assert result.super_stable is None and result.prestress_stable
    unbalanced = stability(critical_configuration(network, np.array([1.0, 2.0, -1.0, -1.0]), x))
    assert unbalanced.status is Status.ill_conditioned


@pytest.mark.parametrize("short", [1e-6, 1e-8, 1e-12])
def test_a_taut_chain_of_any_lengths_has_a_stress(short):
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0 + short, 0.0]])
    chain = Network([[0, 1], [1, 2]], pins={0: x[0], 2: x[2]})
    found = signed_stress(chain, x, [1, 1])
    np.testing.assert_allclose(found.value.critical.tensions, found.value.critical.tensions[0], rtol=1e-12)
    assert found.value.least == pytest.approx(x[2, 0] - x[1, 0], rel=1e-9)
    assert signed_stress(chain, x, [1, -1], throw=False).status is Status.floppy
