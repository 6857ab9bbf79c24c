"""The table of `thresholds` for extras: `python tests/extras/thresholds_of_extras.py [N] [VERTICES]`, from the root."""

import sys
from pathlib import Path

import numpy as np

import critflow as cf
import critflow_extras as ce
from critflow.networks import Network
from critflow_extras.certificates.certify import BALANCED
from critflow_extras.fronts.pareto import FRONT_CERTIFIED
from critflow_extras.targets.constrained import RESTORED

sys.path.insert(0, str(Path(__file__).parents[1]))

from thresholds import Ratios, show


def of_certificates(network: Network, rng: np.random.Generator) -> Ratios:
    """Force balance of a random stress, as its certificate demands."""
    critical = cf.CriticalManifold(network).configuration(np.abs(rng.standard_normal(network.n_edges)))
    yield "balance of a random stress", critical.residual / BALANCED


def of_designs(network: Network, rng: np.random.Generator) -> Ratios:
    """Targets of a design by stress, and of one by stiffness."""
    found = ce.design(network, {"B_0": 0.2, "C_B": 0.1}, throw=False)
    if found.reached:
        yield "targets of a change of stress", found.stats.residual / RESTORED
    cell = cf.delaunay_network(24, seed=int(rng.integers(1000)))
    lengths = np.linalg.norm(cell.bond_vectors(cell.positions), axis=1)
    state = cf.spring_state(cell, lengths, cell.positions)
    found = ce.design(state, {"poisson": 0.1}, change="stiffness", throw=False)
    if found.reached:
        yield "Poisson's ratio of a change of stiffness", found.stats.residual / RESTORED


def of_fronts(network: Network, rng: np.random.Generator) -> Ratios:
    """First-order conditions of a point between the ends of a front."""
    front = ce.pareto(network, ["B_0", "V_L"], 3, throw=False)
    residuals = front.residuals[np.array([status is cf.Status.ok for status in front.statuses])]
    if residuals.size:
        yield "first-order conditions of a front", float(residuals.max()) / FRONT_CERTIFIED


if __name__ == "__main__":
    show((of_certificates, of_designs, of_fronts), *map(int, sys.argv[1:]))
