"""The examples in the docstrings of public functions run and print what they show."""

import doctest
import inspect

import matplotlib.pyplot as plt
import pytest
from public import checked_functions

FUNCTIONS = checked_functions()
# Their examples are on pages of the documents.
ON_PAGES = {
    *("add", "cut", "prune_towards", "pareto", "design", "design_onset", "design_stiffness", "isogonal_design"),
    *("strained_response", "stiffening_bound", "surface_geometry"),
    *("principal_curvatures", "gaussian_curvature", "geometric_split", "hookean_split", "bond_operator"),
    "stress_hessian",
}


@pytest.fixture(scope="module")
def examples():
    finder = doctest.DocTestFinder(recurse=False)
    return {name: finder.find(inspect.unwrap(f), name, globs={})[0].examples for name, f in FUNCTIONS.items()}


def test_every_public_function_has_an_example(examples):
    assert {name for name, found in examples.items() if not found} <= ON_PAGES


def test_the_examples_of_docstrings_run(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner(optionflags=doctest.FAIL_FAST)
    for name, function in FUNCTIONS.items():
        for example in finder.find(inspect.unwrap(function), name, globs={}):
            report: list[str] = []
            runner.run(example, out=report.append)
            assert not runner.summarize(verbose=False).failed, "".join(report)
    plt.close("all")
