"""critflow: design spring networks that sit exactly at the rigidity transition."""

from importlib import import_module
from importlib.metadata import version
from typing import Any

from critflow.critical.backbone import Backbone, TautComponent, backbone
from critflow.critical.curvature import StereographicChart, principal_curvatures, surface_geometry
from critflow.critical.gaussian import gaussian_curvature
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import Objective, transition_modulus
from critflow.critical.stress_hessian import flat_directions, stress_hessian
from critflow.design.designed import Design
from critflow.design.isogonal import face_modes, isogonal_modes
from critflow.design.isogonal_design import IsogonalDesign, isogonal_design
from critflow.design.leverage import EdgeLeverage, add, cut, edge_leverage
from critflow.design.modulus_bounds import bulk_modulus_bound, modulus_bound, stiffening_bound
from critflow.design.nearest import Nearest, nearest_critical
from critflow.design.onset_target import OnsetDesign, design_onset
from critflow.design.optimize import optimize
from critflow.design.optimum import Optimum
from critflow.design.pareto import Front, pareto
from critflow.design.prune_towards import PrunedDesign, prune_towards
from critflow.design.stiffness_design import StiffnessDesign, design_stiffness, isotropic_targets
from critflow.design.strained_objective import StrainedObjective, StrainedResponse, strained_response
from critflow.design.targets import design
from critflow.design.tensegrity import SignedStress, Stability, signed_stress, stability
from critflow.design.transition_properties import TransitionProperties, transition_properties
from critflow.examination.examine import examine
from critflow.examination.report import Examination
from critflow.exchange.convert import network_from, write_network
from critflow.exchange.repair import ImportedNetwork
from critflow.mechanics.elasticity import Elasticity
from critflow.mechanics.equilibrium import equilibrium
from critflow.mechanics.hessian import bond_operator, geometric_split, hookean_split
from critflow.mechanics.laws import Cable, Hookean, PowerLaw, SpringLaw, WormLike
from critflow.mechanics.moduli import elastic_moduli, elasticity, transition_moduli
from critflow.mechanics.moduli_bounds import transition_bounds
from critflow.mechanics.perimeters import cells_of, critical_from_perimeters, perimeter_moduli, perimeter_state
from critflow.mechanics.response import linear_response
from critflow.mechanics.springs import spring_state
from critflow.mechanics.stiffening import stiffening
from critflow.mechanics.strain_path import strain_path
from critflow.networks.deformation import DEFORMATIONS, Deformation, deformation_of
from critflow.networks.dilution import diluted
from critflow.networks.faces import Faces, planar_faces
from critflow.networks.fibre_networks import mikado_network, phantom_network
from critflow.networks.lattices import (
    cubic_network,
    diamond_network,
    honeycomb_network,
    kagome_network,
    square_network,
    triangular_network,
)
from critflow.networks.network import Network
from critflow.networks.packings import packing_network
from critflow.networks.pruning import Pruned, prune, pruned_network
from critflow.networks.random_networks import delaunay_network, foam_network, three_bar_linkage, voronoi_network
from critflow.networks.random_points import random_sequential_addition
from critflow.networks.regular_networks import regular_network
from critflow.networks.tessellations import delaunay_of, voronoi_of
from critflow.onset.critical_strain import Onset, critical_strain
from critflow.onset.from_lengths import critical_from_lengths
from critflow.onset.rigidity_surface import RigiditySurface, rigidity_surface, strain_plane
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
from critflow.rigidity.counts import certify, rigidity, zero_modes
from critflow.rigidity.second_order import second_order_rigidity
from critflow.rigidity.stress_space import StressSpace, stresses_of

__version__ = version("critflow")

__all__ = [
    "DEFORMATIONS",
    "Backbone",
    "Cable",
    "CritflowError",
    "CriticalConfiguration",
    "CriticalManifold",
    "Deformation",
    "Design",
    "EdgeLeverage",
    "Elasticity",
    "EnvironmentFailure",
    "Examination",
    "Faces",
    "Front",
    "Hookean",
    "ImportedNetwork",
    "InputError",
    "IntegrityError",
    "IsogonalDesign",
    "Nearest",
    "Network",
    "NetworkError",
    "Objective",
    "Onset",
    "OnsetDesign",
    "Optimum",
    "PowerLaw",
    "Pruned",
    "PrunedDesign",
    "RigiditySurface",
    "SignedStress",
    "Solution",
    "SolveError",
    "SpringLaw",
    "Stability",
    "Stats",
    "Status",
    "StereographicChart",
    "StiffnessDesign",
    "StrainedObjective",
    "StrainedResponse",
    "StressSpace",
    "StudyError",
    "TautComponent",
    "TransitionProperties",
    "WormLike",
    "__version__",
    "add",
    "backbone",
    "bond_operator",
    "bulk_modulus_bound",
    "cells_of",
    "certify",
    "critical_from_lengths",
    "critical_from_perimeters",
    "critical_strain",
    "cubic_network",
    "cut",
    "deformation_of",
    "delaunay_network",
    "delaunay_of",
    "design",
    "design_onset",
    "design_stiffness",
    "diamond_network",
    "diluted",
    "draw",
    "edge_leverage",
    "elastic_moduli",
    "elasticity",
    "equilibrium",
    "examine",
    "face_modes",
    "flat_directions",
    "foam_network",
    "gaussian_curvature",
    "geometric_split",
    "honeycomb_network",
    "hookean_split",
    "isogonal_design",
    "isogonal_modes",
    "isotropic_targets",
    "kagome_network",
    "linear_response",
    "mikado_network",
    "modulus_bound",
    "nearest_critical",
    "network_from",
    "optimize",
    "packing_network",
    "pareto",
    "perimeter_moduli",
    "perimeter_state",
    "phantom_network",
    "planar_faces",
    "principal_curvatures",
    "prune",
    "prune_towards",
    "pruned_network",
    "random_sequential_addition",
    "regular_network",
    "rigidity",
    "rigidity_surface",
    "second_order_rigidity",
    "signed_stress",
    "spring_state",
    "square_network",
    "stability",
    "stiffening",
    "stiffening_bound",
    "strain_path",
    "strain_plane",
    "strained_response",
    "stress_hessian",
    "stresses_of",
    "surface_geometry",
    "three_bar_linkage",
    "transition_bounds",
    "transition_moduli",
    "transition_modulus",
    "transition_properties",
    "triangular_network",
    "voronoi_network",
    "voronoi_of",
    "write_network",
    "write_page",
    "zero_modes",
]

# Functions that draw: matplotlib takes most of the time of an import.
_DRAWING = {"draw": "critflow.drawing", "write_page": "critflow.examination.page"}


def __getattr__(name: str) -> Any:
    """Import a function that draws at its first use."""
    if name in _DRAWING:
        return getattr(import_module(_DRAWING[name]), name)
    raise AttributeError(f"module 'critflow' has no attribute {name!r}")
