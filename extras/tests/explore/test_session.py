"""The state of the page without a browser: changes, undo, recipes, and numbers equal to those of the library."""

from pathlib import Path

import numpy as np
import pytest

import critflow
import critflow_extras as ce
from critflow import CritflowError, elasticity, stiffening, upper_bound
from critflow_extras import certify
from critflow_extras.explore import numbers
from critflow_extras.explore.model import POPULATIONS
from critflow_extras.explore.picture import PALETTES, face_outlines, network_drawing, shades_of
from critflow_extras.explore.script import script
from critflow_extras.explore.session import Session
from critflow_extras.explore.source import File, Random

SOURCE = Random(64, 3)


@pytest.fixture
def session():
    return Session(SOURCE)


def replay(session, changes):
    for change in changes:
        session.apply(change)


def text(session, key):
    state = session.state
    found = numbers.variances(state.critical) + numbers.precise(state.model.manifold, state.critical)
    return next(number.text for number in found if number.key == key)


RECIPES = {
    "edges": [("edge", 5, 0.7), ("edge", 9, -1.5), ("edge", 5, 0.1)],
    "population and face": [("population", "random_stress"), ("face", 4, 0.05), ("edge", 2, 0.3)],
    "optimum": [("population", "min_V_tau"), ("edge", 7, 0.2)],
    "blend": [("blend", 0.0, 0.0, 1.0, 0.0, 0.25, 0.5), ("face", 1, 0.01)],
    "cut": [("population", "random_stress"), ("cut", 11), ("edge", 3, 1.0), ("cut", 0), ("cut", 20)],
}


@pytest.mark.parametrize("changes", RECIPES.values(), ids=RECIPES)
def test_the_script_repeats_the_state_to_the_last_digit(session, changes):
    replay(session, changes)
    scope = {}
    exec(script(session), scope)
    assert np.array_equal(scope["critical"].coordinates, session.state.critical.coordinates)
    assert np.array_equal(scope["critical"].sigma, session.state.critical.sigma)


