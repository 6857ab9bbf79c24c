"""Slack cables on a path: floppy vertices, which no taut edge meets, are placed where no cable near them is tight.

Nothing determines these coordinates.  But relaxation leaves an edge that was longer than ℓ at |L| = ℓ to rounding, on
the kink of its energy, where the next iteration cannot tell whether it resists: with all slack edges inside, |L| < ℓ,
floppy vertices feel no force at all, and those of the taut part have a positive definite Hessian.
"""

from __future__ import annotations

from critflow.networks import Array
from critflow.springs import SpringState
from critflow.taut_edges import placed

NO_TENSION = 1e-9  # σ of an edge that counts as slack, in units of the largest
TIGHT = 0.999  # |L|/ℓ of a slack edge above which floppy vertices are placed anew
PLACED = 1e-8  # tolerance of the cone program: any place inside will do


def with_slack_placed(springs: SpringState, sigma: Array) -> SpringState:
    """The springs with floppy vertices at min max |L|/ℓ over the slack edges that meet them, by one cone program.

    sigma  (N_b,) that tells taut from slack edges
    """
    network, taut = springs.network, sigma > NO_TENSION * sigma.max()
    if not (springs.lengths > TIGHT * springs.rest_lengths)[~taut].any():
        return springs
    x = springs.coordinates[network.free_rows]
    moved = placed(network, taut, springs.rest_lengths, springs.bond_vectors, x, PLACED)
    return springs if moved is x else springs.moved(moved - x)
