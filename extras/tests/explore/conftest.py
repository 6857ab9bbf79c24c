"""A small dataset with configurations, for the tests of the page, and a loop that runs while one of them waits."""

import asyncio
import inspect

import pytest

from critflow.command.main import main


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """The path of a dataset of four cases; without the lengths no figure is drawn."""
    folder = tmp_path_factory.mktemp("ensemble")
    words = ["n_vertices=36", "seeds=0:2", "populations=max_B_0,random_stress", "strains=0.001,0.002,0.003"]
    words.append("variables=edges,offsets,cell,sigma,position,B_0,G_0,C_B,B")
    assert main(["run", "ensemble", "--out", str(folder), "--workers", "0", *(f"--set={word}" for word in words)]) == 0
    return folder / "ensemble.nc"


@pytest.fixture(scope="module")
def loop():
    with asyncio.Runner() as runner:
        yield runner


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem):
    """Tests that are coroutines run in the loop."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    pyfuncitem.funcargs["loop"].run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True
