"""No stress exceeds the bound.

B_0 of random stresses of increasing spread, and the closed-form maximum.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=60, seed=1)
manifold = cf.CriticalManifold(network)
rng = np.random.default_rng(0)
spreads = np.repeat(np.linspace(0.05, 1.5, 30), 5)
stresses = [
    np.exp(spread * rng.standard_normal(network.n_edges)) for spread in spreads
]
moduli = [
    cf.elasticity(manifold.configuration(stress)).value.bulk
    for stress in stresses
]
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.plot(spreads, moduli, ".", label="random stress")
axes.axhline(cf.upper_bound(network, "B_0"), color="#D55E00", label="bound")
axes.set(
    xlabel="standard deviation of log σ", ylabel="$B_0$ [k]", ylim=(0, None)
)
axes.legend(frameon=False)
figure.savefig("bound.png", dpi=80)
