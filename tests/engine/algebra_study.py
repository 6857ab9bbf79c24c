"""Dense algebra, large enough that a library with several threads would sum in another order."""

import os
import time

import numpy as np
import psutil
from threadpoolctl import threadpool_info

from critflow.engine import Axis, Study, Variable, stable_rng
from critflow.result import Status


def case(parameters, *, seed, part):
    """Products, a factorisation and eigenvalues; the threads of the libraries and the sockets of the process."""
    time.sleep(float(os.environ.get("CRITFLOW_TEST_PAUSE", "0")))
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


study = Study(
    name="algebra",
    title="Dense algebra",
    axes=(Axis("seed", range(4), "seed"), Axis("part", ("left", "right", "middle"), "part")),
    parameters={"size": 150},
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
