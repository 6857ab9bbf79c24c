"""Tensions from the picture of a tissue, with and without pressures: recovered errors, and their amplification.

Planted stresses σ, and pressures of the cells or none, give a configuration; its positions with independent errors of a
part ε of the mean length give them back (`nearest_critical`).  "pressures ignored" infers tensions alone from those.
With pressures sides are arcs: the same networks have 0, 1, 2 and 4 vertices on each side, whose tensions are compared.
"""

import numpy as np
from critflow.studies.shared.checks import voronoi_check
from critflow.studies.shared.figures import counted, lettered, panels
from critflow.studies.shared.reports import parameters, series
from critflow.studies.shared.tables import network_study, numbers, outcomes, stacked
from scipy.stats import chi2

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim, Coordinate

SOURCES = "Chiou, Hufnagel, Shraiman, PLoS Comput. Biol. 8 (2012); Ishihara, Sugimura, J. Theor. Biol. 313 (2012)"
MODELS = ("tensions alone", "tensions and pressures", "pressures ignored")
STRESS_SPREAD, PRESSURE_SPREAD = 0.2, 0.1  # standard deviations of log σ, and of p in units of σ


def case(parameters, *, seed):
    """Relative errors of σ at all noises, by model, with the stated errors."""
    network = cf.voronoi_network(parameters["n_vertices"], seed)
    manifold, rng = cf.CriticalManifold(network), np.random.default_rng([seed, 1])
    sigma = np.exp(STRESS_SPREAD * rng.standard_normal(network.n_edges))
    pressures = PRESSURE_SPREAD * rng.standard_normal(network.faces.n_faces)
    without, within = manifold.configuration(sigma), manifold.configuration(sigma, pressures)
    noise = rng.standard_normal(within.coordinates.shape)
    rows = [
        stacked([inferred(manifold, planted, model, level, noise) for level in parameters["noises"]])
        for model, planted in zip(MODELS, (without, within, within), strict=True)
    ]
    sides = stacked(
        [from_sides(network, sigma, pressures, parameters["traced_noise"], n, seed) for n in parameters["traced"]]
    )
    return {"status": cf.Status.ok, **stacked(rows), **sides}


def traced(network, pieces):
    """The network with this number of edges on each side, straight at its positions."""
    (tail, head), L = network.edges.T, network.bond_vectors(network.positions)
    n, m = network.n_vertices, network.n_edges
    inner = n + np.arange(m * (pieces - 1)).reshape(m, pieces - 1)
    chain = np.column_stack([tail, inner, head])
    edges = np.stack([chain[:, :-1], chain[:, 1:]], axis=-1).reshape(-1, 2)
    parts = np.arange(1, pieces)[None, :, None] / pieces
    points = (network.positions[tail][:, None] + parts * L[:, None]).reshape(-1, 2)
    offsets = np.zeros((m, pieces, 2), int)
    offsets[:, -1] = network.offsets
    return ce.network_from(
        edges=edges,
        positions=np.concatenate([network.positions, points]),
        cell=network.cell,
        offsets=None if network.cell is None else offsets.reshape(-1, 2),
        pins=sorted(network.pins) or None,
    ).network


def from_sides(base, sigma, pressures, level, n_traced, seed):
    """Median error of tensions, true and stated, over that of positions, and χ² over its degrees of freedom."""
    pieces = n_traced + 1
    network = traced(base, pieces)
    # The stress of each piece, for which the tension along a side does not depend on their number.
    planted = cf.CriticalManifold(network).configuration(pieces * np.repeat(sigma, pieces), pressures)
    s = level * planted.lengths.sum() / base.n_edges
    known, noise = planted.coordinates, np.random.default_rng([seed, 2]).standard_normal(planted.coordinates.shape)
    exact = ce.nearest_critical(network, known, s, throw=False, pressures=True)
    found = ce.nearest_critical(network, known + s * noise, s, throw=False, pressures=True)
    error = found.side_tensions / exact.side_tensions * (exact.side_tensions.sum() / found.side_tensions.sum()) - 1
    stated = exact.side_errors / np.abs(exact.side_tensions)
    return {
        "side_error": np.median(np.abs(error)) / level,
        "side_stated": np.median(stated) / level,
        "side_ratio": np.median(np.abs(error) / stated),
        "side_chi_squared": found.chi_squared / found.freedom if found.freedom else np.nan,
        "side_freedom": found.freedom,
        "side_status": found.status,
    }


