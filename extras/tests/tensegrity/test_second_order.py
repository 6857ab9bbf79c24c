"""Second-order rigidity and prestress stability: closed forms, and every certificate checked by dense algebra."""

import numpy as np
import pytest
from frameworks import chain, star
from problems import dense_free, dense_rigidity, random_stress, triangular_lattice, voronoi_3d

from critflow import CriticalManifold, Network, Status, lattice, three_bar_linkage, voronoi_network
from critflow.saddles import Saddle
from critflow_extras import rigidity
from critflow_extras.tensegrity import second_order
from critflow_extras.tensegrity.second_order import second_order_rigidity

ANSWERS = {
    "first order": (True, True, True),
    "prestress": (False, True, True),
    "second order": (False, False, True),
    "flexible": (False, False, False),
    "undecided": (False, False, None),
}


def decide(network, x, expected):
    """The solution, with its certificate checked against dense matrices."""
    solution = second_order_rigidity(network, x)
    value = solution.value
    answer = (value.first_order_rigid, value.prestress_stable, value.second_order_rigid)
    assert answer == ANSWERS[expected], str(value)
    (g, b), (R, free) = dense_free(network), dense_rigidity(network, x)
    L = g @ x[free] + b
    left, s, right = np.linalg.svd(R)
    rank = int((s > 1e-8).sum())
    stresses = left.T[rank:] / np.linalg.norm(L, axis=1)
    stresses /= np.linalg.norm(stresses, axis=1, keepdims=True)
    Z = right[rank:].reshape(-1, len(free), network.dimension)
    stretch = np.einsum("ai,nid->nad", g, Z)
    if expected == "first order":
        assert len(Z) == value.counts.n_trivial
    if expected == "prestress":
        assert solution.status is Status.ok
        assert np.linalg.norm(value.stress) == pytest.approx(1)
        assert np.abs(g.T @ (value.stress[:, None] * L)).max() < 1e-11
        stiffness = np.linalg.eigvalsh(np.einsum("a,nad,mad->nm", value.stress, stretch, stretch))
        # Only translations have zero energy.
        assert np.abs(stiffness[: value.counts.n_trivial]).max(initial=0.0) < 1e-10
        assert stiffness[value.counts.n_trivial] > 1e-8
        if np.isfinite(value.least_stiffness):
            assert value.least_stiffness == pytest.approx(stiffness[value.counts.n_trivial], rel=1e-6)
    else:
        assert value.stress is None
    if expected == "flexible":
        assert solution.status is (Status.ok if value.counts.n_self_stresses else Status.floppy)
        z = value.escape[free]
        assert np.linalg.norm(value.escape) == pytest.approx(1)
        assert np.abs(value.escape[list(network.pins)]).max(initial=0.0) == 0.0
        assert np.abs(R @ z.ravel()).max() < 1e-9
        work = np.sum((g @ z) ** 2, axis=1)
        assert np.abs(stresses @ work).max(initial=0.0) < 1e-9
        # The mode is not a translation.
        assert work.max() > 1e-3
    else:
        assert value.escape is None
    return solution


def joined(*parts):
    """The union of pinned networks as one network."""
    edges, pins, places, start = [], {}, [], 0
    for network, x in parts:
        edges.append(network.edges + start)
        pins |= {start + i: p for i, p in network.pins.items()}
        places.append(x)
        start += len(x)
    return Network(np.concatenate(edges), pins=pins), np.concatenate(places)


def saddle_of_two_stresses():
    """Connelly and Whiteley's framework of seven joints in space, one triangle of it pinned.

    Two self-stresses resist two zero modes by x² − y² and xy: no combination is definite, no motion escapes both.
    """
    points = [(0, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 0)]
    edges = "03 05 06 14 16 23 24 34 35 45 46 56"
    x = np.array(points, float)
    return Network([[int(i) for i in e] for e in edges.split()], pins={i: x[i] for i in range(3)}, n_vertices=7), x


