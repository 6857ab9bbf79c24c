"""How near to their thresholds the results are that decide `ok`: a table of reached over demanded, over many networks.

`python tests/thresholds.py [N] [VERTICES]` prints it, for the kernel that OPENBLAS_CORETYPE names.  A threshold whose
ratio is near one is met by the luck of a processor; the rule is that every ratio stays below a tenth.
"""

import sys
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from threadpoolctl import threadpool_info

import critflow as cf
from critflow.equilibria import FINEST_TOLERANCE
from critflow.linear_response import TRUSTED_ERROR
from critflow.networks import Network
from critflow.optima import BALANCED as AT_BOUND
from critflow.self_stress import CLEAR_GAP, ZERO_MODE, Spectrum
from critflow.taut_edges import FITTED

MOST = 0.1
"""The largest ratio that the rule allows."""

# Tolerance of a descent by default, one that none meets, and strains of a path.
_DESCENT, _NEVER, _STRAINS = 1e-12, 1e-30, (0.001, 0.01)
Ratios = Iterator[tuple[str, float]]


def of_configurations(network: Network, rng: np.random.Generator) -> Ratios:
    """The gap of the counts of a random stress."""
    critical = cf.CriticalManifold(network).configuration(np.abs(rng.standard_normal(network.n_edges)))
    spectrum = Spectrum(network, critical.coordinates)
    largest_zero, smallest_nonzero = spectrum.null_space(spectrum.n_self_stresses, of_stresses=True)[1]
    yield "largest singular value that is zero", largest_zero / ZERO_MODE
    yield "least singular value that is not", CLEAR_GAP * ZERO_MODE / smallest_nonzero


def of_optima(network: Network, rng: np.random.Generator) -> Ratios:
    """Gradients that rounding leaves at the ends of descents, and the stiffest configuration next to its bound.

    A descent ends as soon as it meets its tolerance, so it is continued here until rounding stops it.
    """
    best = cf.optimize(network, "B_0", throw=False)
    yield "B_0 of the closed form, from its bound", abs(best.objective / best.bound - 1) / AT_BOUND
    for name in ("V_L", "V_tau", "G_0"):
        if not cf.optimize(network, name, throw=False):
            continue
        found = cf.optimize(network, name, tolerance=_NEVER, throw=False)
        yield f"gradient of {name} that rounding leaves", found.stats.residual / _DESCENT


def of_lengths(network: Network, rng: np.random.Generator) -> Ratios:
    """Lengths of the critical configuration of random rest lengths, all of whose edges are taut."""
    lengths = 1 + 0.1 * rng.standard_normal(network.n_edges)
    found = cf.critical_from_lengths(network, lengths, throw=False)
    if found.ok:
        ratio = found.value.lengths / lengths
        yield "lengths of given rest lengths", float(np.ptp(ratio) / ratio.mean()) / FITTED


def of_responses(network: Network, rng: np.random.Generator) -> Ratios:
    """Errors of moduli and coefficients, and forces past the transition."""
    critical = cf.CriticalManifold(network).configuration(np.abs(rng.standard_normal(network.n_edges)) + 0.1)
    moduli = cf.elasticity(critical).value
    yield "error of B_0", moduli.errors.bulk / abs(moduli.bulk) / TRUSTED_ERROR
    growth = cf.stiffening(critical)
    yield "error of C_B", growth.stats.error_bound.C_B / abs(growth.value.C_B) / TRUSTED_ERROR
    path = cf.strain_path(critical, _STRAINS, throw=False).value
    unit = path.states[-1].stiffness_scale * path.states[-1].length_scale
    yield "force on a path", float(path.max_force.max()) / unit / (10 * FINEST_TOLERANCE)
    yield "error of B on a path", float((path.bulk_modulus_error / path.bulk_modulus).max()) / TRUSTED_ERROR


Group = Callable[[Network, np.random.Generator], Ratios]
SCENE: tuple[Group, ...] = (of_configurations, of_optima, of_lengths, of_responses)


def table(networks: int, n_vertices: int, groups: Sequence[Group] = SCENE) -> dict[str, np.ndarray]:
    """Reached over demanded by threshold, one number a network where the result is `ok`."""
    found: dict[str, list[float]] = {}
    for seed in range(networks):
        network, rng = cf.voronoi_network(n_vertices=n_vertices, seed=seed), np.random.default_rng(seed)
        for group in groups:
            for name, ratio in group(network, rng):
                found.setdefault(name, []).append(ratio)
    return {name: np.array(ratios) for name, ratios in found.items()}


def show(groups: Sequence[Group], networks: int = 100, n_vertices: int = 100) -> None:
    """Print the table."""
    kernels = {one["architecture"] for one in threadpool_info() if one.get("internal_api") == "openblas"}
    print(f"networks: {networks} of {n_vertices} vertices, kernel {', '.join(sorted(kernels))}")
    print(f"{'threshold':42} {'n':>4} {'median':>9} {'99 %':>9} {'largest':>9}")
    for name, ratios in table(networks, n_vertices, groups).items():
        values = (np.median(ratios), np.percentile(ratios, 99), ratios.max())
        mark = "" if ratios.max() < MOST else "  above the rule"
        print(f"{name:42} {len(ratios):4} {' '.join(f'{value:9.1e}' for value in values)}{mark}")


if __name__ == "__main__":
    show(SCENE, *map(int, sys.argv[1:]))
