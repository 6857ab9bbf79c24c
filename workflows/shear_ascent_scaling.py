"""Compressed edges of the unconstrained ascent against the size of the network (`ShearModulusSteepestDescent` F, G).

Networks of all sizes are compared where they reach the same part of the closed-form bound, because the same number of
steps leads small networks farther.
"""

from __future__ import annotations

import json

import numpy as np
from matplotlib.figure import Figure

from critflow import CriticalManifold, InputError, StudyError, voronoi_network
from critflow.objectives import pure_shear
from critflow.plot import COLOURS
from critflow.result import Status
from critflow.supremum import least_compressed_length
from critflow.workflow import Axis, Claim, Coordinate, Study, Variable

from ._ascent import ascend, check_ascent
from ._scaling import exponent, shown


def case(parameters, *, n_vertices, seed):
    """One ascent, measured where it first reaches each part of the bound, and what any configuration there needs."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed, parameters["hard_core"]))
    steps, fractions = (0, parameters["n_steps"]), parameters["fractions"]
    found, bound, _, reached, first, _ = ascend(manifold, parameters["method"], steps, fractions, stop_at_last=True)
    return {
        # To be stopped at the largest part of the bound is what was asked for.
        "status": Status.ok if (first >= 0).all() else found.status,
        "bound": bound,
        "shear_modulus": reached[0],
        "step": first,
        "longest_edge": reached[1],
        "compressed_edges": reached[3],
        "compressed_length": reached[4],
        "least_compressed_length": least_compressed_length(manifold, pure_shear(2)),
        "crossings": len(found.stats.details["crossings"]),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_ascent(parameters)
    if parameters["n_steps"] < 1:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 1")
    for n_vertices in axes["n_vertices"]:
        try:
            voronoi_network(n_vertices, axes["seed"][0], parameters["hard_core"])
        except InputError as error:
            raise StudyError(str(error)) from error


def scaling_figure(ds):
    """Number and total length of compressed edges against size, at each part of the bound."""
    figure = Figure(figsize=(9.5, 4.2), dpi=120, layout="constrained")
    sizes = ds.n_vertices.values
    for axes, name, label, expected in zip(
        figure.subplots(1, 2),
        ("compressed_edges", "compressed_length"),
        ("number of compressed edges  $N(\\tau<0)$", "total length of compressed edges  $L(\\tau<0)$"),
        (0.5, 1.0),
        strict=True,
    ):
        markers = zip(ds.fraction.values, COLOURS, "osD^v", strict=False)
        for fraction, colour, marker in markers:
            values = ds[name].sel(fraction=fraction).transpose("n_vertices", "seed").values
            fit = exponent(sizes, values)
            axes.errorbar(
                sizes, np.nanmean(values, 1), np.nanstd(values, 1), fmt=marker, color=colour, capsize=2, markersize=5,
                label=f"{100 * fraction:.0f} % of the bound: exponent {fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]",
            )  # fmt: skip
            mean = np.exp(np.nanmean(np.log(np.nanmean(values, 1))) + fit[0] * (np.log(sizes) - np.log(sizes).mean()))
            axes.plot(sizes, mean, color=colour, linewidth=1.2)
        if name == "compressed_length":
            least = ds.least_compressed_length.transpose("n_vertices", "seed").values
            fit = exponent(sizes, least)
            axes.plot(
                sizes, np.nanmean(least, 1), "k--", linewidth=1.1,
                label=f"least that the bound needs: exponent {fit[0]:.3f}",
            )  # fmt: skip
        start = 0.55 * np.nanmin(ds[name].mean("seed").isel(n_vertices=0))
        guide = start * (sizes / sizes[0]) ** expected
        axes.plot(sizes, guide, color="0.6", linestyle=":")
        axes.text(sizes[-1], 0.8 * guide[-1], f"$\\propto N_v^{{{expected:g}}}$", color="0.4", ha="right", va="top")
        axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel=label)
        axes.legend(fontsize=8, frameon=False, loc="upper left")
        low, high = axes.get_ylim()
        axes.set_ylim(low, high * 5)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        f"Few but long: compression in networks near their largest shear modulus ({ds.sizes['seed']} networks a size)",
        fontsize=11,
    )
    return figure


def claims(ds):
    """The paper's exponents beside those measured, at every part of the bound."""
    sizes = ds.n_vertices.values
    if len(sizes) < 2:
        return
    for name, key, said, words in (
        ("compressed_edges", "F", 0.5, "the number of compressed edges grows as √N_v"),
        ("compressed_length", "G", 1.0, "the total length of compressed edges grows as N_v"),
    ):
        fits = {
            float(fraction): exponent(sizes, ds[name].sel(fraction=fraction).transpose("n_vertices", "seed").values)
            for fraction in ds.fraction.values
        }
        last = fits[max(fits)]
        value = "; ".join(f"at {100 * fraction:.0f} % of the bound {shown(fit)}" for fraction, fit in fits.items())
        yield Claim(
            f"ShearModulusSteepestDescent-{key}", words, f"exponent {said:g}", value,
            "holds" if abs(last[0] - said) < 0.1 else "differs",
            "" if abs(last[0] - said) < 0.1 else f"at {100 * max(fits):.0f} % of the bound the exponent is "
            f"{last[0]:.2f}; it changes with how far the ascent is taken, which the paper does not say",
        )  # fmt: skip
    least = ds.least_compressed_length.transpose("n_vertices", "seed").values
    fit = exponent(sizes, least)
    yield Claim(
        "ShearModulusSteepestDescent-G-bound",
        "at the bound itself a compressed length ∝ N_v cannot be avoided (linear program over all configurations)",
        "L(τ<0) ∝ N_v", f"at least {np.nanmean(least / sizes[:, None]):.3f} N_v, exponent {shown(fit)}",
        "holds" if abs(fit[0] - 1) < 0.05 else "differs", "" if abs(fit[0] - 1) < 0.05 else "another exponent",
    )  # fmt: skip


