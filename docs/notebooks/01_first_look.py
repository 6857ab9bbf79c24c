# %% [markdown]
# # A first look at an ensemble
#
# `critflow run ensemble` writes one file, `results/ensemble/ensemble.nc`. This notebook reads it with xarray alone:
# its contents, selection by label, the meaning of a status, and the distributions. Nothing is recomputed.

# %%
import json

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.command.example_data import ensemble_path

ensemble = xr.open_dataset(ensemble_path())
print(ensemble)

# %% [markdown]
# ## Dimensions
#
# - `seed`: the network. The same seed is the same network in every population and in every run.
# - `population`: the choice of critical configuration: minimal variance of lengths or tensions, maximal
#   bulk or shear modulus, random rest lengths (in two states), random stress. `population_label`,
#   `population_symbol` and `population_color` are coordinates along it, for tables and figures.
# - `edge`, `vertex`: within a network. `end` is tail or head, `axis` is x or y.
# - `strain`: steps past the transition, V(γ) = V(0)(1 + γ).
#
# `edges`, `offsets` and `cell` have no `population`: the network is the same, only its configuration differs. Every
# variable has a `long_name`; units are the stiffness k and the mean area of a vertex.

# %%
for name, variable in ensemble.data_vars.items():
    print(
        f"{name:34s} {'(' + ', '.join(variable.dims) + ')':32s} {variable.attrs['long_name']}"
    )

# %% [markdown]
# ## Provenance
#
# The attributes contain the settings and the command of the run. The same settings give the same bytes in
# every variable, for any number of workers.

# %%
for name in ("title", "source", "references", "history"):
    print(f"{name:11s} {ensemble.attrs[name]}")
parameters = json.loads(ensemble.attrs["parameters"])
print("parameters ", parameters)

# %% [markdown]
# ## Status before value
#
# Every configuration has a status, and 0 is good; `valid` is 1 where its numbers are sound. Two other statuses are
# sound and physical:
# `slack_edges` means that some edges carry no tension at these rest lengths, and `edge_collapse` that the minimal
# tension variance requires an edge of zero length, a limit that no configuration attains. Undefined values are NaN:
# the coefficients C_B and C_G at such a limit, for example, or with slack parts in the network. NaN never means "not
# computed"; that is the status `missing`.

# %%
meaning = dict(
    zip(
        ensemble.status.attrs["flag_values"],
        ensemble.status.attrs["flag_meanings"].split(),
        strict=True,
    )
)
for population in ensemble.population.values:
    codes, counts = np.unique(
        ensemble.status.sel(population=population), return_counts=True
    )
    undefined = int(ensemble.C_B.sel(population=population).isnull().sum())
    outcomes = ", ".join(
        f"{count} {meaning[code]}"
        for code, count in zip(codes, counts, strict=True)
    )
    print(f"{population:20s} {outcomes}; C_B undefined in {undefined}")

# %% [markdown]
# ## Selecting by label
#
# One configuration, one population, sound members only. `where` turns the others into NaN, and `mean` skips NaN. It is
# applied to the variables in use: on the whole dataset it would copy `edges` to each population.

# %%
one = ensemble.sel(population="max_B_0", seed=ensemble.seed[0])
print(f"B_0 of the first network at its largest: {one.B_0.item():.4f} k")

good = ensemble[["B_0", "B", "C_B"]].where(ensemble.valid)
table = xr.Dataset({"mean": good.B_0.mean("seed"), "std": good.B_0.std("seed"),
                    "members": good.B_0.count("seed")})  # fmt: skip
for population in table.population.values:
    row = table.sel(population=population)
    print(
        f"{population:20s} B_0 = {row['mean'].item():7.4f} ± {row['std'].item():.4f} k  ({row.members.item()} networks)"
    )

# %% [markdown]
# `status == 0` would select fewer: random rest lengths leave edges slack in nearly every network, and their values are
# those of a network with slack edges.

# %%
finite = np.isfinite(ensemble.B_0)
print(
    "finite B_0:",
    {
        str(p): int(finite.sel(population=p).sum())
        for p in ensemble.population.values
    },
)

# %% [markdown]
# ## Error bounds
#
# A variable with the attribute `ancillary_variables` has a bound on its error next to it. It is the error of the
# computation, and says nothing about the spread between networks. With it one can ask whether a value differs from
# zero, or two values from each other, by more than rounding.

# %%
bounds = {
    name: variable.attrs["ancillary_variables"]
    for name, variable in ensemble.data_vars.items()
    if "ancillary_variables" in variable.attrs
}
for name, bound in bounds.items():
    print(f"{name:32s} error at most {float(ensemble[bound].max()):.0e}")
G_0, error = ensemble.G_0, ensemble[bounds["G_0"]]
print(
    f"G_0 > 0 by more than its error in {int((G_0 > error).sum())} of {int(G_0.count())} configurations"
)

# %% [markdown]
# ## A distribution and a plane
#
# Left: the bulk modulus at the transition. Right: C_B, its derivative with respect to strain. Populations with
# the largest B_0 soften, C_B < 0.

# %%
fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for index, name in enumerate(ensemble.population.values):
    member = good.sel(population=name)
    B_0, C_B = member.B_0.values, member.C_B.values
    colour = member.population_color.item()
    if np.isfinite(B_0).any():
        body = left.violinplot(
            [B_0[np.isfinite(B_0)]], [index], showextrema=False, widths=0.8
        )["bodies"][0]
        body.set(facecolor=colour, alpha=0.4)
        left.plot(
            np.full(B_0.shape, index), B_0, "_", color=colour, markersize=8
        )
    right.plot(
        B_0,
        C_B,
        "o",
        color=colour,
        markersize=4,
        alpha=0.8,
        label=member.population_symbol.item(),
    )
left.set_xticks(
    range(ensemble.sizes["population"]),
    [name.replace(" ", "\n", 1) for name in ensemble.population_symbol.values],
    fontsize=8,
)
left.set_ylabel("bulk modulus at the transition $B_0$  [$k$]")
right.axhline(0, color="0.7", linewidth=0.8, zorder=0)
right.set_xlabel("$B_0$  [$k$]")
right.set_ylabel("derivative with strain $C_B$  [$k$]")
right.legend(fontsize=7, frameon=False)
plt.show()

# %% [markdown]
# ## The strain path
#
# The inner dimension `strain` is the path past the transition. Lines are means over good members of the relative
# change of the bulk modulus; their derivatives at γ = 0 are C_B/B_0, known without the path.

# %%
change = (good.B / good.B_0 - 1).mean("seed").dropna("population")
fig, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
for name in change.population.values:
    member = change.sel(population=name)
    axes.plot(
        [0.0, *change.strain.values],
        [0.0, *member.values],
        "o-",
        color=member.population_color.item(),
        markersize=3,
        linewidth=1,
        label=member.population_symbol.item(),
    )
axes.axhline(0, color="0.7", linewidth=0.8, zorder=0)
axes.set_xlabel("volumetric strain past the transition $\\gamma$")
axes.set_ylabel("$B(\\gamma)/B_0 - 1$")
fig.legend(loc="outside right upper", fontsize=7, frameon=False)
plt.show()

# %% [markdown]
# Without Python: `critflow show results/ensemble/ensemble.nc --set seed=0 --set population=max_G_0` draws one
# member, and `ncdump -h` lists the file.
