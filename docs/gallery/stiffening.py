"""Softening and stiffening past the transition.

Lines are B_0 + C_B γ from the critical configuration alone; points are
computed along strain paths.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=100, seed=1)
stress = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
found = {
    "largest $B_0$": cf.optimize(network, "B_0").value,
    "equal lengths": cf.optimize(network, "V_L").value,
    "random stress": cf.CriticalManifold(network).configuration(stress),
}
strains = np.linspace(0.001, 0.02, 8)
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
for (name, critical), colour in zip(
    found.items(), ("#0072B2", "#D55E00", "#009E73"), strict=True
):
    growth = cf.stiffening(critical).value
    path = cf.strain_path(critical, strains).value
    ratio = path.bulk_modulus / growth.bulk_0
    axes.plot(100 * strains, ratio, "o", color=colour, label=name)
    line = [1, 1 + 0.02 * growth.C_B / growth.bulk_0]
    axes.plot([0, 2], line, color=colour, linewidth=0.8)
axes.plot([], [], color="0.4", linewidth=0.8, label="$1 + C_B γ/B_0$")
axes.set(xlabel="volumetric strain γ [%]", ylabel="$B/B_0$")
axes.legend(frameon=False)
figure.savefig("stiffening.png", dpi=80)
