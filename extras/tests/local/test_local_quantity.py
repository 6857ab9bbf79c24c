"""The quantity local[i-j,k-l]: gradient, names, and every call that takes quantities."""

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import hung_ring, oblique, random_stress, voronoi_3d
from refusals import refused
from stiffness_checks import Unknown

from critflow import CriticalManifold, Status, lattice, optimize, quantity, spring_state, voronoi_network
from critflow.command.main import main
from critflow.quantities import StressedBonds, evaluate
from critflow_extras import design, edge_leverage, local_response, pareto, properties, write_network
from critflow_extras.fronts.leverage import Part
from critflow_extras.sensitivities.gradients import by_stiffness

NETWORK = voronoi_network(20, seed=1)
MANIFOLD = CriticalManifold(NETWORK)
CRITICAL = MANIFOLD.configuration(random_stress(30, 1))
NAME = "local[0-9,4-15]"
CASES = {
    "periodic": (NETWORK, NAME),
    "image": (NETWORK, "local[0-9:1:0,3-17:1:-1]"),
    "shared vertex": (NETWORK, "local[0-9,9-14]"),
    "oblique cell": (oblique(voronoi_network(20, seed=2)), "local[0-9,4-14]"),
    "pins": (hung_ring(), "local[0-3,1-6]"),
    "pin of a pair": (hung_ring(), "local[0-3,4-17]"),
    "space": (voronoi_3d(4), "local[0-9,4-15]"),
    "vertex": (NETWORK, "local[0-9,4x]"),
    "vertex between pins": (hung_ring(), "local[0-3,1y,0.1]"),
    "under stress": (NETWORK, "local[0-9,4-15,0.01]"),
    "image under stress": (NETWORK, "local[0-9:1:0,3-17:1:-1,0.2]"),
    "pins under stress": (hung_ring(), "local[0-3,4-17,0.1]"),
    "space under stress": (voronoi_3d(4), "local[0-9,4-15,0.1]"),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient(case):
    network, name = CASES[case]
    manifold, goal = CriticalManifold(network), quantity(network, name)
    sigma, rng = random_stress(network.n_edges, 5), np.random.default_rng(6)
    here = evaluate(manifold.balance(sigma), goal)
    directions = 0.1 * rng.standard_normal((2, len(sigma)))
    scale = float(np.abs(here.gradient).max())
    assert scale > 1e-4
    assert_derivative(
        lambda s: evaluate(manifold.balance(s), goal).value, here.gradient, sigma, directions, 1e-3, 1e-6, 1e-8
    )
    assert abs(here.gradient @ sigma) < 1e-11 * scale * len(sigma)
    assert evaluate(manifold.balance(7 * sigma), goal).value == pytest.approx(here.value, rel=1e-10)


def test_properties_agree_with_the_response():
    found = properties(CRITICAL, [NAME, "B_0", "local[0-9,2-11]"])
    answer = local_response(CRITICAL, (0, 9), [(4, 15), (2, 11)]).value
    assert [found.values[NAME], found.values["local[0-9,2-11]"]] == pytest.approx(answer.strains, rel=1e-13)
    assert [found.errors[NAME], found.errors["local[0-9,2-11]"]] == pytest.approx(answer.errors, rel=1e-6)
    assert not found.by_stiffness[NAME].any()
    by_differences = by_stiffness(Unknown(quantity(NETWORK, NAME)), CRITICAL)
    assert np.abs(by_differences).max() < 1e-9


@pytest.mark.parametrize("stress", [1e-4, 0.01, 0.3])
@pytest.mark.parametrize("k", [1.0, 2.0**-18])
def test_under_stress(stress, k):
    """The value is that of springs with this stress, in any unit of k."""
    network = voronoi_network(20, seed=1).with_stiffness(k * np.linspace(0.5, 2, 30))
    critical, t = CriticalManifold(network).configuration(random_stress(30, 1)), stress * k
    goal = quantity(network, f"local[0-9,4-15,{t!r}]")
    lengths = critical.lengths * (1 - t * critical.sigma / network.stiffness)
    answer = local_response(spring_state(network, lengths, critical.coordinates), (0, 9), (4, 15)).value
    value, _ = goal.evaluate(critical)
    assert abs(value - answer.strains[0]) < answer.errors[0] + goal.error(critical)
    exact, differences = goal.by_stiffness(critical), by_stiffness(Unknown(goal), critical)
    assert np.abs(exact - differences).max() < 1e-3 * np.abs(exact).max() and np.abs(exact * k).max() > 1e-5


def test_stress_that_no_springs_have():
    """k must exceed tσ: NaN, and a design that says so."""
    goal = quantity(NETWORK, "local[0-9,4-15,1.0]")
    value, (by_sigma, by_L) = goal.evaluate(CRITICAL)
    assert np.isnan(value) and np.isnan(by_sigma).all() and np.isnan(by_L).all()
    failed = design(NETWORK, {"local[0-9,4-15,1.0]": 0.3}, throw=False)
    assert failed.status is Status.not_reached and "has no value at the start" in failed.note
    assert np.isnan(goal.error(CRITICAL)) and np.isnan(goal.by_stiffness(CRITICAL)).all()


def test_design_that_holds_under_stress():
    network, t = voronoi_network(100, seed=1), 1e-3
    critical = design(network, {"local[3-50,20-77,1e-3]": -1.0}).value
    state = spring_state(network, critical.lengths * (1 - t * critical.sigma), critical.coordinates)
    assert local_response(state, (3, 50), (20, 77)).value.strains == pytest.approx([-1.0], abs=1e-9)
    assert abs(local_response(critical, (3, 50), (20, 77)).value.strains[0] + 1) > 1e-3


def test_names_are_read_as_they_are_written():
    for name in (NAME, "local[0-9:0:0,3-17:-1:2]"):
        assert quantity(NETWORK, name).name == name
    nearest, given = (quantity(NETWORK, name) for name in (NAME, "local[0-9:0:-1, 4-15:-1:+0]"))
    assert (nearest.source, nearest.target) == (given.source, given.target)
    assert quantity(NETWORK, "local[0-9:0:0,4-15]").source != nearest.source


@pytest.mark.parametrize("value", [1.0, -1.0])
def test_design_of_one_response(value):
    network = voronoi_network(100, seed=1)
    made = design(network, {"local[3-50,20-77]": value})
    assert made.ok and made.targets["local[3-50,20-77]"].value == pytest.approx(value, abs=1e-9)
    assert local_response(made.value, (3, 50), [(20, 77)]).value.strains == pytest.approx([value], abs=1e-9)


def test_design_of_several_responses_and_a_modulus():
    targets = {"local[3-50,20-77]": 0.5, "local[3-50,40-71]": (-1.0, -0.4), "B_0": 0.26}
    made = design(voronoi_network(100, seed=1), targets)
    assert made.ok and made.targets["B_0"].value == pytest.approx(0.26, abs=1e-8)
    assert made.targets["local[3-50,20-77]"].value == pytest.approx(0.5, abs=1e-8)
    assert -1.0001 < made.targets["local[3-50,40-71]"].value < -0.3999


def test_optimize_and_pareto():
    start = properties(MANIFOLD.configuration(NETWORK.stiffness), NAME).values[NAME]
    best = optimize(NETWORK, NAME, max_steps=20, throw=False)
    assert best.objective < start
    front = pareto(NETWORK, {"B_0": "largest", NAME: "smallest"}, 3, within={"force_densities": (0.2, None)})
    assert np.isfinite(front.achieved).all() and front.achieved[-1, 1] < front.achieved[0, 1]


def test_leverage_of_edges():
    """Values after a cut are those of the network without the edge at the stress of the others."""
    found = edge_leverage(CRITICAL, NAME)
    assert np.isfinite(found.value.after).sum() > 20 and found.value.before == pytest.approx(
        properties(CRITICAL, NAME).values[NAME]
    )
    for edge in (3, 12):
        rest = np.arange(30) != edge
        cut = CriticalManifold(NETWORK.without_edges(edge)).configuration(CRITICAL.sigma[rest])
        images = [(*pair, tuple(quantity(NETWORK, NAME).__getattribute__(end).image))
                  for pair, end in (((0, 9), "source"), ((4, 15), "target"))]  # fmt: skip
        expected = local_response(cut, images[0], [images[1]]).value.strains[0]
        assert found.value.after[edge] == pytest.approx(expected, rel=1e-8)


def test_a_part_with_other_vertices_has_no_value():
    """Where a part of the network has lost vertices, numbers of vertices are those of others."""
    kept = ~(NETWORK.edges == 7).any(axis=1)
    part = Part(NETWORK, kept, CRITICAL.sigma, CRITICAL.bond_vectors)
    assert part.manifold.network.n_vertices == 19
    value, (by_sigma, by_L) = quantity(NETWORK, NAME).evaluate(part)
    assert np.isnan(value) and np.isnan(by_sigma).all() and by_L.shape == (kept.sum(), 2)


def test_target_of_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_network(NETWORK, "mine.graphml")
    assert main(["make", "mine.graphml", "--out=out.graphml", f"--target={NAME}=0.5"]) == 0
    assert f"{NAME} 0.5 ±" in capsys.readouterr().out.replace("0.500000000000", "0.5")


def test_balances_without_coordinates():
    goal = quantity(NETWORK, NAME)
    bonds = StressedBonds(MANIFOLD, CRITICAL.sigma, CRITICAL.bond_vectors)
    assert goal.evaluate(bonds)[0] == pytest.approx(goal.evaluate(CRITICAL)[0], rel=1e-12)


UNKNOWN = {
    "local[3-50]": "needs a source and a target",
    "local[3-5,4-1,2-6]": "needs a source and a target",
    "local[0-9,4-15,0]": "needs a positive stress t",
    "local[0-9,4-15,-1e-3]": "needs a positive stress t",
    "local[a-b,1-2]": "no pair of vertices is called 'a-b'",
    "local[3-3,1-7]": "names vertex 3 twice",
    "local[0-9,9-0]": "are the same pair",
    "local[0-90,4-15]": "vertex 90, which is not there",
    "local[0-9:1,4-15]": "must be 2 whole numbers",
    "local[0-9,4z]": "take xy",
    "local[0-9,90x]": "fixed or not there",
    "locl[0-9,4-15]": r"did you mean 'local\[I-J,K-L\]'",
}
REFUSED = {name: (lambda name=name: quantity(NETWORK, name), word) for name, word in UNKNOWN.items()}
REFUSED["stresses of any sign"] = (
    lambda: design(NETWORK, {NAME: 0.3}, signs=np.where(np.arange(30) == 4, -1, 1)),
    "positive stresses",
)
REFUSED["several self-stresses"] = (
    lambda: design(lattice("triangular", 4, 4), {"local[0-6,1-10]": 0.3}),
    "one self-stress",
)
test_unknown_names_are_one_sentence = refused(REFUSED)
