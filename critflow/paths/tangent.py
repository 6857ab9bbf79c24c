"""The tangent of a strain path: velocities of its unknowns, the modulus along the path, and its extrapolation.

The strain γ has the rate A = F'F⁻¹ of the cell and the second derivative F''F⁻¹; free components q of the cell have
rates A_m and mixed second derivatives with γ.  For rates a, b with relaxed bond rates L̇ = A L + g u and ḣ = L·L̇,
    E_ab = Σ ḣ_a K ḣ_b + σ (L̇_a·L̇_b + L·L̈_ab);
free components follow with q̇ = −E_mn⁻¹ E_nγ, and the modulus along the path is (E_γγ + E_γm q̇_m)/V.
Antisymmetric parts of A only rotate, so their relaxation u is zero.

From the velocities at its last points the path is extrapolated by Hermite polynomials (`Predictor`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot, norms
from critflow.networks.deformation import strain_components
from critflow.networks.network import Array
from critflow.response.linear_response import LinearResponse, accumulated_rounding
from critflow.springs.newton import FLOPPY_SHIFT
from critflow.springs.state import SpringState

# Corrections of a relaxation, the part of it at which they stop, and the largest that rounding may leave.
_MOST_CORRECTIONS, _CONVERGED, _CORRECT = 4, 1e-9, 1e-2
# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2
# Points of the path from which it is extrapolated.
_MOST_POINTS = 3


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives along a path at one state.

    relaxation    dx/dγ − Ȧx, (n_free, d): velocities relative to the affine motion of the cell
    free_rate     dq/dγ of free components, (m,)
    second        d²E/dγ² of the relaxed energy, and its rounding error
    """

    relaxation: Array
    free_rate: Array
    second: float
    second_error: float


def tangent_of_response(response: LinearResponse, rates: Array, second_rates: Array) -> Tangent:
    """The tangent from the responses to all strains: no sums over edges."""
    tensors, weights = response.value, np.array([strain_components(0.5 * (A + A.T)) for A in rates])
    E = np.array([[tensors.second(A, B) for B in rates] for A in rates])
    E[0] += [float(np.vdot(tensors.stress, A)) for A in second_rates]
    E[1:, 0] = E[0, 1:]
    path = _with_free(E)
    # Errors of q̇ enter squared only.
    size = np.abs(path @ weights)
    error = float(size @ tensors.errors.tensor @ size)
    V = tensors.volume
    return Tangent(response.relaxation(path @ weights), path[1:], float(V * (E[0] @ path)), V * error)


def tangent_of_springs(
    state: SpringState, rates: Array, second_rates: Array, pattern: FixedPattern, factor: Factor | None
) -> Tangent | None:
    """The tangent from the relaxations to each rate, by a factor near the state; None where it is not determined."""
    if factor is None:
        factor = state.factorize(pattern)
        if factor.indefinite:
            factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
    relaxations = relaxations_to(state, factor, rates)
    if relaxations is None:
        return None
    network, L, sigma = state.network, state.bond_vectors, state.sigma
    speeds = np.array([L @ A.T + network.free_incidence @ u for A, u in zip(rates, relaxations, strict=True)])
    hdots, rows = np.array([dot(L, speed) for speed in speeds]), speeds.reshape(len(speeds), -1)
    E = hdots @ state.resistance(hdots).T + (np.repeat(sigma, L.shape[1]) * rows) @ rows.T
    curved = np.array([sigma * dot(L, L @ A.T) for A in second_rates])
    E[0] += curved.sum(axis=1)
    E[1:, 0] = E[0, 1:]
    path = _with_free(E)
    relaxation, second = np.tensordot(path, relaxations, 1), float(E[0] @ path)
    noise = _edge_rounding(state, np.tensordot(path, speeds, 1), relaxation) + 4 * EPS * np.abs(curved[0])
    return Tangent(relaxation, path[1:], second, accumulated_rounding(noise) + 4 * EPS * abs(second))


def _with_free(E: Array) -> Array:
    """(1, q̇) from the second derivatives E_ab, (1 + m,); free components that no stress resists do not follow."""
    if len(E) == 1:
        return np.ones(1)
    return np.concatenate([[1.0], -np.linalg.lstsq(E[1:, 1:], E[1:, 0], rcond=None)[0]])


