"""One face as large as possible, at the largest B_0.

A linear program over the isogonal modes; no edge is shorter than 0.15.
"""

import critflow_extras as ce
import numpy as np

import critflow as cf
from critflow.isogonal import face_modes

network = cf.voronoi_network(n_vertices=100, seed=6)
modes = face_modes(cf.optimize(network, "B_0").value)
faces = network.faces
chosen = int(faces.sizes.argmax())
sides = faces.edges[faces.starts[chosen] : faces.starts[chosen + 1]]
large = modes.largest(
    np.bincount(sides, minlength=network.n_edges), shortest=0.15
).value
axes = ce.draw(
    large,
    title=f"perimeter {large.lengths[sides].sum():.2f}, "
    f"$B_0$ = {cf.elasticity(large).value.bulk:.4f} k",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("large_face.png", dpi=80)
