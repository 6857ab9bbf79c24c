"""Local structure: shape anisotropy of faces and of the polygons of the force network, and relative variance.

κ = 2(λ_1⁴ + λ_2⁴)/(λ_1² + λ_2²)² − 1 with λ the eigenvalues of the gyration tensor of a polygon's corners about their
centre: 0 for a regular polygon, 1 for a line (`ShapeAnisotropy`).  With λ² as eigenvalues, as in polymer physics, the
same expression would be the smaller number q below.
"""

import numpy as np
from numpy.typing import NDArray

from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.result import InputError


def relative_variance(values: Array) -> float:
    """Variance over the squared mean: V_L of lengths, V_τ of tensions."""
    return float(np.var(values) / np.mean(values) ** 2)


def face_anisotropy(critical: CriticalConfiguration) -> Array:
    """κ of every face, (n_faces,).  Raises `InputError` for a network whose faces are not known."""
    faces = critical.network.faces
    if faces is None:
        raise InputError("the faces of this network are not known: give `faces`, for example from `planar_faces`")
    return polygon_anisotropy(faces.signs[:, None] * critical.bond_vectors[faces.edges], faces.starts)


def force_anisotropy(critical: CriticalConfiguration) -> Array:
    """κ of the closed polygon of the tensions at each free vertex, (n,): triangles where three edges meet.

    Rotated by a right angle these polygons are the faces of the dual force network.
    """
    network = critical.network
    if network.dimension != 2:
        raise InputError("force polygons are defined in two dimensions")
    pull = critical.sigma[:, None] * critical.bond_vectors
    origin = network.edges.T.ravel()
    outward = np.concatenate([pull, -pull])
    direction = np.concatenate([critical.bond_vectors, -critical.bond_vectors])
    order = np.lexsort((np.arctan2(direction[:, 1], direction[:, 0]), origin))
    inner = np.isin(origin[order], list(network.pins or {}), invert=True)
    order = order[inner]
    starts = np.flatnonzero(np.diff(origin[order], prepend=-1, append=network.n_vertices))
    return polygon_anisotropy(outward[order], starts)


def polygon_anisotropy(sides: Array, starts: NDArray[np.intp]) -> Array:
    """κ of polygons given by their sides (n, 2) as vectors, polygon p being `sides[starts[p]:starts[p + 1]]`.

    A polygon without extent has no shape: NaN.
    """
    counts = np.diff(starts)
    corner = np.cumsum(sides, axis=0)
    centre = np.add.reduceat(corner, starts[:-1]) / counts[:, None]
    arm = corner - np.repeat(centre, counts, axis=0)
    xx, yy, xy = (np.add.reduceat(arm[:, i] * arm[:, j], starts[:-1]) for i, j in ((0, 0), (1, 1), (0, 1)))
    with np.errstate(invalid="ignore"):
        # q = (λ_1 − λ_2)²/(λ_1 + λ_2)² needs no eigenvalues, and κ = (λ_1² − λ_2²)²/(λ_1² + λ_2²)² = 4q/(1 + q)².
        q = ((xx - yy) ** 2 + 4 * xy**2) / (xx + yy) ** 2
        return 4 * q / (1 + q) ** 2