def inferred(manifold, planted, model, level, noise):
    """Root mean square error of σ, its mean square in stated errors, amplification, compressed edges, outcome."""
    s, pressed = level * planted.lengths.mean(), model == MODELS[1]
    found = ce.nearest_critical(manifold, planted.coordinates + s * noise, s, throw=False, pressures=pressed)
    sigma = found.value.sigma
    # Stated errors are those of σ at fixed Σσ with pressures, of log σ at fixed Σ log σ without.
    stated = found.stress_error / planted.sigma if pressed else found.stress_error
    scale = planted.sigma.sum() / sigma.sum() if pressed else np.exp(np.mean(np.log(planted.sigma / sigma)))
    error = scale * sigma / planted.sigma - 1
    return {
        "error": np.sqrt(np.mean(error**2)),
        "deviation": np.mean((error / stated) ** 2),
        "amplification": np.sqrt(np.mean(stated**2)) / level,
        "compressed": np.sum(sigma < 0),
        "inference_status": found.status,
    }


def figure(ds):
    """Errors of σ against the noise of positions."""
    noises, first = np.array(parameters(ds)["noises"]), int(np.argmin(parameters(ds)["noises"]))
    alone, pressed, _ = ds.amplification.values[:, :, first].T
    made, (axes,) = panels(
        1,
        f"Tensions have {np.median(alone):.2g} times the error of a picture's positions, "
        f"with pressures {np.median(pressed):.0f} times\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices: medians and 80 %)",
        height=3.3,
    )
    for n, model in enumerate(MODELS):
        error = ds.error.values[:, n]
        axes.loglog(noises, np.median(error, axis=0), label=model, markersize=5, **series(n))
        axes.fill_between(noises, *np.quantile(error, [0.1, 0.9], axis=0), color=series(n)["color"], alpha=0.2)
    axes.loglog(noises, noises, ":", color="0.5", linewidth=0.8, label="error of the positions")
    axes.set(xlabel="error of the positions over the mean length", ylabel="relative error of σ")
    axes.legend(fontsize=9, frameon=False, loc="lower right", labelspacing=0.25)
    return made


def sides_figure(ds):
    """Amplification, and χ², against the number of vertices on a side."""
    counts = list(parameters(ds)["traced"])
    straight, curved = (np.median(ds.side_error.values[:, n]) for n in (0, -1))
    made, (errors, tests) = panels(
        2,
        f"Vertices on the sides of cells reduce the error of tensions from {straight:.0f} times to {curved:.2g} times\n"
        f"that of the positions, and leave a test of the model ({counted(ds)}, with pressures)",
        height=3.3,
    )
    places = np.arange(len(counts))
    for axes, values in ((errors, ds.side_error.values), (tests, ds.side_chi_squared.values)):
        shift = np.linspace(-0.15, 0.15, len(values))
        for place in places:
            axes.plot(place + shift, values[:, place], ".", color=series(0)["color"], alpha=0.6, markersize=4)
        axes.set_xticks(places, [str(count) for count in counts])
        axes.set_xlabel("vertices on each side")
    errors.plot(places, np.median(ds.side_error.values, axis=0), "_", color="black", markersize=22, label="median")
    errors.plot(
        places,
        np.median(ds.side_stated.values, axis=0),
        "x",
        label="median standard error",
        **{"color": series(1)["color"]},
    )
    errors.set(ylabel="relative error of a tension\nover that of the positions", yscale="log")
    errors.legend(fontsize=9, frameon=False)
    tested = np.flatnonzero(np.array(counts) > 0)
    freedom = ds.side_freedom.values[0]
    low, high = (chi2.ppf(part, freedom[tested]) / freedom[tested] for part in (0.005, 0.995))
    tests.bar(tested, high - low, 0.4, low, color="0.85", zorder=0, label="99 % interval")
    tests.use_sticky_edges = False
    tests.axhline(1, color="0.5", linewidth=0.8, zorder=0)
    tests.set(ylabel="χ² over degrees of freedom", xlim=errors.get_xlim())
    if counts[0] == 0:
        tests.text(0, 1.01, "no test", ha="center", va="bottom", fontsize=9, color="0.4")
    tests.legend(fontsize=9, frameon=False, loc="upper right")
    lettered(errors, tests)
    return made


