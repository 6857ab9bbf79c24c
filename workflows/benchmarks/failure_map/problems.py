"""Difficulties: each a list of strengths, and for each strength a network with its stresses and rest lengths.

Errors at construction belong to the answer, so everything is made at first use.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from critflow import CriticalManifold, Network, lattice, voronoi_network
from critflow.engine import stable_rng
from critflow.manifold import critical_configuration
from critflow.points import STANDARD_HARD_CORE
from critflow.springs import SpringState, spring_state

from ...shared.populations import OPTIMA
from .. import reference
from .outcomes import Unavailable


@dataclass(eq=False)
class Problem:
    """A network with its stresses, strain and rest lengths.

    make        the network
    stress      σ of the network (N_b,), as it is handed to the library
    strain      past the transition, and in how many steps the reference goes there
    lengths     rest lengths of the network (N_b,)
    threshold   r of the constrained shear modulus; None: no penalty
    n_stresses  self-stresses of the configuration
    moduli      B_0 and G_0 where one self-stress does not determine them
    """

    make: Callable[[], Network]
    stress: Callable[[Network], np.ndarray] = lambda network: np.ones(network.n_edges)
    strain: float = 1e-3
    lengths: Callable[[Network], np.ndarray] = lambda network: np.ones(network.n_edges)
    threshold: float | None = 0.1
    dtype: type = float
    n_stresses: Callable[[Network], int] = lambda network: 1
    moduli: tuple[float, float] | None = None

    @cached_property
    def network(self):
        return self.make()

    @cached_property
    def sigma(self):
        return np.asarray(self.stress(self.network), dtype=self.dtype)

    @cached_property
    def rest_lengths(self):
        return np.asarray(self.lengths(self.network), dtype=self.dtype)

    @cached_property
    def manifold(self):
        return CriticalManifold(self.network)

    @cached_property
    def solution(self):
        return self.manifold.solve(self.sigma)

    @property
    def critical(self):
        """The configuration of σ as the library has it."""
        if not self.solution.ok:
            raise Unavailable(self.solution.status)
        return self.solution.value

    @property
    def stressed(self):
        """The network of the stressed edges, whose configuration is exact."""
        return self.network

    @cached_property
    def digits(self):
        return reference.digits_for(self.sigma)

    @cached_property
    def exact(self):
        """The configuration of σ as it is."""
        return reference.configuration(self.network, self.sigma, digits=self.digits)

    @cached_property
    def strained(self):
        """Springs at rest in the configuration, with everything expanded: where an equilibrium is looked for."""
        critical = self.critical
        if self.dtype is float:
            state = SpringState(self.network, critical.lengths, critical.coordinates, critical.bond_vectors)
        else:
            rest, x = critical.lengths.astype(self.dtype), critical.coordinates.astype(self.dtype)
            state = spring_state(self.network, rest, x)
        return state.deformed(np.sqrt(1 + self.strain) * np.eye(2))


@dataclass(eq=False)
class SlackProblem(Problem):
    """A critical network to which slack edges are tied: vertices that three edges each join to others.

    taut   the network without them, and its stresses
    ratio  slack edges to taut edges
    """

    make: Callable[[], Network] = field(init=False)
    taut: Problem = field(kw_only=True)
    ratio: float = field(kw_only=True)

    def __post_init__(self):
        self.make = self._with_slack_edges

    def _with_slack_edges(self):
        network, rng = self.taut.network, np.random.default_rng(self.taut.network.n_vertices)
        n, n_tied = network.n_vertices, int(np.ceil(self.ratio * network.n_edges / 3))
        tied = [(n + k, other) for k in range(n_tied) for other in rng.choice(n + k, 3, replace=False)]
        edges = np.concatenate([network.edges, np.array(tied, int).reshape(-1, 2)])
        offsets = np.concatenate([network.offsets, np.zeros((len(tied), 2), int)])
        places = rng.random((n_tied, 2)) @ network.cell
        return Network(edges, offsets, network.cell, positions=np.concatenate([network.positions, places]))

    @property
    def stressed(self):
        return self.taut.network

    @property
    def exact(self):
        return self.taut.exact

    @cached_property
    def digits(self):
        return self.taut.digits

    @property
    def critical(self):
        taut, n = self.taut.critical, self.taut.network.n_edges
        sigma = np.concatenate([taut.sigma, np.zeros(self.network.n_edges - n)])
        tied = self.network.positions[self.taut.network.n_vertices :] - self.network.positions[0]
        whole = critical_configuration(self.network, sigma, np.concatenate([taut.coordinates, tied]))
        errors = np.full(self.network.n_edges, np.nan)
        # The bond vectors have more digits than differences of coordinates.
        L = whole.bond_vectors.copy()
        L[:n], errors[:n] = taut.bond_vectors, taut.bond_errors
        return replace(whole, bond_vectors=L, bond_errors=errors)


@dataclass(frozen=True)
class Difficulty:
    """A difficulty: its strengths, its problems, and the quantities that are computed."""

    label: str  # meaning of the strength
    strengths: tuple[float, ...]
    problem: Callable[[float, int, int | Network], Problem]  # strength, seed, number of vertices or network
    quantities: tuple[str, ...]


CONFIGURATION = ("configuration", "transition_moduli", "stiffening", "rigidity")
SPRINGS = ("equilibrium_newton", "equilibrium_fire", "strain_path", "linear_response")
LENGTHS = ("lengths_conic", "lengths_strain")
METHODS = ("auto", "newton", "lbfgs", "fire")
BEST = tuple(f"{optimum}_{method}" for optimum in OPTIMA for method in METHODS)
QUANTITIES = (*CONFIGURATION, *SPRINGS, *LENGTHS, *BEST)
# Difficulties that other methods and programs have too.
WITH_PEERS = ("small_strain", "large_step", "contrast", "hard_core")


def _standard(source, seed):
    """Maker of the network of a file, or of a generated one of a number of vertices."""
    return (lambda: source) if isinstance(source, Network) else lambda: voronoi_network(source, seed)


def _n_edges(source):
    return source.n_edges if isinstance(source, Network) else 3 * source // 2


def _draw(seed, name):
    return stable_rng(seed, "failures", name)


def _spread(strength, seed, n_vertices):
    powers = _draw(seed, "spread").uniform(-1, 1, _n_edges(n_vertices))
    return Problem(_standard(n_vertices, seed), lambda network: 10.0 ** (strength * powers))


def _one_edge(strength, seed, n_vertices, power):
    def stress(network):
        sigma = 0.5 + _draw(seed, "edge").random(network.n_edges)
        sigma[7 * seed % network.n_edges] = 10.0 ** (power * strength)
        return sigma

    return Problem(_standard(n_vertices, seed), stress, lengths=lambda network: np.minimum(1, 1 / stress(network)))


def _faint_cut(strength, seed, n_vertices):
    """Two neighbours joined to the rest of the network by faint edges only."""

    def stress(network):
        sigma = 0.5 + _draw(seed, "cut").random(network.n_edges)
        pair = network.edges[7 * seed % network.n_edges]
        sigma[np.isin(network.edges, pair).sum(axis=1) == 1] *= 10.0**-strength
        return sigma

    return Problem(_standard(n_vertices, seed), stress)


def _near_singular(strength, seed, n_vertices):
    """One edge compressed until the prestress matrix is singular, which is at 1/σ_0 = 1 − 1/r in closed form."""

    def stress(network):
        sigma, edge = np.ones(network.n_edges), 5 * (seed + 1) % network.n_edges
        # P is that of σ = 1 and (σ_0 − 1) g₀ᵀg₀ more; r = g₀ P⁻¹ g₀ᵀ.
        r = _resistance(network, network.free_incidence.toarray()[edge])
        sigma[edge] = float(1 - 1 / r) * (1 - strength)
        return sigma

    return Problem(_standard(n_vertices, seed), stress)


@reference.precise
def _resistance(network, row):
    """g₀ P⁻¹ g₀ᵀ at σ = 1, as an exact number: rounding would move the singular point."""
    right = reference.numbers(row)[:, None]
    matrix = reference.laplacian(network, reference.numbers(np.ones(network.n_edges)))
    return (right.T @ reference.solve(matrix, right))[0, 0]


def _generic(seed):
    return lambda network: 0.5 + _draw(seed, "generic").random(network.n_edges)


def _small_strain(strength, seed, n_vertices):
    return Problem(_standard(n_vertices, seed), _generic(seed), strain=strength)


def _rest_lengths(strength, seed, n_vertices):
    normal = _draw(seed, "lengths").standard_normal(_n_edges(n_vertices))
    return Problem(_standard(n_vertices, seed), lengths=lambda network: np.maximum(1 + strength * normal, 1e-3))


def _smallest(strength, seed, n_vertices):
    if strength == 2:
        return Problem(lambda: lattice("honeycomb", 1, 1), _generic(seed))
    return Problem(lambda: voronoi_network(int(strength), seed, hard_core=0.5), _generic(seed))


def _contrast(strength, seed, n_vertices):
    def make():
        network = _standard(n_vertices, seed)()
        return network.with_stiffness(strength ** _draw(seed, "contrast").random(network.n_edges))

    return Problem(make, _generic(seed))


def _extra_edges(strength, seed, n_vertices):
    """More edges than motions: one self-stress for each additional edge."""

    def make():
        network = voronoi_network(n_vertices, seed)
        rng, n_edges = _draw(seed, "extra"), 2 * (n_vertices - 1) + int(strength)
        edges, offsets = network.edges, network.offsets
        while len(edges) < n_edges:
            tail, head = rng.choice(n_vertices, 2, replace=False)
            # To the nearest image, as the positions have it.
            apart = (network.positions[head] - network.positions[tail]) @ np.linalg.inv(network.cell)
            new = np.array([[tail, head]]), -np.rint(apart).astype(int)[None]
            same = (np.sort(edges) == np.sort(new[0])).all(axis=1)
            if not same.any():
                edges, offsets = np.concatenate([edges, new[0]]), np.concatenate([offsets, new[1]])
        return Network(edges, offsets, network.cell, positions=network.positions)

    return Problem(make, _generic(seed), n_stresses=lambda network: max(1, int(strength)))


def _straight_lines(strength, seed, n_vertices):
    n = int(strength)
    stress = stress_of_lines(_draw(seed, "lines").uniform(0.5, 1.5, 2 * n))
    return Problem(
        lambda: subdivided_square(n), lambda network: stress, n_stresses=lambda network: 2 * n, moduli=(0.25, 0.0)
    )


def subdivided_square(n):
    """A square lattice with a vertex in the middle of each edge: every line carries one self-stress.

    Counting edges does not show it.  Each of 2n lines of length n has 2n springs: B = 2n (n/2)²/(2n)/n² = ¼, G = 0.
    """
    edges, offsets, positions = [], [], []
    for column, row in np.ndindex(n, n):
        site = 3 * (column * n + row)
        right, above = 3 * ((column + 1) % n * n + row), 3 * (column * n + (row + 1) % n)
        edges += [(site, site + 1), (site + 1, right), (site, site + 2), (site + 2, above)]
        offsets += [(0, 0), (int(column + 1 == n), 0), (0, 0), (0, int(row + 1 == n))]
        positions += [(column, row), (column + 0.5, row), (column, row + 0.5)]
    return Network(np.array(edges), np.array(offsets), n * np.eye(2), positions=np.array(positions, dtype=float))


def stress_of_lines(line):
    """The stress (4n²,) of `subdivided_square(n)` from those of its lines (2n,), the n along x first."""
    n = len(line) // 2
    column, row = np.divmod(np.arange(n * n), n)
    # For each site: the two halves of the edge to the right, then of that upwards.
    return np.stack([line[row], line[row], line[n + column], line[n + column]], axis=1).ravel()


def _deformed(strength, seed, n_vertices, gradient):
    """The standard network in the cell deformed by F(strength)."""
    return Problem(lambda: _standard(n_vertices, seed)().deformed(gradient(strength)), _generic(seed))


def _skew_cell(strength, seed, n_vertices):
    """The same network in ever longer vectors of its lattice: large offsets, whose sum cancels."""

    def make():
        network, turns = _standard(n_vertices, seed)(), int(strength)
        # b = offset @ cell: the second vector gains multiples of the first, and offsets give them back.
        back = network.offsets - np.outer(network.offsets[:, 1], [turns, 0])
        cell = network.cell + np.array([[0.0, 0.0], turns * network.cell[0]])
        return Network(network.edges, back, cell, positions=network.positions, faces=network.faces)

    return Problem(make, _generic(seed))


def _single_precision(strength, seed, n_vertices):
    problem = _spread(strength, seed, n_vertices)
    powers = _draw(seed, "single").uniform(-1, 1, _n_edges(n_vertices))
    problem.dtype, problem.lengths = np.float32, lambda network: 1 + 0.05 * powers
    return problem


# Difficulties that make their own networks, and are left out for the network of a file.
GENERATED = ("hard_core", "smallest", "extra_edges", "straight_lines")
_DECADES = tuple(10.0**-n for n in range(1, 17))
DIFFICULTIES = {
    "stress_spread": Difficulty(
        "decades of σ either side of 1", (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 15, 16, 17, 18, 20),
        _spread, (*CONFIGURATION, "equilibrium_newton", "linear_response"),
    ),
    "faint_edge": Difficulty(
        "one edge at σ = $10^{-x}$", (2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 30, 50, 100, 150, 200, 300),
        partial(_one_edge, power=-1), (*CONFIGURATION, "equilibrium_newton", "linear_response"),
    ),
    "faint_cut": Difficulty(
        "two vertices joined at σ = $10^{-x}$",
        (2, 4, 6, 8, 10, 12, 13, 14, 15, 16, 18, 20, 50, 100, 200, 300),
        _faint_cut, (*CONFIGURATION, "equilibrium_newton", "linear_response"),
    ),
    "short_edge": Difficulty(
        "one edge at σ = $10^x$", (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 18, 20, 100),
        partial(_one_edge, power=1), (*CONFIGURATION, *SPRINGS, *LENGTHS),
    ),
    "near_singular": Difficulty(
        "distance to a singular P",
        (1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 1e-15, 0, -1e-15, -1e-13, -1e-11, -1e-9, -1e-7, -1e-4, -1e-1),
        _near_singular, CONFIGURATION,
    ),
    "small_strain": Difficulty("strain γ", _DECADES[:15], _small_strain, SPRINGS),
    "large_step": Difficulty(
        "strain γ in one step",
        (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
        _small_strain, SPRINGS,
    ),
    "rest_lengths": Difficulty(
        "spread of rest lengths s",
        (0, 0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.18, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5),
        _rest_lengths, LENGTHS,
    ),
    "hard_core": Difficulty(
        "hard core ρ", (STANDARD_HARD_CORE, 0.8, 0.75, 0.7, 0.6, 0.5, 0.35, 0.2, 0.05),
        lambda rho, seed, n: Problem(lambda: voronoi_network(n, seed, hard_core=rho), _generic(seed)), QUANTITIES,
    ),
    "threshold": Difficulty(
        "threshold r, 0 without any", (0.5, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 0),
        lambda r, seed, source: Problem(_standard(source, seed), threshold=r or None),
        tuple(name for name in BEST if name.startswith("max_G_0")),
    ),
    "smallest": Difficulty("number of vertices", (16, 14, 12, 10, 8, 6, 4, 2), _smallest, QUANTITIES),
    "contrast": Difficulty(
        "largest over least stiffness", (1, 10, 100, 1e3, 1e4, 1e5, 1e6, 1e8), _contrast, QUANTITIES,
    ),
    "extra_edges": Difficulty(
        "edges beyond $2(N_v - 1)$", (-6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 6, 8, 10), _extra_edges,
        (*CONFIGURATION, "min_V_L_auto", "max_B_0_auto", "max_G_0_auto"),
    ),
    "slack_backbone": Difficulty(
        "slack edges per taut edge", (0, 0.1, 0.3, 1, 3, 10, 24),
        lambda x, seed, source: SlackProblem(taut=Problem(_standard(source, seed), _generic(seed)), ratio=x),
        ("transition_moduli", "stiffening"),
    ),
    "anisotropic_cell": Difficulty(
        "aspect ratio of the cell", (1e1, 1e2, 1e3, 1e4, 1e5, 1e6),
        partial(_deformed, gradient=lambda aspect: np.diag([aspect**0.5, aspect**-0.5])),
        (*CONFIGURATION, *SPRINGS, "lengths_conic"),
    ),
    "sheared_cell": Difficulty(
        "simple shear of the cell", (0.1, 0.3, 1, 3, 10, 30, 100),
        partial(_deformed, gradient=lambda gamma: np.array([[1.0, gamma], [0.0, 1.0]])),
        (*CONFIGURATION, *SPRINGS, "lengths_conic"),
    ),
    "skew_cell": Difficulty(
        "multiples of a cell vector added", (1, 10, 100, 1e3, 1e4, 1e5, 1e6),
        _skew_cell, (*CONFIGURATION, *SPRINGS, "lengths_conic"),
    ),
    "straight_lines": Difficulty("straight lines per direction", (1, 2, 3, 4), _straight_lines, CONFIGURATION),
    "single_precision": Difficulty(
        "± decades of float32 σ", (0, 1, 2, 4, 6, 8, 10, 12, 14, 16),
        _single_precision, (*CONFIGURATION, *(q for q in SPRINGS if q != "strain_path"), "lengths_conic"),
    ),
}  # fmt: skip
