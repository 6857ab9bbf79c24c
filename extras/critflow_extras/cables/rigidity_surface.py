"""The rigidity surface: the boundary of the set of strains that leave a network floppy.

The set {F : t(F) ≤ 1} is convex, since t(F) = min_x max_α |F b_α + (g x)_α| / ℓ_α is.  On each ray F = 1 + γA from a
floppy network it ends at the critical strain γ_c, and its normal there is the macroscopic stress ∂t/∂F = Σ f_α ⊗ b_α.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind
from critflow.calls import counted, running
from critflow.networks import Array, Network
from critflow.result import InputError, Record, Status
from critflow_extras.cables.critical_strain import critical_strain


@dataclass(frozen=True, eq=False, repr=False)
class RigiditySurface(Record):
    """Points of the rigidity surface on rays F = 1 + γA; NaN where a ray does not meet it, or no bounds are proven.

    directions    A, (n, d, d)
    strains       γ_c, (n,)
    error_bounds  upper less lower bound of γ_c, (n,)
    normals       ∂t/∂F at the points, Σ|f|ℓ = 1, (n, d, d)
    taut          number of taut edges, (n,)
    statuses      outcome of each ray, (n,)
    """

    directions: Array
    strains: Array
    error_bounds: Array
    normals: Array
    taut: NDArray[np.int64]
    statuses: tuple[Status, ...]

    @property
    def points(self) -> Array:
        """F − 1 = γ_c A, (n, d, d)."""
        return self.strains[:, None, None] * self.directions

    @property
    def found(self) -> NDArray[np.bool_]:
        """Rays that meet the surface, (n,)."""
        return np.isfinite(self.strains)


@running("rigidity_surface")
def rigidity_surface(network: Network, rest_lengths: ArrayLike, directions: ArrayLike) -> RigiditySurface:
    """The rigidity surface of cables of rest lengths ℓ (N_b,), on rays F = 1 + γA for directions A (n, d, d).

    Raises `InputError` for directions of another shape.  A ray on which the network stays floppy to a flat cell, or
    rigid at γ = 0, has a status other than `ok` and NaN.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> import numpy as np
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> surface = ce.rigidity_surface(network, np.full(12, 1.1), np.eye(2)[None])
    >>> surface.strains.round(6)
    array([0.1])
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, rest_lengths=rest_lengths, directions=directions)
    A = np.array(directions, dtype=float)
    if A.ndim != 3 or A.shape[1:] != (network.dimension,) * 2 or not np.isfinite(A).all():
        d = network.dimension
        raise InputError(f"directions must be finite matrices, an array of shape (n, {d}, {d}), not {A.shape}")
    onsets = [critical_strain(network, rest_lengths, one, throw=False) for one in counted(A, "direction")]
    return RigiditySurface(
        directions=A,
        strains=np.array([onset.value.strain if all(onset.value.proven) else np.nan for onset in onsets]),
        error_bounds=np.array([onset.value.upper - onset.value.lower for onset in onsets]),
        normals=np.array([onset.value.normal for onset in onsets]).reshape(A.shape),
        taut=np.array([onset.value.taut.sum() for onset in onsets], dtype=np.int64),
        statuses=tuple(onset.status for onset in onsets),
    )


def strain_plane(first: ArrayLike, second: ArrayLike, n: int) -> Array:
    """Directions cos θ A + sin θ B (n, d, d) at n equal angles θ: a plane section of the space of strains.

    In two dimensions A = diag(1, −1) and B = 1 span pure shear and dilation.

    >>> from critflow_extras.cables.rigidity_surface import strain_plane
    >>> import numpy as np
    >>> strain_plane(np.eye(2), np.diag([1.0, -1.0]), 4).shape
    (4, 2, 2)
    """
    of_kind(np.ndarray, first=first, second=second)
    n = of_kind(int, n=n)
    A, B = np.array(first, dtype=float), np.array(second, dtype=float)
    if A.shape != B.shape or A.ndim != 2 or n < 1:
        raise InputError(f"a plane of strains needs two matrices of one shape and n ≥ 1, not {A.shape}, {B.shape}, {n}")
    angle = 2 * np.pi * np.arange(n)[:, None, None] / n
    return np.asarray(np.cos(angle) * A + np.sin(angle) * B)
