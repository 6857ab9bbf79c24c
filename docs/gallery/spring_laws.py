"""One configuration with three spring laws.

All laws share B_0; they differ in how the modulus grows.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=60, seed=2)
critical = cf.optimize(network, "B_0").value
strains = np.linspace(0.005, 0.1, 8)
laws = {
    "Hookean": cf.Hookean(),
    "power law, exponent 4": cf.PowerLaw(4),
    "worm-like chain": cf.WormLike(0.2),
}
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.set_prop_cycle(color=["#0072B2", "#D55E00", "#009E73"])
for name, law in laws.items():
    path = cf.strain_path(critical, strains, law=law).value
    axes.plot(100 * strains, path.bulk_modulus, "o-", markersize=4, label=name)
axes.set(xlabel="volumetric strain γ [%]", ylabel="bulk modulus B [k]")
axes.legend(frameon=False)
figure.savefig("spring_laws.png", dpi=80)
