"""Every proof that targets are infeasible is attacked: configurations of all kinds are asked for their own values."""

import numpy as np
import pytest
from problems import with_random_stiffness

from critflow import (
    CriticalManifold,
    Network,
    Status,
    delaunay_network,
    elasticity,
    lattice,
    optimize,
    quantity,
    spring_state,
    voronoi_network,
)
from critflow.isogonal import isogonal_modes
from critflow_extras import design, foam_network
from critflow_extras.design_stiffness.stiffnesses import Stiffnesses, component_names
from critflow_extras.targets.faces import FaceAmplitudes
from critflow_extras.targets.problem import parse_targets
from critflow_extras.targets.refusals import refusal_of


def stretched(network, *factors):
    return network.deformed(np.diag(factors))


def line(direction):
    """Six springs in a row between two pins."""
    direction = np.asarray(direction, float)
    return Network([[n, n + 1] for n in range(6)], pins={0: 0 * direction, 6: direction}).with_volume(1.0)


def planar_web(normal=(0.0, 0.0, 1.0)):
    """Spokes and a ring in a plane through the origin of space."""
    turn = np.linalg.qr(np.column_stack([normal, np.eye(3)[:, :2]]))[0][:, [1, 2]]
    angles = 2 * np.pi * np.arange(6) / 6
    rim = (1 + 0.2 * np.sin(angles**2))[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) @ turn.T
    edges = [[n, n + 6] for n in range(6)] + [[n + 6, (n + 1) % 6 + 6] for n in range(6)] + [[6, 9]]
    return Network(edges, pins=dict(enumerate(rim))).with_volume(1.0)


def ring_along_a_diagonal():
    """Three springs in a row that close around the cell along (1, 1, 0)."""
    edges, offsets = [[0, 1], [1, 2], [2, 0]], [[0, 0, 0], [0, 0, 0], [1, 1, 0]]
    return Network(edges, offsets, np.eye(3))


def ring_in_a_tilted_cell(dimension, seed):
    """Three springs in a row that close around a cell of no symmetry."""
    random, offsets = np.random.default_rng(seed), np.zeros((3, dimension), int)
    offsets[2, :2] = 1, -1
    cell = np.eye(dimension) + 0.3 * random.standard_normal((dimension, dimension))
    return Network([[0, 1], [1, 2], [2, 0]], offsets, cell).with_stiffness(np.exp(random.standard_normal(3)))


DIAGONAL = np.outer([1, 1, 0], [1, 1, 0])
KINDS = {
    "plane": lambda: voronoi_network(20, seed=1),
    "plane, other springs": lambda: with_random_stiffness(voronoi_network(20, seed=2), 3),
    "plane, stretched": lambda: stretched(voronoi_network(20, seed=3), 30.0, 0.1),
    "plane, a ribbon": lambda: stretched(voronoi_network(20, seed=4), 1e4, 1.0),
    "plane, sheared": lambda: voronoi_network(20, seed=5).deformed([[1.0, 30.0], [0.0, 1.0]]),
    "honeycomb": lambda: lattice("honeycomb", 3, 3),
    "space": lambda: foam_network(52, seed=1),
    "space, stretched": lambda: stretched(foam_network(52, seed=2), 1.0, 30.0, 0.2),
    "space, a sheet": lambda: stretched(foam_network(52, seed=3), 1e4, 1.0, 1.0),
    "space, a fibre": lambda: stretched(foam_network(52, seed=4), 1.0, 1.0, 1e4),
    "diamond": lambda: lattice("diamond", 2, 2, 2),
    "diamond, stretched": lambda: stretched(lattice("diamond", 2, 2, 2), 1.0, 2.0, 3.0),
    "diamond, stretched along a diagonal": lambda: lattice("diamond", 2, 2, 2).deformed(np.eye(3) + 0.4 * DIAGONAL),
    "a ring": ring_along_a_diagonal,
    "a line in the plane": lambda: line([1.0, 0.7]),
    "a line in space": lambda: line([1.0, 0.7, -0.3]),
    "a web in space": planar_web,
    "a tilted web in space": lambda: planar_web((0.3, -0.5, 0.8)),
}
LAWS = {
    "one": lambda random, k: 0.3 + random.random(len(k)),
    "wide": lambda random, k: np.exp(3 * random.standard_normal(len(k))),
    "nearly slack": lambda random, k: np.where(random.random(len(k)) < 0.2, 10.0 ** random.uniform(-7, -3), 1.0) * k,
    "one edge nearly slack": lambda random, k: k * np.where(np.arange(len(k)) == random.integers(len(k)), 1e-11, 1.0),
    "stiffest": lambda random, k: k,
    "near the stiffest": lambda random, k: k * (1 + 10.0 ** random.uniform(-8, -2) * random.standard_normal(len(k))),
}