def test_the_script_asks_for_coefficients_only_where_they_exist(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    network = critflow.lattice("triangular", 3, 3)
    ce.write_network(network, "several.csv", network.positions, force_densities=np.ones(network.n_edges))
    lines = script(Session(File(Path("several.csv"))))
    exec(lines, {})
    assert "one self-stress" in lines
    assert "stiffening" not in lines and "bulk" in capsys.readouterr().out


def test_script_repeats_a_strain(session, capsys):
    replay(session, [("edge", 5, 0.7), ("strain", "dilation", 0.01)])
    scope = {}
    exec(script(session), scope)
    strained = session.state.path(moduli=True).value
    assert np.array_equal(scope["path"].states[-1].coordinates, session.state.springs.coordinates)
    assert str(strained.bulk_modulus) in capsys.readouterr().out


def test_a_face_changes_while_b_0_stands_still_to_the_last_digit(session):
    session.apply(("population", "random_stress"))
    before, growth = text(session, "B_0"), text(session, "C_B")
    lengths = session.state.critical.lengths
    for amplitude in (0.01, 0.02, -0.03):
        session.apply(("face", 4, amplitude))
        assert text(session, "B_0") == before
    assert text(session, "C_B") != growth
    assert np.abs(session.state.critical.lengths - lengths).max() > 0.01


def test_a_slider_that_moves_on_is_one_step_of_undo(session):
    start = session.state
    for value in (0.1, 0.2, 0.3):
        session.apply(("edge", 5, value))
    raised = session.state
    assert raised.critical.sigma[5] / start.critical.sigma[5] > 1.2
    session.apply(("edge", 6, 0.1))
    session.undo()
    assert session.state is raised
    session.undo()
    assert session.state is start and not session.can_undo
    session.redo()
    assert session.state is raised
    session.apply(("cut", 1))
    assert not session.can_redo


def test_the_recipe_leaves_out_what_later_changes_overrule(session):
    replay(session, [("edge", 5, 1.0), ("cut", 2), ("strain", "dilation", 0.01), ("population", "max_B_0")])
    assert session.recipe() == [("cut", 2), ("population", "max_B_0")]


def test_numbers_are_those_of_the_library(session):
    replay(session, [("population", "random_stress"), ("edge", 1, 0.5)])
    critical, manifold = session.state.critical, session.state.model.manifold
    moduli = elasticity(critical).value
    growth = stiffening(critical, manifold=manifold)
    shown = {n.key: n for n in numbers.precise(manifold, critical) + numbers.counts(critical)}
    for key, value, bound in (
        ("B_0", moduli.bulk, moduli.errors.bulk),
        ("G_0", moduli.shear, moduli.errors.shear),
        ("C_B", growth.value.C_B, growth.stats.error_bound.C_B),
        ("C_G", growth.value.C_G, growth.stats.error_bound.C_G),
    ):
        decimals = len(shown[key].text.partition(".")[2])
        assert shown[key].text == f"{value:.{decimals}f}"
        assert 0 < shown[key].error == bound < 10.0**-decimals
    assert int(shown["self-stresses"].text) == certify(critical).n_self_stresses == 1
    assert session.state.model.bulk_bound == upper_bound(manifold, "B_0") > moduli.bulk
    assert elasticity(critical).value.errors.bulk > 0


def test_bound_of_a_variance_covers_changes_of_the_values():
    rng = np.random.default_rng(0)
    values, change = rng.uniform(0.5, 2.0, 40), rng.uniform(0, 1e-3, 40)

    def variance(values):
        return values.var() / values.mean() ** 2

    bound = numbers._variance_error(variance(values), values, change)
    moved = [abs(variance(values + change * s) - variance(values)) for s in rng.choice([-1, 1], (300, 40))]
    assert max(moved) < bound < 30 * max(moved)
    equal = numbers._variance_error(0.0, np.ones(40), change)
    assert max(variance(1 + change * s) for s in rng.choice([-1, 1], (300, 40))) < equal


BAD = {
    "unknown": (("explode", 1), "explode"),
    "edge": (("edge", 1000, 0.1), "edge 1000"),
    "negative edge": (("edge", -1, 0.1), "edge -1"),
    "steep": (("edge", 1, 1e9), "log"),
    "not a number": (("edge", 1, float("nan")), "between"),
    "text": (("edge", "one", 0.1), "change"),
    "short": (("edge",), "change"),
    "face": (("face", 1, 100.0), "length"),
    "population": (("population", "best"), "best"),
    "blend of nothing": (("blend", *[0.0] * len(POPULATIONS)), "weight"),
    "strain": (("strain", "dilation", 7.0), "strain"),
    "deformation": (("strain", "twist", 0.1), "twist"),
    "loosening": (("strain", "dilation", -0.01), "loosens"),
}


@pytest.mark.parametrize(("change", "word"), BAD.values(), ids=BAD)
def test_a_change_that_fails_leaves_the_state(session, change, word):
    session.apply(("edge", 3, 0.4))
    before = session.state
    with pytest.raises(CritflowError, match=word):
        session.apply(change)
    assert session.state is before


def test_a_network_in_space_is_referred_to_its_picture(tmp_path):
    network = critflow.lattice("cubic", 2, 2, 2)
    ce.write_network(network, tmp_path / "cube.json", network.positions)
    with pytest.raises(CritflowError, match="draw"):
        Session(File(tmp_path / "cube.json"))


def test_a_file_opens_at_its_stress(tmp_path):
    session = Session(SOURCE)
    session.apply(("population", "random_stress"))
    critical = session.state.critical
    path = tmp_path / "made.csv"
    ce.write_network(critical.network, path, critical.coordinates, force_densities=critical.sigma)
    opened = Session(File(path))
    assert np.allclose(opened.state.critical.sigma, critical.sigma, rtol=1e-12, atol=0)
    assert "force_densities" in script(opened)
    opened.apply(("edge", 3, 0.5))
    assert opened.state.model.dual is not None


def test_a_file_without_stress_opens_where_its_positions_are_critical(tmp_path, monkeypatch):
    session = Session(SOURCE)
    session.apply(("population", "random_stress"))
    critical = session.state.critical
    rng, path = np.random.default_rng(0), tmp_path / "patch.csv"
    for noise, nearest in ((1e-5, True), (0.05, False)):
        moved = critical.coordinates + noise * rng.standard_normal(critical.coordinates.shape)
        ce.write_network(critical.network, path, moved)
        opened = Session(File(path)).state.critical
        assert np.allclose(opened.sigma / opened.sigma.mean(), critical.sigma / critical.sigma.mean(), 0.05) is nearest
        assert np.allclose(opened.sigma, opened.sigma[0]) is not nearest
        # The lines of Python make it again to the last digit.
        monkeypatch.chdir(tmp_path)
        made = {}
        exec(script(Session(File(path))), made)
        np.testing.assert_array_equal(made["critical"].coordinates, opened.coordinates)


def test_the_force_diagram_closes_around_every_vertex(session):
    session.apply(("population", "random_stress"))
    critical, dual = session.state.critical, session.state.model.dual
    y, periods, offsets = dual.diagram(critical.network, critical.sigma, critical.bond_vectors)
    forces = critical.sigma[:, None] * critical.bond_vectors @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    right, left = dual.ends.T
    assert np.abs(y[left] + offsets @ periods - y[right] - forces).max() < 1e-11


def test_a_point_in_a_face_picks_it(session):
    critical, dual = session.state.critical, session.state.model.dual
    shades = shades_of(critical.tensions, critical.sigma).numbers
    drawing = network_drawing(critical.network, critical.coordinates, shades)
    for face in range(dual.faces.n_faces):
        outline = face_outlines(dual.faces, face, critical.network, critical.coordinates, critical.bond_vectors)[0]
        point = outline.mean(axis=0)
        inside = point @ np.linalg.inv(critical.network.cell)
        point = (inside - np.floor(inside)) @ critical.network.cell
        segment = drawing.nearest(point)
        assert dual.ends[drawing.edges[segment], drawing.side(segment, point)] == face


def test_shades_separate_tension_slackness_and_compression():
    tensions = np.array([0.0, 1.0, 0.5, -1.0, 1.0])
    shades = shades_of(tensions, tensions)
    assert shades.numbers.tolist() == [32, 31, 16, 33, 31] and (shades.low, shades.high) == (0.0, 1.0)


@pytest.mark.parametrize(("theme", "direction"), [("light", -1), ("dark", 1)])
def test_shades_differ_in_lightness_alone(theme, direction):
    colours = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in PALETTES[theme]]) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    # Luminance of WCAG 2; eyes without red or green cones see its order too.
    luminance = linear @ (0.2126, 0.7152, 0.0722)
    assert (direction * np.diff(luminance[:32]) > 0).all() and (direction * np.diff(linear[:32, 2]) >= 0).all()


SHORT = {
    "proved": (numbers.Number("B_0", 0.28, 4e-16, numbers.PROOF), "0.2800", "0.28000000000000"),
    "few certain digits": (numbers.Number("C_B", 0.12345, 1e-3, numbers.ESTIMATE), "0.12", "0.12"),
    "below its error": (numbers.Number("V_L", 3e-17, 1e-14, numbers.PROOF), "0.0000000000000", "0.0000000000000"),
    "far below its error": (numbers.Number("V_L", 5e-32, 7.9e-30, numbers.PROOF), "0", "0"),
    "negative": (numbers.Number("C_B", -12.34567, 1e-9, numbers.ESTIMATE), "-12.35", "-12.34567000"),
    "small": (numbers.Number("residual", 1.234567e-16), "1.235e-16", "1.23457e-16"),
    "count": (numbers.Number("floppy modes", 123456), "123456", "123456"),
    "none": (numbers.Number("G_0", np.nan), "—", "—"),
}


@pytest.mark.parametrize(("number", "short", "text"), SHORT.values(), ids=SHORT)
def test_a_number_is_shown_with_four_digits_unless_its_error_leaves_fewer(number, short, text):
    assert (number.short, number.text) == (short, text)
