"""critflow: design spring networks that sit exactly at the rigidity transition."""

from importlib import import_module
from importlib.metadata import version
from typing import Any

from critflow.critical.isogonal import isogonal_modes as isogonal_modes
from critflow.critical.manifold import CriticalConfiguration as CriticalConfiguration
from critflow.critical.manifold import CriticalManifold as CriticalManifold
from critflow.critical.nearest import nearest_critical as nearest_critical
from critflow.critical.quantity import Quantity as Quantity
from critflow.design.optimize import optimize as optimize
from critflow.design.pareto import pareto as pareto
from critflow.design.prune_towards import prune_towards as prune_towards
from critflow.design.targets import design as design
from critflow.examination.examine import examine as examine
from critflow.exchange.convert import network_from as network_from
from critflow.exchange.convert import write_network as write_network
from critflow.generators.dilution import diluted as diluted
from critflow.generators.fibre_networks import fibre_network as fibre_network
from critflow.generators.lattices import lattice as lattice
from critflow.generators.packings import packing_network as packing_network
from critflow.generators.random_networks import delaunay_network as delaunay_network
from critflow.generators.random_networks import foam_network as foam_network
from critflow.generators.random_networks import three_bar_linkage as three_bar_linkage
from critflow.generators.random_networks import voronoi_network as voronoi_network
from critflow.generators.regular_networks import regular_network as regular_network
from critflow.networks.deformation import Deformation as Deformation
from critflow.networks.network import Network as Network
from critflow.networks.pruning import pruned as pruned
from critflow.onset.critical_strain import critical_strain as critical_strain
from critflow.onset.from_lengths import critical_from_lengths as critical_from_lengths
from critflow.onset.rigidity_surface import rigidity_surface as rigidity_surface
from critflow.paths.strain_path import strain_path as strain_path
from critflow.quantities.largest_modulus import upper_bound as upper_bound
from critflow.quantities.leverage import edge_leverage as edge_leverage
from critflow.quantities.properties import properties as properties
from critflow.quantities.vocabulary import quantity as quantity
from critflow.response.elasticity import elasticity as elasticity
from critflow.response.stiffening import stiffening as stiffening
from critflow.response.weak_forces import weak_forces as weak_forces
from critflow.result import CritflowError as CritflowError
from critflow.result import InputError as InputError
from critflow.result import Solution as Solution
from critflow.result import SolveError as SolveError
from critflow.result import Status as Status
from critflow.rigidity.counts import certify as certify
from critflow.rigidity.counts import rigidity as rigidity
from critflow.rigidity.signed_stress import stability as stability
from critflow.rigidity.stress_space import self_stresses as self_stresses
from critflow.springs.equilibrium import equilibrium as equilibrium
from critflow.springs.laws import Cable as Cable
from critflow.springs.laws import Hookean as Hookean
from critflow.springs.laws import PowerLaw as PowerLaw
from critflow.springs.laws import SpringLaw as SpringLaw
from critflow.springs.laws import WormLike as WormLike
from critflow.springs.state import spring_state as spring_state
from critflow.springs.tissue import critical_from_perimeters as critical_from_perimeters
from critflow.springs.tissue import tissue as tissue
from critflow.springs.weak_energies import AngleSprings as AngleSprings
from critflow.springs.weak_energies import PointForces as PointForces
from critflow.springs.weak_energies import SoftSprings as SoftSprings
from critflow.springs.weak_energies import Temperature as Temperature

__version__ = version("critflow")


def __getattr__(name: str) -> Any:
    """Import the function that draws at its first use: matplotlib takes most of the time of an import."""
    if name == "draw":
        return import_module("critflow.figures.drawing").draw
    raise AttributeError(f"module 'critflow' has no attribute {name!r}")
