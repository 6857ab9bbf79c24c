"""Ends of fronts: certified by gradients where values differ by rounding, and never said to be one by mistake."""

import pytest

from critflow import InputError, Status, voronoi_network
from critflow_extras import pareto
from critflow_extras.fronts.pareto import FRONT_CERTIFIED

# Ends that stalled at a residual of 1.1 to 1.4 times the limit.
STALLED = [(200, 0, "V_tau"), (500, 0, "V_L"), (500, 1, "V_L")]


@pytest.mark.parametrize(("n_vertices", "seed", "other"), STALLED)
def test_the_stiffest_end_is_certified(n_vertices, seed, other):
    front = pareto(voronoi_network(n_vertices, seed=seed), ["B_0", other], 2)
    assert front.statuses == (Status.ok, Status.ok)
    assert front.residuals.max() < 0.3 * FRONT_CERTIFIED


def test_ends_far_apart_are_not_called_the_same():
    """From equal stresses the gradient of G_0 is small and its curvature leads away."""
    front = pareto(voronoi_network(500, seed=0), ["B_0", "G_0"], 2, throw=False)
    (stiff, no_shear), (_, shear) = front.achieved
    assert stiff > 0.27 and no_shear < 1e-4 and shear > 0.07


def test_an_end_that_is_not_reached_says_so():
    network = voronoi_network(60, seed=0)
    for second, best in (("G_0", "largest G_0"), ("V_L", "smallest V_L")):
        with pytest.raises(InputError, match=f"{best} is not reached: raise max_steps"):
            pareto(network, ["B_0", second], 2, max_steps=1)
    with pytest.raises(InputError, match="same best configuration"):
        pareto(network, {"B_0": "largest", "C_B": "smallest"}, 2)
