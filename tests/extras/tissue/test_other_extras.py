"""What other extras say of a tissue."""

import numpy as np
from refusals import refused

from critflow import AngleSprings, critical_from_perimeters, design, lattice, weak_forces

TISSUE = critical_from_perimeters(lattice("honeycomb", 3, 3), np.ones(9))
BAD = {
    "design": (lambda: design(TISSUE.value.at_rest(), {"B_0": 1.0}, change="stiffness"), "springs on edges"),
    "weak forces": (lambda: weak_forces(TISSUE, AngleSprings()), "not springs on edges"),
}
test_bad_input_raises_one_sentence = refused(BAD)
