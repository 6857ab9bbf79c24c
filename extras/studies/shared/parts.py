"""Settings, outcomes, measurements and drawings that several studies of critflow-extras share."""

import time

import numpy as np
from critflow.studies.shared.populations import SETTINGS
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon

from critflow import CriticalConfiguration, Status
from critflow.engine import Variable
from critflow.networks import Array

# A spread at which every edge of a planar network carries tension, and few edges are slack in space.
NARROW = SETTINGS | {"spread": 0.1}
MISSED = (Status.infeasible, Status.not_reached)  # outcomes of designs without their targets


def scaled_stress(critical: CriticalConfiguration) -> Array:
    """S_xx, S_yy, S_xy over √D of a planar configuration, all that its linear elasticity is; NaN without one."""
    S = np.einsum("a,ai,aj->ij", critical.sigma, critical.bond_vectors, critical.bond_vectors)
    S /= np.sqrt(np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness))
    return np.array([S[0, 0], S[1, 1], S[0, 1]])


def signed(value):
    """A number with the sign of typography."""
    return f"{value:g}".replace("-", "−")


def segments(critical):
    """Ends of the edges (N_b, 2, 2) of a planar configuration, with the tails inside the cell."""
    network = critical.network
    tail = critical.coordinates[network.edges[:, 0]]
    tail = (tail @ np.linalg.inv(network.cell) % 1.0) @ network.cell
    return np.stack([tail, tail + critical.bond_vectors], axis=1)


def draw_in_cell(axes, lines, widths, n_vertices, shear=0.0, **style):
    """Draw the edges of a planar network with all their images in the cell, a sheared square with V = N_v, once."""
    cell = np.sqrt(n_vertices) * np.array([[1, 0], [shear, 1]])
    outline = Polygon([[0, 0], cell[0], cell[0] + cell[1], cell[1]], facecolor="none", edgecolor="0.7", linewidth=0.8)
    axes.add_patch(outline)
    images = [lines + (np.array(shift) - 1) @ cell for shift in np.ndindex(3, 3)]
    drawn = LineCollection(np.concatenate(images), linewidths=np.tile(widths, len(images)), **style)
    axes.add_collection(drawn, autolim=False)
    drawn.set_clip_path(outline)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_anchor("N")
    axes.set_axis_off()


def seconds(dims, /, **long_names):
    """Variables with times, which differ from run to run."""
    return [Variable(name, dims, "f8", long_name=text, volatile=True) for name, text in long_names.items()]


def timed(function, *arguments, **options):
    """The result of a call, and its processor time in seconds."""
    start = time.process_time()
    result = function(*arguments, **options)
    return result, time.process_time() - start