def names(dimension):
    axes = "xyz"[:dimension]
    S = [f"S_{a}{b}" for n, a in enumerate(axes) for b in axes[n:]]
    return [
        *("B_0", "G_0", "C_B", "C_G", "V_L", "modulus[uniaxial]", "modulus[pure_shear]"),
        *S,
        *("C_xxxx", "C_xxyy", "C_xxxy", "C_xyxy", "stiffening[uniaxial]"),
    ]


def own_targets(configuration, chosen, random):
    """The values of a configuration, each as a number or inside limits."""
    targets = {}
    for name in chosen:
        measured = quantity(configuration.network, name)
        value, error = measured.evaluate(configuration)[0], measured.error(configuration)
        width = abs(value) * 10.0 ** random.uniform(-6, 0) if random.random() < 0.3 else 0.0
        if width == 0 and error < 1e-12 * abs(value):
            targets[name] = value
        else:
            targets[name] = (value - max(error, width * random.random()), value + max(error, width))
    return targets


def selections(dimension, random):
    """Subsets of the names: those of which proofs speak, and random ones."""
    S = [name for name in names(dimension) if name[:2] == "S_"]
    yield from (["B_0", "C_B"], ["B_0", "G_0", "C_B", "C_G"], ["C_B", "C_G", "B_0"], ["C_B"], ["C_G"], S, [*S, "B_0"])
    yield from ([*S, "G_0", "modulus[uniaxial]"], ["B_0", "G_0", "modulus[uniaxial]"], ["B_0", "modulus[uniaxial]"])
    for _ in range(6):
        yield list(random.choice(names(dimension), random.integers(1, 7), replace=False))


@pytest.mark.parametrize("law", [*LAWS, "any signs"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_configuration_is_refused_its_own_values(kind, law):
    manifold, random = CriticalManifold(KINDS[kind]()), np.random.default_rng(len(kind) + 7 * len(law))
    network, tried = manifold.network, 0
    for _ in range(2):
        if law == "any signs":
            sigma = random.standard_normal(network.n_edges)
        else:
            sigma = LAWS[law](random, network.stiffness)
        solved = manifold.solve(sigma)
        if not solved.ok:
            continue
        for chosen in selections(network.dimension, random):
            targets = own_targets(solved.value, chosen, random)
            if not np.isfinite([value for one in targets.values() for value in np.ravel(one)]).all():
                continue
            parsed = parse_targets(network, targets)
            assert refusal_of(manifold, parsed, law != "any signs") == "", targets
            tried += 1
    assert tried > 10


def measured(configuration, *chosen):
    return [quantity(configuration.network, name).evaluate(configuration)[0] for name in chosen]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind[:5] in ("plane", "honey", "space", "diamo")])
def test_the_bound_of_both_growths_holds_and_is_attained_by_no_turning(kind):
    manifold, random = CriticalManifold(KINDS[kind]()), np.random.default_rng(3)
    network, d = manifold.network, manifold.network.dimension
    for spread in (0.3, 1.0, 0.0):
        critical = manifold.configuration(network.stiffness * np.exp(spread * random.standard_normal(network.n_edges)))
        B_0, G_0, C_B, C_G = measured(critical, "B_0", "G_0", "C_B", "C_G")
        least = (2 / d - 1) * G_0 - G_0 / (3 * B_0) * (C_B - (3 / d - 2) * B_0)
        error = sum(quantity(network, name).error(critical) for name in ("C_B", "C_G"))
        assert C_G >= least - error - 1e-12 * (abs(C_B) + B_0 + G_0)


def test_a_ring_along_a_diagonal_has_its_coefficient_by_hand():
    """E = ½K(ℓ − ℓ_0)² of one straight spring ℓ(γ, ε) along (1, 1, 0)."""
    manifold = CriticalManifold(ring_along_a_diagonal())
    critical = manifold.configuration([1.0, 2.0, 3.0])
    G_0, C_G = measured(critical, "G_0", "C_G")
    assert C_G == pytest.approx(-G_0 / 3, rel=1e-12)
    targets = dict(zip(("B_0", "G_0", "C_B", "C_G"), measured(critical, "B_0", "G_0", "C_B", "C_G"), strict=True))
    found = design(manifold, targets, initial=critical.sigma, throw=False)
    assert found.status is not Status.infeasible and found.reached


