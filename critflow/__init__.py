"""critflow: design spring networks that sit exactly at the rigidity transition."""

from importlib.metadata import version

from critflow.critical import critical_from_lengths
from critflow.generate import (
    honeycomb_network,
    random_sequential_addition,
    three_bar_linkage,
    voronoi_network,
    voronoi_of,
)
from critflow.geometry import StereographicChart, surface_geometry
from critflow.isogonal import face_modes, isogonal_modes
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
from critflow.rigidity import certify, rigidity
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
    "bulk_modulus_bound",
    "certify",
    "critical_from_lengths",
    "elastic_moduli",
    "equilibrium",
    "face_modes",
    "fit_stiffening",
    "honeycomb_network",
    "isogonal_modes",
    "linear_response",
    "optimize",
    "random_sequential_addition",
    "rigidity",
    "spring_state",
    "stiffening",
    "strain_path",
    "surface_geometry",
    "three_bar_linkage",
    "transition_moduli",
    "voronoi_network",
    "voronoi_of",
]