def relaxations_to(state: SpringState, factor: Factor, rates: Array) -> Array | None:
    """u (n, n_free, d) with H u = −∂²E/∂x∂a for each rate (n, d, d) of the cell; None where corrections do not shrink.

    factor  of the Hessian at or near the state
    """
    found = np.zeros((len(rates), *state.forces.shape))
    for u, A in zip(found, rates, strict=True):
        # The antisymmetric part rotates all.
        affine, before = 0.5 * (state.bond_vectors @ (A + A.T)), np.inf
        for _ in range(_MOST_CORRECTIONS):
            force = state.force_rates(affine + state.edge_rates(u))
            correction = factor.solve(force.ravel()).reshape(u.shape)
            u += correction
            size = float(np.abs(correction).max(initial=0.0))
            small = float(np.abs(u).max(initial=0.0))
            # Corrections that no longer shrink are rounding, or the factor is of no use.
            if not size < before:
                if not size <= _CORRECT * small:
                    return None
                break
            if size <= _CONVERGED * small:
                break
            before = size
    return found


def _edge_rounding(state: SpringState, speed: Array, u: Array) -> Array:
    """Rounding error of each edge's part of d²E/dγ², (N_b,), as `linear_response` has it."""
    network, sigma, length = state.network, state.sigma, state.lengths
    stress = state.resistance(dot(state.bond_vectors, speed))
    size, vertex_speed = norms(speed), np.zeros(network.n_vertices)
    vertex_speed[network.free_rows] = norms(u)
    rate_rounding = EPS * (size + vertex_speed.take(network.edges.T).sum(axis=0) + length)
    noise = state.stress_rounding * (size**2 + length * size)
    return noise + 2 * (np.abs(stress) * length + np.abs(sigma) * size) * rate_rounding


@dataclass(frozen=True, eq=False)
class Predictor:
    """Extrapolates a path y(γ) from its last two or three points, whichever predicted the last one better.

    points  (γ, y, dy/dγ) of the last points, the newest last; y and dy/dγ (n,), the latter None if it is unknown
    better  index of the better prediction: from two points 0, from all −1
    """

    points: tuple[tuple[float, Array, Array | None], ...]
    better: int = -1

    @classmethod
    def at(cls, strain: float, y: Array, velocity: Array | None = None) -> Predictor:
        """The predictor at the first point of a path."""
        return cls(((strain, y, velocity),))

    def extended(self, strain: float, y: Array, velocity: Array | None, predicted: Array) -> Predictor:
        """The predictor with a further point, of which `changes` were predicted; the last three are kept."""
        better = self.better
        if len(predicted) > 1:
            better = int(np.abs(predicted - (y - self.points[-1][1])).max(axis=1).argmin())
        return Predictor((*self.points[1 - _MOST_POINTS :], (strain, y, velocity)), better)

    def chosen(self, changes: Array) -> Array:
        """The change (n,) to use of those predicted."""
        return np.asarray(changes[self.better if len(changes) > 1 else 0])

    def changes(self, strain: float) -> Array:
        """Extrapolated changes of y from the newest point (1 or 2, n): from two points, and from three."""
        last, y, velocity = self.points[-1]
        if velocity is None:
            return np.zeros((1, len(y)))
        ahead, behind = strain - last, last - self.points[-2:][0][0]
        if abs(ahead) > _FARTHEST * abs(behind):
            return (velocity * ahead)[None]
        values = [part for _, there, rate in self.points for part in (there - y, rate) if part is not None]
        weights = [_weights(self.points[-n:], strain) for n in range(2, len(self.points) + 1)]
        return np.array([[0.0] * (len(values) - len(row)) + row for row in weights]) @ np.array(values)


def _weights(points: tuple[tuple[float, Array, Array | None], ...], strain: float) -> list[float]:
    """The weights in a Hermite polynomial at a strain: of the value and, if known, the velocity of each point."""
    weights = list[float]()
    for here, _, velocity in points:
        value, slope = 1.0, 0.0
        for there, _, rate in points:
            if there != here:
                order = 1 if rate is None else 2
                value *= ((strain - there) / (here - there)) ** order
                slope += order / (here - there)
        weights += [value] if velocity is None else [value * (1 - (strain - here) * slope), value * (strain - here)]
    return weights