# Signed lengths of bars in a row.
ROWS = [
    *([1, 1, 1], [2, 0.5, 3], [4, 1, -2], [4, -2, 1], [6, -1, -2], [-1, 5, -1], [1, 2], [3, -1], [1, 1, 1, 1]),
    *([5, -1, 1, 1], [5, -1, -2, 1], [8, -1, -2, -1], [1, 1, 9, -1, -1], [9, -1, -1, -2, -1]),
]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("lengths", ROWS, ids=str)
def test_bars_in_a_row(lengths, dimension):
    # σ = 1/ℓ along a positive span: P has as many negative eigenvalues as bars lie reversed, of all but one in total;
    # so the only self-stress is definite where none or all but one are reversed, and else a branch point.
    reversed_bars = sum(length < 0 for length in lengths)
    assert sum(lengths) > 0
    expected = "prestress" if reversed_bars in (0, len(lengths) - 1) else "flexible"
    solution = decide(*chain(lengths, dimension), expected)
    assert (solution.value.counts.n_self_stresses, solution.value.counts.n_trivial) == (1, 0)


def linkage(sigma):
    critical = CriticalManifold(three_bar_linkage()).configuration(sigma)
    return critical.network, critical.coordinates


def at_rest(network, away=0.0):
    """The network at its positions, displaced by random vectors of this size."""
    return network, network.positions + away * np.random.default_rng(1).standard_normal(network.positions.shape)


def legs(n):
    """A vertex on bars to n pins around it."""
    x = np.array([[0.1, 0.0], [1.0, 0.0], [-0.5, 0.9], [-0.4, -0.8]])[: n + 1]
    return Network([[0, i] for i in range(1, n + 1)], pins={i: x[i] for i in range(1, n + 1)}), x


# Makers, the order of rigidity, and the number of self-stresses.
KNOWN = {
    "linkage in tension": (lambda: linkage([1, 2, 3]), "prestress", 1),
    "linkage beyond the branch point": (lambda: linkage([1, 1, -0.6]), "flexible", 1),
    "linkage before the branch point": (lambda: linkage([1, 1, -0.4]), "prestress", 1),
    "linkage off the manifold": (lambda: at_rest(three_bar_linkage()), "flexible", 0),
    "three legs": (lambda: legs(3), "first order", 1),
    "two legs": (lambda: legs(2), "first order", 0),
    "triangular": (lambda: triangular_lattice(4, 4), "first order", 18),
    "honeycomb": (lambda: at_rest(lattice("honeycomb", 4, 3)), "prestress", 1),
    # More than 400 edges are counted and tested by sparse matrices alone.
    "honeycomb, 432 edges": (lambda: at_rest(lattice("honeycomb", 12, 12)), "prestress", 1),
    # A tessellation has a self-stress (Maxwell); displaced it has none.
    "voronoi": (lambda: at_rest(voronoi_network(40, seed=1)), "prestress", 1),
    "voronoi in space": (lambda: at_rest(voronoi_3d()), "prestress", 1),
    "voronoi, displaced": (lambda: at_rest(voronoi_network(40, seed=1), 0.05), "flexible", 0),
    "voronoi in space, displaced": (lambda: at_rest(voronoi_3d(), 0.05), "flexible", 0),
}


@pytest.mark.parametrize("name", KNOWN)
def test_networks_of_known_order(name):
    make, expected, n_self_stresses = KNOWN[name]
    solution = decide(*make(), expected)
    assert solution.value.counts.n_self_stresses == n_self_stresses
    assert (solution.status is Status.floppy) == ("without a self-stress" in solution.note)
    if expected == "first order":
        assert str(solution.value).startswith("rigid to first order: every motion")


@pytest.mark.parametrize("spacing", [60, 3])
def test_compressed_edges_of_a_disordered_network(spacing):
    network = voronoi_network(100, seed=1)
    sigma = np.ones(150)
    sigma[::spacing] = -0.3
    solution = CriticalManifold(network).solve(sigma)
    # With few compressed edges P stays positive definite; with many it is indefinite, also on the zero modes.
    few = spacing == 60
    assert (solution.negative_pivots == 0) == few
    decide(network, solution.value.coordinates, "prestress" if few else "flexible")


@pytest.mark.parametrize("dimension", [2, 3])
def test_collinear_pins(dimension):
    decide(*star([-1, 1, 2, -3, 5, -0.5], dimension), "prestress")
    # All pins on one side: Σσp = 0 needs both signs, and Σσ ≠ 0 is possible as soon as two pins differ.
    value = decide(*star([1, 2, 4], dimension), "prestress").value
    # Zero modes are moves across the line, of stiffness Σσ; the best unit σ is 1 projected off p: √(3 − 49/21).
    assert value.least_stiffness == pytest.approx(np.sqrt(3 - 49 / 21), rel=1e-6)
    # Two bars to the same position cancel in the only self-stress.
    decide(*star([1, 1], dimension), "flexible")


