"""Tensions from the picture of a tissue, with and without pressures: recovered errors, and their amplification.

Planted stresses σ, and pressures of the cells or none, give a configuration; its positions with independent errors of a
part ε of the mean length give them back (`nearest_critical`).  "pressures ignored" infers tensions alone from those.
"""

import numpy as np
from critflow.studies.shared.checks import voronoi_check
from critflow.studies.shared.figures import counted, panels
from critflow.studies.shared.reports import parameters, series
from critflow.studies.shared.tables import network_study, numbers, outcomes, stacked

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
    return {"status": cf.Status.ok, **stacked(rows)}


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


def claims(ds):
    """Stated errors, amplification with and without pressures, and the price of ignoring them."""
    first = ds.isel(noise=int(np.argmin(parameters(ds)["noises"])))
    mean = first.deviation.mean("seed").values
    spread = first.deviation.std("seed").values / np.sqrt(max(ds.sizes["seed"] - 1, 1))
    alone, pressed, _ = first.amplification.median("seed").values
    ignored = float(first.error[:, 2].median())
    pushed = ", ".join(f"{int(count)}" for count in (ds.compressed[:, 1] > 0).sum("seed"))
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
    ]  # fmt: skip


study = network_study(
    name="tension_inference",
    title="Tensions from a picture, with and without pressures",
    references=SOURCES,
    n=20,
    parameters={"n_vertices": 60, "noises": (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)},
    coordinates=(Coordinate("noise", "noises", "error of the positions over the mean length"),),
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
    ),
    figures={"inference": figure},
    claims=claims,
)
