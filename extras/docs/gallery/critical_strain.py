"""Critical strain against coordination.

Diluted triangular lattices: the fewer edges, the larger the shear that makes
the network rigid. Edges are 3 % too long; bars are standard errors of four
networks.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
import critflow_extras as ce

lattice = cf.lattice("triangular", 12, 12)
coordinations, n = np.linspace(3.3, 4.2, 7), 4
onsets = np.empty((n, len(coordinations)))
for seed in range(n):
    for at, z in enumerate(coordinations):
        network = ce.diluted(lattice, z=z, seed=seed)
        lengths = np.full(network.n_edges, 1.03)
        onset = ce.critical_strain(network, lengths, "simple_shear")
        onsets[seed, at] = onset.value.strain
error = onsets.std(axis=0, ddof=1) / np.sqrt(n)
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
axes.errorbar(coordinations, onsets.mean(axis=0), error, fmt="o-")
axes.set(xlabel="coordination z", ylabel="critical shear strain $γ_c$")
axes.set_ylim(0, None)
figure.savefig("critical_strain.png", dpi=80)
