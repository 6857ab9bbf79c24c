"""Young's modulus by direction.

Triangular lattices at rest with horizontal springs of other stiffness; the
isotropic one is a circle of radius 2/√3.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

lattice = cf.lattice("triangular", 4, 4)
horizontal = np.abs(lattice.bond_vectors(lattice.positions)[:, 1]) < 1e-9
angles = np.linspace(0, 2 * np.pi, 181)
figure, axes = plt.subplots(
    figsize=(4.4, 4.2), layout="constrained", subplot_kw={"projection": "polar"}
)
axes.set_prop_cycle(color=["#0072B2", "#D55E00", "#009E73"])
for stiffness in (0.2, 1.0, 3.0):
    network = lattice.with_stiffness(np.where(horizontal, stiffness, 1.0))
    tensor = cf.elasticity(network, lattice.positions).value
    axes.plot(
        angles, [tensor.young(a) for a in angles], label=f"k = {stiffness}"
    )
axes.set_title("Young's modulus [k]", fontsize=10)
figure.legend(loc="outside lower center", ncols=3, fontsize=8)
figure.savefig("directions.png", dpi=70)
