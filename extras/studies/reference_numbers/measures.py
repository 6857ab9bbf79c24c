"""One function for each reference number: from parameters and a seed to a value and the curve that it is read from."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

import critflow as cf
import critflow_extras as ce
from critflow.engine import stable_rng
from critflow.taut_part import backbone
from critflow_extras.anisotropy.tensors import voigt
from critflow_extras.pruning.pruning import carrying_part

# Length of the stored curves.
POINTS = 8
# Strain past an onset at γ_c, in units of γ_c: the coefficient is the limit of small strain.
STEP = 1e-4
# Bulk modulus over shear modulus below which a network does not resist dilation.
SOFT = 1e-6
# Strains of a dilation near the transition.
_NEAR = (1e-6, 1e-4)
SHEAR = cf.Deformation.simple_shear(2)
# Simple shears between which a disordered network has the cell without shear stress.
_SHEARS = (-0.5, 0.5)
# Turn of a corner, relative to the lengths of its sides, below which a corner is straight.
STRAIGHT = 1e-9


class Measured(NamedTuple):
    """A value, the curve (x, y) behind it, at most `POINTS` long, and the outcome."""

    value: float
    x: np.ndarray
    y: np.ndarray
    status: cf.Status = cf.Status.ok


def hexagon_shape(parameters, seed):
    """Critical shape index of regular hexagons with perimeter springs."""
    return _shape(cf.lattice("honeycomb", 4, 4))


def planar_shape(parameters, seed):
    """Critical shape index of the disordered planar vertex model without an area term."""
    return _shape(cf.voronoi_network(parameters["n_vertices_cells"], seed))


def _shape(network):
    found = ce.critical_from_perimeters(network, np.ones(network.faces.n_faces), throw=False)
    shapes = found.value.shape_index
    return Measured(float(shapes.mean()), np.empty(0), np.empty(0), found.status)


def honeycomb_length(parameters, seed):
    """Least length ℓ_0 that all edges of the honeycomb can have at V = N_v; the curve is ℓ_min in simple shear."""
    strains = np.linspace(-0.2, 0.2, POINTS)
    return Measured(_least_length(0.0), strains, np.array([_least_length(gamma) for gamma in strains]))


def honeycomb_shear(parameters, seed):
    """Coefficient b of ℓ_min = ℓ_0 + b γ², from differences at two strains with the next order removed."""
    steps = np.array([0.01, 0.02])
    b = [(_least_length(h) + _least_length(-h) - 2 * _least_length(0.0)) / (2 * h**2) for h in steps]
    return Measured((4 * b[0] - b[1]) / 3, steps, np.array(b))


def _least_length(gamma):
    network = cf.lattice("honeycomb", 3, 3)
    scale = np.sqrt(network.n_vertices / network.volume)
    sheared = network.deformed(scale * SHEAR.gradient(gamma))
    return float(cf.critical_from_lengths(sheared, np.ones(network.n_edges)).value.lengths.mean())


def factor_three(parameters, seed):
    """(G − G_c) γ_c/σ just past onsets at γ_c in simple shear; the value is the limit γ_c → 0 of its fit a + b γ_c².

    γ is measured from the cell of least ℓ_min on this path, where the critical network has no shear stress.
    """
    network = _without_shear_stress(cf.voronoi_network(parameters["n_vertices"], seed))
    onsets = np.array(parameters["onsets"])
    ratios = np.full(len(onsets), np.nan)
    for n, onset in enumerate(onsets):
        # Equal lengths that fit the cell sheared by γ_c are those whose onset is γ_c.
        sheared = network.deformed(SHEAR.gradient(onset))
        found = cf.critical_from_lengths(sheared, np.ones(network.n_edges), throw=False)
        if not found.ok:
            return Measured(np.nan, onsets, ratios, found.status)
        G_c = cf.elasticity(found.value).value.shear
        strains = STEP * onset * np.array([1.0, 2.0])
        path = cf.strain_path(found.value, strains, deformation="simple_shear", taut_only=True).value
        ratio = (path.modulus - G_c) * onset / path.stress[:, 0, 1]
        ratios[n] = 2 * ratio[0] - ratio[1]
    return Measured(float(np.polyfit(onsets**2, ratios, 1)[1]), onsets, ratios)


def _without_shear_stress(network):
    """The network in the sheared cell in which equal lengths are critical without shear stress."""

    def stress(gamma):
        found = cf.critical_from_lengths(network.deformed(SHEAR.gradient(gamma)), np.ones(network.n_edges), throw=False)
        L, sigma = found.value.bond_vectors, found.value.sigma
        return float(sigma @ (L[:, 0] * L[:, 1]) / (sigma @ np.sum(L**2, axis=1)))

    return network.deformed(SHEAR.gradient(brentq(stress, *_SHEARS, xtol=1e-12)))


def tension_honeycomb(parameters, seed):
    """The honeycomb of equal lengths."""
    network = cf.lattice("honeycomb", 10, 10)
    return _shear_of_tension(cf.critical_from_lengths(network, np.ones(network.n_edges), throw=False))


def tension_voronoi(parameters, seed):
    """The standard network with the lengths that it is made with."""
    network = cf.voronoi_network(parameters["n_vertices"], seed)
    return _shear_of_tension(cf.critical_from_lengths(network, _lengths(network), throw=False))


def tension_delaunay(parameters, seed):
    """A diluted Delaunay network with the lengths that it is made with."""
    network = ce.diluted(cf.delaunay_network(parameters["n_vertices"], seed), parameters["z"], seed)
    return _shear_of_tension(cf.critical_from_lengths(network, _lengths(network), throw=False))


def tension_phantom(parameters, seed):
    """A phantom triangular lattice, critical under random stress.

    The lengths that it is made with are degenerate: all cables of a straight fibre become taut at once.
    """
    side = round(np.sqrt(parameters["n_vertices"]))
    # One bond of each straight fibre is cut, which limits the coordination of small networks.
    network = ce.fibre_network("phantom", side, side, z=min(parameters["z"], 4 - 6 / side), seed=seed)
    return _shear_of_tension(cf.CriticalManifold(network).solve(_random_stress(network, seed)))


def _shear_of_tension(found):
    """Exponent of G − G_c against the isotropic tension T past the transition of a dilation, and this curve.

    Where edges are slack at the transition, the network is its taut part.
    """
    if found.status not in (cf.Status.ok, cf.Status.slack_edges):
        return Measured(np.nan, np.empty(0), np.empty(0), found.status)
    critical = max(backbone(found.value).components, key=lambda part: part.network.n_edges)
    path = cf.strain_path(critical, np.geomspace(*_NEAR, POINTS), throw=False)
    tension = np.einsum("nii->n", path.value.stress) / 2
    excess = path.value.shear_modulus - cf.elasticity(critical).value.shear
    if not path.ok or (excess <= 0).any():
        return Measured(np.nan, tension, excess, path.status)
    return Measured(float(np.polyfit(np.log(tension), np.log(excess), 1)[0]), tension, excess)


def _lengths(network):
    """Lengths of the edges as made."""
    return np.linalg.norm(network.bond_vectors(network.positions), axis=1)


def _random_stress(network, seed):
    return np.abs(stable_rng(seed, "stress").standard_normal(network.n_edges))


def onset_self_stresses(parameters, seed):
    """Number of self-stresses at the onset of a diluted Delaunay network in simple shear; taut edges against γ_c.

    Its lengths are those that it is made with, which are generic; those of lattices are not.
    """
    network = ce.diluted(cf.delaunay_network(parameters["n_vertices"], seed), parameters["z"], seed)
    found = ce.critical_strain(network, _lengths(network), "simple_shear", throw=False)
    if not found.ok:
        return Measured(np.nan, np.empty(0), np.empty(0), found.status)
    onset, taut = np.array([found.value.strain]), np.array([float(found.value.taut.sum())])
    return Measured(float(ce.certify(found.value).n_self_stresses), onset, taut)


def reflex(faces, bond_vectors):
    """Whether each corner of each face, in the order of its sides, turns by more than a straight angle."""
    side = faces.signs[:, None] * bond_vectors[faces.edges]
    following = np.arange(1, len(side) + 1)
    following[faces.starts[1:] - 1] = faces.starts[:-1]
    after = side[following]
    turn = side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]
    return turn < -STRAIGHT * np.linalg.norm(side, axis=1) * np.linalg.norm(after, axis=1)


def auxetic(parameters, seed):
    """Poisson's ratio of a triangular lattice pruned for the least one, with convex faces, at its end; ν against z.

    Each step removes the edge, of some chosen at random, that leaves the least ν, down to z = 4 plus a few edges.
    """
    network = cf.lattice("triangular", parameters["columns"], parameters["columns"])
    rng, z, ratios = stable_rng(seed, "pruned"), [6.0], [poisson(network)]
    while 2 * (network.n_edges - 2) / network.n_vertices > 4:
        found = []
        for edge in rng.permutation(network.n_edges):
            candidate = _without(network, edge)
            if candidate is not None:
                found.append((poisson(candidate), int(edge), candidate))
            if len(found) == parameters["candidates"]:
                break
        if not found:
            break
        ratio, _, network = min(found, key=lambda each: each[:2])
        z.append(2 * network.n_edges / network.n_vertices)
        ratios.append(ratio)
    shown = np.linspace(0, len(z) - 1, POINTS).astype(int)
    return Measured(ratios[-1], np.array(z)[shown], np.array(ratios)[shown])


def poisson(network):
    """Poisson's ratio (B − G)/(B + G) of the Voigt averages, of springs at rest at the positions of the lattice.

    Infinite for networks that do not resist dilation, where it would be −1.
    """
    found = cf.elasticity(network, network.positions)
    B, G = voigt(found.value)
    return (B - G) / (B + G) if found.ok and B > SOFT * G else np.inf


def _without(network, edge):
    """The network without an edge, or None if other edges go with it or a face is no longer convex."""
    kept = np.arange(network.n_edges) != edge
    part = carrying_part(network.edges[kept], network.offsets[kept], {}, network.n_vertices)
    if len(part.edges) < network.n_edges - 1:
        return None
    smaller = ce.pruned(network, kept).network
    return None if reflex(smaller.faces, smaller.bond_vectors(smaller.positions)).any() else smaller
