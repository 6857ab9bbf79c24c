"""The table of formats: the reader and the writer of each file ending, and the reader of each foreign object."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from critflow.arguments import shown
from critflow.network_files import require_folder, write_tables
from critflow.result import InputError
from critflow_extras.files.data import NetworkData, from_dataset, optional, require_regular
from critflow_extras.files.drawings import write_solid, write_svg
from critflow_extras.files.graphs import from_graph, read_graph, write_graph
from critflow_extras.files.meshes import from_mesh, read_mesh, write_mesh
from critflow_extras.files.particles import from_atoms, read_gsd, read_lammps, write_gsd, write_lammps
from critflow_extras.files.polygons import read_geojson
from critflow_extras.files.tables import frames, read_tables


@dataclass(frozen=True)
class Format:
    """One format: what it is called, and how a network is read from its files or objects and written.

    endings    of its files
    read       record of a file
    write      from a record to a path, with options
    packages   optional modules that the writer needs
    planar     whether it holds two-dimensional networks only
    options    keywords of the writer
    kind       package and class of an object of another library, such as "networkx.Graph"
    convert    record of such an object
    keywords   of `network_from` that `read` and `convert` take
    """

    name: str
    endings: tuple[str, ...] = ()
    read: Callable[..., NetworkData] | None = None
    write: Callable[..., None] | None = None
    packages: tuple[str, ...] = ()
    planar: bool = False
    options: tuple[str, ...] = ()
    kind: str = ""
    convert: Callable[..., NetworkData] | None = None
    keywords: tuple[str, ...] = ()


def write_frames(data: NetworkData, path: Path) -> None:
    """Write the tables of edges and vertices."""
    write_tables(*frames(data), path)


# The class of one table of pandas.
FRAME = "pandas.DataFrame"
_SOLID = ("size", "radius", "by_stiffness")
# All formats; whoever adds one enters it here (docs/extending.md).
FORMATS = [
    Format("tables", (".csv", ".txt", ".tsv"), read_tables, write_frames, kind=FRAME, convert=read_tables),
    Format(
        *("graph", (".graphml", ".gml", ".json"), read_graph, write_graph, ("networkx",)),
        kind="networkx.Graph",
        convert=from_graph,
        keywords=("positions",),
    ),
    Format("LAMMPS data", (".data", ".lmp", ".lammps"), read_lammps, write_lammps),
    Format("GSD", (".gsd",), read_gsd, write_gsd, ("gsd.hoomd",)),
    Format("ASE atoms", kind="ase.Atoms", convert=from_atoms, keywords=("edges", "offsets", "cutoff")),
    Format("mesh", (".vtu", ".vtk"), read_mesh, write_mesh, ("meshio",), kind="meshio.Mesh", convert=from_mesh),
    # Those without lines, or without data of lines.
    Format("mesh", (".msh", ".ply", ".obj", ".xdmf"), read_mesh),
    Format("GeoJSON", (".geojson",), read_geojson, keywords=("weld",)),
    Format("critflow dataset", kind="xarray.Dataset", convert=from_dataset),
    Format("SVG drawing", (".svg",), write=write_svg, planar=True, options=("size", "width", "by_stiffness")),
    Format("STL solid", (".stl",), write=write_solid, packages=("trimesh",), options=_SOLID),
    Format("3MF solid", (".3mf",), write=write_solid, packages=("trimesh", "lxml.etree", "networkx"), options=_SOLID),
]
# What libraries read and write in a few lines: a sentence that goes on after the name of the file.
READ_PICTURES = (
    "is read by scikit-image and skan, as extras/docs/recipes/pictures.md shows for fibres: give edges= and "
    "positions=, or labels= for a mask whose values number the cells of a tissue"
)
_WORKBOOKS = "by pandas, as extras/docs/recipes/workbooks.md shows"
_DRAWINGS = "by ezdxf, as extras/docs/recipes/drawings.md shows"
_RECIPES = {
    "read": {
        **dict.fromkeys((".png", ".jpg", ".tif", ".tiff", ".npy"), READ_PICTURES),
        ".xlsx": f"is read {_WORKBOOKS}: give its sheets of edges and vertices",
        ".dxf": f"is read {_DRAWINGS}: give edges= and positions=",
    },
    "write": {
        ".xlsx": f"is written {_WORKBOOKS}: choose .csv here",
        ".dxf": f"is written {_DRAWINGS}: choose .svg here",
    },
}


def is_frame(source: object) -> bool:
    """Whether an object is a table of pandas."""
    return FRAME in _kinds(source)


def _kinds(source: object) -> set[str]:
    """The classes of an object, each with its package: "networkx.Graph"."""
    return {f"{each.__module__.split('.')[0]}.{each.__name__}" for each in type(source).__mro__}


def format_of_object(source: object) -> Format:
    """The format of an object of another library, by the names of its classes, else an `InputError`."""
    kinds = _kinds(source)
    for known in FORMATS:
        if known.kind in kinds:
            return known
    raise InputError(
        f"{shown(source)} is not a known source of a network: give a file, a graph, atoms, a mesh, or edges= and "
        "positions="
    )


def readable_format(path: Path) -> Format:
    """The format in which a file is read; `InputError` for files of many networks, pipes and devices."""
    if path.suffix == ".nc":
        raise InputError(
            f"{path.name} is a dataset of networks: give one case of it, dataset.sel(seed=0, ...), or --set seed=0 "
            "to the command"
        )
    require_regular(path)
    return _format_of(path, "read")


def writable_format(path: Path, dimension: int = 2, options: Iterable[str] = ()) -> Format:
    """The format in which a file can be written, before anything is computed for it.

    Raises `InputError` for an ending that cannot be written, a folder that does not exist, and a dimension or an option
    that the format does not have; `EnvironmentFailure` where the package of the writer is missing.
    """
    known = _format_of(path, "write")
    require_folder(path)
    if known.planar and dimension != 2:
        raise InputError("drawings to cut are two-dimensional: write STL for a network in three dimensions")
    if unknown := sorted(set(options) - set(known.options)):
        raise InputError(f"{unknown[0]}= is no option of the format {known.name}: leave it out")
    for package in known.packages:
        optional(package)
    return known


def _format_of(path: Path, task: str) -> Format:
    """The format of a file by its ending, to "read" or "write"; else an `InputError` with the endings for that task."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")
    possible = {ending: known for known in FORMATS if getattr(known, task) for ending in known.endings}
    if path.suffix.lower() in possible:
        return possible[path.suffix.lower()]
    if path.suffix.lower() in _RECIPES[task]:
        raise InputError(f"{path.name} {_RECIPES[task][path.suffix.lower()]}")
    known = any(path.suffix.lower() in format.endings for format in FORMATS)
    what = f"is {'read' if task == 'write' else 'written'} only" if known else "is that of no format"
    raise InputError(f"the ending {path.suffix!r} of {str(path)!r} {what}: choose one of {', '.join(possible)}")
