"""Networks and configurations with known answers, and independent ways to evaluate what critflow evaluates.

Each answer names its source.  References do not use the linear algebra of critflow: they are dense NumPy formulas of
the edges, offsets, cell and pins alone.
"""

from __future__ import annotations

from collections import Counter
from hashlib import sha256
from itertools import pairwise

import numpy as np

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    Network,
    Status,
    critical_from_lengths,
    equilibrium,
    lattice,
    spring_state,
    voronoi_network,
)
from critflow.checks import blocks, components, opened_edges
from critflow.manifold import critical_configuration
from critflow.minimisers import Function, Point
from critflow.points import random_sequential_addition
from critflow.sparse import FixedPattern
from workflows.benchmarks import reference
from workflows.benchmarks.failure_map.problems import stress_of_lines, subdivided_square

SQRT3 = np.sqrt(3.0)

# Honeycomb of edge length 1 and k = 1: V = 3√3/4 a vertex, 3/2 edges a vertex, all σ and |L| equal, so that
# B_0 = (1/4V)(Σσ|L|²)²/Σσ²|L|² = (1/4)(3/2)/(3√3/4) = √3/6; no shear works on it, Σ L_x L_y = 0, so G_0 = 0.
HONEYCOMB_BULK_MODULUS = SQRT3 / 6

# Triangular lattice of unit springs at rest: Lamé constants λ = μ = √3/4 k, so B = λ + μ and G = μ.
TRIANGULAR_BULK_MODULUS, TRIANGULAR_SHEAR_MODULUS = SQRT3 / 2, SQRT3 / 4


def digest(*arrays: np.ndarray) -> str:
    """Hash of every bit of the arrays."""
    bits = [array.astype("<i8" if array.dtype.kind == "i" else "<f8").tobytes() for array in arrays]
    return sha256(b"".join(bits)).hexdigest()[:16]


def random_stress(n_edges: int, seed: int) -> np.ndarray:
    """Positive stresses without any symmetry, between 0.3 and 2.3."""
    return 0.3 + 2.0 * np.random.default_rng(seed).random(n_edges)


def random_start(seed: int, n_edges: int = 150) -> np.ndarray:
    """|N(0, 1)|: positive stresses without a lower limit."""
    return np.abs(np.random.default_rng(seed).standard_normal(n_edges))


def foam_network(n_vertices: int, seed: int) -> Network:
    """The network of the function of this name, which is an extra, by functions of the scene."""
    rng, n_cells, network = np.random.default_rng(seed), round(n_vertices / 6.467), None
    while network is None or network.n_vertices != n_vertices:
        points = random_sequential_addition(n_cells, 0.87 / n_cells ** (1 / 3), rng, dimension=3)
        network = voronoi_network(points=points)
    return network


def with_random_stiffness(network: Network, seed: int) -> Network:
    """The network with stiffnesses between 0.5 and 2."""
    return network.with_stiffness(0.5 + 1.5 * np.random.default_rng(seed).random(network.n_edges))


def thinned(network: Network, n_removed: int, seed: int = 1) -> Network:
    """The network without this number of random edges, and without those that carry no tension without them."""
    left = np.sort(np.random.default_rng(seed).permutation(network.n_edges)[n_removed:])
    graph = network.edges[left], network.offsets[left], network.cell, network.pins, network.n_vertices
    opened = left[opened_edges(*blocks(*graph))]
    part = components(network.edges[opened], network.n_vertices)[network.edges[opened, 0]]
    kept = np.zeros(network.n_edges, bool)
    kept[opened[part == np.bincount(part).argmax()]] = True
    return network.part(kept)[0]


def slack_lattice() -> tuple[Network, np.ndarray, CriticalConfiguration]:
    """A lattice of z = 3.6 of which many edges are slack at the transition, with ℓ and its configuration."""
    network = thinned(lattice("triangular", 7, 7), 64)
    lengths = 1 + 0.05 * np.random.default_rng(1).standard_normal(network.n_edges)
    return network, lengths, critical_from_lengths(network, lengths, throw=False).value


def taut_rows(n: int = 3) -> CriticalConfiguration:
    """The square lattice n × n with its horizontal edges taut: n cables, of which each closes on its image."""
    network = lattice("square", n, n)
    horizontal = np.abs(network.bond_vectors(network.positions)[:, 0]) > 0.5
    return critical_configuration(network, horizontal.astype(float), network.positions)


