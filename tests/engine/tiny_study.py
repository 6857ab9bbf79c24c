"""A study without physics, as small as one can be that has everything: shared, inner, integer and status variables."""

from time import sleep

import numpy as np
from matplotlib.figure import Figure

from critflow.engine import Axis, Claim, Coordinate, Study, Variable, decimals, stable_rng
from critflow.result import Status, StudyError


def case(parameters, *, seed, population):
    """Random numbers of the right shapes; `trouble` and `pause` make it misbehave on demand."""
    how = parameters["how"] if f"{seed}-{population}" == parameters["trouble"] else ""
    n_edges = parameters["n_edges"]
    if how == "raise":
        raise ValueError("the trouble\nasked for")
    if how == "longer":
        n_edges += 1
    sleep(parameters["pause"])
    edges = stable_rng(seed, "network").integers(0, 5, (n_edges, 2))
    if how == "other edges":
        edges = edges + 1
    rng = stable_rng(seed, "stress", population)
    if population == "floppy":
        return {"status": Status.floppy, "edges": edges}
    strains = np.array(parameters["strains"])
    return {
        "status": Status.ok,
        "edges": edges,
        "sigma": parameters["spread"] * rng.normal(size=n_edges),
        "modulus": strains * seed,
        "steps": rng.integers(0, 9, strains.size),
        "residual": rng.random(),
    }


def check(parameters, axes):
    if parameters["n_edges"] % 2:
        raise StudyError(f"n_edges={parameters['n_edges']} is odd: give an even number")


def figure(ds):
    picture = Figure()
    picture.subplots().plot(ds.strain, ds.modulus.mean(("seed", "population")))
    return picture


def claims(ds):
    finite = bool(np.isfinite(ds.residual.where(ds.status == Status.ok, 0.0)).all())
    return [
        Claim("finite", "residuals are finite", "all", str(finite), "holds", criterion="all"),
        Claim("count", "there are configurations", "not stated", "8", "measured"),
        Claim(
            "large",
            "residuals | are large",
            "7",
            "0.5",
            "differs",
            because="they are uniform below one",
            criterion="= 7",
        ),
    ]


study = Study(
    name="tiny",
    title="A study without physics",
    axes=(
        Axis("seed", range(4), "seed of the network", noun="network"),
        Axis("population", ("random", "floppy"), "kind of configuration"),
    ),
    parameters={"n_edges": 6, "spread": 0.1, "strains": decimals("0.001:0.003:0.001")}
    | {"trouble": "none", "how": "raise", "pause": 0.0},
    coordinates=(Coordinate("strain", "strains", "volumetric strain"),),
    case=case,
    check=check,
    variables=(
        Variable("edges", ("seed", "edge", "end"), "i4", long_name="tail and head"),
        Variable("sigma", ("population", "seed", "edge"), "f8", long_name="stress"),
        Variable("modulus", ("population", "seed", "strain"), "f4", long_name="modulus", units="N m-1"),
        Variable("steps", ("population", "seed", "strain"), "i2", long_name="steps", fill=-1),
        Variable("residual", ("population", "seed"), "f8", long_name="residual"),
        Variable("status", ("population", "seed"), "i1", long_name="outcome", flags=Status),
    ),
    figures={"modulus": figure},
    animations={"growth": lambda ds: (figure(ds.isel(strain=slice(0, n + 1))) for n in range(ds.sizes["strain"]))},
    claims=claims,
    summary=lambda ds: {"largest": ds.residual.max(), "count": np.int64(ds.seed.size), "nothing": float("nan")},
)
