"""The largest shear modulus over all stresses.

It requires compressed edges, dashed here; the value is known in closed form.
"""

import matplotlib.pyplot as plt

import critflow as cf
from critflow.pictures import draw_network
from critflow.quantities import transition_modulus

network = cf.voronoi_network(n_vertices=100, seed=7)
stiffest = cf.optimize(network, "G_0", signs="any")
shear = transition_modulus(network, [[0.0, 0.5], [0.5, 0.0]])
bound = cf.upper_bound(network, shear)
figure, axes = plt.subplots(figsize=(4.8, 3.9), layout="constrained")
lines = draw_network(
    axes,
    network.edges,
    network.offsets,
    network.cell,
    stiffest.value.coordinates,
    stiffest.value.tensions,
)
axes.set_title(f"$G_0$ = {stiffest.objective:.4f} k, bound {bound:.4f} k")
figure.colorbar(lines, ax=axes, shrink=0.7, label="tension, up to a factor")
figure.savefig("compression.png", dpi=80)
