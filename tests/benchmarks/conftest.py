"""The studies of this folder are run without drawing their pictures, unless the sweeps run too."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def quick(undrawn_but_in_sweeps):
    """Studies are run without drawing their pictures, unless the sweeps run too."""
