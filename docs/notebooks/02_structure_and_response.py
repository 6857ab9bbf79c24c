# %% [markdown]
# # Structure against response
#
# Does the structure of a critical network predict its stiffness? Structure: the variance of the lengths
# (V_L) and of the tensions (V_τ), the elongation of the faces and of the triangles of the force network. Response:
# B_0 and G_0 at the transition, and their derivatives C_B and C_G past it.
#
# There are two questions. *Between* populations: do populations with larger V_τ have smaller B_0?
# *Within* a population: does a member with larger V_τ than the others have smaller B_0? The answers can differ.

# %%

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.command.example_data import ensemble_path

ensemble = xr.open_dataset(ensemble_path())
names = [str(name) for name in ensemble.population.values]
SYMBOLS = dict(zip(names, ensemble.population_symbol.values, strict=True))
STRUCTURE = {
    "V_L": "$V_L$",
    "V_tau": "$V_\\tau$",
    "kappa_phys": "$\\langle\\kappa_{phys}\\rangle$",
    "kappa_force": "$\\langle\\kappa_{force}\\rangle$",
}
RESPONSE = {
    "B_0": "$B_0$",
    "C_B": "$C_B$",
    "G_0": "$G_0$",
    "C_G_stress_corrected": "$C_G$",
}
COLOURS = ensemble.population_color.values

# %% [markdown]
# ## The planes
#
# Each point is one network in one population.

# %%
fig, grid = plt.subplots(
    4, 4, figsize=(10, 9), sharex="col", sharey="row", layout="constrained"
)
for row, response in zip(grid, RESPONSE, strict=True):
    for axes, structure in zip(row, STRUCTURE, strict=True):
        for colour, name in zip(COLOURS, names, strict=False):
            member = ensemble.sel(population=name)
            axes.plot(
                member[structure],
                member[response],
                "o",
                color=colour,
                markersize=2.5,
                alpha=0.7,
                label=SYMBOLS[name],
            )
        if structure.startswith("V_"):
            # Some variances are zero to rounding: they are at the left border.
            axes.set_xscale("symlog", linthresh=1e-3)
        if response == "G_0":
            axes.set_yscale("log")
        axes.tick_params(labelsize=7)
for axes, label in zip(grid[-1], STRUCTURE.values(), strict=True):
    axes.set_xlabel(label)
for axes, label in zip(grid[:, 0], RESPONSE.values(), strict=True):
    axes.set_ylabel(f"{label}  [$k$]")
handles, labels = grid[0, 0].get_legend_handles_labels()
fig.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8,
           frameon=False, markerscale=2)  # fmt: skip
plt.show()

# %% [markdown]
# ## Rank correlations
#
# Ranks depend on order only, so they suit quantities that span decades. Between populations: ranks of the medians.
# Within: ranks among the members, averaged over the populations. A metric that does not vary in a population (V_L
# where it is zero) is excluded there.


# %%
def ranks(values):
    return np.argsort(np.argsort(values)).astype(float)


def rank_correlation(x, y):
    """Spearman's coefficient over pairs of finite values; NaN where one of the two does not vary."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 3 or min(np.ptp(x), np.ptp(y)) < 1e-12:
        return np.nan
    return float(np.corrcoef(ranks(x), ranks(y))[0, 1])


def known_mean(values):
    known = [value for value in values if np.isfinite(value)]
    return np.mean(known) if known else np.nan


medians = ensemble[[*STRUCTURE, *RESPONSE]].median("seed")
between = np.array(
    [
        [
            rank_correlation(medians[s].values, medians[r].values)
            for s in STRUCTURE
        ]
        for r in RESPONSE
    ]
)
in_each = [
    [[rank_correlation(ensemble[s].sel(population=p).values, ensemble[r].sel(population=p).values) for p in names]
     for s in STRUCTURE]
    for r in RESPONSE
]  # fmt: skip
within = np.array([[known_mean(values) for values in row] for row in in_each])

fig, pair = plt.subplots(1, 2, figsize=(8.5, 3.8), layout="constrained")
for axes, values, title in zip(
    pair,
    (between, within),
    ("between populations", "within populations"),
    strict=True,
):
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_xticks(range(4), STRUCTURE.values())
    axes.set_yticks(range(4), RESPONSE.values())
    axes.set_title(title, fontsize=10)
    for (i, j), value in np.ndenumerate(values):
        axes.text(
            j,
            i,
            f"{value:.2f}",
            ha="center",
            va="center",
            fontsize=9,
            color="w" if abs(value) > 0.6 else "k",
        )
fig.colorbar(image, ax=pair, label="rank correlation", shrink=0.85)
plt.show()

# %% [markdown]
# ## Interpretation
#
# - V_τ and B_0: the more unequal the tensions, the softer, between populations and within. The reason: at unit
#   pressure, Σ τ|L| = 2V, the modulus at the transition is B_0 = V/Σ τ² for k = 1. The stiffest network carries the
#   pressure with the smallest Σ τ², which unequal tensions increase.
# - A metric that orders the populations may not order the members of one: the optimum fixes it, and only the
#   network varies.
# - With few seeds the right table is noise: the error of a rank correlation of n values is about 1/√n. The next cell
#   prints it.

# %%
n = ensemble.sizes["seed"]
print(
    f"{n} networks: a correlation within one population is known to ± {1 / np.sqrt(max(n - 1, 1)):.2f}"
)
for (i, j), value in np.ndenumerate(between):
    response, structure = list(RESPONSE)[i], list(STRUCTURE)[j]
    print(
        f"{response:28s} {structure:20s} between {value:5.2f}  within {within[i, j]:5.2f}"
    )

# %% [markdown]
# ## Lengths and tensions together
#
# B_0 = (1/4V)(Σ τ|L|)²/Σ τ² at k = 1, with ⟨τ²⟩ = ⟨τ⟩²(1 + V_τ). If tensions and lengths were not correlated, this
# would be B_0 = N_b⟨|L|⟩²/4V/(1 + V_τ). The next figure compares the two: points above the line have long edges
# with more tension, as at σ = k.

# %%
volume = np.abs(np.linalg.det(ensemble.cell.values))
mean_length = ensemble.length.mean("edge")
guess = (
    ensemble.sizes["edge"]
    * mean_length**2
    / (4 * xr.DataArray(volume, dims="seed"))
    / (1 + ensemble.V_tau)
)
fig, axes = plt.subplots(figsize=(4.8, 4.2), layout="constrained")
for colour, name in zip(COLOURS, names, strict=False):
    B_0 = ensemble.B_0.sel(population=name)
    axes.plot(
        guess.sel(population=name),
        B_0,
        "o",
        color=colour,
        markersize=3.5,
        label=SYMBOLS[name],
    )
ends = [float(np.nanmin(guess)), float(np.nanmax(guess))]
axes.plot(ends, ends, color="0.5", linewidth=0.8, zorder=0)
axes.set_xlabel("$N_b\\langle|L|\\rangle^2/4V\\,/\\,(1 + V_\\tau)$  [$k$]")
axes.set_ylabel("$B_0$  [$k$]")
axes.legend(fontsize=7, frameon=False)
plt.show()
