"""`network_from` and `write_network`: anything that describes a network in, and any format out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked, shown
from critflow.exchange.boundaries import Pins, hull_volume, with_pins
from critflow.exchange.checks import check
from critflow.exchange.data import NetworkData, data_of, from_zero, numbers
from critflow.exchange.datasets import from_dataset
from critflow.exchange.formats import readable_format, writable_format
from critflow.exchange.graphs import from_graph
from critflow.exchange.meshes import from_compas, from_mesh, from_polygons
from critflow.exchange.offsets import with_offsets
from critflow.exchange.particles import from_atoms
from critflow.exchange.pictures import from_labels, from_skeleton
from critflow.exchange.repair import ImportedNetwork, imported, in_its_plane
from critflow.exchange.tiling import Copies, tiled
from critflow.networks.network import Network
from critflow.result import CritflowError, InputError, Solution

_KINDS = ("edges", "polygons", "picture", "labels")


@checked
def network_from(
    source: Any = None,
    *,
    cell: ArrayLike | None = None,
    pins: Pins = None,
    nearest: bool = False,
    strict: bool = False,
    contract: bool = False,
    join_crossings: bool = False,
    volume: float | str | None = None,
    **given: Any,
) -> ImportedNetwork:
    """A network from a file or an object of another program, checked and repaired, with one sentence for each repair.

    source   a path; a networkx graph; ASE atoms; a meshio mesh; a COMPAS graph; a case of a critflow
             dataset; a `Network`; or None, with the arrays
             edges= and positions= (and offsets= or bond_vectors=), polygons= and positions=, picture= or labels=
    cell     (d, d) rows are the cell vectors; without one the cell of the source is used
    pins     fixed vertices: "hull", "degree", "box", a list of vertices, or a mask
    nearest  accept nearest images of edges longer than 0.4 of the height of the cell
    strict   refuse a source that needs any repair
    contract  join the edges of vertices of two edges: springs in series
    join_crossings  put a vertex where two edges of a planar network cross
    volume   V to which the moduli of a network without a cell refer; "hull": that of the convex hull

    Many parameters: hints that a source may lack.  Further keywords are those of the source: offsets, bond_vectors,
    stiffness, rest_lengths, force_densities, positions, edges, cutoff, pixel.  Raises `InputError` or `NetworkError`
    with a question where the source is ambiguous, and `EnvironmentFailure` where a package is missing.

    >>> import critflow as cf
    >>> cf.network_from(edges=[[0, 1], [1, 2]], positions=[[0, 0], [1, 1], [2, 0]], pins=[0, 2]).network
    Network(3 vertices, 2 edges, 2 dimensions, 2 pins, z = 1.333)
    """
    data = _record(source, given)
    if cell is not None:
        data = replace(data, cell=numbers(cell, "the cell"))
    if data.cell is not None and data.cell.shape != (data.dimension,) * 2:
        data = replace(data, cell=_cell_in(data.cell, data.dimension))
    check(data)
    data = in_its_plane(data)
    found = imported(with_pins(with_offsets(data, nearest), pins), strict, contract, join_crossings)
    if volume is None and isinstance(source, Network):
        volume = source.reference_volume
    return found if volume is None else _referring(found, volume)


@checked
def write_network(
    network: Any,
    path: str | PathLike[str],
    coordinates: ArrayLike | None = None,
    *,
    rest_lengths: ArrayLike | None = None,
    force_densities: ArrayLike | None = None,
    copies: Copies = 1,
    **options: Any,
) -> None:
    """Write a network to a file whose ending names the format, with all digits that the format can hold.

    network          a `Network`; a configuration or state, with its coordinates, lengths and stresses; or a `Solution`
                     that holds one of these
    coordinates      (N_v, d); positions of the network by default
    rest_lengths     ℓ (N_b,); the lengths by default, where a format needs them
    force_densities  σ (N_b,)
    copies           of a periodic cell along each cell vector, one number or d numbers, as one larger network

    Many parameters: the state of a network is more than its graph.  Options: size (mm) and width or radius (mm) of
    drawings and solids, which are cut at the border of the cell.  Raises `InputError` where the format cannot hold the
    network, `EnvironmentFailure` where its package is missing.

    >>> import critflow as cf
    >>> import tempfile
    >>> path = tempfile.mkdtemp() + '/network.csv'
    >>> cf.write_network(cf.lattice("honeycomb", 2, 2), path)
    >>> print(cf.network_from(path).network)
    Network(8 vertices, 12 edges, 2 dimensions, periodic, z = 3)
    """
    target = Path(path)
    write = writer_to(target, network, coordinates)
    write(tiled(_state(network, coordinates, rest_lengths, force_densities), copies), target, **options)


def writer_to(path: Path, network: Any, coordinates: ArrayLike | None = None) -> Callable[..., None]:
    """The writer of a file, checked against the network: commands call it before they compute."""
    known = writable_format(path)
    assert known.write is not None
    if known.accepts is not None:
        known.accepts(_state(network, coordinates, None, None))
    return known.write


def _referring(found: ImportedNetwork, volume: float | str) -> ImportedNetwork:
    """The network with the volume to which its moduli refer."""
    if isinstance(volume, str):
        if volume != "hull":
            raise InputError(f"the volume must be a number or 'hull', not {volume!r}")
        volume = hull_volume(found.positions)
        found = replace(found, notes=(*found.notes, f"moduli refer to the convex hull, V = {volume:.8g}"))
    return replace(found, value=found.value.with_volume(volume))


def _state(
    thing: Any, coordinates: ArrayLike | None, rest_lengths: ArrayLike | None, force_densities: ArrayLike | None
) -> NetworkData:
    """The record of a network, or of a configuration or state with the values that are not given."""
    if isinstance(thing, ImportedNetwork):
        rest_lengths = thing.rest_lengths if rest_lengths is None else rest_lengths
        force_densities = thing.force_densities if force_densities is None else force_densities
    thing = thing.value if isinstance(thing, Solution) else thing
    if isinstance(thing, Network):
        return data_of(thing, coordinates, rest_lengths, force_densities)
    if not isinstance(getattr(thing, "network", None), Network) or not hasattr(thing, "coordinates"):
        raise InputError(f"{shown(thing)} cannot be written: give a network, a configuration or a state")
    if rest_lengths is None:
        rest_lengths = getattr(thing, "rest_lengths", getattr(thing, "lengths", None))
    force_densities = getattr(thing, "sigma", None) if force_densities is None else force_densities
    return data_of(
        thing.network, thing.coordinates if coordinates is None else coordinates, rest_lengths, force_densities
    )


def _record(source: Any, given: dict[str, Any]) -> NetworkData:
    """The record of a source, recognised by its type or its attributes."""
    if isinstance(source, str | PathLike):
        return _overridden(_read(Path(source)), given)
    if source is None:
        return _from_keywords(given)
    if isinstance(source, Sequence | np.ndarray):
        return _from_keywords({"edges": source, **given})
    if isinstance(source, Network | Solution) or isinstance(getattr(source, "network", None), Network):
        return _overridden(_state(source, given.pop("positions", None), None, None), given)
    try:
        return _overridden(_foreign(source, given), given)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        if isinstance(error, CritflowError):
            raise
        raise InputError(f"{shown(source)} cannot be read as a network: {error}") from error


def _foreign(source: Any, given: dict[str, Any]) -> NetworkData:
    """The record of an object of another library, without the keywords that it takes from those given."""
    if hasattr(source, "data_vars"):
        return from_dataset(source)
    if hasattr(source, "get_positions") and hasattr(source, "get_pbc"):
        return from_atoms(source, **{key: given.pop(key) for key in ("edges", "offsets", "cutoff") if key in given})
    if hasattr(source, "node_attributes") and hasattr(source, "edge_attribute"):
        return from_compas(source)
    if hasattr(source, "nodes") and hasattr(source, "number_of_edges"):
        positions = given.pop("positions", None)
        if positions is not None and not isinstance(positions, Mapping):
            if len(positions) != len(source.nodes):
                raise InputError(f"positions must have one row for each of the {len(source.nodes)} nodes")
            positions = dict(zip(source.nodes, positions, strict=True))
        return from_graph(source, positions)
    if hasattr(source, "points") and hasattr(source, "cells"):
        return from_mesh(source)
    raise InputError(
        f"{shown(source)} is not a known source of a network: give a file, a graph, atoms, a mesh, or edges= and "
        "positions="
    )


def _read(path: Path) -> NetworkData:
    known = readable_format(path)
    assert known.read is not None
    if known.name != "tables" and not path.is_file():
        raise InputError(f"there is no file {path}: check its name")
    try:
        return known.read(path)
    except FileNotFoundError as missing:
        raise InputError(
            f"there is no file {missing.filename}: the tables of a network are NAME_edges{path.suffix} and "
            f"NAME_vertices{path.suffix}"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file: check its name") from None
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        if isinstance(error, CritflowError):
            raise
        raise InputError(f"{path} cannot be read as {known.name}: {error}") from error


def _from_keywords(given: dict[str, Any]) -> NetworkData:
    kind = next((kind for kind in _KINDS if kind in given), None)
    if kind is None:
        raise InputError("give a source: a file, an object, or one of edges=, polygons=, picture=, labels=")
    value, pixel = given.pop(kind), given.pop("pixel", 1.0)
    if not isinstance(pixel, int | float) or not 0 < pixel < np.inf:
        raise InputError(f"pixel must be a positive size, not {shown(pixel)}")
    if kind == "picture":
        return _overridden(from_skeleton(value, pixel), given)
    if kind == "labels":
        return _overridden(from_labels(value, pixel), given)
    if "positions" not in given:
        raise InputError(f"{kind}= needs positions=, one row for each vertex")
    positions = _table(given.pop("positions"), "positions")
    if kind == "polygons":
        return _overridden(from_polygons(positions, value), given)
    edges = _table(value, "edges", whole=True)
    return _overridden(from_zero(NetworkData(edges, positions)), given)


def _overridden(data: NetworkData, given: dict[str, Any]) -> NetworkData:
    """The record with values given by keyword, each of one row for an edge."""
    known = ("offsets", "bond_vectors", "stiffness", "rest_lengths", "force_densities")
    unknown = set(given) - set(known)
    if unknown:
        raise InputError(f"this source takes no keyword {sorted(unknown)[0]!r}: choose from {', '.join(known)}")
    values: dict[str, Any] = {}
    for name, value in given.items():
        if value is None:
            continue
        array = numbers(value, name, whole=name == "offsets")
        if name == "stiffness" and array.ndim == 0:
            array = np.full(data.n_edges, float(array))
        if array.shape[:1] != (data.n_edges,):
            raise InputError(f"{name} must have one row for each of the {data.n_edges} edges, not shape {array.shape}")
        values[name] = array
    return replace(data, **values)


def _table(values: Any, name: str, whole: bool = False) -> Any:
    array = numbers(values, name, whole)
    if array.ndim != 2:
        raise InputError(f"{name} must be a table of numbers, one row each, not of shape {array.shape}")
    return array


def _cell_in(cell: Any, dimension: int) -> Any:
    """A cell of a plane given in space, or side lengths given in place of vectors."""
    if cell.ndim == 1 and len(cell) >= dimension:
        return np.diag(cell[:dimension])
    if cell.ndim == 0:
        return float(cell) * np.eye(dimension)
    if cell.ndim == 2 and cell.shape == (3, 3) and dimension == 2:
        return cell[:2, :2]
    raise InputError(
        f"the cell must be a {dimension} × {dimension} matrix or {dimension} side lengths, not {cell.shape}"
    )
