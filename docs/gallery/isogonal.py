"""Configurations of equal B_0: an isogonal mode.

Directions and tensions of all edges are the same in each panel; the lengths are
not.
"""

import critflow_extras as ce
import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
from critflow.isogonal import face_modes

network = cf.voronoi_network(n_vertices=60, seed=3)
modes = face_modes(cf.optimize(network, "B_0").value)
direction = np.random.default_rng(0).standard_normal(network.faces.n_faces)
figure, row = plt.subplots(1, 2, figsize=(5.6, 3), layout="constrained")
for axes, fraction in zip(row, (0.0, 0.9), strict=True):
    critical = modes.towards(direction, fraction)
    ce.draw(
        critical,
        axes,
        title=f"$B_0$ = {cf.elasticity(critical).value.bulk:.10f} k",
    )
figure.savefig("isogonal.png", dpi=90)
