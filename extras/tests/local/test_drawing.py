"""Pictures of local responses."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from problems import hung_ring, random_stress, voronoi_3d
from refusals import refused

from critflow import CriticalManifold, optimize, voronoi_network
from critflow_extras import local_response
from critflow_extras.local.drawing import GROWS, SHRINKS, draw_response, response_legend

NETWORK = voronoi_network(20, seed=1)
BEST = optimize(NETWORK, "B_0").value
FOUND = local_response(BEST, (0, 9), [(4, 15), (0, 2), (1, 17)]).value


@pytest.fixture
def axes():
    drawn = draw_response(BEST, FOUND)
    yield drawn
    drawn.figure.clear()


def test_pairs_have_the_colours_and_widths_of_their_responses(axes):
    lines = [one for one in axes.collections if isinstance(one, LineCollection)][-1]
    colours, widths = [to_hex(colour) for colour in lines.get_colors()], lines.get_linewidths()
    assert set(colours) == {"#000000", to_hex(GROWS), to_hex(SHRINKS)}
    assert max(widths) == 3.5 and len({round(float(w), 9) for w in widths}) == 4
    r = FOUND.source.vector(NETWORK, BEST.bond_vectors)
    source = [line for line, colour in zip(lines.get_segments(), colours, strict=True) if colour == "#000000"]
    assert all(np.allclose(line[1] - line[0], r) for line in source)


def test_arrows_are_the_motion(axes):
    arrows = next(one for one in axes.collections if hasattr(one, "U"))
    motion, drawn = FOUND.displacements, np.stack([arrows.U, arrows.V], axis=1)
    assert np.allclose(motion[:, 0] * drawn[:, 1], motion[:, 1] * drawn[:, 0], atol=1e-12)
    assert np.linalg.norm(drawn, axis=1).max() <= 0.8 * NETWORK.spacing * (1 + 1e-12)
    assert len(response_legend()) == 3


def test_a_network_on_pins():
    critical = CriticalManifold(hung_ring()).configuration(random_stress(24, 1))
    drawn = draw_response(critical, local_response(critical, (0, 3), [(1, 6)]).value)
    assert len(drawn.collections) >= 3
    drawn.figure.clear()


def space():
    critical = CriticalManifold(voronoi_3d(4)).configuration(np.ones(56))
    return draw_response(critical, local_response(critical, (0, 9), [(4, 15)]).value)


test_refused = refused(
    {
        "space": (space, "planar networks"),
        "a solution that failed": (lambda: draw_response(BEST, 3.0), "response must be a LocalResponse"),
    }
)
