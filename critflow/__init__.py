"""critflow: design spring networks that sit exactly at the rigidity transition."""

from importlib.metadata import version

from critflow.critical import critical_from_lengths
from critflow.flatness import flat_directions, stress_hessian
from critflow.generate import (
    honeycomb_network,
    random_sequential_addition,
    three_bar_linkage,
    voronoi_network,
    voronoi_of,
)
from critflow.geometry import StereographicChart, surface_geometry
from critflow.hessian import bond_operator, geometric_split, hookean_split
from critflow.isogonal import isogonal_modes
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.moduli import elastic_moduli, fit_stiffening, linear_response, stiffening, transition_moduli
from critflow.network import Network
from critflow.optimize import bulk_modulus_bound, optimize
from critflow.path import strain_path
from critflow.result import (
    CritflowError,
    EnvironmentFailure,
    InputError,
    IntegrityError,
    NetworkError,
    Solution,
    SolveError,
    Stats,
    Status,
    StudyError,
)
from critflow.rigidity import certify, rigidity, zero_modes
from critflow.second_order import second_order_rigidity
from critflow.springs import equilibrium, spring_state

__version__ = version("critflow")

__all__ = [
    "CritflowError",
    "CriticalConfiguration",
    "CriticalManifold",
    "EnvironmentFailure",
    "InputError",
    "IntegrityError",
    "Network",
    "NetworkError",
    "Solution",
    "SolveError",
    "Stats",
    "Status",
    "StereographicChart",
    "StudyError",
    "__version__",
    "bond_operator",
    "bulk_modulus_bound",
    "certify",
    "critical_from_lengths",
    "elastic_moduli",
    "equilibrium",
    "fit_stiffening",
    "flat_directions",
    "geometric_split",
    "honeycomb_network",
    "hookean_split",
    "isogonal_modes",
    "linear_response",
    "optimize",
    "random_sequential_addition",
    "rigidity",
    "second_order_rigidity",
    "spring_state",
    "stiffening",
    "strain_path",
    "stress_hessian",
    "surface_geometry",
    "three_bar_linkage",
    "transition_moduli",
    "voronoi_network",
    "voronoi_of",
    "zero_modes",
]
