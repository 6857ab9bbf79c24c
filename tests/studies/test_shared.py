"""The parts that several studies share."""

import ast
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from critflow import CriticalManifold, Status, voronoi_network
from critflow.engine.code_digest import load_study, named_studies
from workflows.shared.figures import violins
from workflows.shared.populations import LABELS, NAMES, POPULATIONS
from workflows.shared.reports import finite, spread, status_counts
from workflows.shared.verification import balance_error, bond_vectors, contradictions, forces

WORKFLOWS = Path(__file__).parents[2] / "workflows"


def test_populations_are_listed_by_name():
    """No study takes its populations from the list of objectives of the library, which may grow."""
    for path in WORKFLOWS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("critflow"):
                assert "OBJECTIVES" not in {alias.name for alias in node.names}, path
    for one in (LABELS, NAMES):
        assert len(set(one.values())) == len(POPULATIONS)
    assert load_study("ensemble").study.axes[1].values == tuple(POPULATIONS)


def test_own_studies_import_the_populations_by_the_package():
    installed = import_module("critflow.studies.shared.populations")
    assert installed.POPULATIONS.keys() == POPULATIONS.keys() and installed.configuration.__name__ == "configuration"


def test_no_study_needs_the_extras():
    for path in WORKFLOWS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                imported = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
                assert not any(name.startswith("critflow_extras") for name in imported), path


def test_the_hard_core_of_no_study_is_typed():
    """It is that of the networks of the library, so that the default stands in one place."""
    for path in WORKFLOWS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Dict):
                typed = [key.value for key, value in zip(node.keys, node.values, strict=True)
                         if isinstance(key, ast.Constant) and isinstance(value, ast.Constant)]  # fmt: skip
                assert "hard_core" not in typed, path


def test_a_study_imports_no_other_study():
    folders = {path.parent.name for path in WORKFLOWS.rglob("study.py")}
    for path in WORKFLOWS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level > 1:
                assert (node.module or "").split(".")[0] not in folders, path


def test_a_violin_on_a_logarithmic_axis_marks_the_median_of_the_values():
    """Of two values the median is their mean, which has another logarithm than theirs."""
    axes = Figure().add_subplot()
    violins(axes, [np.array([1.0, 100.0])], ["two"], ["k"], log=True)
    assert axes.lines[-1].get_ydata()[0] == pytest.approx(np.log10(50.5), rel=1e-14)
    assert axes.lines[-1].get_color() == "k"


@pytest.mark.parametrize(
    "values, names",
    [((0.2, 0.4), ["0.2", "0.3", "0.4"]), ((2e-6, 4e-6), [rf"${n} \times 10^{{-6}}$" for n in (2, 3, 4)])],
)
def test_a_logarithmic_axis_of_less_than_a_decade_names_its_ticks(values, names):
    axes = Figure().add_subplot()
    violins(axes, [np.array(values)], ["one"], ["k"], log=True)
    assert [text.get_text() for text in axes.get_yticklabels()] == names


def test_numbers_that_are_not_finite_are_left_out():
    values = np.array([1.0, np.nan, 3.0, np.inf])
    assert finite(values).tolist() == [1.0, 3.0]
    assert spread(values) == "2 ± 1"
    assert spread(np.full(3, np.nan)) == "undefined"
    assert status_counts([0, 6, 0]) == {"ok": 2, "slack_edges": 1}


@pytest.mark.parametrize(
    "status, lines", [(Status.ok, 1), (Status.slack_edges, 1), (Status.failed, 0), (Status.missing, 0)]
)
def test_a_contradiction_names_the_case_and_the_checks(status, lines):
    ds = xr.Dataset({"status": ("seed", [int(Status.ok), int(status)])}, {"seed": [3, 4]})
    problems = contradictions(ds, ("seed",), lambda one: [("length", int(one.seed) == 3), ("sigma", True)])
    assert problems == ["seed 4: length does not follow from the arrays"] * lines


STORED = re.compile(
    r"(sampled_|strained_|sheared_)?(position|bulk|growth|least|signed|tensile|sampled|achieved|critical_strain"
    r"|B|G|G_stress_corrected|B_0|G_0(_ascent)?|C_[BG](_stress_corrected)?(_fit)?)"
)


@pytest.mark.parametrize("name", named_studies())
def test_moduli_coefficients_and_coordinates_have_a_bound_on_their_errors(name):
    """A fitted coefficient has its standard error instead; the steps of an ascent and their pictures are no results."""
    names = {variable.name for variable in load_study(name).study.variables}
    bare = {
        one for one in names if STORED.fullmatch(one) and not {f"{one}_error_bound", f"{one}_standard_error"} & names
    }
    assert bare == ({"G_0_ascent", "position"} if name == "shear" else set())


@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e6])
def test_coordinates_of_short_edges_with_large_stresses_are_in_balance(ratio):
    # The edge of the largest σ is short, and the coordinates of its ends have the rounding of the whole cell.
    network = voronoi_network(n_vertices=100, seed=3)
    sigma = np.ones(network.n_edges)
    sigma[::30] = ratio
    critical = CriticalManifold(network).configuration(sigma)
    stored = xr.Dataset(
        {
            "sigma": ("edge", critical.sigma),
            "position": (("vertex", "axis"), critical.coordinates.copy()),
            "edges": (("edge", "end"), network.edges),
            "offsets": (("edge", "axis"), network.offsets),
            "cell": (("cell_vector", "axis"), network.cell),
        }
    )
    error = balance_error(stored, critical.tensions)
    assert np.abs(forces(stored, bond_vectors(stored))).max() <= error
    stored["position"][1] += 1e3 * error / critical.sigma.min()
    assert np.abs(forces(stored, bond_vectors(stored))).max() > error
