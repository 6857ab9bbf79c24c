"""Cuts of edges in other units: the same values, and the same cuts that leave nothing."""

from functools import partial

import numpy as np
from problems import NETWORKS, hung_ring, random_stress
from units import INVERSE, SCALED, Units, same_in_units

from critflow import CriticalManifold, three_bar_linkage
from critflow_extras import edge_leverage


def cut(network, units, name):
    found = edge_leverage(CriticalManifold(network).configuration(random_stress(network.n_edges, 1)), name)
    numbers = found.status, found.value.bypass, np.isfinite(found.value.errors)
    after = found.value.after
    return {"number": numbers, "stiffness": (after,)} if name == "B_0" else {"number": (*numbers, after)}


FAR = [SCALED, INVERSE, Units(length=2.0**-40), Units(length=2.0**40)]
test_leverage_in_other_units = same_in_units(
    {
        f"{name} of {kind}": (partial(cut, name=name), make)
        for name in ("B_0", "V_L", "V_tau")
        for kind, make in (
            ("voronoi", NETWORKS["voronoi"]),
            ("ring", hung_ring),
            ("chain", lambda: three_bar_linkage().with_volume(1.0)),
        )
        if not (kind == "chain" and name == "B_0")
    },
    1e-9,
    FAR,
)
