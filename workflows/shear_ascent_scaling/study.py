"""Compressed edges of the unconstrained ascent against the size of the network (`ShearModulusSteepestDescent` F, G).

Networks of all sizes are compared at the end of the paper's method, FIRE, after the same number of steps, and by L-BFGS
where they reach the same part of the closed-form bound, because the same number of steps leads small networks farther.
"""

from __future__ import annotations

import json

import numpy as np
from matplotlib.figure import Figure

from critflow import CriticalManifold, StudyError, voronoi_network
from critflow.critical.objectives import pure_shear
from critflow.design.modulus_bounds import least_compressed_length
from critflow.plot import COLOURS
from critflow.result import Status
from critflow.workflow import Axis, Claim, Coordinate, Study, Variable

from ..shared.ascent import ascend, check_ascent
from ..shared.checks import check_network
from ..shared.power_laws import exponent, shown


def case(parameters, *, n_vertices, algorithm, seed):
    """One ascent, measured at its end and where it first reaches each part of the bound."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed, parameters["hard_core"]))
    steps, fractions = (0, parameters["n_steps"]), parameters["fractions"]
    ascent = ascend(manifold, algorithm, steps, fractions, stop_at_last=algorithm != "fire")
    return {
        # To be stopped at the largest part of the bound is what was asked for.
        "status": Status.ok if (ascent.first >= 0).all() else ascent.solution.status,
        "bound": ascent.bound,
        "step": ascent.first,
        "compressed_edges": ascent.reached[3],
        "compressed_length": ascent.reached[4],
        "shear_modulus_end": ascent.end[0],
        "longest_edge_end": ascent.end[1],
        "compressed_edges_end": ascent.end[3],
        "compressed_length_end": ascent.end[4],
        "least_compressed_length": least_compressed_length(manifold, pure_shear(2)),
        "crossings": len(ascent.solution.crossings),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_ascent(parameters)
    if parameters["n_steps"] < 1:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 1")
    for n_vertices in axes["n_vertices"]:
        check_network(voronoi_network, n_vertices, axes["seed"][0], parameters["hard_core"])


def _curves(ds, name):
    """What is fitted: label and values (n_sizes, n_networks) for the end of FIRE and each part of the bound."""
    for algorithm in map(str, ds.algorithm.values):
        one = ds.sel(algorithm=algorithm)
        if algorithm == "fire":
            values = one[f"{name}_end"].transpose("n_vertices", "seed").values
            yield f"FIRE, {_parameters(ds)['n_steps']} steps", values
        else:
            for fraction in ds.fraction.values:
                values = one[name].sel(fraction=fraction).transpose("n_vertices", "seed").values
                yield f"{algorithm.upper()}, {100 * fraction:.0f} % of the bound", values


def scaling_figure(ds):
    """Number and total length of compressed edges against size."""
    figure = Figure(figsize=(9.8, 4.4), dpi=120, layout="constrained")
    sizes = ds.n_vertices.values
    for axes, name, label, expected in zip(
        figure.subplots(1, 2),
        ("compressed_edges", "compressed_length"),
        ("number of compressed edges  $N(\\tau<0)$", "total length of compressed edges  $L(\\tau<0)$"),
        (0.5, 1.0),
        strict=True,
    ):
        lowest = np.inf
        for (words, values), colour, marker in zip(_curves(ds, name), COLOURS, "osD^v<>", strict=False):
            # Medians: lengths of an ascent that runs away are beyond all others.
            fit = exponent(sizes, values, np.nanmedian)
            low, middle, high = np.nanquantile(values, (1 / 6, 0.5, 5 / 6), axis=1)
            axes.errorbar(
                sizes, middle, (middle - low, high - middle), fmt=marker, color=colour, capsize=2, markersize=5,
                label=f"{words}: {fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]",
            )  # fmt: skip
            line = np.exp(np.nanmean(np.log(middle)) + fit[0] * (np.log(sizes) - np.log(sizes).mean()))
            axes.plot(sizes, line, color=colour, linewidth=1.2)
            lowest = min(lowest, middle[0])
        if name == "compressed_length":
            least = _least(ds)
            axes.plot(
                sizes, np.nanmean(least, 1), "k--", linewidth=1.1,
                label=f"least that the bound needs: {exponent(sizes, least)[0]:.3f}",
            )  # fmt: skip
        guide = 0.5 * lowest * (sizes / sizes[0]) ** expected
        axes.plot(sizes, guide, color="0.6", linestyle=":")
        axes.text(sizes[-1], 0.8 * guide[-1], f"$\\propto N_v^{{{expected:g}}}$", color="0.4", ha="right", va="top")
        axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel=label)
        axes.legend(fontsize=8, frameon=False, loc="upper left", title="exponent [95 %]", title_fontsize=8)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high * 12)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        f"Few but long: compressed edges on the way to the largest shear modulus ({ds.sizes['seed']} networks a size; "
        "medians, bars hold two thirds)",
        fontsize=11,
    )
    return figure


def claims(ds):
    """The paper's exponents beside those measured, by method and part of the bound."""
    sizes = ds.n_vertices.values
    if len(sizes) < 2:
        return
    for name, key, said, words in (
        ("compressed_edges", "F", 0.5, "the number of compressed edges of final networks grows as √N_v"),
        ("compressed_length", "G", 1.0, "the total length of compressed edges of final networks grows as N_v"),
    ):
        for label, values in _curves(ds, name):
            fit = exponent(sizes, values, np.nanmedian)
            holds = fit[1] - 0.05 <= said <= fit[2] + 0.05
            yield Claim(
                f"ShearModulusSteepestDescent-{key}-{label.split(' ')[0].rstrip(',').lower()}-{_place(label)}",
                f"{words} ({label})", f"exponent {said:g}", f"exponent {shown(fit)}",
                "holds" if holds else "differs", "" if holds else _WHY,
            )  # fmt: skip
    part = (100 * ds.shear_modulus_end / ds.bound).mean("seed")
    reached = (
        f"{algorithm} {float(part.sel(algorithm=algorithm, n_vertices=size)):.0f} % at N_v = {size}"
        for algorithm in map(str, ds.algorithm.values)
        for size in sizes
    )
    yield Claim(
        "ShearModulusSteepestDescent-end",
        "how much of the bound the ascents reach",
        "not stated",
        ", ".join(reached),
        "measured",
    )
    fit, least = exponent(sizes, _least(ds)), _least(ds)
    yield Claim(
        "ShearModulusSteepestDescent-G-bound",
        "at the bound itself a compressed length ∝ N_v cannot be avoided (linear program over all configurations)",
        "not stated", f"at least {np.nanmean(least / sizes[:, None]):.3f} N_v, exponent {shown(fit)}", "measured",
    )  # fmt: skip


