"""The change of B_0 by cutting each edge.

All edges at once, exactly, from one factorisation.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce

network = cf.voronoi_network(n_vertices=150, seed=5)
critical = cf.optimize(network, "V_L").value
leverage = ce.edge_leverage(critical, "B_0")
axes = ce.draw(
    critical, color=np.abs(leverage.value.change), cmap="viridis", width=2.5
)
axes.set_title(
    f"$B_0$ = {leverage.value.before:.4f} k, "
    f"least after a cut {np.nanmin(leverage.value.after):.4f} k",
    fontsize=10,
)
axes.figure.colorbar(
    axes.collections[0],
    ax=axes,
    shrink=0.7,
    label="fall of $B_0$ by its cut [k]",
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("leverage.png", dpi=80)
