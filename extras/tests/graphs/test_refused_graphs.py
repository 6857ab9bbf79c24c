"""Bad input of generators raises one sentence that names the fault and the next step."""

import numpy as np
from refusals import refused

from critflow import lattice
from critflow_extras import diluted, fibre_network, packing_network, regular_network

CASES = {
    "diluted above": (lambda: diluted(lattice("honeycomb"), 3.5), "z must"),
    "diluted to nothing": (lambda: diluted(lattice("honeycomb"), 2.01), "reach"),
    "fibres beyond any memory": (lambda: fibre_network("mikado", 10**9), "at most 20,000,000"),
    "phantom above": (lambda: fibre_network("phantom", 5, 5, z=4.2), "z must"),
    "phantom of no cells": (lambda: fibre_network("phantom", 0, 5), "at least"),
    "mikado above": (lambda: fibre_network("mikado", 100, z=4.0), "between"),
    "mikado of few": (lambda: fibre_network("mikado", 1), "at least"),
    "no such fibres": (lambda: fibre_network("gel"), "phantom"),
    "fibres of three numbers": (lambda: fibre_network("phantom", 3, 3, 3), "2 whole"),
    "packing beyond any memory": (lambda: packing_network(10**9), "at most 20,000,000"),
    "packing not jammed": (lambda: packing_network(50, density=0.8), "density"),
    "packing density NaN": (lambda: packing_network(50, density=np.nan), "density"),
    "packing of few": (lambda: packing_network(5), "at least"),
    "packing on a line": (lambda: packing_network(50, dimension=1), "dimension"),
    "regular below three": (lambda: regular_network(50, 2.5), "z must"),
    "regular of few": (lambda: regular_network(5), "at least"),
    "regular on a line": (lambda: regular_network(50, dimension=1), "dimension"),
}

test_bad_input_raises_one_sentence = refused(CASES)