def claims(ds):
    """Stated errors, amplification with and without pressures, and the price of ignoring them."""
    first = ds.isel(noise=int(np.argmin(parameters(ds)["noises"])))
    mean = first.deviation.mean("seed").values
    spread = first.deviation.std("seed").values / np.sqrt(max(ds.sizes["seed"] - 1, 1))
    alone, pressed, _ = first.amplification.median("seed").values
    ignored = float(first.error[:, 2].median())
    pushed = ", ".join(f"{int(count)}" for count in (ds.compressed[:, 1] > 0).sum("seed"))
    counts, sides = parameters(ds)["traced"], ds.side_error.median("seed").values
    tests = (ds.side_chi_squared * ds.side_freedom).values[:, (ds.side_freedom > 0).all("seed").values]
    freedom = ds.side_freedom.values[:, (ds.side_freedom > 0).all("seed").values]
    inside = int(np.sum(np.abs(chi2.cdf(tests, freedom) - 0.5) < 0.495))
    failed = int((ds.inference_status != cf.Status.ok).sum())
    return [
        Claim.tested(
            "inference-errors", "errors of σ at the smallest noise are those stated, with and without pressures", "1",
            f"mean square ratios {mean[0]:.3f} ± {spread[0]:.3f} without, {mean[1]:.2f} ± {spread[1]:.2f} with",
            (np.abs(mean - 1) <= 3 * spread)[:2].all(), "the response of the inference to noise is not linear",
            criterion="mean square ratios within three standard errors of 1", kind="check",
        ),
        Claim.tested(
            "inference-amplification", "pressures as unknowns amplify errors of positions at least tenfold", "",
            f"median amplification {pressed:.0f} with pressures, {alone:.2g} without", pressed >= 10 * alone,
            "the networks are small", criterion="ratio of medians of at least 10",
        ),
        Claim(
            "inference-ignored", f"median error of σ where pressures of {PRESSURE_SPREAD:g} σ are ignored", "",
            f"{ignored:.2g}: with pressures, that of positions off by {ignored / pressed:.1e} of the mean length; "
            f"then {pushed} networks, by noise, have compressed edges; {failed} inferences failed", "measured",
        ),
        Claim.tested(
            "inference-sides", "vertices on curved sides reduce the error of a tension at least fivefold", "",
            ", ".join(f"{error:.3g} times with {count}" for count, error in zip(counts, sides, strict=True))
            + f" vertices on a side; {inside} of {tests.size} χ² in the 99 % interval",
            sides[0] >= 5 * sides[-1], "the sides are almost straight", criterion="ratio of medians of at least 5",
        ),
    ]  # fmt: skip


study = network_study(
    name="tension_inference",
    title="Tensions from a picture, with and without pressures",
    references=SOURCES,
    n=20,
    parameters={
        "n_vertices": 60,
        "noises": (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2),
        "traced": (0, 1, 2, 4),
        "traced_noise": 1e-3,
    },
    coordinates=(
        Coordinate("noise", "noises", "error of the positions over the mean length"),
        Coordinate("on_side", "traced", "vertices on each side"),
    ),
    case=case,
    check=voronoi_check(),
    variables=(
        *numbers(
            ("seed", "model", "noise"),
            error="root mean square relative error of σ",
            deviation="mean square of errors over stated errors",
            amplification="stated error of σ over the error of the positions",
            compressed="number of edges in compression",
        ),
        *outcomes(("seed", "model", "noise"), inference_status="outcome of the inference"),
        *numbers(
            ("seed", "on_side"),
            side_error="median relative error of a tension over that of the positions",
            side_stated="the same as stated",
            side_ratio="median of error over stated error",
            side_chi_squared="χ² over its degrees of freedom",
            side_freedom="degrees of freedom",
        ),
        *outcomes(("seed", "on_side"), side_status="outcome of the inference from sides"),
    ),
    figures={"inference": figure, "curved_sides": sides_figure},
    claims=claims,
)
