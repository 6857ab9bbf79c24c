"""The largest shear modulus over all stresses.

It requires compressed edges, dashed here; the value is known in closed form.
"""

import critflow_extras as ce

import critflow as cf
from critflow.quantities import transition_modulus

network = cf.voronoi_network(n_vertices=100, seed=7)
stiffest = cf.optimize(network, "G_0", signs="any")
bound = cf.upper_bound(
    network, transition_modulus(network, [[0.0, 0.5], [0.5, 0.0]])
)
axes = ce.draw(
    stiffest, title=f"$G_0$ = {stiffest.objective:.4f} k, bound {bound:.4f} k"
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("compression.png", dpi=80)
