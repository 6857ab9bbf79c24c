"""What `import critflow` offers, by the modules that hold it."""

from critflow.bounds import transition_bounds
from critflow.coefficients import stiffening
from critflow.critical import critical_from_lengths
from critflow.equilibrium import equilibrium
from critflow.flatness import flat_directions, stress_hessian
from critflow.generate import (
    foam_network,
    random_sequential_addition,
    three_bar_linkage,
    voronoi_network,
    voronoi_of,
)
from critflow.geometry import StereographicChart, gaussian_curvature, principal_curvatures, surface_geometry
from critflow.hessian import bond_operator, geometric_split, hookean_split
from critflow.isogonal import face_modes, isogonal_modes
from critflow.lattices import (
    cubic_network,
    diamond_network,
    honeycomb_network,
    kagome_network,
    square_network,
    triangular_network,
)
from critflow.laws import Hookean, PowerLaw, SpringLaw, WormLike
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.moduli import elastic_moduli, fit_stiffening, linear_response, transition_moduli
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
from critflow.rigidity import certify, rigidity, zero_modes
from critflow.second_order import second_order_rigidity
from critflow.springs import spring_state
from critflow.stresses import StressSpace, stresses_of
from critflow.supremum import bulk_modulus_bound, modulus_bound
from critflow.tensegrity import SignedStress, Stability, signed_stress, stability

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
    "SignedStress",
    "Solution",
    "SolveError",
    "SpringLaw",
    "Stability",
    "Stats",
    "Status",
    "StereographicChart",
    "StressSpace",
    "StudyError",
    "WormLike",
    "bond_operator",
    "bulk_modulus_bound",
    "cells_of",
    "certify",
    "critical_from_lengths",
    "critical_from_perimeters",
    "cubic_network",
    "diamond_network",
    "elastic_moduli",
    "equilibrium",
    "face_modes",
    "fit_stiffening",
    "flat_directions",
    "foam_network",
    "gaussian_curvature",
    "geometric_split",
    "honeycomb_network",
    "hookean_split",
    "isogonal_modes",
    "kagome_network",
    "linear_response",
    "modulus_bound",
    "optimize",
    "perimeter_moduli",
    "perimeter_state",
    "principal_curvatures",
    "random_sequential_addition",
    "rigidity",
    "second_order_rigidity",
    "signed_stress",
    "spring_state",
    "square_network",
    "stability",
    "stiffening",
    "strain_path",
    "stress_hessian",
    "stresses_of",
    "surface_geometry",
    "three_bar_linkage",
    "transition_bounds",
    "transition_moduli",
    "triangular_network",
    "voronoi_network",
    "voronoi_of",
    "zero_modes",
]