def hung_ring(n=8):
    """A ring of vertices, hung on pins by chains of two edges: one self-stress, without a cell."""
    angles, i = 2 * np.pi * np.arange(n) / n, np.arange(n)
    places = 3 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edges = np.concatenate([np.stack(pair, axis=1) for pair in ((i, (i + 1) % n), (i, n + i), (n + i, 2 * n + i))])
    return Network(edges, pins={int(2 * n + j): places[j] for j in i}).with_volume(20.0)


def voronoi_3d(n_cells: int = 8, seed: int = 5) -> Network:
    """A periodic Voronoi network in three dimensions: four edges at every vertex."""
    return voronoi_network(points=np.random.default_rng(seed).random((n_cells, 3)))


def oblique(network: Network) -> Network:
    """The same graph in an oblique cell of the same volume."""
    F = np.eye(network.dimension)
    F[0, 0], F[1, 1], F[0, 1], F[1, 0] = 1.3, 1 / 1.3 + 0.4 * 0.2 / 1.3, 0.4, 0.2
    return network.deformed(F)


def sheared(network: Network, gamma: float) -> Network:
    """The network after a simple shear γ of its boundary; the image offsets stay as they are."""
    F = np.eye(network.dimension)
    F[0, 1] = gamma
    return network.deformed(F)


def square_octagon(a: float = 2.0, b: float = 3.0, shape: np.ndarray | None = None) -> Network:
    """Four vertices (east, north, west, south of a square) and six edges: the square's sides and the links x and y.

    With stresses s on the sides and t_x, t_y on the links, balance at the east vertex (e, 0) reads
    t_x (a − 2e) = 2 s e, and likewise at the north vertex; see `square_octagon_bond_vectors`.
    """
    edges = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]]
    offsets = [[0, 0]] * 4 + [[1, 0], [0, 1]]
    F = np.eye(2) if shape is None else np.asarray(shape)
    return Network(edges, offsets, np.diag([a, b]) @ F.T)


def square_octagon_bond_vectors(s, t_x, t_y, a=2.0, b=3.0, shape=None):
    """L of `square_octagon`: e = t_x a/(2(s + t_x)), f = t_y b/(2(s + t_y)); an affine cell maps L affinely."""
    e, f = t_x * a / (2 * (s + t_x)), t_y * b / (2 * (s + t_y))
    L = np.array([[-e, f], [-e, -f], [e, -f], [e, f], [a - 2 * e, 0], [0, b - 2 * f]])
    return L @ (np.eye(2) if shape is None else np.asarray(shape)).T


def with_own_images() -> Network:
    """The square-octagon with two more edges, from a vertex to an image of it: stressed but pulling at nothing."""
    plain = square_octagon()
    edges = np.concatenate([plain.edges, [[2, 2], [0, 0]]])
    return Network(edges, np.concatenate([plain.offsets, [[1, 0], [0, 1]]]), plain.cell)


def pinned_star() -> tuple[Network, np.ndarray]:
    """One free vertex (0) between five pins: it sits at the stress-weighted mean of the pins, Σσp/Σσ."""
    pins = np.array([[0.0, 0.0], [2.0, 0.3], [1.5, 2.0], [-0.4, 1.7], [0.9, -1.2]])
    edges = [[0, i + 1] for i in range(len(pins))]
    return Network(edges, pins={i + 1: p for i, p in enumerate(pins)}), pins


def pinned_grid(n: int = 5) -> Network:
    """A square grid of n × n vertices hung on its border, pinned at irregular places; no cell."""
    rng = np.random.default_rng(11)
    number = np.arange(n * n).reshape(n, n)
    edges = np.concatenate(
        [
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
        ]
    )
    places = np.argwhere(number >= 0) + 0.3 * rng.random((n * n, 2))
    border = np.concatenate([number[0], number[-1], number[1:-1, 0], number[1:-1, -1]])
    between_pins = np.isin(edges, border).all(axis=1)
    kept = edges[~between_pins]
    used = np.unique(kept)
    index = np.full(n * n, -1)
    index[used] = np.arange(len(used))
    pins = {int(index[i]): places[i] for i in border if index[i] >= 0}
    return Network(index[kept], pins=pins, positions=places[used])


