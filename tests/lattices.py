"""Regular lattices with their counts and moduli."""

import numpy as np

SQRT3 = np.sqrt(3.0)

# Sizes, edges a vertex, vertices and volume a unit cell, B and G of springs of length and stiffness 1 at rest.
# B and G: isotropic lattices by Cauchy's Lamé constants (triangular: λ = μ = √3/4; kagome: half of it), the others by
# their self-stresses: straight lines resist B with k/2 (square) and k/3 (cubic) and no shear.
PLANE, SOLID = [(1, 2), (2, 1), (2, 2), (3, 2), (4, 6)], [(1, 1, 2), (2, 2, 2), (2, 3, 4)]
LATTICES = {
    "honeycomb": ([(1, 1), *PLANE], 3, 2, 1.5 * SQRT3, SQRT3 / 6, 0.0),
    "square": (PLANE, 4, 1, 1.0, 1 / 2, 0.0),
    "triangular": (PLANE, 6, 1, SQRT3 / 2, SQRT3 / 2, SQRT3 / 4),
    "kagome": ([(1, 1), *PLANE], 4, 3, 2 * SQRT3, SQRT3 / 4, SQRT3 / 8),
    "diamond": ([(1, 1, 1), *SOLID], 4, 2, 16 / (3 * SQRT3), SQRT3 / 12, 0.0),
    "cubic": (SOLID, 6, 1, 1.0, 1 / 3, 0.0),
}
CASES = [(name, size) for name, row in LATTICES.items() for size in row[0]]
