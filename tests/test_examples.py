"""The examples in the docstrings of public functions run and print what they show."""

import doctest
import inspect
from importlib import import_module

import matplotlib.pyplot as plt
import pytest

import critflow

# Their examples are on pages of the documents.
ON_PAGES = {"design", "pareto", "prune_towards"}

MODULES = [
    ".".join(("critflow", *path.relative_to(FOLDER).with_suffix("").parts))
    for path in sorted(FOLDER.rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8") and not absent(used_by_file(path))
]


def examples_of(function) -> list[doctest.DocTest]:
    return doctest.DocTestFinder(recurse=False).find(inspect.unwrap(function), function.__name__, globs={})


def test_every_public_function_has_an_example():
    functions = {name: f for name in critflow.__all__ if inspect.isfunction(f := getattr(critflow, name, None))}
    assert {name for name, f in functions.items() if not examples_of(f)[0].examples} <= ON_PAGES


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_docstrings_run(module, monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    runner = doctest.DocTestRunner(optionflags=doctest.FAIL_FAST)
    defined = [f for f in vars(import_module(module)).values() if getattr(f, "__module__", "") == module]
    for function in filter(inspect.isfunction, defined):
        for example in examples_of(function):
            report: list[str] = []
            runner.run(example, out=report.append)
            with left_out_without_services():
                assert not runner.summarize(verbose=False).failed, "".join(report)
    plt.close("all")
