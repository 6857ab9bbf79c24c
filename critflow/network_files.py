"""Networks from two tables, networkx graphs and cases of datasets, and back, with all digits.

A table of edges has the columns tail and head, those of the image offset of the head, offset_x, offset_y, ..., where
the network is periodic, and where known stiffness, rest_length and force_density.  A table of vertices has x, y, ...,
and where needed id and fixed (1 or 0); it begins with lines `# cell` and d² numbers, vectors by rows, or `# volume`.
`# critflow 1` marks tables that were written here, in which parallel edges, planes in space and long edges are meant.
Graphs have the same names as attributes, with `pos` of a node and `offset` of an edge in place of their components.

Every source becomes two tables first.  Nothing is repaired or guessed: the first fault is one sentence.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, floats, integers, of_kind, shown
from critflow.checks import checked_cell
from critflow.extensions import INSTALL, has_extras
from critflow.faces import planar_faces
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, IntArray, Network
from critflow.numerics import norms
from critflow.result import EnvironmentFailure, InputError, NetworkError, Solution

Tables = tuple[pd.DataFrame, pd.DataFrame]

OFFSETS = ("offset_x", "offset_y", "offset_z")
# The length and the number of an edge follow from the rest, and are not read.
_OF_EDGES = ("tail", "head", *OFFSETS, "stiffness", "rest_length", "force_density", "length", "edge")
_OF_VERTICES = ("x", "y", "z", "id", "fixed")
# Attributes of the table of vertices, and of a graph.
_ATTRIBUTES = ("cell", "volume", "critflow")
_SEPARATORS = {".csv": ",", ".txt": ",", ".tsv": "\t"}
# Largest unbalanced force of a configuration, in units of the mean tension: half of all digits.
_BALANCED = 1e-8
# Coordinates that vary by less than this part of the size of a network have no extent.
_FLAT = 1e-9


def read_network(source: Any, cell: ArrayLike | None = None) -> Network:
    """The network of two tables, of a networkx graph, or of a case of a dataset; with its faces where no edges cross.

    source  "NAME.csv" (or .tsv, .txt): the tables NAME_edges.csv and NAME_vertices.csv; two paths, two data frames of
            pandas, or two dicts of columns, edges and vertices; a graph; a case, `dataset.sel(seed=3, ...)`
    cell    (d, d) rows are the cell vectors, where the source has none

    Raises `InputError` for the first fault.  `critflow_extras.network_from` reads more formats, and repairs.

    >>> import critflow as cf
    >>> edges = {"tail": [0, 1, 2], "head": [3, 3, 3]}
    >>> vertices = {"x": [0, 4, 0, 1], "y": [0, 0, 3, 1], "fixed": [1, 1, 1, 0]}
    >>> cf.read_network((edges, vertices))
    Network(4 vertices, 3 edges, 2 dimensions, 3 pins, z = 1.5)
    """
    with _one_sentence(source):
        return _network(*_tables(source), cell)


def read_critical(source: Any) -> CriticalConfiguration:
    """The critical configuration of the positions and the force densities σ of a source of `read_network`.

    Raises `InputError` also without force densities, and where they do not balance.

    >>> import critflow as cf
    >>> best = cf.optimize(cf.voronoi_network(20, seed=1), "B_0").value
    >>> bool((cf.read_critical(cf.to_tables(best)).sigma == best.sigma).all())
    True
    """
    with _one_sentence(source):
        edges, vertices = _tables(source)
        network = _network(edges, vertices, None)
        if "force_density" not in edges:
            raise InputError("it has no force densities: CriticalManifold(network).configuration(sigma) takes them")
        sigma = edge_values(_numbers(edges, "force_density"), network.n_edges, "force_density", positive=False)
        rest = (
            edge_values(_numbers(edges, "rest_length"), len(sigma), "rest_length") if "rest_length" in edges else None
        )
        x = np.asarray(network.positions)
        critical = CriticalConfiguration(network, sigma, x, network.bond_vectors(x), rest_lengths=rest)
        if not critical.residual < _BALANCED:
            raise InputError(
                f"its forces do not balance, by {critical.residual:.1g} of the mean tension: give all digits, or let "
                "CriticalManifold(network).configuration(sigma) find the positions"
            )
        return critical


def to_tables(thing: Network | CriticalConfiguration | Solution[Any]) -> Tables:
    """The tables of edges and of vertices of a network or a critical configuration, as data frames of pandas.

    The cell or the volume is in `vertices.attrs`.

    >>> import critflow as cf
    >>> edges, vertices = cf.to_tables(cf.lattice("honeycomb", 2, 2))
    >>> list(edges.columns)
    ['tail', 'head', 'offset_x', 'offset_y', 'stiffness', 'length']
    """
    value = thing.value if isinstance(thing, Solution) else thing
    if not isinstance(value, Network | CriticalConfiguration):
        raise InputError(f"{shown(value)} is neither a network nor a critical configuration: give one")
    value = of_kind(Network, CriticalConfiguration, thing=thing)  # a solution that failed is refused
    network, critical = (value, None) if isinstance(value, Network) else (value.network, value)
    if (x := network.positions if critical is None else critical.coordinates) is None:
        raise InputError("the network has no positions: give a configuration, or Network(..., positions=)")
    fixed = np.isin(np.arange(len(x)), list(network.pins)).astype(int)
    x = np.where(fixed[:, None], network.fixed_positions, x)
    values = {
        "stiffness": network.stiffness,
        "rest_length": None if critical is None else critical.rest_lengths,
        "force_density": None if critical is None else critical.sigma,
        "length": norms(network.bond_vectors(x)),
    }
    return tables_of(
        network.edges, network.offsets, values, x, fixed, {"cell": network.cell, "volume": network.reference_volume}
    )


def to_graph(thing: Network | CriticalConfiguration | Solution[Any]) -> Any:
    """A network or a critical configuration as a networkx `MultiGraph`.

    >>> import critflow as cf
    >>> cf.to_graph(cf.lattice("honeycomb", 2, 2)).number_of_edges()
    12
    """
    return graph_of(*to_tables(thing))


def write_network(thing: Network | CriticalConfiguration | Solution[Any], path: str | PathLike[str]) -> None:
    """Write the tables NAME_edges.csv and NAME_vertices.csv of a network or a critical configuration, to NAME.csv.

    path  with the ending .csv or .txt, or .tsv for tabs; `critflow_extras.write_network` writes other formats

    >>> import critflow as cf
    >>> import tempfile
    >>> path = tempfile.mkdtemp() + "/network.csv"
    >>> cf.write_network(cf.lattice("honeycomb", 2, 2), path)
    >>> cf.read_network(path)
    Network(8 vertices, 12 edges, 2 dimensions, periodic, z = 3)
    """
    path = _tabular(Path(of_kind(str, PathLike, path=path)))
    require_folder(path)
    write_tables(*to_tables(thing), path)


# From a source to two tables


def _tables(source: Any) -> Tables:
    """The tables of edges and of vertices of a source."""
    if isinstance(source, str | PathLike):
        source = table_paths(_tabular(Path(source)))
    if _is_a("xarray", "Dataset", source):
        return _of_case(source)
    if _is_a("networkx", "Graph", source):
        return _of_graph(source)
    if not _is_pair(source):
        raise InputError("it is no network: give NAME.csv, two tables, a networkx graph, or one case of a dataset")
    edges, vertices = sorted(map(_table, source), key=lambda table: "tail" not in table)
    return edges, vertices


def _is_a(module: str, name: str, source: object) -> bool:
    """Whether an object is of a class of a library, which who has such an object has imported."""
    return isinstance(source, getattr(sys.modules.get(module), name, ()))


def _is_pair(source: object) -> bool:
    return isinstance(source, tuple | list) and len(source) == 2


def _tabular(path: Path) -> Path:
    """The path, if its ending is that of tables."""
    if path.suffix == ".nc":
        raise InputError("it is a dataset of networks: give one case of it, xarray.open_dataset(file).sel(seed=0, ...)")
    if not is_tabular(path):
        raise InputError(f"the ending of {path.name} is none of {', '.join(_SEPARATORS)}, those of tables: choose one")
    return path


def is_tabular(path: Path) -> bool:
    """Whether the ending of a path is that of tables."""
    return path.suffix.lower() in _SEPARATORS


def table_paths(path: Path) -> tuple[Path, Path]:
    """The edge table and the vertex table: NAME_edges.csv and NAME_vertices.csv (or NAME_nodes.csv) of NAME.csv."""
    stem = path.stem.removesuffix("_edges").removesuffix("_vertices").removesuffix("_nodes")
    edges, vertices, nodes = (
        path.with_name(f"{stem}_{table}{path.suffix}") for table in ("edges", "vertices", "nodes")
    )
    return edges, nodes if nodes.exists() and not vertices.exists() else vertices


def _table(source: Any) -> pd.DataFrame:
    """A data frame, a mapping of columns, or a file, whose lines `# cell` and `# volume` are in `attrs`."""
    if isinstance(source, pd.DataFrame | Mapping):
        return source if isinstance(source, pd.DataFrame) else pd.DataFrame(source)
    path = _tabular(Path(of_kind(str, PathLike, pd.DataFrame, table=source)))
    if not path.is_file():
        tables = "the tables of NAME.csv are NAME_edges.csv and NAME_vertices.csv"
        raise InputError(f"there is no file {path}: check its name; {tables}")
    text = path.read_text(encoding="utf-8-sig")
    options: dict[str, Any] = {"comment": "#", "dtype": str, "keep_default_na": False, "skipinitialspace": True}
    table = pd.read_csv(StringIO(text), sep=_SEPARATORS[path.suffix.lower()], **options)
    if not isinstance(table.index, pd.RangeIndex):
        raise InputError(f"the rows of {path.name} have more values than its header has names: correct it")
    words = [line[1:].split() for line in text.splitlines() if line.startswith("#")]
    table.attrs = {word[0]: word[1:] for word in words if word and word[0] in _ATTRIBUTES}
    return table


def _of_graph(graph: Any) -> Tables:
    """The tables of a networkx graph."""
    nodes = {node: row for row, node in enumerate(graph)}
    vertices = pd.DataFrame([_spread(graph.nodes[node], "pos", "xyz") for node in nodes])
    vertices.attrs = {name: graph.graph[name] for name in _ATTRIBUTES if name in graph.graph}
    rows = []
    for a, b, values in sorted(graph.edges(data=True), key=lambda edge: edge[2].get("index", 0)):
        row = _spread(values, "offset", OFFSETS)
        row.pop("index", None)
        tail = row.pop("tail", a if graph.is_directed() or not any(values.get("offset", ())) else None)
        if tail not in (a, b):
            raise InputError(f"the edge of {a} and {b} has an offset and no tail: give its tail, or a directed graph")
        rows.append({**row, "tail": nodes[tail], "head": nodes[b if tail == a else a]})
    return pd.DataFrame(rows), vertices


def _spread(attributes: Mapping[str, Any], name: str, columns: Sequence[str]) -> dict[str, Any]:
    """Attributes with the entries of one of them as columns."""
    rest = dict(attributes)
    vector = rest.pop(name, ())
    if np.ndim(vector) != 1 or len(vector) > len(columns):
        raise InputError(f"the attribute {name} must be up to three numbers, not {shown(vector)}")
    return {**dict(zip(columns, vector, strict=False)), **rest}


def stored_configuration(case: Any) -> dict[str, np.ndarray | None]:
    """Edges, offsets, cell, position, stresses and stiffnesses of a case, by name; of the last two None if not stored.

    Raises `InputError` for a dataset without configurations, several cases, and a case without a configuration.
    """
    if missing := [name for name in ("edges", "offsets", "cell", "position") if name not in case]:
        raise InputError(f"this dataset contains no configurations: it lacks {', '.join(missing)}")
    if several := [str(dim) for dim in case["position"].dims if dim not in ("vertex", "axis")]:
        # Words of a file are an array of objects, whose entries have no `item`.
        example = ", ".join(
            f"{dim}={case[dim].values.tolist()[0]!r}" if dim in case.coords else f"{dim}=0" for dim in several
        )
        chosen = f"dataset.sel({example})" if set(several) <= set(case.coords) else f"dataset.isel({example})"
        raise InputError(f"choose one {' and one '.join(several)} of the dataset, as in {chosen}")
    position = np.asarray(case["position"], dtype=float)
    if not np.isfinite(position).all():
        raise InputError("this case of the dataset has no configuration: see its status, or choose another")
    names = ("edges", "offsets", "cell", "position", "sigma", "stiffness")
    return {name: np.asarray(case[name]) if name in case else None for name in names} | {"position": position}


def _of_case(case: Any) -> Tables:
    """The tables of a case of a dataset."""
    edges, offsets, cell, x, sigma, stiffness = stored_configuration(case).values()
    assert edges is not None and offsets is not None and x is not None
    return tables_of(
        edges, offsets, {"stiffness": stiffness, "force_density": sigma}, x, np.zeros(len(x), int), {"cell": cell}
    )


# Between tables, networks, files and graphs


def tables_of(
    edges: IntArray,
    offsets: IntArray,
    values: Mapping[str, Array | None],
    x: Array,
    fixed: IntArray,
    boundary: dict[str, Any],
) -> Tables:
    """The tables of arrays, with `values` of edges by column, marks of fixed vertices, and the cell or the volume.

    Their own mark says that what looks like a mistake is meant: parallel edges, planes in space, edges beyond a cell.
    """
    d = x.shape[1]
    ends = dict(zip(("tail", "head", *OFFSETS[:d]), (*edges.T, *offsets.T), strict=True))
    places = dict(zip("xyz"[:d], x.T, strict=True))
    vertices = pd.DataFrame({"id": np.arange(len(x)), **places, "fixed": fixed})
    given = {**boundary, "critflow": 1}
    vertices.attrs = {name: np.asarray(value).tolist() for name, value in given.items() if value is not None}
    return pd.DataFrame({**ends, **{name: value for name, value in values.items() if value is not None}}), vertices


def _network(edges: pd.DataFrame, vertices: pd.DataFrame, cell: ArrayLike | None) -> Network:
    """The network of two tables, else the sentence on the first fault."""
    needed = {"edges": (edges, _OF_EDGES, ("tail", "head")), "vertices": (vertices, _OF_VERTICES, ("x",))}
    for name, (table, known, columns) in needed.items():
        if unknown := [column for column in table if column not in known]:
            raise InputError(f"no column {unknown[0]!r:.40} of {name} is read: delete it, or choose {', '.join(known)}")
        if missing := [column for column in columns if column not in table]:
            raise InputError(f"the table of {name} has no column {missing[0]}: name one so in its header")
    axes = [axis for axis in "xyz" if axis in vertices]
    d, present = len(axes), [column for column in OFFSETS if column in edges]
    if axes != list("xyz"[:d]) or present not in ([], list(OFFSETS[:d])):
        raise InputError(f"the columns {', '.join([*axes, *present])} have no common dimension: add or delete some")
    x, own = np.array([_numbers(vertices, axis) for axis in axes]).T, "critflow" in vertices.attrs
    if not own and d == 3 and np.count_nonzero((extent := np.ptp(x, axis=0)) <= _FLAT * extent.max()) == 1:
        raise InputError("all vertices lie in one plane of two axes: give these two as x and y")
    cell = _given(vertices, "cell", d**2, cell)
    volume = _given(vertices, "volume", 1)
    offsets = integers(np.array([_numbers(edges, name) for name in present]).T, "offsets") if present else None
    if cell is not None and offsets is None:
        raise InputError(f"a periodic network needs the columns {', '.join(OFFSETS[:d])}: give them")
    if cell is None and offsets is not None and offsets.any():
        raise InputError("offsets need a cell: begin the table of vertices with a line '# cell', or give cell=")
    fixed = _numbers(vertices, "fixed") if "fixed" in vertices else np.zeros(len(x))
    if not np.isin(fixed, (0, 1)).all():
        raise InputError("the column fixed must be 1 for fixed vertices and 0 for others: correct it")
    network = Network(
        _ends(edges, vertices),
        offsets,  # type: ignore[arg-type]
        None if cell is None else checked_cell(np.reshape(cell, (d, d))),
        _numbers(edges, "stiffness") if "stiffness" in edges else 1.0,  # type: ignore[arg-type]
        {int(vertex): x[vertex] for vertex in np.flatnonzero(fixed)},
        n_vertices=len(x),
        positions=None if own else x,
    )
    if not own:
        _require_single(network)
    network = network if volume is None else network.with_volume(volume[0])
    L = (
        x[network.edges[:, 1]]
        - x[network.edges[:, 0]]
        + (0 if network.cell is None else network.offsets @ network.cell)
    )
    try:
        faces = planar_faces(network.edges, L, len(x)) if d == 2 else None
    except NetworkError:  # edges cross
        faces = None
    return network._copied(positions=x, faces=faces)


def _ends(edges: pd.DataFrame, vertices: pd.DataFrame) -> IntArray:
    """Tails and heads (N_b, 2) as rows of the table of vertices, by their names where it has a column id."""
    if "id" not in vertices:
        return integers(np.array([_numbers(edges, end) for end in ("tail", "head")]).T, "tail and head")
    names = pd.Index([str(name).strip() for name in vertices["id"]])
    if not names.is_unique:
        raise InputError(f"the id {names[names.duplicated()][0]!r:.40} is that of two vertices: give one another id")
    ends = [[str(name).strip() for name in edges[end]] for end in ("tail", "head")]
    rows = np.array([names.get_indexer(column) for column in ends]).T
    for edge, end in np.argwhere(rows < 0)[:1]:
        raise InputError(
            f"edge {edge} ends at {ends[end][edge]!r:.40}, which is no id of a vertex: add or correct it "
            "(edges count from 0)"
        )
    return rows


def _numbers(table: pd.DataFrame, column: str) -> Array:
    """The numbers (n,) of a column, else the sentence on the first entry that is none, or not finite."""
    numbers = np.empty(len(table))
    for row, entry in enumerate(table[column]):
        try:
            numbers[row] = entry
        except (TypeError, ValueError):
            numbers[row] = np.nan
        if not np.isfinite(numbers[row]):
            raise InputError(
                f"row {row + 1} of column {column} has {entry!r:.40}, which is no number: correct it "
                "(rows count from 1)"
            )
    return numbers


def _given(table: pd.DataFrame, name: str, count: int, argument: ArrayLike | None = None) -> Array | None:
    """The numbers (count,) of the cell or the volume, in the attributes of a table or as an argument."""
    attribute = table.attrs.get(name)
    if attribute is not None and argument is not None:
        raise InputError(f"it has a {name} of its own: leave {name}= out")
    if (given := argument if attribute is None else attribute) is None:
        return None
    if (numbers := floats(given, name).ravel()).size != count:
        raise InputError(f"the {name} must have {count} numbers, vectors by rows, not {numbers.size}: correct it")
    return numbers


def _require_single(network: Network) -> None:
    """Refuse an edge that is listed twice, as in lists of the neighbours of each vertex."""
    first: dict[tuple[int, ...], int] = {}
    for row, ((tail, head), offset) in enumerate(zip(network.edges.tolist(), network.offsets.tolist(), strict=True)):
        edge = min((tail, head, *offset), (head, tail, *(-image for image in offset)))
        if (other := first.setdefault(edge, row)) != row:
            raise InputError(
                f"edge {row} is edge {other} again, in this or the other direction: list each edge once "
                "(edges count from 0)"
            )


def require_folder(path: Path) -> None:
    """Raise `InputError` where a file cannot be written for want of its folder, or is a folder itself."""
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {path.name}: make it, or choose another")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")


def write_tables(edges: pd.DataFrame, vertices: pd.DataFrame, path: Path) -> None:
    """Write two tables with headers and all digits, vertices with the cell and the volume in comment lines."""
    edges_path, vertices_path = table_paths(path)
    separator = _SEPARATORS[path.suffix.lower()]
    with vertices_path.open("w", newline="", encoding="utf-8") as file:
        for name, value in vertices.attrs.items():
            file.write(f"# {name} {' '.join(map(repr, np.ravel(value).tolist()))}\n")
        vertices.to_csv(file, sep=separator, index=False)
    edges.to_csv(edges_path, sep=separator, index=False)


def graph_of(edges: pd.DataFrame, vertices: pd.DataFrame) -> Any:
    """A networkx multigraph of two tables; edges have index and tail, since it keeps neither order nor direction."""
    try:
        networkx = import_module("networkx")
    except ImportError:
        raise EnvironmentFailure("a graph needs networkx, which is not installed: pip install networkx") from None
    graph = networkx.MultiGraph(**vertices.attrs)
    places = vertices.drop(columns=["id", "fixed"]).to_numpy().tolist()
    for vertex, (x, fixed) in enumerate(zip(places, vertices["fixed"], strict=True)):
        graph.add_node(vertex, pos=tuple(x), fixed=bool(fixed))
    columns = [column for column in OFFSETS if column in edges]
    offsets = edges[columns].to_numpy().tolist()
    values = edges.drop(columns=[*columns, "length"]).to_dict("records")
    for index, (row, offset) in enumerate(zip(values, offsets, strict=True)):
        tail, head = int(row.pop("tail")), int(row.pop("head"))
        graph.add_edge(tail, head, index=index, tail=tail, **row, offset=tuple(offset))
    return graph


@contextmanager
def _one_sentence(source: Any) -> Iterator[None]:
    """Faults of a source as one sentence that begins with its name and ends with what repairs it."""
    try:
        yield
    except (InputError, OSError, ValueError) as error:
        name = source if isinstance(source, str | PathLike) else "tables" if _is_pair(source) else shown(source)
        extras = "network_from of critflow-extras" if has_extras() else f"critflow-extras ({INSTALL})"
        reason = " ".join(str(error).split())
        sentence = f"{name!s:.100}: {reason:.250}; {extras} repairs networks and reads other formats"
        raise InputError(sentence) from error
