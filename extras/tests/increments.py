"""Increments of the stress against relaxed states: a check of any springs."""

import numpy as np
from derivatives import assert_derivative

from critflow import equilibrium
from critflow.deformation import strain_basis
from critflow_extras.anisotropy.tensors import stress_strain


def assert_increments(state, response):
    """The stress–strain tensor is the derivative of the stress."""
    d, basis = state.network.dimension, strain_basis(state.network.dimension)[1]

    def stress(e):
        after = equilibrium(state.deformed(np.eye(d) + np.einsum("a,aij->ij", e, basis)), tolerance=1e-15).value
        L = after.bond_vectors
        return np.einsum("aij,ij->a", basis, (after.sigma[:, None] * L).T @ L / after.network.volume)

    ends, tensor = np.eye(len(basis))[[0, -1]], stress_strain(response.value)
    assert_derivative(stress, lambda e: tensor @ e, np.zeros(len(basis)), ends, rtol=1e-5, step=1e-4)
