"""Rest lengths → critical configuration, by the cone program or by straining springs until they are rigid.

Given rest lengths ℓ, shrinking them uniformly (the same as expanding the box) leads the network to a critical
configuration.  The cone program finds it directly and lists the slack edges; the strain protocol of the paper
approaches it in steps and stops slightly past it, where slack springs are slightly compressed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.manifold import COLLAPSED, CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.linalg.matrices import balanced_part
from critflow.linalg.saddle import Saddle
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.onset.boundary_path import BoundaryPath
from critflow.onset.taut_edges import ROUGH_CONE, OnsetState, newton_taut, unknown_configuration
from critflow.onset.taut_set import EXACT_CONE, NO_STRESS, polish_taut, resolved, stressed
from critflow.precision.double_double import divide, dot, extended, multiply, scaled, subtract, total, two_product
from critflow.precision.geometry import ExtendedGeometry
from critflow.result import InputError, Solution, Stats, Status
from critflow.solvers.cone import fit_lengths
from critflow.springs.equilibrium import equilibrium, relaxation_method
from critflow.springs.state import spring_state

EVEN = 0.12  # spread of the logarithms of rest lengths below which few networks have slack edges
SOLVED = 1e-6  # relative residual of a Newton step that determines the error of its start
STRAIN_STEPS = 2000  # steps of the strain protocol, after which it stops: a strain of 20 in the default steps


@dataclass(frozen=True, eq=False, kw_only=True)
class FromLengths(Solution[CriticalConfiguration]):
    """The critical configuration of rest lengths ℓ.

    slack_edges   edges without tension
    ratio         |L|/ℓ of the stressed edges (cone program)
    polish_steps  steps of Newton's method after the cone program
    """

    slack_edges: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    ratio: float = np.nan
    polish_steps: int = 0

    @property
    def configuration(self) -> CriticalConfiguration:
        """The critical configuration, the same as `value`."""
        return self.value


@dataclass(frozen=True, eq=False, kw_only=True)
class FromStrain(FromLengths):
    """The critical configuration of rest lengths ℓ by the strain protocol.

    strain         γ of the recorded state, whose rest lengths are ℓ/(1 + γ)
    energy         energy of the recorded state
    rest_lengths   ℓ/(1 + γ), (N_b,)
    skipped_steps  strain steps below the transition that were not relaxed
    """

    strain: float
    energy: float
    rest_lengths: Array
    skipped_steps: int


@checked
def critical_from_lengths(
    network: Network | CriticalManifold,
    rest_lengths: ArrayLike,
    method: str = "auto",
    *,
    relaxation: str = "auto",
    strain_step: float = 0.01,
    energy_threshold: float = 1e-4,
    throw: bool = True,
) -> FromLengths:
    """The critical configuration reached from rest lengths ℓ (N_b,) when the box expands.

    method "conic" (or "auto"): lengths proportional to ℓ on every stressed edge, exactly at the transition.
    `slack_edges` lists the edges without tension; they have σ = 0 and set `Status.slack_edges`.  The configuration
    keeps its rest lengths at the transition, so that `strain_path` follows all edges from there.
    `stats.error_bound` (estimate) is that of every coordinate against the exact configuration with these ratios; where
    edges are slack, coordinates are not determined and it is NaN.  The bounds of the configuration itself are against
    the exact one of its stress.
    method "strain": ℓ/(1 + γ) with γ in steps of `strain_step` from 0 until the energy reaches `energy_threshold`, in
    units of mean k times (V/N_v)^(2/d), or the squared mean ℓ without a cell.  Springs are relaxed by the method
    `relaxation` of `equilibrium`; the recorded state is then slightly past the transition, and the solution is a
    `FromStrain`.  Where the cone program shows that every edge will be stressed, the end does not
    depend on the path, and the steps of the floppy network are skipped (not by "fire").

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> solution = cf.critical_from_lengths(network, np.ones(30))
    >>> solution.ok, bool(np.ptp(solution.value.lengths) < 1e-12)
    (True, True)
    """
    manifold = CriticalManifold.of(network)
    lengths = edge_values(rest_lengths, manifold.network.n_edges, "rest_lengths")
    if method not in ("auto", "conic", "strain"):
        raise InputError(f"no method is called {method!r}: choose 'auto', 'conic' or 'strain'")
    if not (strain_step > 0 and energy_threshold > 0):
        raise InputError("the strain step and the energy threshold must be positive")
    relaxation = relaxation_method(relaxation)
    if method == "strain":
        solution: FromLengths = _by_strain(manifold, lengths, relaxation, strain_step, energy_threshold)
    else:
        solution = _by_cone(manifold, lengths)
    return solution.or_raise("these rest lengths have no all-tension critical configuration") if throw else solution


def stressed_fraction(sigma: Array) -> float:
    """Fraction of the edges under tension: σ above rounding of its mean."""
    return float(np.mean(sigma > NO_STRESS * np.mean(np.abs(sigma))))


def _by_cone(manifold: CriticalManifold, lengths: Array) -> FromLengths:
    """The critical configuration by the cone program and Newton's method on the stressed edges.

    1. The program min t, |L| ≤ t ℓ; first a rough one where all edges may be stressed.
    2. Newton's method for |L| = (1 + s) t ℓ on the stressed edges, s → 0, which also decides which are stressed.
    3. The exact balance of the stress of the last step.
    """
    network, steps = manifold.network, 0
    if lengths.min() <= COLLAPSED * lengths.mean():
        note = f"the target length of edge {lengths.argmin()} is below the rounding of coordinates: lengthen it"
        return FromLengths(value=unknown_configuration(network), status=Status.stalled, stats=Stats("conic"), note=note)
    path = BoundaryPath(network, Deformation.linear(np.eye(network.dimension)), analysed=manifold.saddle)
    even = float(np.std(np.log(lengths))) < EVEN
    for tolerance in (ROUGH_CONE, *EXACT_CONE) if even else EXACT_CONE:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, tolerance)
        steps += cone.steps
        rough = tolerance == ROUGH_CONE
        if not (rough or cone.solved):
            return FromLengths(value=unknown_configuration(network), status=Status.stalled, stats=Stats("conic", steps))
        taut = np.ones(network.n_edges, bool) if rough else cone.stressed
        start = OnsetState(0.0, np.zeros(0), cone.coordinates, cone.sigma, taut)
        end = (newton_taut if rough else polish_taut)(path, cone.ratio * lengths, start)
        balanced = None
        # A slack edge that is longer than its rest length shows a wrong set of taut edges.
        fits = end is not None and resolved(path, cone.ratio * lengths, end)
        if end is not None and fits and np.array_equal(stressed(end), end.taut):
            balanced = _balanced(manifold, path, end)
        if balanced is not None:
            break
    if end is None or balanced is None:
        return FromLengths(
            value=unknown_configuration(network), status=Status.stalled, stats=Stats("conic", steps), ratio=cone.ratio
        )
    value, condition = balanced
    slack, status, note, bound = np.flatnonzero(~end.taut), Status.ok, "", np.nan
    if len(slack):
        status = Status.slack_edges
        note = f"{len(slack)} of {network.n_edges} edges are slack, edge {slack[0]} among them; narrow the lengths"
    else:
        bound = 2 * newton_error(manifold.saddle, network, lengths, value.coordinates, value.sigma)
    ratio = float((value.lengths / lengths)[end.taut].mean())
    return FromLengths(
        value=replace(value, rest_lengths=np.where(end.taut, value.lengths, ratio * lengths)),
        status=status,
        stats=Stats("conic", steps, residual=end.error, condition=condition, error_bound=bound),
        note=note,
        slack_edges=slack,
        ratio=ratio,
        polish_steps=end.steps,
    )


def _balanced(
    manifold: CriticalManifold, path: BoundaryPath, end: OnsetState
) -> tuple[CriticalConfiguration, float] | None:
    """The configuration in exact balance under the stress of the taut edges, and its condition number.

    Newton's method reduces the errors of lengths and forces together.  Vertices off the taut edges keep their
    coordinates.  None where the balance fails.
    """
    network, taut, part = manifold.network, end.taut, end.part
    if taut.all():
        balance = manifold.solve(end.sigma)
        return (balance.value, balance.stats.condition) if balance.ok else None
    if part is None or part.several:
        return None
    balance = CriticalManifold(part.network).solve(end.sigma[taut])
    if not balance.ok:
        return None
    x = network.all_coordinates(end.coordinates / (1 + end.strain))
    # A part without pins is grounded at its first vertex, which lies at the origin there.
    x[part.vertices] = balance.value.coordinates + (0.0 if part.network.pins else x[part.vertices[0]])
    sigma, errors = np.zeros(network.n_edges), np.full(network.n_edges, np.nan)
    sigma[taut] = balance.value.sigma
    whole = critical_configuration(network, sigma, x if network.pins else x - x[0])
    # Short edges would lose digits in the rounding of the coordinates.
    whole.bond_vectors[taut], errors[taut] = balance.value.bond_vectors, balance.value.bond_errors
    return replace(whole, bond_errors=errors), balance.stats.condition


def newton_error(saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array) -> float:
    """Largest component of the difference from the coordinates in exact balance with lengths ∝ ℓ.

    Error bound (estimate): one more step of Newton's method, from residuals in extended precision.  All edges are
    stressed.  NaN where the step is not determined.
    """
    geometry, stress = ExtendedGeometry(network), extended(sigma)
    L = geometry.bond_vectors(extended(coordinates[network.free]), network.boundary_vectors)
    twice_h, target = dot(L, L), two_product(lengths, lengths)
    # The equation of the lengths is consistent for one ratio only, which needs the same number of digits.
    ratio = divide(total(multiply(stress, twice_h)), total(multiply(stress, target)))
    left = 0.5 * subtract(multiply(ratio, target), twice_h).high
    force = geometry.divergence(scaled(stress, L)).high
    # The solver expects residuals of order one: divide by their own scale, that of rounding.
    size = float(max(np.abs(left).max(), np.abs(force).max()))
    if size == 0.0:
        return 0.0
    u, _, residual = saddle.factorize(sigma, L.high).solve(-force / size, left / size)
    return size * float(np.abs(u).max()) if residual < SOLVED else np.nan


def _energy_unit(network: Network, lengths: Array) -> float:
    """Mean stiffness times the square of a length that is 1 for one unit of volume a vertex."""
    size = float(lengths.mean())
    if network.cell is not None:
        size = (network.volume / network.n_vertices) ** (1 / network.dimension)
    return float(network.stiffness.mean()) * size**2


def _by_strain(
    manifold: CriticalManifold, lengths: Array, relaxation: str, strain_step: float, energy_threshold: float
) -> FromStrain:
    """The rigid state of springs with rest lengths ℓ/(1 + γ), and the stress that balances at its coordinates."""
    network, pattern = manifold.network, manifold.hessian
    newton = relaxation == "newton"
    step, x = _skipped(manifold, lengths, strain_step) if newton else (0, None)
    skipped, threshold = step, energy_threshold * _energy_unit(network, lengths)
    if x is None:
        x = network.positions
    if x is None:
        x = manifold.configuration(network.stiffness).coordinates
    steps = 0
    state = spring_state(network, lengths / (1 + strain_step * step), x)
    while True:
        solution = equilibrium(state, relaxation, pattern=pattern, throw=False)
        state, steps = solution.value, steps + solution.stats.steps
        if not solution.ok or state.energy >= threshold:
            break
        if step - skipped >= STRAIN_STEPS:
            solution = replace(solution, status=Status.step_limit, note="take larger strain steps")
            break
        step += 1
        state = spring_state(network, lengths / (1 + strain_step * step), state.coordinates)
    if newton:
        state = equilibrium(state, tolerance=1e-16, max_steps=6, pattern=pattern, throw=False).value
    # From the coordinates: rounding of many steps separates the bond vectors of the state from them.
    sigma = balanced_part(network, network.bond_vectors(state.coordinates), state.sigma, pattern)
    value = critical_configuration(network, sigma, state.coordinates)
    slack = np.flatnonzero(value.sigma <= NO_STRESS * np.mean(np.abs(value.sigma)))
    status = Status.slack_edges if solution.ok and len(slack) else solution.status
    return FromStrain(
        value=value if solution.ok else unknown_configuration(network),
        status=status,
        stats=Stats(f"strain, {relaxation}", steps, residual=solution.stats.residual),
        slack_edges=slack,
        strain=strain_step * step,
        energy=state.energy,
        rest_lengths=state.rest_lengths,
        skipped_steps=skipped,
        note=solution.note,
    )


def _skipped(manifold: CriticalManifold, lengths: Array, strain_step: float) -> tuple[int, Array | None]:
    """The number of strain steps of the floppy network, and the coordinates at the transition; 0 if edges are slack.

    With all edges stressed the rigid states follow from the unique critical configuration, for any path to it.
    """
    transition = _by_cone(manifold, lengths)
    if not transition.ok:
        return 0, None
    steps = max(0, int(np.floor((1 / transition.ratio - 1) / strain_step)) + 1)
    return steps, transition.value.coordinates
