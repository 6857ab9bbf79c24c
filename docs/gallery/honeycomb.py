"""Moduli of the honeycomb past the transition.

Points are computed along a strain path; the line is B_0 (1 + γ)^(−1/2), the
exact answer.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.lattice("honeycomb", 4, 4)
critical = cf.CriticalManifold(network).configuration(np.ones(network.n_edges))
strains = np.linspace(0.05, 1.0, 12)
path = cf.strain_path(critical, strains).value
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.plot(
    strains,
    np.sqrt(3) / 6 / np.sqrt(1 + strains),
    color="0.5",
    label="B, exact",
)
axes.plot(strains, path.bulk_modulus, "o", color="#0072B2", label="B")
axes.plot(
    strains,
    path.shear_modulus,
    "s",
    color="#D55E00",
    label="G, energy convention",
)
axes.plot(
    strains,
    path.shear_modulus_stress_corrected,
    "^",
    color="#009E73",
    label="G, stress-corrected",
)
axes.set(xlabel="volumetric strain γ", ylabel="modulus [k]")
axes.legend(frameon=False)
figure.savefig("honeycomb.png", dpi=80)
