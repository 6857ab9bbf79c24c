"""A foam in three dimensions at its largest bulk modulus.

Four edges meet at each vertex; far edges fade.
"""

import critflow as cf
import critflow_extras as ce

foam = ce.foam_network(n_vertices=60, seed=1)
best = cf.optimize(foam, "B_0")
axes = ce.draw(
    best,
    title=f"{foam.n_vertices} vertices, $B_0$ = {best.objective:.4f} k/length",
)
axes.figure.set_size_inches(4.4, 3.9)
axes.figure.savefig("foam.png", dpi=80)
