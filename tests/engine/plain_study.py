"""A small study without figures, for tests that run it often. The environment slows its cases and counts them."""

import os
import time

import numpy as np

from critflow.engine import Axis, Claim, Study, Variable
from critflow.result import Status

# Seeds that fail or are interrupted in this process. They are no parameters, so that a case may succeed later.
broken: set[int] = set()
stopped: set[int] = set()


def case(parameters, *, seed):
    """Numbers that depend on the parameters and on the seed."""
    if tally := os.environ.get("CRITFLOW_TEST_TALLY"):
        with open(tally, "a") as file:
            file.write(f"{seed}\n")
    time.sleep(float(os.environ.get("CRITFLOW_TEST_PAUSE", "0")))
    if seed in stopped:
        raise KeyboardInterrupt
    if seed in broken:
        raise ValueError("broken on demand")
    values = parameters["scale"] * (seed + np.arange(4.0))
    return {"status": Status.ok, "shared": np.arange(4), "values": values, "total": values.sum()}


def claims(ds):
    return [Claim("total", "totals grow", "yes", str(float(ds.total.sum())), "holds", criterion="> 0")]


study = Study(
    name="plain",
    title="Numbers that differ from case to case",
    axes=(Axis("seed", range(4), "seed"),),
    parameters={"scale": 1.0},
    case=case,
    variables=(
        Variable("shared", ("place",), "i4", long_name="the same in every case"),
        Variable("values", ("seed", "place"), "f8", long_name="numbers"),
        Variable("total", ("seed",), "f8", long_name="their sum"),
        Variable("status", ("seed",), "i1", long_name="outcome", flags=Status),
    ),
    claims=claims,
    summary=lambda ds: {"total": ds.total.sum()},
)
