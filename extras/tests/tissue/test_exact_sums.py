"""Sums in extended precision against numbers of higher precision."""

import numpy as np
import scipy.sparse as sp

from critflow.double_double import Extended
from critflow_extras.tissue.exact_sums import exact_sums
from workflows.benchmarks import reference


def test_sums_lose_nothing():
    rng = np.random.default_rng(1)
    high = rng.standard_normal(40)
    low = 1e-17 * rng.standard_normal(40)
    weights = rng.uniform(0.1, 3.0, (5, 40))
    goal = weights @ high
    expected = reference.numbers(weights) @ reference.numbers(high, low) - reference.numbers(goal)
    found = exact_sums(sp.csr_array(weights), Extended(high, low), goal)
    np.testing.assert_allclose(found, expected.astype(float), rtol=1e-6, atol=1e-23)
