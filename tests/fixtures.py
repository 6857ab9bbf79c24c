"""Two sizes of the test suite.

`pytest` runs every test but the sweeps: repetitions of a test over many seeds, sizes or steps, the tests of studies
other than the ensemble, of benchmarks and of pages, and the pictures and long programs of the documents.
`pytest -m ""` runs everything, and draws the pictures of the studies; `.ci/run` does that.
"""

import os
import re
from contextlib import contextmanager, nullcontext
from pathlib import Path

# Before NumPy is imported: the tests run in one process per core, and threads of BLAS in each of them wait for the
# cores of the others, at twice the processor time.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import matplotlib.pyplot as plt
import pytest
from hypothesis import settings
from matplotlib.figure import Figure
from skips import pytest_terminal_summary  # noqa: F401 (a hook)
from units import INVERSE, PLAIN, SCALED

from critflow.command.main import main

TINY = str(Path(__file__).parent / "engine" / "tiny_study.py")


def pytest_configure(config):
    settings.register_profile("reproducible", max_examples=20, deadline=None, derandomize=True)
    settings.load_profile("reproducible")


def everything(config):
    """Whether the sweeps run too."""
    return "not sweep" not in config.getoption("markexpr")


# Folders of tests of what the package does not contain, and studies that users start with.
_MADE_HERE, _RUN_BY_USERS = ("studies", "benchmarks", "pages"), ("test_ensemble.py", "test_own_network.py")
# Pictures and long programs of the documents.
_OF_DOCUMENTS = re.compile(
    r"test_(a_picture_of_the_gallery|a_committed_picture|an_eighth_population)"
    r"|.*\[docs/(question|command|howto/dataset)\.md"
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        made_here = item.path.parent.name in _MADE_HERE and item.path.name not in _RUN_BY_USERS
        if made_here or _OF_DOCUMENTS.match(item.name):
            item.add_marker(pytest.mark.sweep)
    # Files that wait for other processes begin, so that no process is alone with them at the end.
    items.sort(key=lambda item: item.path.parent.name != "engine")


@pytest.fixture(params=[PLAIN, SCALED, INVERSE], ids=str)
def units(request):
    """A test runs with lengths near one and stiffnesses of one, and with both far from it."""
    return request.param


@pytest.fixture(scope="session")
def results(tmp_path_factory, empty_pictures):
    """The results of a study without physics; tests only read them."""
    folder = tmp_path_factory.mktemp("results")
    with empty_pictures():
        assert main(["run", TINY, "--out", str(folder), "--workers", "0"]) == 0
    return folder


@pytest.fixture
def said(capsys):
    """`said(words, code)` gives a command and returns what it wrote to stdout and stderr."""

    def of(words, code=0):
        capsys.readouterr()
        assert main(words) == code
        return capsys.readouterr()

    return of


@pytest.fixture(autouse=True)
def figures_are_closed():
    """Pyplot keeps each figure, and warns from the twenty-first one in a process of many tests."""
    yield
    plt.close("all")


@contextmanager
def _empty_pictures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "draw", lambda figure, renderer: None)
        yield


@pytest.fixture(scope="session")
def empty_pictures():
    """A context in which pictures are made but remain empty: drawing takes most of the time of a small study."""
    return _empty_pictures


@pytest.fixture(scope="module")
def undrawn(empty_pictures):
    with empty_pictures():
        yield


@pytest.fixture(scope="module")
def undrawn_but_in_sweeps(request, empty_pictures):
    with nullcontext() if everything(request.config) else empty_pictures():
        yield


@pytest.fixture
def assert_picture(request):
    """`assert_picture(file)`: the file is a picture, and not an empty one if pictures are drawn."""

    def check(file, least=10_000, most=500_000):
        picture = file.read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert not everything(request.config) or least < len(picture) < most

    return check
