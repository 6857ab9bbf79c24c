"""Three networks of one topology and one B_0 that soften, keep and stiffen past the transition.

C_B is prescribed to −0.05, 0 and 0.3 at B_0 = 0.25, and each is strained to γ = 0.1.
`python -m workflows.benchmarks.design_energies` recomputes the energies of these paths by LAMMPS.
"""

import numpy as np

import critflow as cf
from critflow.workflow import Claim

from .shared.checks import voronoi_check
from .shared.figures import lettered, panels, signed
from .shared.reports import MISSED, parameters, series
from .shared.tables import bounded, network_study, outcomes

MODULUS = 0.25
GROWTH = {"softens": -0.05, "keeps": 0.0, "stiffens": 0.3}
STRAINS = np.concatenate([[1e-4, 1e-3], np.linspace(0.005, 0.1, 20)])


def designs(n_vertices, seed):
    """The three designs of one network."""
    manifold = cf.CriticalManifold(cf.voronoi_network(n_vertices, seed))
    return [cf.design(manifold, {"B_0": MODULUS, "C_B": growth}, throw=False) for growth in GROWTH.values()]


def case(parameters, *, seed):
    """Strain paths of the three designs."""
    made = designs(parameters["n_vertices"], seed)
    paths = [cf.strain_path(one.value, STRAINS, throw=False).value for one in made]
    return {
        "status": cf.Status.ok,
        "B": [path.bulk_modulus for path in paths],
        "B_error_bound": [path.bulk_modulus_error for path in paths],
        "G": [path.shear_modulus for path in paths],
        "G_error_bound": [path.shear_modulus_error for path in paths],
        "kind_status": [one.status for one in made],
    }


def figure(ds):
    """Moduli against strain."""
    figure, (left, right) = panels(
        2,
        f"{ds.sizes['seed']} networks ($N_v$ = {parameters(ds)['n_vertices']}), each designed three times: "
        f"one topology, one $B_0$ = {MODULUS:g} k, three $C_B$",
    )
    low, high = 100 * np.nanquantile(ds.B.values / MODULUS - 1, (0, 1))
    for axes, name, label, title in (
        (left, "B", "$B$  [k]", f"$B$ changes by {signed(round(low))} to +{high:.0f} %"),
        (right, "G", "$G$  [k]", "$G$ grows alike"),
    ):
        for n, (kind, growth) in enumerate(GROWTH.items()):
            color, legend = series(n)["color"], f"{kind}: $C_B$ = {signed(growth)} k"
            for i, moduli in enumerate(ds[name].values[:, n]):
                axes.plot(STRAINS, moduli, color=color, linewidth=1.2, alpha=0.7, label="" if i else legend)
        axes.set(xlabel="dilation $\\gamma$", ylabel=label, xlim=(0, None), title=title)
    left.axhline(MODULUS, color="0.5", linewidth=0.8, linestyle=":")
    left.legend(fontsize=9, frameon=False, loc="lower left")
    lettered(left, right)
    return figure


def claims(ds):
    """The order of the three curves."""
    start = ds.B.values[:, :, 0]
    end = ds.B.values[:, :, np.argmin(np.abs(STRAINS - 0.01))]
    equal = np.abs(start - MODULUS).max()
    ordered = (end[:, 0] < end[:, 1]) & (end[:, 1] < end[:, 2]) & (end[:, 0] < MODULUS) & (end[:, 2] > MODULUS)
    return [
        Claim.tested(
            "design-curves", "networks of one topology and one B_0 soften, keep and stiffen by design", "all",
            f"{ordered.sum()} of {len(ordered)} networks at γ = 0.01; B at γ = 1e-4 within {equal:.1e} of {MODULUS}",
            ordered.all() and equal < 1e-3 and not np.isin(ds.kind_status.values, MISSED).any(),
            "the growth changes within this strain", criterion="order and sign in every network, B_0 to 1e-3",
        )
    ]  # fmt: skip


study = network_study(
    name="design_curves",
    title="Networks that soften, keep and stiffen on demand",
    parameters={"n_vertices": 400},
    case=case,
    check=voronoi_check(),
    variables=(
        *outcomes(("seed", "kind"), kind_status="outcome of the design"),
        *bounded(
            ("seed", "kind", "strain"),
            B="bulk modulus [k]",
            G="shear modulus, energy convention [k]",
        ),
    ),
    figures={"curves": figure},
    claims=claims,
)
