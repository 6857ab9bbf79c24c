"""Crossing rods: a Mikado network at its critical configuration.

Segments of a rod of length ℓ have the stiffness 1/ℓ. Lengths of the picture
are kept as rest lengths.
"""

import critflow_extras as ce

network = ce.fibre_network("mikado", 150, z=3.6, seed=1)
lengths = [
    sum(bond**2) ** 0.5 for bond in network.bond_vectors(network.positions)
]
onset = ce.critical_strain(network, lengths, "simple_shear", throw=False)
axes = ce.draw(
    onset.value.configuration,
    title=f"taut in shear at γ = {onset.value.strain:.3f}",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("fibres.png", dpi=80)
