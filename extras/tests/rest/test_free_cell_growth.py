"""Free components of the cell relax the only self-stress of a critical configuration, so that it has no growth."""

from dataclasses import astuple

import numpy as np
import pytest
from problems import NETWORKS, critical_of
from units import same_in_units

from critflow import CriticalManifold, Deformation, InputError, Status, lattice, stiffening


def honeycomb():
    """Its stress is isotropic: a free side relaxes it, and a free shear does not."""
    network = lattice("honeycomb", 3, 3)
    return CriticalManifold(network).configuration(np.ones(network.n_edges))


@pytest.mark.parametrize("deformation", ["uniaxial_free", Deformation.uniaxial(2).freeing("xy", "yy")], ids=str)
def test_paths_along_which_the_network_stays_floppy_have_a_status(deformation):
    solution = stiffening(honeycomb(), throw=False, deformation=deformation)
    assert solution.status is Status.floppy
    assert "free component yy" in solution.note
    assert np.isnan(astuple(solution.value)).all()


def test_free_components_that_keep_the_stress_are_refused():
    with pytest.raises(InputError, match="fix the cell"):
        stiffening(honeycomb(), deformation=Deformation.dilation(2).freeing("xy"))


def outcome(network, units):
    solution = stiffening(critical_of(network), throw=False, deformation="uniaxial_free")
    return {"number": (solution.status, solution.note), "stiffness": (astuple(solution.value),)}


test_the_outcome_in_other_units = same_in_units({"side": (outcome, NETWORKS["voronoi, random stiffness"])})