def test_a_line_is_not_refused_its_own_stress():
    manifold = CriticalManifold(line([1.0, 0.7]))
    critical = manifold.configuration(np.arange(1.0, 7.0))
    targets = dict(zip(("S_xx", "S_xy", "S_yy"), measured(critical, "S_xx", "S_xy", "S_yy"), strict=True))
    assert design(manifold, targets, initial=critical.sigma, throw=False).status is not Status.infeasible
    # Compression, and a stress with a zero eigenvalue where the network has none, are refused.
    refused = {"S_xx": 0.02, "S_xy": 0.02, "S_yy": 0.001}
    assert "positive definite" in refusal_of(manifold, parse_targets(manifold.network, refused), True)
    plane = CriticalManifold(voronoi_network(20, seed=1))
    singular = {"S_xx": 1.0, "S_xy": 1.0, "S_yy": 1.0}
    assert "positive definite" in refusal_of(plane, parse_targets(plane.network, singular), True)


@pytest.mark.parametrize("height, flat", [(2e-6, False), (3e-7, True)])
def test_a_stress_along_one_axis_is_refused_unless_the_network_is_a_line_to_rounding(height, flat):
    """Moments along y are height² of those along x, of which rounding leaves 1e-12."""
    manifold = CriticalManifold(stretched(voronoi_network(20, seed=1), 1.0, height))
    targets = parse_targets(manifold.network, {"S_xx": 1e-9, "S_xy": 0.0, "S_yy": 0.0})
    assert ("positive definite" in refusal_of(manifold, targets, True)) is not flat


@pytest.mark.parametrize("factors", [(1.0, 1.0), (100.0, 1.0)])
def test_isogonal_designs_near_the_stiffest_are_not_refused_their_own_coefficient(factors):
    manifold, random = CriticalManifold(stretched(voronoi_network(20, seed=6), *factors)), np.random.default_rng(1)
    best = optimize(manifold, "B_0").value
    for spread in (0.0, 1e-6, 1e-5, 3e-5, 1e-3, 0.3):
        stress = best.sigma * np.exp(spread * random.standard_normal(len(best.sigma)))
        critical = manifold.configuration(stress)
        modes = isogonal_modes(critical)
        walked = modes.walk(0.1 * random.standard_normal(len(modes.elongations)) * critical.lengths.min())
        for configuration in (critical, manifold.configuration(walked.sigma)):
            error = quantity(manifold.network, "C_B").error(configuration)
            (value,) = measured(configuration, "C_B")
            targets = parse_targets(manifold.network, {"C_B": (value - error, value + error)})
            assert FaceAmplitudes(configuration).refusal(targets) == ""


@pytest.mark.parametrize("spread", [0.3, 2.0, 5.0])
@pytest.mark.parametrize("factors", [(1.0, 1.0), (100.0, 1.0)])
def test_springs_at_rest_are_not_refused_their_own_tensor(factors, spread):
    random = np.random.default_rng(2)
    plain = stretched(delaunay_network(20, seed=1), *factors)
    network = plain.with_stiffness(np.exp(spread * random.standard_normal(plain.n_edges)))
    x = network.positions
    state = spring_state(network, np.linalg.norm(network.bond_vectors(x), axis=1), x)
    tensor = elasticity(state).value.tensor
    targets = {name: float(tensor[place]) for name, place in component_names(2).items()}
    assert Stiffnesses(state).refusal(parse_targets(network, targets)) == ""


@pytest.mark.parametrize("seed", [108, 129, 142, 231])
def test_a_line_is_not_refused_values_that_attain_a_bound_of_rounding(seed):
    """Some components of S nearly vanish along a line in a tilted cell: their bounds are roundings of others."""
    manifold = CriticalManifold(ring_in_a_tilted_cell(3, seed))
    stiffest = manifold.configuration(manifold.network.stiffness)
    for name in ("S_yy", "S_zz", "S_yz", "C_yyyy", "C_zzzz", "C_xxyy", "C_xxzz"):
        targets = {name: measured(stiffest, name)[0]}
        assert refusal_of(manifold, parse_targets(manifold.network, targets), True) == ""