_WHY = (
    "the exponent depends on the method and on how far it climbs: FIRE, the paper's method, has the first row; L-BFGS "
    "climbs farther and compresses more and shorter edges, of a total length that grows as said"
)


def _place(label):
    return label.split(", ")[1].split(" ")[0]


def _least(ds):
    return ds.least_compressed_length.isel(algorithm=0).transpose("n_vertices", "seed").values


def _parameters(ds):
    return json.loads(ds.attrs["parameters"])


def summary(ds):
    """Scalars for tables: means by method and size."""
    names = ("bound", "shear_modulus_end", "longest_edge_end", "compressed_edges_end", "compressed_length_end")
    codes, counts = np.unique(ds.status.values, return_counts=True)
    return {
        "networks": ds.sizes["seed"],
        "parameters": _parameters(ds),
        "status": {Status(int(code)).name: int(count) for code, count in zip(codes, counts, strict=True)},
        "n_vertices": ds.n_vertices.values,
        "algorithms": {
            str(a): {name: ds[name].sel(algorithm=a).mean("seed").values for name in names} for a in ds.algorithm.values
        },
    }


EACH = ("algorithm", "n_vertices", "seed")

study = Study(
    name="shear_ascent_scaling",
    title="Compressed edges of the unconstrained shear ascent against the size of the network",
    references="Hain, Santangelo and Manning, arXiv:2407.13939, figure ShearModulusSteepestDescent F, G",
    axes=(
        Axis("seed", range(12), "seed of the network", noun="networks"),
        Axis("algorithm", ("fire", "lbfgs"), "algorithm of the ascent", choices=("newton",)),
        Axis("n_vertices", (50, 100, 200, 500, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={"hard_core": 0.82, "n_steps": 10000, "fractions": (0.5, 0.8, 0.95)},
    coordinates=(Coordinate("fraction", "fractions", "part of the closed-form bound that is reached"),),
    case=case,
    check=check,
    variables=(
        Variable("bound", EACH, "f8", long_name="largest shear modulus of any stress, in units of k"),
        Variable("step", (*EACH, "fraction"), "i4", long_name="step that first reached this part; -1: none", fill=-2),
        Variable("compressed_edges", (*EACH, "fraction"), "f8", long_name="number of compressed edges there"),
        Variable("compressed_length", (*EACH, "fraction"), "f8", long_name="total length of compressed edges there"),
        Variable("shear_modulus_end", EACH, "f8", long_name="shear modulus at the end, in units of k"),
        Variable("longest_edge_end", EACH, "f8", long_name="longest edge at the end over the side of the box"),
        Variable("compressed_edges_end", EACH, "f8", long_name="number of compressed edges at the end"),
        Variable("compressed_length_end", EACH, "f8", long_name="total length of compressed edges at the end"),
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
