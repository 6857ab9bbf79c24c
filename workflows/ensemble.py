"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths come
twice, with the spread that the paper prints (0.3, `random_lengths_wide`) and with the largest one that leaves every
edge of these networks stressed (0.1, `random_lengths`).

With `network=FILE` the network is that of a file; seeds are then those of random populations and of random starts.
"""

from __future__ import annotations

import numpy as np

from critflow.figures.plot import unit_pressure_tensions
from critflow.generators.random_networks import check_voronoi
from critflow.paths.strain_path import check_strains
from critflow.result import StudyError
from critflow.workflow import Axis, Claim, Coordinate, Study, decimals

from .shared.checks import check_deformation, check_network, check_positive
from .shared.measurements import DRAWN, planar_member, table, verify
from .shared.own_network import check_own, own_network, with_digest
from .shared.panels import Drawing, Panel, gallery_figure, panel_figure
from .shared.population_reports import counts, described, of, percolation_claims, population_claims, summary
from .shared.populations import LABELS, MEANING, NAMES, PAPER_POPULATIONS, POPULATIONS, SPREADS
from .shared.reports import PAPER, parameters


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    return planar_member(parameters, seed=seed, population=population, wanted=wanted)


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "spread_wide", "hard_core", "fit_window")
    if parameters["protocol"] not in ("conic", "strain"):
        raise StudyError(f"protocol={parameters['protocol']} must be conic (exact) or strain (the paper's steps)")
    check_deformation(parameters["deformation"])
    if network := own_network(parameters):
        check_own(network)
    else:
        check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


STRUCTURE = {
    "length_variance": "length variance $V_L$",
    "anisotropy_physical": "mean face anisotropy $\\langle\\kappa_{phys}\\rangle$",
    "tension_variance": "tension variance $V_\\tau$",
    "anisotropy_force": "mean force anisotropy $\\langle\\kappa_{force}\\rangle$",
}
RESPONSE = {
    "bulk_modulus_0": "bulk modulus at the transition $B_0$  [$k$]",
    "C_B_exact": "its growth with strain $C_B$  [$k$]",
    "shear_modulus_0": "shear modulus at the transition $G_0$  [$k$]",
    "C_G_stress_corrected_exact": "its growth with strain $C_G$, stress-corrected  [$k$]",
}
# Quantities on logarithmic axes, and the least value that is drawn.
LEAST_DRAWN = {"length_variance": 1e-3, "tension_variance": 1e-3, "shear_modulus_0": 1e-12}

_DRAWINGS = "Drawings: medians of the highest and lowest population; dark, wide edges carry the most tension."


def structure_figure(ds):
    """`StructuralMetrics`: lengths and faces, tensions and force triangles."""
    panels = [_panel(ds, name, label, least=LEAST_DRAWN.get(name)) for name, label in STRUCTURE.items()]
    note = f"{_DRAWINGS} $V_L$ of min $V_L$ vanishes to rounding and stands at {LEAST_DRAWN['length_variance']:g}."
    return panel_figure(panels, _names(ds), "Structure of critical configurations", f"{note} {_random_note(ds)}")


def response_figure(ds):
    """`ResponseMetrics`: moduli at the transition and how they grow past it."""
    panels = [_panel(ds, name, label, name.startswith("C_"), LEAST_DRAWN.get(name)) for name, label in RESPONSE.items()]
    note = (
        f"Red lines: no change with strain{_deformation_note(ds)}. Undefined: edges shrink to zero length. {_DRAWINGS}"
    )
    return panel_figure(
        panels, _names(ds), "Mechanical response of critical configurations", f"{note} {_random_note(ds)}"
    )


def _deformation_note(ds):
    """The deformation where it is not the dilation of the paper."""
    name = parameters(ds).get("deformation", "dilation")
    return "" if name == "dilation" else f" of the {name.replace('_', ' ')}"


def gallery(ds):
    """`Networks`: the first network in every population, on one colour scale."""
    drawings = []
    for population in ds.population.values:
        one = ds.isel(seed=0).sel(population=population)
        if np.isfinite(one.sigma.values).all():
            drawings.append(_drawing(one, f"{{name}}: $B_0$ = {float(one.bulk_modulus_0):.3f}"))
    title = f"One network of {ds.sizes['vertex']} vertices at the rigidity transition in seven populations"
    return gallery_figure(drawings, title.replace("seven", _NUMBERS.get(len(drawings), str(len(drawings)))))


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven"}


def _names(ds):
    return [LABELS[str(population)].replace("random ", "random\n") for population in ds.population.values]


def _random_note(ds):
    """The spreads of the rest lengths, and what the wide one leaves slack."""
    given = {p: parameters(ds)[key] for p, key in SPREADS.items() if p in ds.population}
    text = "; ".join(f"{LABELS[p]}: rest lengths of spread $s$ = {spread:g}" for p, spread in given.items())
    if "random_lengths_wide" in given:
        stressed = float(ds.stressed_fraction.sel(population="random_lengths_wide").mean())
        text += f" as printed in the paper, where {100 * stressed:.0f} % of the edges are stressed"
    return f"{text}." if text else ""


def _panel(ds, name, label, zero_line=False, least=None):
    values = ds[name].transpose("population", "seed")
    medians = values.median("seed")
    drawings = []
    if np.isfinite(medians).any():
        for word, population in (("high", medians.idxmax()), ("low", medians.idxmin())):
            of_population = values.sel(population=population)
            seed = np.abs(of_population - of_population.median()).idxmin()
            value = float(of_population.sel(seed=seed))
            shown = f"{value:.2g}" if abs(value) > 1e-15 else "0"
            drawings.append(_drawing(ds.sel(population=population, seed=seed), f"{word}: {shown}\n{{name}}"))
    groups = list(values.values if least is None else np.maximum(values.values, least))
    return Panel(label, groups, drawings, least is not None, zero_line)


def _drawing(one, caption):
    """One configuration with its caption, which may contain the {name} of its population."""
    sigma, lengths, cell = one.sigma.values, one.length.values, one.cell.values
    tensions = unit_pressure_tensions(sigma, lengths, float(abs(np.linalg.det(cell))))
    return Drawing(
        caption.replace("{name}", LABELS[str(one.population.values)]),
        one.edges.values,
        one.offsets.values,
        cell,
        one.coordinates.values,
        tensions,
    )


# Claims

ALIKE = 10  # percent of the range of all populations: the width of a mark on an axis of a figure
NEAREST_TO_ONE = 0.95


def claims(ds):
    """The statements of the paper on the populations, none for a network from a file or for few populations.

    Where the populations of the paper were not all run, percolation alone is tested.
    """
    if "network" in parameters(ds):
        return []
    if any(p not in ds.population.values or not len(of(ds, "bulk_modulus_0", p)) for p in PAPER_POPULATIONS):
        return list(percolation_claims(ds, "paper"))
    return [*population_claims(ds, "paper"), _thin(ds), *_alike(ds)]


def _thin(ds):
    kappa = of(ds, "anisotropy_force", "shear_modulus")
    return Claim.tested(
        "StructuralMetrics-force", "⟨κ_force⟩ of max G_0 is close to its maximum of 1", "close to 1", described(kappa),
        np.median(kappa) >= NEAREST_TO_ONE, "at the threshold r of the paper the force triangles are thin, not flat",
        criterion=f"median ≥ {NEAREST_TO_ONE}, which rounds to 1.0", sample=f"{len(kappa)} networks", kind="paper",
    )  # fmt: skip


def _alike(ds):
    medians = ds[list(STRUCTURE)].sel(population=list(PAPER_POPULATIONS)).median("seed")
    for one, other, word in (
        ("length_variance", "random_lengths", "very similar"),
        ("length_variance", "random_lengths_wide", "very similar"),
        ("bulk_modulus", "tension_variance", "largely similar"),
    ):
        if other not in ds.population:
            continue
        gap = {}
        for metric in STRUCTURE:
            width = float(medians[metric].max() - medians[metric].min())
            apart = float(ds[metric].sel(population=one).median() - ds[metric].sel(population=other).median())
            gap[metric] = 100 * abs(apart) / width
        spread = f" (s = {parameters(ds)[SPREADS[other]]:g})" if other in SPREADS else ""
        yield Claim.tested(
            f"StructuralMetrics-{one}-{other}", f"{NAMES[one]} and {NAMES[other]}{spread} are {word} in all metrics",
            word, "medians differ by " + ", ".join(f"{name} {value:.3g} %" for name, value in gap.items()),
            max(gap.values()) <= ALIKE, "rest lengths that spread gather tension on some edges",
            criterion=f"each within {ALIKE} % of the range of all populations",
            sample=counts(ds, "stressed_fraction", (one, other)), kind="paper",
        )  # fmt: skip


study = Study(
    name="ensemble",
    version=2,
    title="Populations of critical configurations, strained past the rigidity transition",
    references=PAPER,
    axes=(
        Axis("seed", range(100), "seed of the network", noun="networks"),
        Axis("population", POPULATIONS, MEANING),
    ),
    parameters={
        "n_vertices": 1000,
        "hard_core": 0.82,
        "threshold": 0.1,
        "spread": 0.1,
        "spread_wide": 0.3,
        "protocol": "conic",
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
        "deformation": "dilation",
        "network": "",
    },
    coordinates=(
        Coordinate("strain", "strains", "strain |γ| past the transition, of the deformation and sign that tightens"),
    ),
    case=case,
    check=check,
    complete=with_digest,
    variables=tuple(table(planar=True)),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    needs={
        "gallery": (*DRAWN, "bulk_modulus_0"),
        "structure": (*DRAWN, *STRUCTURE, "stressed_fraction"),
        "response": (*DRAWN, *RESPONSE, "stressed_fraction"),
        "claims": (*STRUCTURE, *RESPONSE, "C_G_exact", "C_B", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
