"""The examples in docstrings: the machinery of `test_examples.py`, of the scene and of the extras."""

import doctest
import inspect
from importlib import import_module

import matplotlib.pyplot as plt
import pytest
from sources import modules_of


def examples_of(function) -> list[doctest.DocTest]:
    return doctest.DocTestFinder(recurse=False).find(inspect.unwrap(function), function.__name__, globs={})


def without_example(package) -> set[str]:
    """The public functions of a package whose docstring has no example."""
    functions = {name: f for name in package.__all__ if inspect.isfunction(f := getattr(package, name))}
    return {name for name, f in functions.items() if not examples_of(f)[0].examples}


def run_and_print_what_they_show(package: str):
    """The test that the examples of every module of a package run."""
    files = modules_of(package).items()

    @pytest.mark.parametrize("module", [name for name, path in files if ">>> " in path.read_text(encoding="utf-8")])
    def test(module, monkeypatch, tmp_path):
        monkeypatch.setenv("TMPDIR", str(tmp_path))
        runner = doctest.DocTestRunner(optionflags=doctest.FAIL_FAST)
        defined = [f for f in vars(import_module(module)).values() if getattr(f, "__module__", "") == module]
        for function in filter(inspect.isfunction, defined):
            for example in examples_of(function):
                report: list[str] = []
                runner.run(example, out=report.append)
                assert not runner.summarize(verbose=False).failed, "".join(report)
        plt.close("all")

    return test
