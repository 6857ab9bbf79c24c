"""What holds at every onset of cables."""

import numpy as np
import pytest


def check(solution, lengths):
    """Critical to rounding on the taut edges, no other edge longer than ℓ, and bounds on both sides."""
    onset = solution.value
    assert solution.ok and all(onset.proven)
    assert onset.lower < onset.strain < onset.upper < onset.lower + 1e-9
    critical, taut = onset.configuration, onset.taut
    # Coordinates of order ten limit the lengths of the shortest edges.
    np.testing.assert_allclose(critical.lengths[taut], lengths[taut], rtol=1e-12, atol=1e-15)
    assert (critical.lengths < lengths * (1 + 1e-9)).all()
    np.testing.assert_allclose(critical.rest_lengths, lengths, rtol=1e-12, atol=1e-15)
    assert critical.residual < 1e-11
    assert (critical.sigma[taut] > 0).all() and (critical.sigma[~taut] == 0).all()
    assert np.trace(onset.stress) == pytest.approx(1, rel=1e-12)
