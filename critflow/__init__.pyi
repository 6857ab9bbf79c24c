"""The public names and their modules, for type checkers and for `lazy_loader`."""

from .deformation import Deformation as Deformation
from .elastic import elasticity as elasticity
from .equilibria import equilibrium as equilibrium
from .growth import stiffening as stiffening
from .isogonal import isogonal_modes as isogonal_modes
from .lattices import lattice as lattice
from .lattices import three_bar_linkage as three_bar_linkage
from .lengths import critical_from_lengths as critical_from_lengths
from .manifold import CriticalConfiguration as CriticalConfiguration
from .manifold import CriticalManifold as CriticalManifold
from .network_files import read_critical as read_critical
from .network_files import read_network as read_network
from .network_files import to_graph as to_graph
from .network_files import to_tables as to_tables
from .network_files import write_network as write_network
from .networks import Network as Network
from .optima import optimize as optimize
from .paths import strain_path as strain_path
from .points import delaunay_network as delaunay_network
from .points import voronoi_network as voronoi_network
from .quantities import Quantity as Quantity
from .quantities import quantity as quantity
from .quantities import upper_bound as upper_bound
from .result import CritflowError as CritflowError
from .result import InputError as InputError
from .result import Solution as Solution
from .result import SolveError as SolveError
from .result import Status as Status
from .springs import Cable as Cable
from .springs import Hookean as Hookean
from .springs import PowerLaw as PowerLaw
from .springs import SpringLaw as SpringLaw
from .springs import WormLike as WormLike
from .springs import spring_state as spring_state

__all__: list[str]
__version__: str
