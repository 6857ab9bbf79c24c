"""Principal curvatures of the critical manifold.

Towards its normal σ the manifold is convex: all curvatures have one sign.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
from critflow.critical.curvature import principal_curvatures

network = cf.voronoi_network(n_vertices=60, seed=1)
manifold = cf.CriticalManifold(network)
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.set_prop_cycle(color=["#0072B2", "#D55E00"])
for name in ("bulk_modulus", "length_variance"):
    sigma = cf.optimize(network, name).value.sigma
    found = principal_curvatures(manifold, sigma).value
    axes.semilogy(
        np.sort(np.abs(found.curvatures)),
        label=f"optimum of {name.replace('_', ' ')}",
    )
axes.set(
    xlabel="number of the curvature, by size",
    ylabel="principal curvature [1/area]",
)
axes.legend(frameon=False)
figure.savefig("curvature.png", dpi=80)
