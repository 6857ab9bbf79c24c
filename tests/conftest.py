"""Two sizes of the test suite.

`pytest` runs every test but the sweeps: repetitions of a test over many seeds, sizes or steps. `pytest -m ""` runs
everything, and draws all pictures; `.ci/run` does that.
"""

import os

# Before NumPy is imported: the tests run in one process per core, and threads of BLAS in each of them wait for the
# cores of the others, at twice the processor time.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import pytest
from hypothesis import settings
from matplotlib.figure import Figure


def pytest_configure(config):
    settings.register_profile("reproducible", max_examples=20, deadline=None, derandomize=True)
    settings.load_profile("reproducible")


def everything(config):
    """Whether the sweeps run too."""
    return "not sweep" not in config.getoption("markexpr")


@pytest.fixture(scope="module")
def undrawn(request):
    """Pictures are made but remain empty: drawing them takes most of the time of a small study."""
    with pytest.MonkeyPatch.context() as patch:
        if not everything(request.config):
            patch.setattr(Figure, "draw", lambda figure, renderer: None)
        yield


@pytest.fixture
def assert_picture(request):
    """`assert_picture(file)`: the file is a picture, and not an empty one if pictures are drawn."""

    def check(file, least=10_000):
        picture = file.read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert not everything(request.config) or least < len(picture) < 500_000

    return check
