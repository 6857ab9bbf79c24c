"""The critical manifold as a surface in the space of h = |L|²/2: chart, metric and curvature, at any size.

The surface is h(σ) (`SelfStressParamaterization_Lsqr`).  Stress is normal to it, and B = ∂h/∂σ gives the rest:
tangents B V, metric VᵀB²V and second fundamental form −VᵀB V/|σ| in any chart σ(s) with V = ∂σ/∂s (`TangentSpace`,
`Metric`, `2FF`).  The sign is that of Σ_α σ_α ∂²h_α/∂s∂s/|σ|, since σᵀB = 0 gives σᵀ∂B = −B; the paper prints the
opposite one.

In a chart about the point V is an orthonormal basis of σ^⊥, and −VᵀBV x = κ|σ| VᵀB²V x makes the principal
directions eigenvectors of B and the radii of curvature 1/κ the eigenvalues of −|σ|B on σ^⊥.  B has rank N_b − 1 where
there is one self-stress and P is definite; then all radii are positive and the manifold is convex.  B is a sparse
solve, so that a few radii need neither N_b × N_b matrices nor generalised eigenproblems.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.arguments import of_kind
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.linalg.vectors import quasi_random
from critflow.networks.checks import edge_values
from critflow.networks.network import Array
from critflow.progress import running
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.threads import one_blas_thread

CURVATURE_ERROR = 1e-8  # largest relative residual of principal curvatures that are returned
DENSE_BYTES = 10**9  # largest dense matrix of an operator, in bytes: 10,000 rows and columns take 0.8 GB


def dense(operator: LinearOperator) -> Array:
    """The matrix of an operator, column by column; raises `InputError` where it would take more than a gigabyte."""
    rows, columns = operator.shape
    if 8 * rows * columns > DENSE_BYTES:
        raise InputError(f"a dense matrix takes {8e-9 * rows * columns:.3g} GB: apply the operator, or give k")
    return operator @ np.eye(columns)


@dataclass(frozen=True, eq=False, repr=False)
class StereographicChart(Record):
    """Unit stresses by N_b − 1 coordinates s about a pole σ⁰ (`projection`); s = 0 is the pole itself.

    The basis v of the pole's complement is the last N_b − 1 columns of the reflection 1 − 2uuᵀ that takes the pole to
    an end of the first axis: it depends on the pole alone and costs no more than one vector.
    """

    pole: Array  # (N_b,), of unit norm
    mirror: Array  # u, (N_b,), of unit norm

    @classmethod
    def about(cls, pole: ArrayLike) -> StereographicChart:
        """The chart about a stress (N_b,) of any scale."""
        sigma = edge_values(pole, np.size(pole), "pole", positive=False)
        if not sigma.any():
            raise InputError("the pole of the chart must not be zero everywhere")
        unit = sigma / np.linalg.norm(sigma)
        mirror = unit.copy()
        mirror[0] += np.copysign(1.0, unit[0])  # the end of the axis that lies farther away, so that nothing cancels
        return cls(unit, mirror / np.linalg.norm(mirror))

    @cached_property
    def basis(self) -> LinearOperator:
        """v, (N_b, N_b − 1): orthonormal and orthogonal to the pole."""

        def reflected(w: Array) -> Array:
            return w - 2 * (self.mirror @ w) * self.mirror

        return LinearOperator(
            (len(self.pole), len(self.pole) - 1),
            matvec=lambda s: reflected(np.append(0.0, s)),
            rmatvec=lambda w: reflected(np.ravel(w))[1:],
            dtype=float,
        )

    def sigma(self, s: ArrayLike) -> Array:
        """σ(s), of unit norm, (N_b,)."""
        at = self._checked(s)
        quarter = float(at @ at) / 4
        return (self.basis @ at + (1 - quarter) * self.pole) / (1 + quarter)

    def coordinates(self, sigma: ArrayLike) -> Array:
        """s of a stress (N_b,) of any scale; raises `InputError` for the antipode of the pole, which has none."""
        stress = edge_values(sigma, len(self.pole), "sigma", positive=False)
        size = float(np.linalg.norm(stress))
        height = size + float(self.pole @ stress)
        if not height > 1e-14 * size:
            raise InputError("zero and the antipode of the pole have no coordinates: choose the pole nearer the stress")
        return 2 * (self.basis.T @ stress) / height

    def derivative(self, s: ArrayLike) -> LinearOperator:
        """V = ∂σ/∂s, (N_b, N_b − 1) (`projectionDeriv`)."""
        at, half = self._checked(s), (self.pole + self.sigma(s)) / 2
        scale = 1 / (1 + float(at @ at) / 4)
        return LinearOperator(
            (len(self.pole), len(at)),
            matvec=lambda ds: scale * (self.basis @ np.ravel(ds) - (at @ np.ravel(ds)) * half),
            rmatvec=lambda w: scale * (self.basis.T @ np.ravel(w) - (half @ np.ravel(w)) * at),
            dtype=float,
        )

    def _checked(self, s: ArrayLike) -> Array:
        at = np.asarray(s, dtype=float)
        if at.shape != (len(self.pole) - 1,) or not np.isfinite(at).all():
            raise InputError(f"s must be {len(self.pole) - 1} finite coordinates, one less than edges, not {at.shape}")
        return at


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceGeometry(Record):
    """The manifold at one point of a chart, as operators; `dense` makes matrices of them.

    sigma     unit normal σ(s), (N_b,)
    response  B of that stress, (N_b, N_b)
    chart     V = ∂σ/∂s, (N_b, N_b − 1)
    """

    sigma: Array
    response: LinearOperator
    chart: LinearOperator

    @cached_property
    def tangents(self) -> LinearOperator:
        """T = ∂h/∂s = B V, (N_b, N_b − 1) (`TangentSpace`)."""
        return self.response @ self.chart

    @cached_property
    def metric(self) -> LinearOperator:
        """TᵀT = VᵀB²V (`Metric`)."""
        return self.tangents.T @ self.tangents

    @cached_property
    def second_fundamental_form(self) -> LinearOperator:
        """Σ_α σ_α ∂²h_α/∂s∂s = −VᵀBV for |σ| = 1 (`2FF`, with the sign that finite differences have)."""
        return -(self.chart.T @ self.tangents)


@running("surface_geometry")
@one_blas_thread()
def surface_geometry(manifold: CriticalManifold, chart: StereographicChart, s: ArrayLike) -> SurfaceGeometry:
    """Tangents, metric and second fundamental form at chart coordinates s (N_b − 1,).

    Raises `InputError` for coordinates of another shape and `SolveError` where the stress has no configuration.
    """
    manifold = of_kind(CriticalManifold, manifold=manifold)
    chart = of_kind(StereographicChart, chart=chart)
    of_kind(np.ndarray, s=s)
    sigma, V = chart.sigma(s), chart.derivative(s)
    return SurfaceGeometry(sigma, unit_response(manifold, manifold.configuration(sigma)), V)


def unit_response(manifold: CriticalManifold, configuration: CriticalConfiguration) -> LinearOperator:
    """|σ|B, (N_b, N_b): the response B to stresses of unit norm, which no longer depends on the scale of σ."""
    # h(σ) does not change with the scale of σ, so B = ∂h/∂σ goes as its inverse.
    return manifold.response(configuration) * float(np.linalg.norm(configuration.sigma))


@dataclass(frozen=True, eq=False, repr=False)
class PrincipalCurvatures(Record):
    """Curvatures κ of the manifold towards its normal σ, by growing size (n,), and the method that found them.

    radii       1/κ, eigenvalues of −|σ|B on σ^⊥, in units of h
    directions  (n, N_b) unit vectors: principal directions among the h, and the stresses that move along them
    residuals   |−|σ|B w − w/κ| κ of each.  Error bound (proof up to the rounding of the products): an eigenvalue of a
                symmetric operator lies within this relative distance
    """

    radii: Array
    directions: Array
    residuals: Array

    @property
    def curvatures(self) -> Array:
        """κ, (n,), in units of 1/h."""
        return 1 / self.radii

    @property
    def log_gaussian(self) -> float:
        """log|Πκ|: of all N_b − 1 curvatures this is the Gaussian one, K, whose sign is that of Πκ.

        Error bound (proof up to the rounding of the products): Σ residuals/(1 − residuals).
        """
        return -float(np.log(np.abs(self.radii)).sum())


@running("principal_curvatures")
@one_blas_thread()
def principal_curvatures(
    manifold: CriticalManifold,
    sigma: ArrayLike,
    k: int | None = None,
    *,
    tolerance: float = CURVATURE_ERROR,
    throw: bool = True,
) -> Solution[PrincipalCurvatures]:
    """Principal curvatures at a stress (N_b,): all N_b − 1 by dense matrices, or the k flattest by sparse solves.

    `Status.singular` where P(σ) is singular, `Status.edge_collapse` where an edge has no length and B less than N_b − 1
    directions, `Status.stalled` where a residual exceeds `tolerance`; values are then NaN.
    """
    manifold = of_kind(CriticalManifold, manifold=manifold)
    of_kind(np.ndarray, sigma=sigma)
    k = of_kind(int, None, k=k)
    of_kind(float, tolerance=tolerance)
    of_kind(bool, throw=throw)
    n = manifold.network.n_edges
    if k is not None and not 0 < k < n - 1:
        raise InputError(f"k = {k} must lie between 1 and {n - 2}: leave it out for all {n - 1} curvatures")
    found = manifold.solve(sigma)
    status, residual = found.status, found.stats.residual
    value = PrincipalCurvatures(*(np.full(shape, np.nan) for shape in ((k or n - 1,), (k or n - 1, n), (k or n - 1,))))
    method = "dense" if k is None else "Lanczos"
    if found.ok and len(found.value.collapsed_edges):
        status = Status.edge_collapse
    elif found.ok:
        try:
            candidate = _candidates(manifold, found.value, k)
        except ArpackNoConvergence:
            status = Status.stalled
        else:
            residual = float(candidate.residuals.max())
            status = Status.ok if residual < tolerance else Status.stalled
            value = candidate if status is Status.ok else value
    solution = Solution(value, status, Stats(method, residual=residual), _NOTES.get(status, ""))
    return solution.or_raise("the principal curvatures were not found") if throw else solution


_NOTES = {
    Status.edge_collapse: "an edge without length leaves the manifold no tangent plane here: move the stress away",
    Status.stalled: "some curvatures are infinite, as with several self-stresses, or below rounding: request "
    "the k flattest",
}


def _candidates(manifold: CriticalManifold, configuration: CriticalConfiguration, k: int | None) -> PrincipalCurvatures:
    """Eigenvalues of −|σ|B: all but the zero of σ by a dense matrix, or the k largest by Lanczos iteration."""
    operator, n = -unit_response(manifold, configuration), manifold.network.n_edges
    if k is None:
        matrix = dense(operator)
        radii, vectors = scipy.linalg.eigh((matrix + matrix.T) / 2)
    else:
        radii, vectors = eigsh(operator, k=k, which="LM", v0=quasi_random(n) - 0.5)
    order = np.argsort(-np.abs(radii))[: n - 1]
    radii, directions = radii[order], vectors.T[order]
    return PrincipalCurvatures(radii, directions, _residuals(operator, directions, radii))


def _residuals(operator: LinearOperator, vectors: Array, values: Array) -> Array:
    left = [np.linalg.norm(operator @ w - value * w) for w, value in zip(vectors, values, strict=True)]
    return np.divide(left, np.abs(values), out=np.full(len(values), np.inf), where=values != 0)
