"""Dense algebra, large enough that a library with several threads would sum in another order."""

import ctypes
import os
import sys
import time

import numpy as np
import psutil
from threadpoolctl import threadpool_info

from critflow.result import Status
from critflow.workflow import Axis, Study, Variable, stable_rng


def case(parameters, *, seed, part):
    """Products, a factorisation and eigenvalues; how many threads the libraries have, and who listens to whom."""
    if parameters["once"]:
        _die_once(parameters["once"], f"{seed}-{part}")
    time.sleep(parameters["pause"])
    matrix = stable_rng(seed, part).normal(size=(parameters["size"], parameters["size"]))
    product = matrix @ matrix.T
    return {
        "status": Status.ok,
        "product": product.sum(axis=0),
        "solution": np.linalg.solve(product, matrix[0]),
        "eigenvalues": np.linalg.eigvalsh(product),
        "threads": max(library["num_threads"] for library in threadpool_info()),
        "sockets": len(psutil.Process().net_connections("inet")),
    }


def _die_once(folder, name):
    """Kill this process the first time that a case comes here."""
    try:
        os.close(os.open(os.path.join(folder, name), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return
    if name.endswith("left") and sys.platform != "win32":
        os.kill(os.getpid(), 9)
    ctypes.string_at(0)  # a crash in compiled code


study = Study(
    name="algebra",
    title="Dense algebra",
    axes=(Axis("seed", range(6), "seed"), Axis("part", ("left", "right"), "part", choices=("middle",))),
    parameters={"size": 150, "pause": 0.0, "once": ""},
    case=case,
    variables=(
        Variable("product", ("seed", "part", "row"), "f8", long_name="sums of a product"),
        Variable("solution", ("seed", "part", "row"), "f8", long_name="solution"),
        Variable("eigenvalues", ("part", "seed", "row"), "f8", long_name="eigenvalues"),
        Variable("threads", ("seed", "part"), "i2", long_name="threads of the busiest library", volatile=True),
        Variable("sockets", ("seed", "part"), "i2", long_name="sockets of the process", volatile=True),
        Variable("status", ("seed", "part"), "i1", long_name="outcome", flags=Status),
    ),
)
