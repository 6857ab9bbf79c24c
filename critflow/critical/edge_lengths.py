"""Edges without length: every limit below which a length counts as zero, in units of the mean length but where stated.

    1e-2   SOUND          shortest edge of a configuration that is returned in place of an infimum
    1e-4   COLLAPSING     an edge that tends to zero length on a descent
    1e-8   COLLAPSED      an edge without direction
    1e-10  NO_LENGTH      an edge that vanishes by a formula
    1e-150 NO_DIRECTION   a length that no longer divides a tension, in units of the cone program

A descent that makes edges shorter and shorter passes these limits in turn (`critflow.optimisation.descent_end`).
"""

# Shorter edges lose digits in the rounding of the coordinates.  σ > SOUND² and |L| > SOUND are far from all other
# limits of a descent, and an edge below SOUND² is too short to resolve where a descent stalls.
SOUND = 1e-2

# An edge under tension that becomes this short on a descent, while the value decreases, tends to zero: edges of optima
# that are attained are longer.
COLLAPSING = 1e-4

# Rounding of coordinates, 1e-16, leaves half of the digits of a direction here or fewer, and of what follows from it.
COLLAPSED = 1e-8

# In exact arithmetic such an edge has no length: solutions of linear systems leave this much.
NO_LENGTH = 1e-10

# Tension over length would overflow.
NO_DIRECTION = 1e-150