def triangular_lattice(columns: int = 4, rows: int = 4) -> tuple[Network, np.ndarray]:
    """The triangular lattice of unit springs, and its coordinates."""
    network = lattice("triangular", columns, rows)
    return network, network.positions


def rewrapped(network: Network, seed: int) -> Network:
    """The same periodic network with every vertex named by another of its images: only offsets change."""
    image = np.random.default_rng(seed).integers(-2, 3, (network.n_vertices, network.dimension))
    tail, head = network.edges.T
    return Network(network.edges, network.offsets + image[tail] - image[head], network.cell, network.stiffness)


def relabelled(network: Network, seed: int) -> tuple[Network, np.ndarray, np.ndarray, np.ndarray]:
    """The network with vertices renumbered, edges reordered and some reversed: also new vertex, order, sign."""
    rng = np.random.default_rng(seed)
    vertex, order = rng.permutation(network.n_vertices), rng.permutation(network.n_edges)
    sign = rng.choice([-1, 1], network.n_edges)
    edges, offsets = vertex[network.edges[order]], network.offsets[order] * sign[:, None]
    edges = np.where(sign[:, None] < 0, edges[:, ::-1], edges)
    pins = {int(vertex[i]): p for i, p in network.pins.items()}
    copy = Network(edges, offsets, network.cell, network.stiffness[order], pins, n_vertices=network.n_vertices)
    return copy, vertex, order, sign


def dense_incidence(network: Network) -> np.ndarray:
    """g over all vertices, (N_b, N_v), from the edge list."""
    g = np.zeros((network.n_edges, network.n_vertices))
    for edge, (tail, head) in enumerate(network.edges):
        g[edge, head] += 1
        g[edge, tail] -= 1
    return g


def dense_free(network: Network) -> tuple[np.ndarray, np.ndarray]:
    """Dense incidence of the unknown vertices and b, (N_b, d): pins leave the unknowns; without pins none does."""
    g = dense_incidence(network)
    b = np.zeros((network.n_edges, network.dimension))
    if network.cell is not None:
        b += network.offsets @ network.cell
    for vertex, position in network.pins.items():
        b += np.outer(g[:, vertex], position)
    free = [i for i in range(network.n_vertices) if i not in network.pins]
    return g[:, free], b


def grounded(network):
    """Dense free incidence and b as the library takes them: without pins, vertex 0 is the ground."""
    g, b = dense_free(network)
    return (g if network.pins else g[:, 1:]), b


