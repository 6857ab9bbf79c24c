"""The script of docs/idea.md: its length, what it imports, and its numbers against those of critflow.

The script shares no code with critflow, so that it is a reference independent of closed forms and finite differences.
"""

import ast
import importlib.util
import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import critflow as cf
from critflow.quantities import PenalisedModulus, evaluate

PAGE = Path(__file__).parents[1] / "docs" / "idea.md"
LINES = 180
LIBRARIES = {"numpy", "scipy", "xarray", "dask"}

RTOL = 1e-10
# Minimisers compare values, which are flat at an optimum: rounding of 1e-16 leaves σ, and with it tensions and
# gradients of log σ times N_b, uncertain by its root.  V_L is zero there and has no such rounding.
FLAT = 1e-6
# max G_0 has several local optima, which differ by up to a tenth: two minimisers may end at two of them.
LOCAL_OPTIMA = 0.1
# A straight line through strains up to 4e-5 differs from the tangent by the curvature of the modulus.
FIT = 2e-3

STRAINS = np.array([0.001, 0.002, 0.003, 0.004])
MODULI = {"B": "bulk_modulus", "G": "shear_modulus", "G_stress_corrected": "shear_modulus_stress_corrected"}
OPTIMA = {"min_V_L": "V_L", "min_V_tau": "V_tau", "max_B_0": "B_0", "max_G_0": "penalised_G_0"}


