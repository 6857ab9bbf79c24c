"""Optima and the topologies that have them: sections IV A 2 and IV B of the paper, and its supplement.

Each function takes a `Sample` and returns a number and whether the statement holds in this network.
"""

import numpy as np

import critflow as cf
from critflow.isogonal import face_modes
from critflow.points import STANDARD_HARD_CORE

from .sample import rank

STARTS = 4
MANY = 400  # vertices of networks of random points, where the density fluctuates
NEAR = 2.0  # of a vertex, in units of the root of its mean area
HARD_CORES = STANDARD_HARD_CORE, 0.0  # random sequential addition of the ensemble, and points without any


def descents(sample, objective, method):
    """Optima from random stresses e^{N(0, 1/2)}."""
    rng = sample.rng(objective)
    starts = [np.exp(0.5 * rng.standard_normal(sample.network.n_edges)) for _ in range(STARTS)]
    return [cf.optimize(sample.manifold, objective, method, start=start, throw=False).value for start in starts]


def apart(rows):
    """Largest difference of rows from the first, each scaled to a root mean square of one."""
    scaled = [row / np.sqrt(np.mean(row**2)) for row in rows]
    return max(np.abs(row - scaled[0]).max() for row in scaled[1:])


def B_0_one_force_network(sample):
    """Largest difference of the tensions of ascents of B_0 from those of σ = k."""
    off = apart([sample.stiffest.tensions, *(one.tensions for one in descents(sample, "B_0", "lbfgs"))])
    return off, off < 1e-5


def B_0_lengths(sample):
    """Mean length of the edges at max B_0."""
    lengths = sample.stiffest.lengths
    clustered = abs(lengths.mean() - 1) < 0.25 and lengths.std() < 0.25 * lengths.mean()
    return lengths.mean(), clustered and sample.stiffest.sigma.min() > 0


def isogonal_face_modes(sample):
    """Number of independent isogonal modes that those of the faces do not span."""
    every = cf.isogonal_modes(sample.stiffest)
    of_faces = face_modes(sample.stiffest).elongations.toarray()
    n = every.n_independent
    spanned = rank(of_faces) == n == rank(np.vstack([of_faces, every.elongations]))
    return n - rank(of_faces), spanned and n == sample.n_vertices // 2 - 1


def unique_V_L(sample):
    """Largest difference of σ between descents of V_L from random stresses."""
    off = apart([one.sigma for one in descents(sample, "V_L", "newton")])
    return off, off < 1e-6


def random_addition(sample):
    """Part of the edges that equal rest lengths stress on purely random points; all with random addition."""
    stressed = [float(np.mean(_taut(_of_points(sample, hard_core)))) for hard_core in HARD_CORES]
    return stressed[1], stressed[0] == 1 and stressed[1] < 1


def dense_later(sample):
    """Vertices near the ends of edges that equal rest lengths leave slack on random points, over those of taut edges.

    At the transition the taut edges are rigid, and the slack ones become so at a larger strain.
    """
    network = _of_points(sample, 0.0)
    taut = _taut(network)
    x = network.positions @ np.linalg.inv(network.cell)
    apart = x[:, None] - x
    near = np.linalg.norm((apart - np.round(apart)) @ network.cell, axis=2) < NEAR
    of_edges = near.sum(axis=1)[network.edges].mean(axis=1)
    ratio = of_edges[~taut].mean() / of_edges[taut].mean() if not taut.all() else np.nan
    return ratio, ratio > 1


def _of_points(sample, hard_core):
    """A network of many random points, of which some regions are denser."""
    return cf.voronoi_network(max(MANY, sample.n_vertices), sample.seed, hard_core)


def _taut(network):
    """The edges that equal rest lengths stress at the transition."""
    one = cf.critical_from_lengths(network, np.ones(network.n_edges), throw=False).value
    return one.sigma > 1e-9 * one.sigma.max()


def angles_of_120(sample):
    """Least V_τ of a network with other faces than hexagons; zero and 120° in the honeycomb."""
    honeycomb = cf.optimize(cf.lattice("honeycomb", 3, 3), "V_tau")
    unit = honeycomb.value.bond_vectors / honeycomb.value.lengths[:, None]
    g = honeycomb.value.network.incidence.toarray()
    cosines = [
        float((sign[a] * unit[a]) @ (sign[b] * unit[b]))
        for sign in g.T
        for a, b in zip(np.flatnonzero(sign), np.roll(np.flatnonzero(sign), 1), strict=True)
    ]
    regular = honeycomb.objective < 1e-20 and np.allclose(cosines, -0.5, rtol=0, atol=1e-10)
    hexagons = bool((sample.network.faces.sizes == 6).all())
    least = cf.optimize(sample.manifold, "V_tau", throw=False).objective
    return least, regular and not hexagons and least > 1e-3
