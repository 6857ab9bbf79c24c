"""The table of formats: the reader and the writer of each file ending."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from critflow.exchange.data import NetworkData
from critflow.exchange.drawings import require_plane, write_dxf, write_svg
from critflow.exchange.graphs import read_graph, write_graph
from critflow.exchange.meshes import read_compas, read_mesh, require_no_cell, write_compas, write_mesh
from critflow.exchange.node_link import read_node_link, write_node_link
from critflow.exchange.packages import optional
from critflow.exchange.particles import read_gsd, read_lammps, write_gsd, write_lammps
from critflow.exchange.solids import write_solid
from critflow.exchange.tables import read_tables, write_tables
from critflow.result import InputError


@dataclass(frozen=True)
class Format:
    """One format: file endings, reader and writer, of which either may be missing.

    package   optional module that the writer needs
    accepts   refuses, with `InputError`, a network that the format cannot hold
    """

    name: str
    endings: tuple[str, ...]
    read: Callable[[Path], NetworkData] | None
    write: Callable[..., None] | None
    package: str = ""
    accepts: Callable[[NetworkData], None] | None = None


def _read_tables(path: Path) -> NetworkData:
    return read_tables(*table_paths(path))


def _write_tables(data: NetworkData, path: Path) -> None:
    write_tables(data, *table_paths(path))


FORMATS = (
    Format("tables", (".csv", ".txt", ".tsv"), _read_tables, _write_tables),
    Format("graph", (".graphml", ".gml"), read_graph, write_graph, "networkx"),
    Format("graph", (".json",), read_node_link, write_node_link),
    Format("LAMMPS data", (".data", ".lmp", ".lammps"), read_lammps, write_lammps),
    Format("GSD", (".gsd",), read_gsd, write_gsd, "gsd.hoomd"),
    Format("mesh", (".vtu", ".vtk"), read_mesh, write_mesh, "meshio"),
    # Those without lines, or without data of lines.
    Format("mesh", (".msh", ".ply", ".obj", ".xdmf"), read_mesh, None),
    Format("COMPAS graph", (".compas",), read_compas, write_compas, "compas.datastructures", require_no_cell),
    Format("SVG drawing", (".svg",), None, write_svg, accepts=require_plane),
    Format("DXF drawing", (".dxf",), None, write_dxf, "ezdxf", require_plane),
    Format("solid", (".stl", ".3mf"), None, write_solid),
)


def readable_format(path: Path) -> Format:
    """The format in which a file is read; `InputError` for files of many networks and for pictures."""
    if path.suffix == ".nc":
        raise InputError(
            f"{path.name} is a dataset of networks: give one case of it, dataset.sel(seed=0, ...), or --set seed=0 "
            "to the command"
        )
    if path.suffix.lower() in (".png", ".tif", ".tiff", ".jpg", ".npy"):
        raise InputError(f"{path.name} is an array: load it, and give it as picture= (fibres) or labels= (a tissue)")
    known = format_of(path)
    if known.read is None:
        raise InputError(f"the format {known.name} is written only: give a file that holds a network")
    return known


def writable_format(path: Path) -> Format:
    """The format in which a file can be written, before anything is computed for it.

    Raises `InputError` for an ending that cannot be written and for a folder that does not exist, and
    `EnvironmentFailure` where the package of the writer is missing.
    """
    known = format_of(path, writing=True)
    if known.write is None:
        raise InputError(f"files with the ending {path.suffix} are read only: choose another one")
    require_folder(path)
    if known.package:
        optional(known.package)
    return known


def require_folder(path: Path) -> None:
    """Raise `InputError` where a file cannot be written for want of its folder, or is a folder itself."""
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {path.name}: make it, or choose another")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")


def format_of(path: Path, writing: bool = False) -> Format:
    """The format of a file by its ending, else an `InputError` with the endings that are read, or written."""
    for known in FORMATS:
        if path.suffix.lower() in known.endings:
            return known
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")
    possible = [known for known in FORMATS if (known.write if writing else known.read) is not None]
    endings = ", ".join(ending for known in possible for ending in known.endings)
    raise InputError(f"no format has the ending {path.suffix!r} of {str(path)!r}: choose one of {endings}")


def table_paths(path: Path) -> tuple[Path, Path]:
    """Paths of the edge table and the vertex table: NAME_edges.csv and NAME_vertices.csv of NAME.csv."""
    stem = path.stem
    for mark in ("_edges", "_vertices", "_nodes"):
        stem = stem.removesuffix(mark)
    edges = path.with_name(f"{stem}_edges{path.suffix}")
    vertices = path.with_name(f"{stem}_vertices{path.suffix}")
    nodes = path.with_name(f"{stem}_nodes{path.suffix}")
    return edges, nodes if nodes.exists() and not vertices.exists() else vertices
