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
from critflow.isogonal import isogonal_modes
from critflow.laws import Hookean, PowerLaw, SpringLaw, WormLike
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.moduli import elastic_moduli, fit_stiffening, linear_response, stiffening, transition_moduli
from critflow.network import Network
from critflow.optimize import optimize
from critflow.path import strain_path
from critflow.perimeters import cells_of, critical_from_perimeters, perimeter_moduli, perimeter_state
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
from critflow.supremum import bulk_modulus_bound, modulus_bound

__version__ = version("critflow")

__all__ = [
    "CritflowError",
    "CriticalConfiguration",
    "CriticalManifold",
    "EnvironmentFailure",
    "Hookean",
    "InputError",
    "IntegrityError",
    "Network",
    "NetworkError",
    "PowerLaw",
    "Solution",
    "SolveError",
    "SpringLaw",
    "Stats",
    "Status",
    "StereographicChart",
    "StudyError",
    "WormLike",
    "__version__",
    "bulk_modulus_bound",
    "cells_of",
    "certify",
    "critical_from_lengths",
    "critical_from_perimeters",
    "elastic_moduli",
    "equilibrium",
    "fit_stiffening",
    "honeycomb_network",
    "isogonal_modes",
    "linear_response",
    "modulus_bound",
    "optimize",
    "perimeter_moduli",
    "perimeter_state",
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
