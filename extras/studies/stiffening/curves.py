"""Three networks of one topology and one B_0 that soften, keep and stiffen past the transition.

C_B is prescribed to −0.05, 0 and 0.3 at B_0 = 0.25, and each is strained to γ = 0.1.
"""

import numpy as np
from critflow.studies.shared.figures import counted, lettered, panels
from critflow.studies.shared.reports import parameters, series
from critflow.studies.shared.tables import bounded, outcomes

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim
from critflow.engine.study import plural

from ..shared.parts import MISSED, signed

MODULUS = 0.25
GROWTH = {"softens": -0.05, "keeps": 0.0, "stiffens": 0.3}
STRAINS = np.concatenate([[1e-4, 1e-3], np.linspace(0.005, 0.1, 20)])


def paths(parameters, seed):
    """Strain paths of the three designs of one network."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    made = [ce.design(manifold, {"B_0": MODULUS, "C_B": growth}, throw=False) for growth in GROWTH.values()]
    paths = [cf.strain_path(one.value, STRAINS, throw=False).value for one in made]
    return {
        "curve_B": [path.bulk_modulus for path in paths],
        "curve_B_error_bound": [path.bulk_modulus_error for path in paths],
        "curve_G": [path.shear_modulus for path in paths],
        "curve_G_error_bound": [path.shear_modulus_error for path in paths],
        "curve_status": [one.status for one in made],
    }


VARIABLES = (
    *outcomes(("seed", "kind"), curve_status="outcome of the design"),
    *bounded(
        ("seed", "kind", "curve_strain"),
        curve_B="bulk modulus along dilation [k]",
        curve_G="shear modulus along dilation, energy convention [k]",
    ),
)


def figure(ds):
    """Moduli against strain."""
    change = 100 * (ds.curve_B.values / MODULUS - 1)
    figure, (left, right) = panels(
        2,
        f"One topology, one $B_0$ = {MODULUS:g} k: networks soften, keep or stiffen by design, "
        f"by {signed(round(np.nanmin(change)))} to +{np.nanmax(change):.0f} %\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices, each designed three times)",
        height=3.1,
    )
    for n, (kind, growth) in enumerate(GROWTH.items()):
        color, legend = series(n)["color"], f"{kind}: $C_B$ = {signed(growth)} k"
        for axes, curves in ((left, change[:, n]), (right, ds.curve_G.values[:, n])):
            for i, values in enumerate(curves):
                axes.plot(100 * STRAINS, values, color=color, linewidth=1.1, alpha=0.7, label="" if i else legend)
    left.axhline(0, color="0.5", linewidth=0.8, linestyle=":")
    right.legend(fontsize=9, frameon=False, loc="upper left", labelspacing=0.2)
    left.set(xlabel="dilation $\\gamma$  [%]", ylabel="change of the bulk modulus $B$  [%]", xlim=(0, None))
    right.set(xlabel="dilation $\\gamma$  [%]", ylabel="shear modulus $G$  [k]", xlim=(0, None), ylim=(0, 0.033))
    left.set_title("$B$ falls, stays or rises")
    right.set_title("$G$ grows alike in all")
    lettered(left, right)
    return figure


def claims(ds):
    """The order of the three curves."""
    start = ds.curve_B.values[:, :, 0]
    end = ds.curve_B.values[:, :, np.argmin(np.abs(STRAINS - 0.01))]
    equal = np.abs(start - MODULUS).max()
    ordered = (end[:, 0] < end[:, 1]) & (end[:, 1] < end[:, 2]) & (end[:, 0] < MODULUS) & (end[:, 2] > MODULUS)
    return [
        Claim.tested(
            "stiffening-curves", "networks of one topology and one B_0 soften, keep and stiffen by design", "all",
            f"{ordered.sum()} of {plural(len(ordered), 'network')} at γ = 0.01; "
            f"B at γ = 1e-4 within {equal:.1e} of {MODULUS}",
            ordered.all() and equal < 1e-3 and not np.isin(ds.curve_status.values, MISSED).any(),
            "the growth changes within this strain", criterion="order and sign in every network, B_0 to 1e-3",
        )
    ]  # fmt: skip
