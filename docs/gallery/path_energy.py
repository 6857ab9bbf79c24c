"""Energy past the transition.

Along two deformations the energy grows as the square of the strain; the moduli
at the transition are the factors.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=100, seed=1)
critical = cf.optimize(network, "B_0").value
strains = np.geomspace(0.001, 0.1, 9)
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
for deformation, marker, colour in (
    ("dilation", "o", "#0072B2"),
    ("uniaxial", "x", "#D55E00"),
):
    path = cf.strain_path(critical, strains, deformation=deformation).value
    modulus = cf.elasticity(critical).value.modulus(deformation)
    axes.loglog(strains, path.energy, marker, color=colour, label=deformation)
    axes.loglog(
        strains,
        network.volume * modulus * strains**2 / 2,
        color="0.5",
        linewidth=0.8,
    )
axes.set(xlabel="strain γ", ylabel="energy E [k × area]")
axes.legend(frameon=False)
figure.savefig("path_energy.png", dpi=80)
