"""matscipy with the springs of a state: ASE's atoms in a periodic layer, and a calculator of fixed bonds.

matscipy's `MatscipyCalculator` derives the elastic constants from the Hessian.
"""

from typing import Any

import numpy as np
import scipy.sparse as sp

from critflow.networks.network import Array
from critflow.springs.state import SpringState

from ..timing import peer

# Thickness of the layer; volumes are areas times it.
_THICKNESS = 1.0


def atoms_of(state: SpringState) -> Any:
    """ASE's `Atoms` at the coordinates of a state, in a layer."""
    network = state.network
    cell = np.diag([0.0, 0.0, _THICKNESS])
    cell[:2, :2] = network.cell
    x = np.zeros((network.n_vertices, 3))
    x[:, :2] = state.coordinates
    return peer("ase").Atoms(positions=x, cell=cell, pbc=True, numbers=np.ones(len(x), int))


def matscipy_springs(state: SpringState) -> Any:
    """A calculator of stress and of Hessians in matscipy's two formats, for edges and their reverses."""

    class Springs(peer("matscipy.calculators.calculator").MatscipyCalculator):  # type: ignore[misc, name-defined]
        implemented_properties = (
            *("energy", "forces", "stress", "hessian", "nonaffine_forces", "born_constants"),
            *("birch_coefficients", "elastic_constants"),
        )

        def calculate(self, atoms, properties, system_changes):
            super().calculate(atoms, properties, system_changes)
            L, length, tension = _springs(self.atoms)
            pull = L * (tension / length)[:, None]
            stress = self._virial(L, pull) / self.atoms.get_volume()
            forces = np.zeros((len(self.atoms), 3))
            forces[:] = -(g.T @ pull)
            extension = length - state.rest_lengths
            self.results |= {"energy": 0.5 * float(tension @ extension), "forces": forces, "stress": stress}

        def get_hessian(self, atoms, format="sparse", divide_by_masses=False):
            L, length, tension = _springs(atoms)
            stiffness, sigma = state.network.stiffness, tension / length
            n = L / length[:, None]
            blocks = (stiffness - sigma)[:, None, None] * n[:, :, None] * n[:, None, :]
            blocks += sigma[:, None, None] * np.eye(3)
            if format == "neighbour-list":
                pairs, vectors = np.concatenate([edges, edges[:, ::-1]]), np.concatenate([L, -L])
                lengths = np.concatenate([length, length])
                return -np.concatenate([blocks, blocks]), pairs[:, 0], pairs[:, 1], vectors, lengths
            weight = sp.bsr_array((blocks, np.arange(len(L)), np.arange(len(L) + 1)))
            return sp.csr_array(g3.T @ weight @ g3)

    network = state.network
    edges, g, b = network.edges, network.incidence, np.zeros((network.n_edges, 3))
    b[:, :2] = _images(state)
    g3 = sp.csr_array(sp.kron(g, sp.eye_array(3)))

    def _springs(atoms):
        L = g @ atoms.positions + b
        length = np.linalg.norm(L, axis=1)
        return L, length, network.stiffness * (length - state.rest_lengths)

    return Springs()


def _images(state: SpringState) -> Array:
    """Contribution of the images to the bond vectors, (N_b, 2), for coordinates without a grounded vertex."""
    return state.network.offsets @ state.network.cell
