"""How much compression the largest modulus of a planar network needs: a linear program over isogonal modes."""

import numpy as np
import scipy.optimize
import scipy.sparse as sp

from critflow import CriticalManifold, InputError, SolveError
from critflow.numerics import dot, power_of_two
from critflow.optima import QUARTER_TURN
from critflow.quantities import force_map, transition_modulus
from critflow.sparse import spread_columns


def least_compressed_length(network, strain):
    """The least total length of compressed edges of a planar configuration with the largest modulus.

    All these configurations have the forces T = kFL* and differ by isogonal modes.  With t = T/|T| and n ⊥ t:
        least Σ p,  p ≥ 0,  p ≥ −t·(g x + b),  n·(g x + b) = 0.
    """
    manifold = CriticalManifold.of(network)
    network = manifold.network
    if network.dimension != 2:
        raise InputError("configurations of one force network are found in two dimensions only")
    L_star = manifold.balance(network.stiffness).bond_vectors
    F, _ = force_map(network, L_star, transition_modulus(network, strain).symmetric)
    T = network.stiffness[:, None] * (L_star @ F.T)
    unit = T / np.linalg.norm(T, axis=1)[:, None]
    normal = unit @ QUARTER_TURN.T
    # The program has an absolute tolerance, 1e-7: lengths are in a unit of their own.
    length = power_of_two(network.spacing)
    n_edges, n_coordinates, b = network.n_edges, 2 * len(network.free), network.boundary_vectors / length
    program = scipy.optimize.linprog(
        np.repeat([0.0, 1.0], [n_coordinates, n_edges]),
        A_ub=sp.hstack([-spread_columns(network, unit), -sp.eye_array(n_edges)]),
        b_ub=dot(unit, b),
        A_eq=sp.hstack([spread_columns(network, normal), sp.csr_array((n_edges, n_edges))]),
        b_eq=-dot(normal, b),
        bounds=[(None, None)] * n_coordinates + [(0, None)] * n_edges,
    )
    if program.status != 0:
        raise SolveError(f"no configuration has the largest modulus for this strain: {program.message}")
    return length * float(program.fun)