def test_two_strings_need_both_self_stresses():
    both = joined(chain([1, 1, 1]), chain([1, 2, 1], shift=1.0))
    value = decide(*both, "prestress").value
    assert value.counts.n_self_stresses == 2
    assert "tension" in value.reason
    # The stress of one does no work on the modes of the other, so both must be stressed.
    assert np.linalg.norm(value.stress[:3]) > 0.1 and np.linalg.norm(value.stress[3:]) > 0.1
    # A bar between them, perpendicular to both, stays unstressed and changes nothing.
    network, x = both
    tied = Network(np.concatenate([network.edges, [[1, 5]]]), pins=network.pins)
    x = x.copy()
    x[5, 0] = x[1, 0]
    value = decide(tied, x, "prestress").value
    assert "1 slack edges" in value.reason
    assert abs(value.stress[6]) < 1e-12
    # Partly compressed strings need the semidefinite program.
    folded = joined(chain([6, -1, -2]), chain([1, 2, 1], shift=1.0), chain([-1, 5, -1], shift=2.0))
    value = decide(*folded, "prestress").value
    assert "combination of its 3 self-stresses" in value.reason
    # With one of them at a branch point the whole is flexible.
    decide(*joined(chain([1, 1, 1]), chain([4, 1, -2], shift=1.0)), "flexible")


def test_second_order_rigidity_without_prestress_stability():
    value = decide(*saddle_of_two_stresses(), "second order").value
    assert (value.counts.n_self_stresses, value.counts.n_zero_modes) == (2, 2)
    assert "fourth order" in value.reason
    # Next to a long string stabilised by its self-stress, only the two modes remain to be proved.
    network, x = chain(np.ones(9), 3, shift=3.0)
    both = joined(saddle_of_two_stresses(), (network, x))
    assert decide(*both, "second order").value.counts.n_zero_modes == 18
    # Next to a chain at a branch point a mode escapes.
    decide(*joined(saddle_of_two_stresses(), chain([4, 1, -2], 3, shift=3.0)), "flexible")


def test_undecided_rigidity_is_none():
    # Five such frameworks have ten modes, beyond the limit of the fourth-order relaxation: no proof, no escaping mode.
    solution = decide(*joined(*[saddle_of_two_stresses()] * 5), "undecided")
    assert solution.status is Status.undecided
    assert "nor a proof" in solution.note
    assert str(solution.value).startswith("not prestress stable, and undecided")


@pytest.mark.parametrize("n_modes", [25, 30])
def test_the_subspace_of_a_program_grows_to_its_limit(monkeypatch, n_modes):
    # Each stress resists one mode, so that 5, 10, ... modes leave the others at rest; above 20 no more are added.
    monkeypatch.setattr(second_order, "PROGRAM_MODES", 10)
    stiffness = np.linspace(1.0, 2.0, n_modes)
    forms = -stiffness[:, None, None] * np.eye(n_modes)[:, :, None] * np.eye(n_modes)[:, None, :]
    least, _, obstruction, support = second_order._program(forms)
    # The best stress of unit norm makes all modes of the subspace equally stiff.
    weight = -stiffness * support / np.linalg.norm(support)
    seen = weight > 1e-6
    assert seen.sum() == 25
    equal = 1 / np.sqrt(np.sum(stiffness[seen] ** -2))
    np.testing.assert_allclose(weight[seen], equal, rtol=1e-6)
    assert least == pytest.approx(equal if n_modes == 25 else 0.0, rel=1e-6, abs=1e-9)
    # An obstruction on a part of the modes is none on all of them.
    assert (obstruction is None) == (n_modes == 30)


def test_ambiguous_counts_decide_nothing():
    network, x = chain([1, 1, 1])
    x[1, 1] = 1e-6
    solution = second_order_rigidity(network, x)
    assert solution.status is Status.undecided
    value = solution.value
    assert (value.first_order_rigid, value.prestress_stable, value.second_order_rigid) == (None, None, None)
    assert str(value).startswith("undecided: a singular value of")
    loose = Network([[0, 1], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], np.eye(2))
    solution = second_order_rigidity(loose, np.zeros((2, 2)))
    assert solution.status is Status.singular
    assert "edge 0" in str(solution.value)


