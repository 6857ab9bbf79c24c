"""Isogonal modes: every edge keeps its direction, lengths change with closure.

They keep the force network T_α = σ_α L_α, and with it the tension variance and a maximal bulk modulus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from critflow.manifold import CriticalConfiguration, critical_configuration
from critflow.network import Array
from critflow.result import InputError
from critflow.rigidity import spread_columns


@dataclass(frozen=True, eq=False)
class IsogonalModes:
    """A basis of the isogonal modes at a configuration, orthonormal in the displacements.

    displacements  (n_modes, n_free, 2) of the free vertices
    elongations    (n_modes, N_b) of the edges, along their own directions
    gap            largest singular value counted as zero, and the next one
    """

    critical: CriticalConfiguration
    displacements: Array
    elongations: Array
    gap: tuple[float, float]

    def walk(self, amplitudes: Array) -> CriticalConfiguration:
        """The configuration with lengths |L| + Σ a_m e_m and the same tensions, exactly, at any distance.

        Raises `InputError` where an edge would lose its length: nothing is isogonal beyond.
        """
        critical, network = self.critical, self.critical.network
        a = np.asarray(amplitudes, dtype=float)
        if a.shape != (len(self.elongations),) or not np.isfinite(a).all():
            raise InputError(f"a walk needs {len(self.elongations)} finite amplitudes, not an array of shape {a.shape}")
        lengths = critical.lengths + a @ self.elongations
        if not lengths.min() > 0:
            shrinking = -(a @ self.elongations) / critical.lengths
            edge = int(shrinking.argmax())
            raise InputError(
                f"edge {edge} would lose its length: scale the amplitudes by less than {1 / shrinking[edge]:.4g}"
            )
        x = critical.coordinates.copy()
        x[network.free] += np.tensordot(a, self.displacements, 1)
        return critical_configuration(network, critical.tensions / lengths, x)


def isogonal_modes(critical: CriticalConfiguration, tolerance: float = 1e-8) -> IsogonalModes:
    """The isogonal modes of a planar configuration: N_v/2 − 1 for a periodic network of three edges a vertex.

    Displacements u with no component of g u across any edge, by a dense singular value decomposition.
    """
    network = critical.network
    if network.dimension != 2:
        raise InputError("isogonal modes are found in two dimensions only")
    unit = critical.bond_vectors / critical.lengths[:, None]
    across = spread_columns(network, np.stack([-unit[:, 1], unit[:, 0]], axis=1))
    _, values, right = np.linalg.svd(across.toarray())
    values = np.concatenate([values, np.zeros(len(right) - len(values))])
    zero = values < tolerance
    displacements = right[zero].reshape(-1, len(network.free), 2)
    elongations = right[zero] @ sp.csr_array(spread_columns(network, unit)).T
    gap = (float(values[zero].max(initial=0.0)), float(values[~zero].min(initial=np.inf)))
    return IsogonalModes(critical, displacements, np.asarray(elongations), gap)
