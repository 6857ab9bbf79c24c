"""Whether a given stress stabilises the zero modes of a configuration (prestress stability).

P(σ) must be positive on the null space of the rigidity matrix R.  For σ > 0 it is positive everywhere, and nothing is
computed.  Otherwise the inertia of one saddle matrix proves it at any size; where it does not, as its regularisation
hides singular values of R that are small but not zero, the zero modes themselves decide.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from critflow.certificates.spectrum import Spectrum, edge_without_length
from critflow.linalg.saddle import Saddle
from critflow.linalg.tolerances import LARGEST_DENSE, STABLE_MARGIN
from critflow.networks.network import Array, Network

LARGEST_FORM = 2000  # most zero modes whose stiffness under one stress is found by all eigenvalues: some seconds


def stabilises(network: Network, coordinates: Array, L: Array, sigma: Array) -> bool | None:
    """Whether P(σ) is positive on all zero modes of coordinates (N_v, d) with bond vectors L; None: undecided.

    sigma  (N_b,), exact as given: a self-stress that was computed has components of rounding, whose signs say nothing
    """
    if (sigma > 0).all() or Saddle(network).stable(sigma, L):
        return True
    if edge_without_length(np.linalg.norm(L, axis=1)):
        return None
    spectrum = Spectrum(network, coordinates)
    if spectrum.n_motions * spectrum.n_coordinates > LARGEST_DENSE or spectrum.n_motions > LARGEST_FORM:
        return None
    modes, gap = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    if spectrum.doubt(*gap):
        return None
    if not len(modes):
        return True
    form = forms_on_modes(network.free_incidence, sigma[None], modes.reshape(len(modes), -1, network.dimension))[0]
    least = float(np.linalg.eigvalsh(form)[0])
    margin = STABLE_MARGIN * float(np.mean(np.abs(sigma)))
    return least > 0 if abs(least) > margin else None


def forms_on_modes(incidence: sp.csr_array, stresses: Array, modes: Array) -> Array:
    """Zᵀ P(σ) Z of stresses (n, N_b) on orthonormal motions Z (m, n_vertices, d), (n, m, m).

    incidence  of the edges on the vertices that move, (N_b, n_vertices)
    """
    stretch = np.concatenate([np.asarray(incidence @ component.T) for component in np.moveaxis(modes, 2, 0)])
    return np.stack([stretch.T @ (weights[:, None] * stretch) for weights in np.tile(stresses, modes.shape[2])])
