"""Distributions of the tension.

The stiffest configuration has a narrow distribution; a random stress has a
broad one.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=1000, seed=1)
stress = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.set_prop_cycle(color=["#0072B2", "#D55E00"])
for name, critical in {
    "largest $B_0$": cf.optimize(network, "B_0").value,
    "random stress": cf.CriticalManifold(network).configuration(stress),
}.items():
    tensions = critical.tensions / critical.tensions.mean()
    axes.hist(
        tensions,
        bins=np.linspace(0, 4, 50),
        density=True,
        alpha=0.6,
        label=name,
    )
axes.set(xlabel="tension over its mean", ylabel="probability density")
axes.legend(frameon=False)
figure.savefig("tensions.png", dpi=80)
