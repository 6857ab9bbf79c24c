# %% [markdown]
# # From a critical configuration to its stiffening, by hand
#
# Past the transition the moduli grow linearly, B = B_0 + C_B γ and G = G_0 + C_G γ. The paper fits C_B and C_G to a
# strain path. They also follow from the critical configuration alone, by one linear solve for each strain. This
# notebook does both: it reads a stress from the file, computes the strain path, fits over shorter and shorter windows,
# and converges to the exact coefficient. Then it repeats the linear solve in plain NumPy.

# %%

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow import (
    CriticalManifold,
    Network,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.command.example_data import ensemble_path

ensemble = xr.open_dataset(ensemble_path())
one = ensemble.isel(seed=0).sel(population="random_stress")

# %% [markdown]
# ## Back to a network
#
# Edges, image offsets and cell define the network; the stress σ defines the configuration, by force balance, which is
# linear in the coordinates. The result must equal the stored `position`.

# %%
network = Network(one.edges.values, one.offsets.values, one.cell.values)
critical = CriticalManifold(network).configuration(one.sigma.values)
print(
    f"coordinates differ by {np.abs(critical.coordinates - one.position.values).max():.1e}"
)
print(f"unbalanced force over mean tension {critical.residual:.1e}")

# %% [markdown]
# ## The path, and fits over shrinking windows
#
# Rest lengths are the lengths at the transition, so γ = 0 is the transition itself. The derivative at zero of a
# straight line over a window w has an error of order w, that of a parabola of order w².

# %%
exact = stiffening(critical).value
windows = np.array([1e-2, 3e-3, 1e-3, 3e-4, 1e-4])
errors = np.empty((2, len(windows)))
for n, window in enumerate(windows):
    strains = window * np.linspace(0.1, 1.0, 10)
    path = strain_path(critical, strains).value
    for degree in (1, 2):
        slope = np.polyfit(strains, path.bulk_modulus, degree)[-2]
        errors[degree - 1, n] = abs(slope / exact.C_B - 1)
    line, parabola = errors[:, n]
    print(
        f"window {window:.0e}: relative error of C_B {line:.1e} (line), {parabola:.1e} (parabola)"
    )

fig, axes = plt.subplots(figsize=(5, 3.8), layout="constrained")
axes.loglog(windows, errors[0], "o-", color="#0072B2", label="straight line")
axes.loglog(windows, errors[1], "s-", color="#D55E00", label="parabola")
for power, at in (
    (1, errors[0, -1]),
    (2, errors[1, 2] * (windows[-1] / windows[2]) ** 2),
):
    axes.loglog(
        windows,
        at * (windows / windows[-1]) ** power,
        ":",
        color="0.5",
        linewidth=1,
    )
axes.set_xlabel("window of the fit $\\gamma_{max}$")
axes.set_ylabel("relative error of the fitted $C_B$")
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# The published window is γ ≤ 0.01. A straight line over it averages the derivative over a range in which B(γ) is
# curved, which is why the file contains both `C_B_fit` and `C_B`, the exact one.

# %%
for name in ("C_B", "C_G", "C_G_stress_corrected"):
    print(f"{name:22s} fitted {one[name + '_fit'].item():8.4f} ± "
          f"{one[name + '_fit_standard_error'].item():.4f}   exact {one[name].item():8.4f}")  # fmt: skip

# %% [markdown]
# ## The linear solve by hand
#
# A small network and dense matrices suffice. At the transition the springs carry no tension, and tension can appear
# only as the unit self-stress σ̂. Under a strain with affine change A L of the bond vectors,
#
# - the edges extend against the self-stress: h = |L|²/2 changes by ḣ = c K⁻¹σ̂ with K⁻¹ = |L|²/k and
#   c = σ̂·ḣ(affine)/σ̂·K⁻¹σ̂;
# - vertices move by u with R u = c K⁻¹σ̂ − ḣ(affine), R = g L. The zero modes of R remain undetermined;
# - the zero modes minimise the prestress energy uᵀP̂u, P̂ = gᵀ diag(σ̂) g, of the tension that appears.
#
# Together: one bordered system for u, the multipliers λ of the edges, and η, the multiplier of σ̂·λ = 0,
#
# $$\begin{pmatrix} \hat P\otimes 1 & R^T & 0\\ R & 0 & \hat\sigma\\ 0 & \hat\sigma^T & 0\end{pmatrix}
# \begin{pmatrix} u\\ \lambda\\ \eta\end{pmatrix} = \begin{pmatrix} 0\\ cK^{-1}\hat\sigma - \dot h\\ 0\end{pmatrix}.$$

# %%
small = voronoi_network(n_vertices=60, seed=3)
at = CriticalManifold(small).configuration(
    np.abs(np.random.default_rng(1).standard_normal(small.n_edges))
)
L, n_edges, n = at.bond_vectors, small.n_edges, small.n_vertices

g = np.zeros((n_edges, n))
g[np.arange(n_edges), small.edges[:, 0]] -= 1
g[np.arange(n_edges), small.edges[:, 1]] += 1
g = g[:, 1:]  # vertex 0 is fixed, to remove translations
sigma = at.sigma / np.linalg.norm(at.sigma)
flexibility = np.sum(L**2, axis=1) / small.stiffness  # K⁻¹
P = g.T @ (sigma[:, None] * g)
R = np.concatenate([g * L[:, [0]], g * L[:, [1]]], axis=1)

size = 2 * (n - 1)
M = np.zeros((size + n_edges + 1,) * 2)
M[:size, :size] = np.kron(np.eye(2), P)
M[size:-1, :size], M[:size, size:-1] = R, R.T
M[size:-1, -1] = M[-1, size:-1] = sigma
print(
    f"{len(M)} unknowns; the force balance σ̂ R vanishes to {np.abs(sigma @ R).max():.1e}"
)


# %%
def response(A):
    """c and the change of the bond vectors per unit of the affine strain A."""
    affine = L @ A.T
    hdot = np.sum(L * affine, axis=1)
    c = sigma @ hdot / (sigma**2 @ flexibility)
    right = np.concatenate(
        [np.zeros(size), c * flexibility * sigma - hdot, [0.0]]
    )
    u = np.linalg.solve(M, right)[:size].reshape(2, n - 1).T
    dL = affine + g @ u
    # Affine and non-affine change of h add up to the one that the self-stress resists.
    assert np.allclose(
        np.sum(L * dL, axis=1), c * flexibility * sigma, atol=1e-10
    )
    return c, dL


dilation, shear = np.eye(2) / 2, np.array([[0.0, 0.5], [0.5, 0.0]])
(c_g, dL_g), (c_e, dL_e) = response(dilation), response(shear)

# %% [markdown]
# Third derivatives of the energy require first-order responses only:
#
# $$E_{abc} = \sum \varphi'''\,\dot h_a\dot h_b\dot h_c
# + \sum_{cyc} c_a\sum\hat\sigma\,(\dot L_b\cdot\dot L_c + L\cdot\ddot b_{bc}),
# \qquad \varphi''' = -3k/|L|^4,$$
#
# where b̈ is the second derivative of the boundary vectors, mapped on L: −L/4 for two dilations, since b ∝ (1 + γ)^½,
# AL/2 for a dilation and a shear, zero for two shears.

# %%
length2 = np.sum(L**2, axis=1)


def third(a, b, c):
    """E_abc for strains given as (c, L̇, name)."""
    hdot = [strain[0] * flexibility * sigma for strain in (a, b, c)]
    value = np.sum(
        -3 * small.stiffness / length2**2 * hdot[0] * hdot[1] * hdot[2]
    )
    second = {
        ("γ", "γ"): -L / 4,
        ("γ", "ε"): L @ shear.T / 2,
        ("ε", "γ"): L @ shear.T / 2,
        ("ε", "ε"): 0 * L,
    }
    for one, two, three in ((a, b, c), (b, c, a), (c, a, b)):
        value += one[0] * np.sum(
            sigma
            * np.sum(two[1] * three[1] + L * second[two[2], three[2]], axis=1)
        )
    return value


G, E, V = (c_g, dL_g, "γ"), (c_e, dL_e, "ε"), small.volume
stiff = sigma**2 @ flexibility
by_hand = {
    "bulk_0": c_g**2 * stiff / V,
    "shear_0": c_e**2 * stiff / V,
    "C_B": (c_g**2 * stiff + third(G, G, G)) / V,
    "C_G": (third(G, E, E) - c_e**2 * stiff) / V,
}
library = stiffening(at).value
for name, value in by_hand.items():
    print(
        f"{name:8s} by hand {value:.12f}   library {getattr(library, name):.12f}"
    )
    assert abs(value - getattr(library, name)) < 1e-9 * max(1.0, abs(value))

# %% [markdown]
# ## Stiffening and softening
#
# The equations explain the signs. C_B has a negative part, since Hookean springs soften as functions of h
# (φ''' < 0), and a positive part, the tension that appears times the non-affine motion. The configuration σ = k of
# maximal B_0 has no non-affine motion, so only the first part remains, and C_B = −B_0/2 exactly.

# %%
best = ensemble.sel(population="max_B_0")
ratio = best.C_B / best.B_0
print(
    f"C_B/B_0 at the largest bulk modulus: {ratio.mean().item():.12f} ± {ratio.std().item():.1e}"
)
