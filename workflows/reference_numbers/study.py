"""Numbers of the literature on underconstrained networks and vertex models, computed again, none of them adjusted.

Each quantity is a function in `measures.py`, and here are its value in the literature, the source and the rule of
comparison.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from critflow import voronoi_network
from critflow.result import Status, StudyError
from critflow.workflow import Axis, Claim, Study, Variable

from ..shared.checks import check_network, check_positive
from ..shared.reports import finite, status_counts
from . import measures


class Quantity(NamedTuple):
    """A number of the literature.

    value    of the literature
    within   distance of our mean from it that counts as agreement: rounding, half of the last printed digit, or one per
             cent of a limit that is read from a fit
    """

    statement: str
    printed: str
    value: float
    within: float
    source: str
    because: str

    @property
    def exact(self) -> bool:
        """Whether the number is known in closed form or by a theorem."""
        return self.within < 1e-5


MOST_PLACES = 6
LENGTH = np.sqrt(4 / (3 * np.sqrt(3)))
LEE = "Lee, Merkel, Soft Matter (2022), doi:10.1039/D2SM00075J"
_TENSION = "exponent of G − G_c in the isotropic tension, "
_CORRECTED = "G is the energy derivative; other conventions subtract the tension"
QUANTITIES = {
    "hexagon_shape": Quantity(
        "critical shape index of regular hexagons", "√(8√3) = 3.72241943…", np.sqrt(8 * np.sqrt(3)), 1e-10,
        "exact: perimeter of the hexagon of unit area", "rounding is larger than expected",
    ),
    "planar_shape": Quantity(
        "critical shape index of the disordered planar vertex model", "3.81", 3.81, 0.005,
        "Bi, Lopez, Schwarz, Manning, Nature Physics 11, 1074 (2015)", "the topologies differ",
    ),
    "honeycomb_length": Quantity(
        "least length of equal edges of the honeycomb at unit area a vertex", "√(4/3√3) = 0.87738267…",
        LENGTH, 1e-10, "exact", "rounding is larger than expected",
    ),
    "honeycomb_shear": Quantity(
        "coefficient of γ² in the least length of the honeycomb in simple shear", "3ℓ₀/8 = 0.32901850…",
        0.375 * LENGTH, 1e-6, "exact", "differences lose more digits than expected",
    ),
    "factor_three": Quantity(
        "(G − G_c) γ_c/σ past an onset in simple shear, for γ_c → 0", "3", 3.0, 0.03,
        "Merkel, Baumgarten, Tighe, Manning, PNAS 116, 6560 (2019)", "the coefficient depends on the network",
    ),
    "tension_honeycomb": Quantity(
        _TENSION + "honeycomb", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_voronoi": Quantity(
        _TENSION + "Voronoi", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_phantom": Quantity(
        _TENSION + "phantom triangular", "1", 1.0, 0.01, LEE, _CORRECTED),
    "tension_delaunay": Quantity(
        _TENSION + "Delaunay", "1", 1.0, 0.01, LEE, _CORRECTED),
    "onset_self_stresses": Quantity(
        "self-stresses of random networks at their onset in shear", "1", 1.0, 0.0,
        "Vermeulen, Bose, Storm, Ellenbroek, Phys. Rev. E 96, 053003 (2017)", "some onset has several self-stresses",
    ),
    "convex_faces": Quantity(
        "all faces of critical planar networks are convex", "all", 1.0, 0.0,
        "Tutte, Proc. London Math. Soc. 13, 743 (1963); Gandikota et al., arXiv:2204.09192", "some corner is reflex",
    ),
    "auxetic": Quantity(
        "least Poisson's ratio of triangular lattices pruned with convex faces", "≃ −1", -1.0, 0.05,
        "Hagh, Thorpe, Phys. Rev. B 98, 100101 (2018)", "pruning ends before this value",
    ),
}  # fmt: skip


def measured(ds, name):
    """Finite values of a quantity, one a seed."""
    return finite(ds.value.sel(quantity=name).values)


def shown(values):
    """Mean ± standard deviation, or the number itself where the seeds agree."""
    if len(values) == 0:
        return "no value"
    spread = float(np.std(values))
    if spread < 1e-9 * max(abs(float(np.mean(values))), 1e-300):
        return f"{np.mean(values):.10g}"
    places = min(max(0, 1 - int(np.floor(np.log10(spread)))), MOST_PLACES)
    return f"{np.mean(values):.{places}f} ± {spread:.{places}f}"


def holds(name, values):
    """Whether the mean agrees."""
    known = QUANTITIES[name]
    if len(values) == 0:
        return False
    return abs(float(np.mean(values)) - known.value) <= known.within


def claims(ds):
    """Each number of the literature against ours."""
    found = []
    for name in ds.quantity.values:
        known, values = QUANTITIES[str(name)], measured(ds, name)
        outcomes = status_counts(ds.status.sel(quantity=name).values)
        others = ", ".join(f"{n} {status}" for status, n in outcomes.items() if status != "ok")
        found.append(Claim.tested(
            str(name), known.statement, known.printed, shown(values), holds(str(name), values),
            known.because if len(values) else "no network of this run gives a value",
            "; ".join(filter(None, (known.source, f"outcomes: {others}" if others else ""))),
            criterion=f"mean within {known.within:.1g}" if known.within else "equal in every network",
            sample=f"{len(values)} of {ds.sizes['seed']} networks", kind="check" if known.exact else "ours",
        ))  # fmt: skip
    return found


def case(parameters, *, seed, quantity):
    """One number and its outcome."""
    return getattr(measures, quantity)(parameters, seed)._asdict()


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "columns", "candidates", "z")
    if not min(parameters["onsets"]) > 0:
        raise StudyError(f"onsets={parameters['onsets']} must be positive strains")
    for key in ("n_vertices", "n_vertices_cells"):
        check_network(voronoi_network, parameters[key])


study = Study(
    name="reference_numbers",
    title="Numbers of the literature on underconstrained networks and vertex models",
    references="the source of each number is in its claim",
    axes=(
        Axis("seed", range(8), "seed of the networks", noun="networks"),
        Axis("quantity", tuple(QUANTITIES), "quantity of the literature", key="quantities"),
    ),
    parameters={
        "n_vertices": 400,
        "n_vertices_cells": 1000,
        "onsets": (0.025, 0.05, 0.1, 0.2),
        "z": 3.4,
        "columns": 6,
        "candidates": 10,
    },
    case=case,
    check=check,
    variables=(
        Variable("value", ("quantity", "seed"), "f8", long_name="the number that the literature gives"),
        Variable("status", ("quantity", "seed"), "i1", long_name="outcome", flags=Status),
    ),
    claims=claims,
)