def test_large_networks_are_undecided_with_a_reason(monkeypatch):
    network, x = joined(chain([6, -1, -2]), chain([1, 2, 1], shift=1.0))
    monkeypatch.setattr(second_order, "LARGEST_DENSE", 20)
    solution = second_order_rigidity(network, x)
    assert solution.status is Status.undecided
    assert (solution.value.prestress_stable, solution.value.second_order_rigid) == (None, None)
    assert "4 zero modes" in str(solution.value)
    # A factorisation decides at any size.
    assert second_order_rigidity(*joined(chain([1, 1]), chain([1, 2], shift=1.0))).value.prestress_stable
    monkeypatch.setattr(second_order, "LARGEST_DENSE", 10)
    assert "2 self-stresses" in str(second_order_rigidity(network, x).value)


def test_tension_certificate_without_linear_program(monkeypatch):
    monkeypatch.setattr(second_order, "LINEAR_PROGRAM", 0)
    value = decide(*star([-1, 1, 2, -3, 4, -2]), "prestress").value
    assert "tension" in value.reason


@pytest.mark.parametrize("lengths", [[1, 1, 1], [6, -1, -2]])
def test_eigenvalues_decide_without_a_stable_factor(monkeypatch, lengths):
    monkeypatch.setattr(Saddle, "stable", lambda *_: False)
    value = decide(*chain(lengths), "prestress").value
    # The form of unit stresses on unit transverse displacements, P = gᵀ diag(σ) g of the two inner vertices.
    s = np.sign(lengths[0] * np.prod(lengths)) / np.array(lengths) / np.linalg.norm(1 / np.array(lengths))
    least = np.abs(np.linalg.eigvalsh([[s[0] + s[1], -s[1]], [-s[1], s[1] + s[2]]])).min()
    assert value.least_stiffness == pytest.approx(least, rel=1e-10)


def test_proof_fails_with_an_escaping_mode():
    # x² − y² and xz vanish together at x = y, z = 0, and with yz and xy added still along z.
    forms = np.zeros((4, 3, 3))
    forms[0, 0, 0], forms[0, 1, 1] = 1, -1
    for form, (i, j) in zip(forms[1:], ((0, 2), (1, 2), (0, 1)), strict=True):
        form[i, j] = form[j, i] = 0.5
    assert not second_order._none_escapes(forms[:2], np.zeros(2))
    assert not second_order._none_escapes(forms, np.zeros(4))
    last = np.diag([-0.5, -0.5, 1.0])
    assert second_order._none_escapes(np.concatenate([forms, last[None]]), np.zeros(5))


def parallel_bars(seed, decimals):
    """Three equal bars from the ground to a triangle: it can rotate about its feet, and has one self-stress."""
    rng = np.random.default_rng(seed)
    feet, bar = 3 * rng.random((3, 2)), rng.standard_normal(2)
    x = np.round(np.concatenate([feet, feet + bar]), decimals)
    edges = [[0, 3], [1, 4], [2, 5], [3, 4], [4, 5], [5, 3]]
    return Network(edges, pins={i: x[i] for i in range(3)}, positions=x)


@pytest.mark.parametrize("decimals", [3, 5, 8])
def test_rounded_mechanisms_are_not_rigid(decimals):
    for seed in range(12):
        network = parallel_bars(seed, decimals)
        found = second_order_rigidity(network, network.positions, tolerance=100 * 0.5 * 10.0**-decimals)
        assert not found.value.second_order_rigid and not found.value.prestress_stable
        assert found.value.second_order_rigid is not True
    # The tolerance does not hide a stress in tension on every edge.
    network = voronoi_network(24, seed=1)
    x = np.round(CriticalManifold(network).configuration(random_stress(36, 2)).coordinates, decimals)
    if decimals > 3:
        assert second_order_rigidity(network, x, tolerance=50 * 10.0**-decimals).value.prestress_stable


def test_singular_values_above_rounding_are_in_doubt():
    network = lattice("honeycomb", 2, 2)
    x = network.positions.copy()
    x[0, 1] += 4e-12
    assert second_order_rigidity(network, network.positions).status is Status.ok
    found = second_order_rigidity(network, x)
    assert found.status is Status.undecided and found.value.counts.largest_zero == pytest.approx(6.3e-13, rel=0.05)
    assert rigidity(network, x).status is Status.singular


def test_self_stresses_beyond_memory_leave_it_open(monkeypatch):
    network = lattice("kagome", 2, 2)
    monkeypatch.setattr(second_order, "LARGEST_DENSE", 2 * network.n_edges)
    found = second_order_rigidity(network, network.positions)
    assert found.status is Status.undecided and found.value.second_order_rigid is None
    assert "self-stresses are more than fit in memory" in found.note