def block(kind: str) -> str:
    """The one block of the page with this info string."""
    (text,) = re.findall(rf"^```{re.escape(kind)}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    return text


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """The file that the page shows."""
    file = tmp_path_factory.mktemp("idea") / "idea.py"
    file.write_text(block("python idea.py"), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def idea(script):
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("idea", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=["script", "critflow", "oblique cell"])
def networks(request, idea):
    """One network as the script and as critflow have it."""
    if request.param == "script":
        edges, offsets, cell = idea.voronoi(60, seed=3)  # V_tau attains its least value
        network = cf.Network(edges, offsets, cell)
    else:
        shape = [[1.0, 0.0], [0.4, 0.9]] if request.param == "oblique cell" else None
        network = cf.voronoi_network(60, seed=2, cell=shape)
        edges, offsets, cell = network.edges, network.offsets, network.cell
    return idea.make_network(edges, offsets, cell), network


@pytest.fixture(scope="module")
def stresses(idea, networks):
    """σ of every population (N_b,), scaled to Σσ² = N_b as critflow scales it."""
    found = {name: make(networks[0], np.random.default_rng(3)) for name, make in idea.POPULATIONS.items()}
    return {name: sigma / np.sqrt(np.mean(sigma**2)) for name, sigma in found.items()}


def assert_same(values, expected, rtol=RTOL):
    """Arrays that agree relative to their largest component."""
    np.testing.assert_allclose(values, expected, rtol=0, atol=rtol * np.abs(expected).max())


def of_critflow(network, name):
    return PenalisedModulus(cf.quantity(network, "G_0"), 0.1) if name == "penalised_G_0" else cf.quantity(network, name)


def tensions(idea, network, sigma):
    """σ|L| at a configuration of the script (N_b,)."""
    return sigma * np.linalg.norm(idea.configuration(network, sigma)[0], axis=1)


def unit(values):
    return values / np.linalg.norm(values)


def at_vertices(edges, L):
    """Σ g|L|L of every vertex (N_v, 2), in the order of their sizes: what does not depend on the order of vertices."""
    weighted = np.linalg.norm(L, axis=1)[:, None] * L
    sums = np.zeros((edges.max() + 1, 2))
    np.add.at(sums, edges[:, 1], weighted)
    np.subtract.at(sums, edges[:, 0], weighted)
    return sums[np.argsort(np.linalg.norm(sums, axis=1))]


def test_the_script_is_short_and_imports_four_libraries(script):
    text = script.read_text(encoding="utf-8")
    assert text.count("\n") <= LINES
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [
        [node.module] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names] for node in imports
    ]
    assert {name.split(".")[0] for row in names for name in row} - sys.stdlib_module_names == LIBRARIES


def test_the_same_points_give_the_same_network(idea, monkeypatch):
    points = []

    def seen(tiles):
        points.append(np.split(tiles, 9)[4])
        return voronoi(tiles)

    voronoi = idea.Voronoi
    monkeypatch.setattr(idea, "Voronoi", seen)
    edges, offsets, cell = idea.voronoi(60, seed=1)
    network = idea.make_network(edges, offsets, cell)
    gaps = points[0][:, None] - points[0]
    distances = np.linalg.norm(gaps - np.round(gaps), axis=2) + np.eye(30)
    assert distances.min() > 0.8 / np.sqrt(30)
    expected = cf.CriticalManifold(cf.voronoi_network(points=points[0])).configuration(np.ones(90))
    L, _ = idea.configuration(network, np.ones(90))
    assert_same(at_vertices(edges, L), at_vertices(expected.network.edges, expected.bond_vectors))
    assert network.V == pytest.approx(60, rel=RTOL, abs=0)


def test_one_stress_gives_one_configuration(idea, networks, stresses):
    small, network = networks
    for sigma in stresses.values():
        L, _ = idea.configuration(small, sigma)
        assert_same(L, cf.CriticalManifold(network).configuration(sigma).bond_vectors)


@pytest.mark.parametrize("name", ["B_0", "G_0", "V_L", "V_tau", "penalised_G_0"])
def test_values_and_gradients_agree(idea, networks, stresses, name):
    small, network = networks
    objective = of_critflow(network, name)
    for population in ("random_stress", "max_B_0", "max_G_0"):
        sigma = stresses[population]
        critical = cf.CriticalManifold(network).configuration(sigma)
        expected = evaluate(critical.manifold.balance(critical.sigma), objective)
        value, gradient = idea.evaluate(small, getattr(idea, name), sigma)
        assert value == pytest.approx(expected.value, rel=RTOL, abs=0)
        # At an optimum the gradient is rounding, of numbers of size 1/N_b.
        scale = max(np.abs(expected.gradient).max(), 1e-3 / len(sigma))
        np.testing.assert_allclose(gradient, expected.gradient, rtol=0, atol=RTOL * scale)


@pytest.mark.parametrize("population", OPTIMA)
def test_optima_are_stationary(idea, networks, stresses, population):
    small, _ = networks
    _, gradient = idea.evaluate(small, getattr(idea, OPTIMA[population]), stresses[population])
    assert np.abs(gradient * stresses[population]).max() * len(gradient) < FLAT


@pytest.mark.parametrize(
    "population, largest, rtol", [("max_B_0", np.inf, RTOL), ("min_V_tau", np.inf, FLAT), ("min_V_L", RTOL**2, RTOL)]
)
def test_optima_have_the_same_value_and_tensions(idea, networks, stresses, population, largest, rtol):
    """The least V_L is zero, up to lengths equal to RTOL. Isogonal modes change lengths at the same tensions."""
    small, network = networks
    best = cf.optimize(network, OPTIMA[population])
    value, _ = idea.evaluate(small, getattr(idea, OPTIMA[population]), stresses[population])
    assert value == pytest.approx(best.objective, rel=RTOL, abs=0 if largest == np.inf else largest)
    assert max(value, best.objective) < largest
    if population == "max_B_0":
        assert value == pytest.approx(cf.upper_bound(network, "B_0"), rel=RTOL, abs=0)
    assert_same(unit(tensions(idea, small, stresses[population])), unit(best.value.tensions), rtol)


def test_the_largest_shear_modulus_is_a_local_optimum_of_both(idea, networks, stresses):
    small, network = networks
    best = cf.optimize(network, "G_0")
    value, _ = idea.evaluate(small, idea.penalised_G_0, stresses["max_G_0"])
    assert value == pytest.approx(best.objective, rel=LOCAL_OPTIMA, abs=0)
    there, gradient = idea.evaluate(small, idea.penalised_G_0, best.value.sigma)
    assert there == pytest.approx(best.objective, rel=RTOL, abs=0)
    assert np.abs(gradient * best.value.sigma).max() * len(gradient) < FLAT


@pytest.mark.parametrize("population", [*OPTIMA, "random_stress"])
def test_strain_paths_agree(idea, networks, stresses, population):
    small, network = networks
    critical = cf.CriticalManifold(network).configuration(stresses[population])
    expected = cf.strain_path(critical, STRAINS).value
    path = idea.strain_path(small, idea.configuration(small, stresses[population])[0], STRAINS)
    np.testing.assert_array_equal(path.strain, STRAINS)
    for name, attribute in {**MODULI, "E": "energy"}.items():
        np.testing.assert_allclose(path[name], getattr(expected, attribute), rtol=RTOL, err_msg=name)


@pytest.mark.parametrize("population", [*OPTIMA, "random_stress"])
def test_slopes_near_the_transition_are_the_exact_coefficients(idea, networks, stresses, population):
    small, network = networks
    critical = cf.CriticalManifold(network).configuration(stresses[population])
    exact = cf.stiffening(critical).value
    path = idea.strain_path(small, idea.configuration(small, stresses[population])[0], STRAINS / 100)
    for name in MODULI:
        slope = np.polyfit(path.strain, path[name], 1)[0]
        assert slope == pytest.approx(getattr(exact, f"C_{name}"), rel=FIT, abs=FIT), name


def test_the_dataset_has_every_case_in_its_place(idea):
    seeds, n_vertices = [4, 1], 20
    dataset = idea.ensemble(seeds, n_vertices, STRAINS, scheduler="synchronous")
    assert dict(dataset.sizes) == {"seed": 2, "population": 5, "strain": 4}
    assert list(dataset.seed) == seeds and list(dataset.population) == [*OPTIMA, "random_stress"]
    for name, best in (("V_L", "min_V_L"), ("V_tau", "min_V_tau"), ("B_0", "max_B_0"), ("G_0", "max_G_0")):
        extreme = dataset[name].idxmax("population") if best[:3] == "max" else dataset[name].idxmin("population")
        assert (extreme == best).all(), name
    for seed in seeds:
        network = cf.Network(*idea.voronoi(n_vertices, seed))
        draw = np.random.default_rng([seed, 1]).normal(size=network.n_edges)
        for population, sigma in (("max_B_0", np.ones(network.n_edges)), ("random_stress", np.abs(draw))):
            case = dataset.sel(seed=seed, population=population)
            critical = cf.CriticalManifold(network).configuration(sigma)
            values = {name: cf.quantity(network, name).evaluate(critical)[0] for name in ("B_0", "G_0", "V_L", "V_tau")}
            path = cf.strain_path(critical, STRAINS).value
            values |= {name: getattr(path, attribute) for name, attribute in MODULI.items()}
            values |= {f"C_{name}": np.polyfit(STRAINS, values[name], 1)[0] for name in MODULI}
            for name, value in {**values, "E": path.energy}.items():
                np.testing.assert_allclose(case[name], value, rtol=RTOL, err_msg=f"{name}, {seed}, {population}")


@pytest.mark.sweep
def test_the_page_shows_what_the_script_prints(script):
    done = subprocess.run([sys.executable, "-W", "error", script], capture_output=True, text=True, cwd=script.parent)
    assert done.returncode == 0, done.stderr
    printed, shown = (pd.read_csv(io.StringIO(text), sep=r"\s+", index_col=0) for text in (done.stdout, block("text")))
    # Optima that are local or not unique may differ on another processor.
    pd.testing.assert_frame_equal(printed, shown, rtol=0, atol=0.002)
