# %% [markdown]
# # Designing with isogonal modes
#
# The largest bulk modulus of a network is not one configuration but a family of them. Its members share the
# directions of all edges and their tensions, while the lengths change by *isogonal modes*: N_v/2 − 1 of them,
# one for each face but one. The lengths can therefore be designed at constant B_0. This
# notebook starts at the largest B_0 of a stored network, maximises the size of one face, makes the lengths as
# equal as possible, and shows which properties change.

# %%

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow import (
    CriticalManifold,
    Network,
    elasticity,
    stiffening,
    strain_path,
    upper_bound,
)
from critflow.command.example_data import ensemble_path
from critflow.critical.isogonal import affine_bulk_modulus, face_modes
from critflow.figures.plot import (
    draw_network,
    face_polygons,
    shade_faces,
    unit_pressure_tensions,
)
from critflow.networks.faces import planar_faces

ensemble = xr.open_dataset(ensemble_path())
one = ensemble.isel(seed=0).sel(population="max_B_0")
bare = Network(one.edges.values, one.offsets.values, one.cell.values)
faces = planar_faces(
    bare.edges, bare.bond_vectors(one.position.values), bare.n_vertices
)
network = Network(bare.edges, bare.offsets, bare.cell, faces=faces)
start = CriticalManifold(network).configuration(one.sigma.values)


def relative_variance(values):
    """V_L of lengths, V_τ of tensions."""
    return np.var(values) / np.mean(values) ** 2


bound = upper_bound(network, "B_0")
print(
    f"B_0 = {elasticity(start).value.bulk:.12f} k, upper bound over all stresses {bound:.12f} k"
)

# %% [markdown]
# ## One mode for each face
#
# Mode f moves the sides of face f outwards, each in proportion to 1/τ, and its corners in the direction of the
# third edge at each corner. Equal amplitudes on all faces change nothing, since the two shifts of every side cancel.
# Lengths are *linear* in the amplitudes at any distance, and the family ends where the first edge has zero length.

# %%
modes = face_modes(start)
print(f"{modes.elongations.shape[0]} modes, {modes.n_independent} independent, "
      f"{modes.elongations.nnz / modes.elongations.shape[0]:.1f} edges each")  # fmt: skip
print(
    f"equal amplitudes: largest change of a length {np.abs(modes.elongations.sum(axis=0)).max():.1e}"
)
direction = np.random.default_rng(0).standard_normal(faces.n_faces)
walked = modes.towards(direction, fraction=0.9)
print(f"random amplitudes, 90 % of the limit: B_0 changes by {elasticity(walked).value.bulk / bound - 1:.1e}, "
      f"V_τ by {relative_variance(walked.tensions) - relative_variance(start.tensions):.1e}, "
      f"V_L from {relative_variance(start.lengths):.4f} to {relative_variance(walked.lengths):.4f}")  # fmt: skip

# %% [markdown]
# ## A large face
#
# The perimeter of a face is linear in the amplitudes, and so is the condition that every edge keeps a least length.
# That is a linear program: its solution is the global optimum of the family.

# %%
chosen = int(faces.sizes.argmax())
sides = faces.edges[faces.starts[chosen] : faces.starts[chosen + 1]]
weights = np.bincount(sides, minlength=network.n_edges)
large = modes.largest(weights, shortest=0.15).value

# %% [markdown]
# ## Equal lengths
#
# V_L = ⟨|L|²⟩/⟨|L|⟩² − 1 is minimal where the vector of lengths is closest in direction to (1, 1, …, 1). Lengths of
# the family are |L| + Σ a_f e_f, so the best is the projection of that vector on the span of |L| and the e_f:
# least squares.

# %%
span = np.vstack([start.lengths, modes.elongations.toarray()])
coefficients = np.linalg.lstsq(span.T, np.ones(network.n_edges), rcond=None)[0]
even = modes.walk(coefficients[1:] / coefficients[0])
V_L, smaller = relative_variance(start.lengths), relative_variance(even.lengths)
gain = 1 - smaller / V_L
print(f"V_L falls from {V_L:.6f} to {smaller:.6f}, by {100 * gain:.1f} %")
print(
    f"while B_0 changes by {elasticity(even).value.bulk / elasticity(start).value.bulk - 1:.1e}"
)
# The condition of a minimum: no mode changes V_L to first order.
gradient = modes.elongations @ (
    even.lengths * even.lengths.mean() - np.mean(even.lengths**2)
)
print(f"gradient of V_L in the modes {np.abs(gradient).max():.1e}")