def summary(ds):
    """Scalars for tables: mean and spread by size."""
    sizes = {}
    for n in ds.n_vertices.values:
        one = ds.sel(n_vertices=n)
        sizes[int(n)] = {
            name: {"mean": one[name].mean("seed").values, "std": one[name].std("seed").values}
            for name in ("bound", "shear_modulus", "step", "compressed_edges", "compressed_length")
        }
    codes, counts = np.unique(ds.status.values, return_counts=True)
    return {
        "parameters": json.loads(ds.attrs["parameters"]),
        "status": {Status(int(code)).name: int(count) for code, count in zip(codes, counts, strict=True)},
        "sizes": sizes,
    }


EACH = ("n_vertices", "seed")

study = Study(
    name="shear_ascent_scaling",
    title="Compressed edges of the unconstrained shear ascent against the size of the network",
    references="Hain, Santangelo and Manning, arXiv:2407.13939, figure ShearModulusSteepestDescent F, G",
    axes=(
        Axis("seed", range(20), "seed of the network", noun="networks"),
        Axis("n_vertices", (50, 100, 200, 500, 1000, 2000), "number of vertices", key="n_vertices"),
    ),
    parameters={"hard_core": 0.82, "method": "lbfgs", "n_steps": 5000, "fractions": (0.5, 0.8, 0.9, 0.95)},
    coordinates=(Coordinate("fraction", "fractions", "part of the closed-form bound that is reached"),),
    case=case,
    check=check,
    variables=(
        Variable("bound", EACH, "f8", long_name="largest shear modulus of any stress, in units of k"),
        Variable("shear_modulus", (*EACH, "fraction"), "f8", long_name="shear modulus at that step, in units of k"),
        Variable("step", (*EACH, "fraction"), "i4", long_name="step that first reached this part; -1: none", fill=-2),
        Variable("longest_edge", (*EACH, "fraction"), "f8", long_name="longest edge there over the side of the box"),
        Variable("compressed_edges", (*EACH, "fraction"), "f8", long_name="number of compressed edges there"),
        Variable("compressed_length", (*EACH, "fraction"), "f8", long_name="total length of compressed edges there"),
        Variable(
            "least_compressed_length", EACH, "f8", long_name="least compressed length of configurations at the bound"
        ),
        Variable("crossings", EACH, "i4", long_name="steps across a singular prestress matrix", fill=-1),
        Variable("status", EACH, "i1", long_name="outcome of the ascent", flags=Status),
    ),
    figures={"compression": scaling_figure},
    claims=lambda ds: list(claims(ds)),
    summary=summary,
)
