"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, critical_of

import critflow_extras as ce
from critflow_extras.weak.soft_spectrum import soft_spectrum
from critflow_extras.weak.weak_energies import AngleSprings
from critflow_extras.weak.weak_equilibrium import weak_equilibrium


def weakened(problem):
    found = ce.weak_forces(critical_of(problem), AngleSprings())
    found.value.modulus([-1e-3, 0.0, 1e-3], 1e-4)  # NaN beyond the end of the branch
    return found


CALLS = {
    "weak_forces": lambda p, r: weakened(p),
    "weak_equilibrium": lambda p, r: weak_equilibrium(critical_of(p), AngleSprings(), [1e-3], 1e-4, throw=False),
    "soft_spectrum": lambda p, r: soft_spectrum(critical_of(p)),
}

test_answers_or_explains = answers_or_explains(CALLS)