# %%
fig, row = plt.subplots(1, 3, figsize=(10.5, 3.9), layout="constrained")
designs = {
    "σ = k": start,
    "most equal lengths": even,
    "one face of maximal size": large,
}
for axes, (title, critical) in zip(row, designs.items(), strict=True):
    tensions = unit_pressure_tensions(
        critical.sigma, critical.lengths, network.volume
    )
    polygon = face_polygons(
        faces, network.edges, critical.coordinates, critical.bond_vectors
    )[chosen]
    centred = network.cell.sum(axis=0) / 2 - polygon.mean(axis=0)
    lines = draw_network(
        axes,
        network.edges,
        network.offsets,
        network.cell,
        critical.coordinates + centred,
        tensions,
        limits=(0, 2),
    )
    shade_faces(axes, [polygon + centred], network.cell)
    numbers = f"$B_0$ = {elasticity(critical).value.bulk:.6f} $k$, $V_L$ = {relative_variance(critical.lengths):.3f}"
    axes.set_title(f"{title}\n{numbers}", fontsize=9)
fig.colorbar(lines, ax=row, shrink=0.8, label="edge tension at unit pressure")
plt.show()

# %% [markdown]
# ## Why B_0 is constant, and which properties change
#
# Forces T in balance do the same work Σ T·A L on all bond vectors L that close on the same cell. Every modulus at
# the transition, (Σ T·A L)²/(V Σ |T|²/k), therefore depends on the force network alone: isogonal modes keep B_0 and
# G_0 of *any* critical configuration. At the largest B_0 the forces are T = k L*, with L* the configuration at σ = k.
# The bond vectors L + s L* are then in balance at every expansion s, so the bulk response of all members is
# the same at *any* strain, B(γ) = B_0/√(1 + γ), and C_B = −B_0/2.
#
# The non-affine motion changes, and everything that depends on lengths. If the vertices followed the dilation
# affinely the modulus would be B_aff = Σ k|L|²/4V; relaxation reduces it by B_aff − B_0 ≥ 0, which is zero at σ = k
# only. Under shear the members differ as soon as they are past the transition.

# %%
fractions = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9])
family = [modes.towards(direction, fraction) for fraction in fractions]
growth = [stiffening(member).value for member in family]
B_0, G_0, C_B, C_G = (
    np.array([getattr(g, name) for g in growth])
    for name in ("bulk_0", "shear_0", "C_B", "C_G")
)
affine = np.array([affine_bulk_modulus(member) for member in family])
for row in zip(fractions, B_0, affine, G_0, C_B, C_G, strict=True):
    print(
        "{:4.2f}: B_0 = {:.12f}, B_aff = {:.4f}, G_0 = {:.6e}, C_B = {:.6f}, C_G = {:.6f}  [k]".format(
            *row
        )
    )
assert np.abs(B_0 / bound - 1).max() < 1e-12
assert np.abs(C_B / B_0 + 0.5).max() < 1e-9

strains = np.array([0.01, 0.1, 0.5])
path = strain_path(family[-1], strains).value
miss = np.abs(path.bulk_modulus / (bound / np.sqrt(1 + strains)) - 1).max()
print(
    f"B(γ) of the last member differs from B_0/√(1 + γ) by {miss:.1e}, up to γ = {strains[-1]}"
)

fig, (left, right) = plt.subplots(
    1, 2, figsize=(8.5, 3.4), layout="constrained"
)
left.plot(
    fractions, affine, "o-", color="#D55E00", label="affine part $B_{aff}$"
)
left.plot(fractions, B_0, "s-", color="#0072B2", label="$B_0$")
left.fill_between(
    fractions, B_0, affine, color="#D55E00", alpha=0.15, linewidth=0
)
left.set_ylabel("modulus at the transition  [$k$]")
left.legend(frameon=False)
right.plot(fractions, C_B / C_B[0] - 1, "s-", color="#0072B2", label="$C_B$")
right.plot(fractions, C_G / C_G[0] - 1, "o-", color="#009E73", label="$C_G$")
right.set_ylabel("relative change")
right.legend(frameon=False)
for axes in (left, right):
    axes.set_xlabel("fraction of the limit, the first edge of zero length")
plt.show()

# %% [markdown]
# The family changes lengths at a bulk modulus that equals its bound to all digits.
