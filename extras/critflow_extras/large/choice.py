"""Which of the solvers for large matrices are installed, and from which size each is the fastest.

Sizes are numbers of entries of the upper triangle.  Measured on Voronoi networks of 300 to 10⁵ vertices and foams of 60
to 8,000, for one numeric factorisation and four solves, Pardiso is faster than qdldl for the Laplacian, the elastic
Hessian and the saddle matrix from 24,000, 9,000 and 40,000 entries in the plane, and 2,000, 5,000 and 6,000 in space.

Multigrid serves Laplacians in space, which have 3 entries a vertex of a foam.  It is faster than an elimination for one
matrix and three solves, by a third or more: with stresses over one decade it takes 0.03 s at 5,000 vertices, against
0.02 and 0.07 of Pardiso and SuperLU, then 0.05 against 0.04 and 0.24 at 10,000, 0.11 against 0.14 and 1.3 at 20,000,
and 0.3 against 0.7 of Pardiso at 50,000.  Stresses over four decades need three times as many steps.
"""

from __future__ import annotations

from typing import Any

from critflow_extras.large import multigrid, pardiso
from critflow_extras.large.iterative_factor import MultigridFactor

PARDISO = (20_000, 3_000)  # entries up to which other eliminations are faster, in the plane and in space
MULTIGRID = {"pardiso": 60_000, "superlu": 15_000}  # entries up to which an elimination is faster


def installed_solvers() -> dict[str, Any]:
    """The solvers by name of which the library is there."""
    solvers: dict[str, Any] = {"pardiso": pardiso.Pardiso} if pardiso.MKL is not None else {}
    return solvers | ({"pyamg": MultigridFactor} if multigrid.INSTALLED else {})


def fastest_solver(backend: str, n_entries: int, in_space: bool, laplacian: bool) -> str:
    """The name of the fastest of these solvers and of a given one, for a matrix as of `choose_backend`."""
    solvers = installed_solvers()
    if "pardiso" in solvers and n_entries > PARDISO[in_space]:
        backend = "pardiso"
    if "pyamg" in solvers and in_space and laplacian and n_entries > MULTIGRID.get(backend, n_entries):
        backend = "pyamg"
    return backend
