"""Constants that decide in this layer, with their reasons.

Singular values s of R, whose rows have norm √2

ZERO_MODE        s below this counts as zero unless the caller gives a tolerance: the smallest other s is 0.1 in
                 standard networks of 1,000 vertices and falls as 1/√N_v; rounding leaves 1e-12.
CLEAR_GAP        A count is trusted if no s lies within this factor of the tolerance.
ROUNDING_MARGIN  s is zero to rounding below this number times the effect of the rounding of the coordinates on R; the
                 bound adds the errors of all edges in quadrature, of which a few may coincide.
FROM_ROUNDING    s below this number times the estimated effect of rounded coordinates may be due to them: the
                 estimate is 0.7 of the largest in standard networks of 100 vertices.
ITERATION_ERROR  s that inverse iteration leaves for an exact zero.
SQUARED_ROUNDING s below this is within the rounding of RᵀR, whose eigenvalues are s² with an error of 1e-15.
DENSE_EDGES      Up to this number of edges all s are computed by a dense decomposition.
LARGEST_DENSE    Largest number of entries of a dense array made in this layer: 160 MB.

Stresses

BALANCED         Unbalanced forces below this, relative to the mean tension, are those of a self-stress: configurations
                 from σ leave 1e-15, coordinates of eight digits 1e-8.
UNKNOWN_ERROR    Relative error assumed for bond vectors without error bounds.
DIRECTION_MARGIN, DIRECTION_ROUNDING
                 Two directions differ if they do by this number times their errors, plus the rounding of products.
LARGEST_FORM     Most zero modes whose stiffness under one stress is found by all eigenvalues: some seconds.

Second order, in units of the largest |q_I(z)|

POSITIVE         An eigenvalue above this is positive: below, the solutions of semidefinite programs are not accurate.
ZERO             An eigenvalue or form below this is zero to rounding.
RESISTED         A mode with more stiffness than this, under a stress that is nowhere negative, cannot escape.
PROGRAM_MODES    Zero modes in a first semidefinite program; larger ones start from a subspace of half this number.
FOURTH_ORDER_MODES
                 Zero modes in the relaxation of fourth order, whose size is their fourth power.
LINEAR_PROGRAM   Entries of the self-stresses up to which a linear program is tried, a limit of time.
"""

from __future__ import annotations

ZERO_MODE = 1e-6
CLEAR_GAP = 10.0
ROUNDING_MARGIN = 10.0
ITERATION_ERROR = 1e-12
SQUARED_ROUNDING = 1e-7
DENSE_EDGES = 400
LARGEST_DENSE = 20_000_000

BALANCED = 1e-8
UNKNOWN_ERROR = 1e-8
DIRECTION_MARGIN, DIRECTION_ROUNDING = 10.0, 1e-14
LARGEST_FORM = 2000

POSITIVE = 1e-7
ZERO = 1e-10
RESISTED = 1e-4
PROGRAM_MODES = 40
FOURTH_ORDER_MODES = 8
LINEAR_PROGRAM = 4_000_000
FROM_ROUNDING = 6.0
