"""Critical strain against coordination.

Diluted triangular lattices: the fewer edges, the larger the shear that makes
the network rigid.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

lattice = cf.lattice("triangular", 8, 8)
coordinations = np.linspace(2.9, 3.8, 6)
onsets = []
for z in coordinations:
    network = cf.diluted(lattice, z=z, seed=2)
    onset = cf.critical_strain(
        network, np.ones(network.n_edges), "simple_shear", throw=False
    )
    onsets.append(onset.strain)
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.plot(coordinations, onsets, "o-")
axes.set(xlabel="coordination z", ylabel="critical shear strain $γ_c$")
figure.savefig("critical_strain.png", dpi=80)
