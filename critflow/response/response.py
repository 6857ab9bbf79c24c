"""Linear response of springs under stress: relaxations, elasticity tensor and moduli with error bounds.

With the total rates L̇_a = E_a L + g u_a of bond vectors under a strain E_a and ḣ_a = L·L̇_a,
    V C_ab = ḣ_aᵀ K ḣ_b + Σ σ L̇_a·L̇_b
is stationary at the relaxations u, so that their errors enter as products (`LinearResponse`).

The strains are those of `unit_strains`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from critflow.arguments import checked
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.precision.residual import inverse_norm
from critflow.response.elasticity import NO_MODULI, TRUSTED_ERROR, Elasticity, Moduli, no_elasticity
from critflow.response.unit_strains import basis_change, stress_products, unit_strains
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs.newton import FLOPPY_SHIFT
from critflow.springs.state import ElasticState

# Corrections of a relaxation below this part of it have converged; largest number of corrections.
_CONVERGED, _MOST_CORRECTIONS = 0.05, 4
# The contraction of corrections is that observed between two of them times this margin.
_CONTRACTION_MARGIN = 10.0
# Relaxations below this part of the mean length are compared with it instead: all edges then respond affinely.
_NO_RELAXATION = 1e-5


@dataclass(frozen=True, kw_only=True)
class LinearResponse(Solution[Moduli]):
    """Moduli of a state under stress, its elasticity tensor and the responses to all strains.

    elasticity   energy and stress-corrected tensors with their bounds; NaN where the moduli are
    relaxations  dx/dε (n_free, d) under each strain of `strain_basis`, relative to the affine motion, (m, n_free, d)
    relaxation   the same under dilation, by volumetric strain, (n_free, d); both are zero where they are not known
    floppy       whether floppy parts were regularised; they contribute nothing to the moduli
    n_negative   negative eigenvalues of the Hessian, 0 for a stable state
    """

    elasticity: Elasticity = field(repr=False)
    relaxations: Array = field(repr=False)
    relaxation: Array = field(repr=False)
    floppy: bool = False
    n_negative: int = 0


@checked
def linear_response(
    state: ElasticState,
    pattern: FixedPattern | None = None,
    exact: bool = False,
    factor: Factor | None = None,
    volume: float | None = None,
) -> LinearResponse:
    """Moduli and elasticity tensor of springs under stress in equilibrium, and the relaxations that strains cause.

    exact   the state is the equilibrium to the rounding of its numbers, as Newton's method returns it; otherwise the
            exact equilibrium is found and the change of the moduli up to it is part of the error bound
    factor  of the Hessian at or near the state, if there is one
    volume  V of a pinned network, whose pins move with the strain; None: that of the cell

    Error bound (estimate): `stats.error_bound` and `elasticity.bounds` limit the errors against the exact equilibrium
    (see `equilibrium`); roundings are summed by `accumulated_rounding`.  `stats.condition` is ‖H‖‖H⁻¹‖.
    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain.
    `Status.ill_conditioned` and NaN where a bound exceeds a tenth of the larger modulus.
    Floppy parts, such as slack ones, do not resist and contribute nothing.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> critical = cf.optimize(network, 'bulk_modulus').value
    >>> state = cf.equilibrium(cf.spring_state(network, 0.95 * critical.lengths, critical.coordinates))
    >>> cf.linear_response(state).ok
    True
    """
    if state.network.dimension < 2:
        raise InputError("a shear needs at least two dimensions")
    V = state.network.volume if volume is None else volume
    if not V > 0:
        raise InputError(f"the volume must be positive, not {V}")
    return response_of(state, pattern or state.pattern(), exact, factor, V)


def response_of(
    state: ElasticState,
    pattern: FixedPattern,
    exact: bool,
    factor: Factor | None,
    volume: float,
    condition: bool = True,
    strains: tuple[int, ...] | None = None,
) -> LinearResponse:
    """As `linear_response`; without `condition`, which costs a solve, `stats.condition` is NaN.

    strains  rows of `unit_strains`, such as those of `strains_of`; responses to all others are zero in the result
    """
    strains = strains or tuple(range(len(unit_strains(state.network.dimension))))
    # Without negative eigenvalues any factor near the state will do; convergence shows whether it is near enough.
    found = _responses(state, factor, volume, strains) if factor is not None and _taut(state) else None
    if factor is None or found is None or not found.converged:
        factor = state.factorize(pattern)
        found = _responses(state, factor, volume, strains) if factor.sound and not factor.n_negative else None
    floppy = found is None or not found.converged
    if floppy:
        factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
        if factor.indefinite:
            return _unstable(state, factor)
        found = _responses(state, factor, volume, strains)
    assert found is not None
    bounds = (found.moduli_rounding, found.rounding) if found.converged else None
    if bounds is not None and not exact:
        change = _change_to_equilibrium(state, factor, found, floppy, volume, strains)
        bounds = None if change is None else (bounds[0] + change[0], bounds[1] + change[1])
    number = state.largest_stiffness * inverse_norm(factor, found.last[0]) if condition else np.nan
    bound = Moduli(np.inf, np.inf, np.inf) if bounds is None else Moduli(*map(float, bounds[0]))
    stats = Stats("linear response", 1, residual=found.residual, condition=number, error_bound=bound)
    d = state.network.dimension
    relaxations = np.tensordot(basis_change(d)[list(strains)].T, found.relaxations, axes=1)
    relaxation = found.relaxations[0]
    if bounds is None or bounds[0].max() > TRUSTED_ERROR * np.abs(found.moduli[:2]).max():
        value, status, tensors = NO_MODULI, Status.ill_conditioned, no_elasticity(d, volume)
        note = "rounding errors exceed a tenth of the response to strain: measure it further from the transition"
    else:
        value, status, note = Moduli(*map(float, found.moduli)), Status.ok, ""
        tensors = Elasticity(found.tensor, found.affine, found.stress, volume, bounds[1])
    return LinearResponse(
        value, status, stats, note, elasticity=tensors, relaxations=relaxations, relaxation=relaxation, floppy=floppy
    )


def _unstable(state: ElasticState, factor: Factor) -> LinearResponse:
    nothing, d = np.zeros_like(state.forces), state.network.dimension
    return LinearResponse(
        NO_MODULI,
        Status.unstable,
        Stats("linear response", 2),
        elasticity=no_elasticity(d),
        relaxations=np.zeros((d * (d + 1) // 2, *nothing.shape)),
        relaxation=nothing,
        n_negative=factor.n_negative,
    )


# Responses


@dataclass(frozen=True, eq=False)
class _Responses:
    """Responses to all strains, from one factor.

    moduli, moduli_rounding  (3,) in the order of `Moduli`
    tensor, affine, rounding  C_ab in the strain basis, relaxed and affine, with rounding errors of both, (m, m)
    stress                   S, (d, d)
    relaxations, last        u (m, n_free, d) under `unit_strains` and its last correction
    """

    moduli: Array
    moduli_rounding: Array
    tensor: Array
    affine: Array
    rounding: Array
    stress: Array
    relaxations: Array
    last: Array
    residual: float
    converged: bool


def _change_to_equilibrium(
    state: ElasticState, factor: Factor, found: _Responses, floppy: bool, volume: float, strains: tuple[int, ...]
) -> tuple[Array, Array] | None:
    """Twice the change of moduli (3,) and tensor (m, m) up to the exact equilibrium; None where that is not found."""
    correction = state.exact_displacement(factor, regularised=floppy)
    if not np.isfinite(correction.remainder):
        return None
    apart = np.abs(correction.bond_vectors - state.bond_vectors)
    if not (apart > EPS * state.lengths[:, None]).any():
        return np.zeros(3), np.zeros_like(found.tensor)
    moved = replace(state, bond_vectors=correction.bond_vectors)  # type: ignore[type-var]
    there = _responses(moved, factor, volume, strains)
    return (
        (2 * np.abs(there.moduli - found.moduli), 2 * np.abs(there.tensor - found.tensor)) if there.converged else None
    )


def _responses(state: ElasticState, factor: Factor, volume: float, strains: tuple[int, ...]) -> _Responses:
    """The responses to some rows of `unit_strains` by a factor of the Hessian, refined until corrections are small.

    The first of them is the dilation, the last one the last shear.
    """
    network, sigma, square = state.network, state.sigma, state.lengths**2
    d, m, n = network.dimension, len(strains), network.n_edges
    # Arrays over edges have the edges last: NumPy is several times slower where the last axis is short.
    L = np.ascontiguousarray(state.bond_vectors.T)
    affine = (unit_strains(d)[list(strains)].reshape(m * d, d) @ L).reshape(m, d, n)
    rate, direct, least = affine, np.zeros((m, m)), _NO_RELAXATION * state.length_scale
    u, scale, energy = np.zeros((m, *state.forces.shape)), np.zeros(m), np.zeros(m)
    for refinement in range(_MOST_CORRECTIONS + 1):
        hdot = np.einsum("ie,aie->ae", L, rate)
        tension = state.resistance(hdot)
        stressed = sigma * rate
        force = -_at_vertices(network, tension[:, None] * L + stressed)
        stretching = hdot @ tension.T
        form = stretching + stressed.reshape(m, -1) @ rate.reshape(m, -1).T
        direct = direct if refinement else form
        correction = _solved(factor, force)
        gained = force.reshape(m, -1) @ correction.reshape(m, -1).T
        moved, size = _largest(correction), _largest(force)
        u, scale = u + correction, np.maximum(scale, size)
        small = bool((moved <= _CONVERGED * np.maximum(_largest(u), least)).all())
        before, energy = energy, np.abs(gained.diagonal())
        # The energy that a correction leaves is its gain times the contraction, and must be rounding.
        unfinished = energy * _contraction(energy, before)
        if refinement and small and (unfinished <= 4 * EPS * stretching.diagonal()).all():
            break
        rate = affine + _at_edges(network, u)
    form = (form - gained) / volume
    speed = np.sqrt(np.einsum("aie,aie->ae", rate, rate))
    noise, first = _rounding(state, speed, u, tension)
    unfinished = np.sqrt(np.outer(unfinished, unfinished))
    form_rounding = (noise + unfinished) / volume + 4 * EPS * np.abs(form)

    stress_rounding = float(accumulated_rounding(2 * state.stress_rounding * square)) / volume
    moduli, moduli_rounding = _moduli(
        state, form, form_rounding, (first, float(unfinished[0, 0]), stress_rounding), volume
    )
    T = basis_change(d)[list(strains)]
    tensor, stress = T.T @ form @ T, (sigma * L) @ L.T / volume
    rounding = np.abs(T).T @ form_rounding @ np.abs(T) + 4 * EPS * np.abs(tensor)
    rounding += (stress_rounding + 4 * EPS * float(np.abs(stress).max())) * stress_products(d)
    return _Responses(
        moduli,
        moduli_rounding,
        _symmetric(tensor),
        _symmetric(T.T @ direct @ T) / volume,
        _symmetric(rounding),
        _symmetric(stress),
        u,
        correction,
        float((size / np.maximum(scale, 1e-300)).max()),
        small,
    )


def _moduli(
    state: ElasticState, form: Array, form_rounding: Array, parts: tuple[Array, float, float], volume: float
) -> tuple[Array, Array]:
    """Moduli (3,) and their rounding errors from the forms of the dilation, the first, and of the shear, the last.

    parts  rounding of each edge's part of the first form (N_b,), its unfinished correction, and rounding of the stress
    """
    first, unfinished, stress_rounding = parts
    sigma, square, d = state.sigma, state.lengths**2, state.network.dimension
    trace, shear = float(sigma @ square) / volume, form[-1, -1]
    # Dilation (1 + γ)^{1/d} is curved: b̈ = (1/d)(1/d − 1) b.
    curvature = (1 / d) * (1 / d - 1)
    bulk, pressure = form[0, 0] + curvature * trace, trace / d
    stretched = first + (state.stress_rounding + 4 * EPS * np.abs(sigma)) * abs(curvature) * square
    bulk_rounding = (float(accumulated_rounding(stretched)) + unfinished) / volume + 4 * EPS * abs(bulk)
    corrected_rounding = form_rounding[-1, -1] + 0.5 * stress_rounding / d + 4 * EPS * abs(pressure)
    return (
        np.array([bulk, shear, shear - 0.5 * pressure]),
        np.array([bulk_rounding, form_rounding[-1, -1], corrected_rounding]),
    )


def _solved(factor: Factor, forces: Array) -> Array:
    """H⁻¹ f of each of the forces (m, n_free, d)."""
    solved = np.empty_like(forces)
    for u, force in zip(solved, forces, strict=True):
        u[:] = factor.solve(force.ravel()).reshape(force.shape)
    return solved


def _contraction(energy: Array, before: Array) -> float:
    """The part of an error that a correction leaves, from the energies (m,) of two; at most 1.

    The largest of all strains with a margin, since the first correction may shrink faster than those after it.
    """
    ratio = max(
        (one / other if other > 0 else 1.0 for one, other in zip(energy.tolist(), before.tolist(), strict=True))
    )
    return float(min(1.0, _CONTRACTION_MARGIN * np.sqrt(ratio)))


def _rounding(state: ElasticState, speed: Array, u: Array, tension: Array) -> tuple[Array, Array]:
    """Rounding errors of V C_ab, (m, m), and the parts (N_b,) of the first one.

    Sources: σ; rates |L̇| (m, N_b) as differences of vertex velocities u (m, n_free, d), which may exceed them; products
    with K ḣ (m, N_b).
    """
    network, sigma, length = state.network, np.abs(state.sigma), state.lengths
    vertex_speed = np.zeros((len(u), network.n_vertices))
    vertex_speed[:, network.free_rows] = np.sqrt(np.einsum("aiv,aiv->ai", u, u))
    tail, head = network.edges.T
    rate_rounding = EPS * (speed + vertex_speed.take(tail, 1) + vertex_speed.take(head, 1) + length)
    pull = np.abs(tension) * length + sigma * speed
    loose = state.stress_rounding * speed
    mixed = _accumulated_products(pull, rate_rounding)
    return _accumulated_products(loose, speed) + mixed + mixed.T, loose[0] * speed[0] + 2 * pull[0] * rate_rounding[0]


def _accumulated_products(one: Array, other: Array) -> Array:
    """`accumulated_rounding` of all products of rows of two arrays (m, n) without negative entries, (m, m)."""
    return np.asarray(3 * np.sqrt(one**2 @ (other**2).T) + 0.25 * one @ other.T)


def _at_edges(network: Network, u: Array) -> Array:
    """g u of motions u (m, n_free, d), (m, d, N_b)."""
    m, n, d = u.shape
    return np.ascontiguousarray((network.free_incidence @ np.moveaxis(u, 0, 1).reshape(n, m * d)).T).reshape(m, d, -1)


def _at_vertices(network: Network, flow: Array) -> Array:
    """gᵀ f of edge vectors f (m, d, N_b), (m, n_free, d)."""
    m, d, n = flow.shape
    sums = np.asarray(network.divergence @ flow.reshape(m * d, n).T)
    return np.ascontiguousarray(np.moveaxis(sums.reshape(-1, m, d), 1, 0))


def _largest(vectors: Array) -> Array:
    """Largest component of each of the vectors (m, n_free, d), (m,)."""
    return np.abs(vectors).reshape(len(vectors), -1).max(axis=1, initial=0.0)


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)


def _taut(state: ElasticState) -> bool:
    """Whether no edge is compressed and no stiffness negative: then no eigenvalue of the Hessian is negative."""
    return bool((state.sigma >= 0).all() and (state.edge_stiffness >= 0).all())


def accumulated_rounding(errors: Array) -> Any:
    """Error bound (estimate) of sums whose terms have roundings of these magnitudes (..., n): 3‖e‖₂ + ¼ Σ e.

    Independent roundings of mean zero add up to ‖e‖₂ or less (one standard deviation), so 3‖e‖₂ is exceeded in less
    than 1 % of sums.  On lattices symmetric edges round alike and their errors add coherently, of which ¼ Σ e allows
    for a quarter.  The rigorous bound Σ e exceeds typical errors by √n.
    """
    return 3 * np.linalg.norm(errors, axis=-1) + 0.25 * errors.sum(axis=-1)