def dense_rigidity(network: Network, x: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """The dense rigidity matrix, no vertex grounded, and the vertices of its columns."""
    g, b = dense_free(network)
    free = [i for i in range(network.n_vertices) if i not in network.pins]
    L = g @ x[free] + b
    unit = L / np.linalg.norm(L, axis=1)[:, None]
    return np.einsum("ai,ad->aid", g, unit).reshape(len(g), -1), free


def dense_bond_vectors(network: Network, sigma: np.ndarray) -> np.ndarray:
    """L(σ) = b − g P⁺ gᵀ(σ ∘ b) by a dense pseudo-inverse, which needs no ground."""
    g, b = dense_free(network)
    P = g.T @ (sigma[:, None] * g)
    return b - g @ np.linalg.pinv(P, rcond=1e-12, hermitian=True) @ (g.T @ (sigma[:, None] * b))


def at(network: Network, sigma: np.ndarray, L: np.ndarray) -> CriticalConfiguration:
    """A stress and bond vectors on which quantities are evaluated; the coordinates are not used."""
    return CriticalConfiguration(network, sigma, np.zeros((network.n_vertices, network.dimension)), L)


def dense_response(network: Network, sigma: np.ndarray) -> np.ndarray:
    """B = −R^h P⁻¹ R^hᵀ as a dense matrix (N_b, N_b), with (R^h P⁻¹ R^hᵀ)_{αβ} = (g P⁺ gᵀ)_{αβ} L_α·L_β."""
    g, _ = dense_free(network)
    L = dense_bond_vectors(network, sigma)
    P = g.T @ (sigma[:, None] * g)
    return -(g @ np.linalg.pinv(P, rcond=1e-12, hermitian=True) @ g.T) * (L @ L.T)


def modulus_by_formula(network: Network, sigma: np.ndarray, L: np.ndarray, A: np.ndarray) -> float:
    """(1/V)(Σ σ L·AL)²/Σ σ²|L|²/k, edge by edge."""
    work = sum(s * (v @ A @ v) for s, v in zip(sigma, L, strict=True))
    cost = sum(s**2 * (v @ v) / k for s, v, k in zip(sigma, L, network.stiffness, strict=True))
    return float(work**2 / cost / abs(np.linalg.det(network.cell)))


def length_variance(critical: CriticalConfiguration) -> float:
    """V_L by its definition."""
    return np.var(critical.lengths) / np.mean(critical.lengths) ** 2


def tension_variance(critical: CriticalConfiguration) -> float:
    """V_τ by its definition."""
    return np.var(critical.tensions) / np.mean(critical.tensions) ** 2


def face_areas(faces, bond_vectors: np.ndarray) -> np.ndarray:
    """Areas of the faces by the shoelace formula, of corners from the first one on."""
    walks = [slice(*ends) for ends in pairwise(faces.starts)]
    corners = [np.cumsum(faces.signs[walk, None] * bond_vectors[faces.edges[walk]], axis=0) for walk in walks]
    return np.array([0.5 * np.sum(c[:-1, 0] * c[1:, 1] - c[:-1, 1] * c[1:, 0]) for c in corners])


class Analytic(Function):
    """A function given by value, gradient and Hessian."""

    def __init__(self, value, gradient, hessian, diagonal=0.0):
        self._value, self._gradient, self._hessian, self._diagonal = value, gradient, hessian, diagonal

    def at(self, x):
        gradient = self._gradient(x)
        return Point(x, float(self._value(x)), gradient, float(np.abs(gradient).max()))

    def preconditioner(self, point):
        return self._diagonal

    def hessian_product(self, point, direction):
        return self._hessian(point.x) @ direction


def quadratic(n=8):
    """½ (x − a)ᵀ A (x − a) with curvatures between 1 and 100, least at a."""
    rng = np.random.default_rng(1)
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A, a = Q @ np.diag(np.geomspace(1, 100, n)) @ Q.T, rng.standard_normal(n)
    A = 0.5 * (A + A.T)
    return Analytic(lambda x: 0.5 * (x - a) @ A @ (x - a), lambda x: A @ (x - a), lambda x: A), np.zeros(n), a


class Factorisations:
    """Counts numeric factorisations by kind of matrix: `counter(network, call)`; `answer` is that of the last call.

    The kinds have different sizes: "P" (n_free), the elastic "Hessian" (d n_free), the "saddle" matrix of stresses and
    displacements (d n_free + N_b); "part" is any other size.
    """

    def __init__(self, monkeypatch):
        self._sizes = []
        factorize = FixedPattern.factorize

        def counting(pattern, *arguments, **options):
            self._sizes.append(pattern.size)
            return factorize(pattern, *arguments, **options)

        monkeypatch.setattr(FixedPattern, "factorize", counting)

    def __call__(self, network: Network, call) -> Counter:
        self._sizes.clear()
        self.answer = call()
        n, d = len(network.free), network.dimension
        kinds = {n: "P", d * n: "Hessian", d * n + network.n_edges: "saddle"}
        return Counter(kinds.get(size, "part") for size in self._sizes)


def forbidden(*arguments, **options):
    """Replaces a function that a test must not call."""
    raise AssertionError("unnecessary call")


# Networks whose map σ → configuration is tested in every way, by name.
NETWORKS = {
    "voronoi": lambda: voronoi_network(40, seed=1),
    "voronoi, random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=2), 7),
    "voronoi 3D": lambda: with_random_stiffness(voronoi_3d(), 8),
    "honeycomb": lambda: lattice("honeycomb", 3, 4),
    "square-octagon": square_octagon,
    "own images": with_own_images,
    "oblique": lambda: oblique(with_random_stiffness(voronoi_network(40, seed=3), 9)),
    "sheared": lambda: sheared(voronoi_network(40, seed=4), 0.8),
    "tiny": lambda: voronoi_network(12, seed=6),
    "other names and images": lambda: relabelled(rewrapped(voronoi_network(40, seed=5), 1), 2)[0],
    "pinned star": lambda: pinned_star()[0],
    "pinned grid": pinned_grid,
}
PERIODIC = [name for name in NETWORKS if not name.startswith("pinned")]

# Networks of different dimension, cell and stiffness, for derivatives of objectives.
PERIODIC_KINDS = {
    "random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=1), 2),
    "oblique": lambda: oblique(with_random_stiffness(voronoi_network(40, seed=2), 3)),
    "3D": lambda: with_random_stiffness(voronoi_3d(), 4),
}

# The same for what is measured at the transition.
UNPINNED = {
    "2D": lambda: voronoi_network(40, seed=1),
    "2D, random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "2D, oblique": lambda: oblique(voronoi_network(40, seed=3)),
    "3D": voronoi_3d,
    "3D, random stiffness": lambda: with_random_stiffness(voronoi_3d(), 4),
}

# Strained springs, for tests of error bounds

SMALL_NETWORKS = {
    "voronoi": lambda: voronoi_network(12, seed=6),
    "stiffness": lambda: with_random_stiffness(voronoi_network(12, seed=2), 1),
    "oblique": lambda: oblique(voronoi_network(12, seed=3)),
    "honeycomb": lambda: lattice("honeycomb", 2, 2),
}
STRAINS = 10.0 ** -np.arange(1, 13)


def critical_of(network, seed=1):
    """The configuration of a random positive stress."""
    return CriticalManifold(network).configuration(random_stress(network.n_edges, seed))


def expanded(critical, gamma):
    """Springs at rest in a critical configuration, after an affine expansion V → V (1 + γ)."""
    network = critical.network
    state = spring_state(network, critical.lengths, critical.coordinates)
    return state.deformed((1 + gamma) ** (1 / network.dimension) * np.eye(network.dimension))


def relaxed_directly(critical, gamma):
    """Springs at rest in a configuration, relaxed in one step after V → V (1 + γ)."""
    solution = equilibrium(expanded(critical, gamma))
    assert solution.status is Status.ok
    return solution.value


def stiff_lattice(seed=1):
    """A triangular lattice under random stress of both signs, in equilibrium."""
    network, rng = with_random_stiffness(lattice("triangular", 4, 4), seed), np.random.default_rng(seed)
    at_rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    rest = at_rest * (1 + 0.02 * rng.standard_normal(network.n_edges))
    return equilibrium(spring_state(network, rest, network.positions)).value


def partly_compressed(n_vertices, seed):
    """A critical configuration of which an edge in twenty is compressed."""
    network, rng = voronoi_network(n_vertices, seed=seed), np.random.default_rng(seed)
    sigma = np.abs(rng.standard_normal(network.n_edges)) + 0.05
    sigma[rng.choice(network.n_edges, max(1, network.n_edges // 20), replace=False)] *= -0.15
    return CriticalManifold(network).configuration(sigma)


def stressed_lines(n):
    """A square lattice with a vertex in the middle of each edge, and a different stress on every line."""
    return CriticalManifold(subdivided_square(n)).configuration(stress_of_lines(np.linspace(0.5, 1.5, 2 * n)))


def strained(network: Network, gamma: float):
    """A random critical configuration of a network, expanded."""
    return expanded(critical_of(network), gamma)


# Error bounds

# One rounding error may be far below its bound by chance, differently on every processor.  The largest of these many
# errors of one value, computed with its edges in other orders, is not.
ORDERS = 8


def reordered(network: Network):
    """Networks with the same edges in random orders, and the orders: their values are the same but for rounding."""
    for seed in range(ORDERS):
        order = np.random.default_rng(seed).permutation(network.n_edges)
        yield Network(network.edges[order], network.offsets[order], network.cell, network.stiffness[order]), order


def bounds_over_errors(values, bounds, truth):
    """Ratios of the largest error bounds to the largest errors; fails where an error exceeds its bound.

    values, bounds  (n,), or (m, n) from m ways to round
    truth           (n,)
    """
    bounds = np.atleast_2d(bounds)
    errors = np.abs(np.atleast_2d(values) - np.asarray(truth)).astype(float)
    assert (errors <= bounds).all()
    return list(bounds.max(axis=0) / np.maximum(errors.max(axis=0), 1e-60))


def exact_moduli(state):
    """B, G and stress-corrected G of the exact equilibrium next to a state."""
    exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
    return reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths)
