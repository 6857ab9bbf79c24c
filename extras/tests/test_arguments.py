"""Arguments of the wrong kind raise one sentence, in every public function and for every parameter."""

from __future__ import annotations

import inspect
import tempfile
from pathlib import Path

import numpy as np
from argument_checks import (
    CRITICAL,
    HEXAGONS,
    NETWORK,
    called_by_the_scene,
    shows_its_name_and_sets_the_threads,
    wrong_arguments_raise,
)

import critflow_extras as ce
from critflow import lattice

PUBLIC = {
    name: function
    for name in sorted(ce.__all__)
    if inspect.isfunction(function := getattr(ce, name)) and name not in called_by_the_scene()
}
# Right arguments by the name of the parameter.
RIGHT = {
    "kappa": 0.001,
    "targets": np.full(4, 5.0),
    "perimeters": np.full(4, 5.0),
    "moduli": [1.0, 2.0],
    "z": 2.9,
    "directions": np.eye(2)[None],
    "first": np.eye(2),
    "second": np.diag([1.0, -1.0]),
    "edge": 0,
    "tail": 0,
    "head": 1,
    "s": np.zeros(5),
    "thing": CRITICAL,
    "path": Path(tempfile.mkdtemp()) / "page.md",
    "response": ce.local_response(CRITICAL, (0, 2, (1, 1)), (1, 3, (0, 0))).value,
    "energy": ce.AngleSprings(2.0),
    "examination": ce.examine(NETWORK, CRITICAL.coordinates, deformations=()),
}
OF_FUNCTION = {
    "tissue": {"network": HEXAGONS, "coordinates": HEXAGONS.positions},
    "critical_from_perimeters": {"network": HEXAGONS},
    "design": {"targets": {"B_0": 0.1}, "initial": np.ones(6), "signs": "positive"},
    "isotropic_targets": {"youngs_modulus": 1.0, "poissons_ratio": 0.2},
    "prune_towards": {"targets": {"B_0": 0.1}},
    "loaded": {"forces": np.zeros((4, 2))},
    "local_response": {"springs": CRITICAL, "source": (0, 2, (0, 0)), "targets": [(1, 3, (0, 0))]},
    "face_diagonals": {"network": HEXAGONS},
    "response_name": {"source": (0, 2, (0, 0)), "target": (1, 3, (0, 0))},
    "properties": {"quantities": ["B_0"]},
    "pareto": {"objectives": {"B_0": "largest", "V_L": "smallest"}, "start": np.ones(6), "n": 2},
    "fibre_network": {"kind": "mikado", "z": 3.6},
    "diluted": {"network": lattice("honeycomb", 4, 4)},
    "packing_network": {"n_vertices": 24, "z": 4.2},
}
# Functions that compute next to nothing, or wait for the disk.
QUICK = {
    *("draw_response", "face_diagonals", "isotropic_targets", "network_from", "response_name", "strain_plane"),
    *("tissue", "write_network"),
}
# Random points take long for some seeds.
SLOW = {("foam_network", "seed", "zero")}

test_wrong_arguments_of_every_public_function_raise_one_sentence = wrong_arguments_raise(
    PUBLIC, OF_FUNCTION, RIGHT, SLOW
)
test_a_function_that_may_take_long_shows_its_name_and_sets_the_threads = shows_its_name_and_sets_the_threads(
    PUBLIC, QUICK
)
