"""Tables of vertices and edges as text, with or without header, vertices counted from 0 or 1 or named.

pandas is loaded at its first use: it takes longer than the rest of the package.
"""

from __future__ import annotations

import re
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.exchange.data import (
    EDGE_VALUES,
    Array,
    IntArray,
    NetworkData,
    bond_vectors_of,
    edge_values,
    from_zero,
    unread,
)
from critflow.networks.checks import integers
from critflow.result import InputError

# Names of columns, in lower case, that are recognised in a header.
_TAIL = ("tail", "source", "from", "i", "u", "node1", "vertex1", "id1", "start")
_HEAD = ("head", "target", "to", "j", "v", "node2", "vertex2", "id2", "end")
_ID = ("id", "vertex", "node", "index", "name", "label")
_AXES = (("x", "y", "z"), ("pos_x", "pos_y", "pos_z"), ("x0", "x1", "x2"))
_FIXED, _YES = ("fixed", "pinned", "pin"), ("1", "true", "yes")
_OFFSETS = ("offset_x", "offset_y", "offset_z")
# The length, and the number of an edge, follow from the rest.
_READ = {*_TAIL, *_HEAD, *_OFFSETS, *(name for names in EDGE_VALUES.values() for name in names), "length", "edge", "id"}
_KNOWN = {*_TAIL, *_HEAD, *_ID, *(axis for axes in _AXES for axis in axes)}
# Stricter than Python, which also reads 1_0 and digits of other scripts.
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[Nn]a[Nn]|[+-]?[Ii]nf"


def read_tables(path: Path) -> NetworkData:
    """The network of an edge table and a vertex table.

    Edge columns: tail and head, then optional offsets, stiffness, rest length and force density by name.  Vertex
    columns: coordinates, with an optional first column of names.  Without a header columns are taken in this order.
    A comment line `# cell` with d² numbers in the vertex table gives the cell vectors, row by row.
    """
    edges_path, vertices_path = table_paths(path)
    ids, positions, pinned = _vertices(vertices_path)
    table, d = _table(edges_path), positions.shape[1]
    ends = [_named(table, _TAIL), _named(table, _HEAD)]
    if not set(table.columns) & _READ and table.shape[1] > 1:
        ends = list(table.columns[:2])
    if None in ends:
        raise InputError(f"{edges_path} has no columns for tail and head: name them tail and head, or put them first")
    offsets = [name for name in _OFFSETS[:d] if name in table.columns]
    columns = {field: name for field, names in EDGE_VALUES.items() if (name := _named(table, names)) is not None}
    values: dict[str, Any] = {field: _numbers(table[[name]], edges_path)[:, 0] for field, name in columns.items()}
    data = NetworkData(
        edges=_indices(table[ends], ids, edges_path),
        positions=positions,
        offsets=_numbers(table[offsets], edges_path).astype(np.int64) if len(offsets) == d else None,
        cell=_cell(vertices_path, d),
        pins=pinned,
        ids=tuple(ids),
        source=f"tables {edges_path.name} and {vertices_path.name}",
        notes=unread([name for name in table.columns if name not in ends and isinstance(name, str)], _READ),
        **values,
    )
    return data if ids else from_zero(data)


def write_tables(data: NetworkData, path: Path) -> None:
    """Write an edge table and a vertex table with headers and all digits, vertices counted from 0."""
    edges_path, vertices_path = table_paths(path)
    frame, d = import_module("pandas").DataFrame, data.dimension
    mark = "\t" if path.suffix.lower() == ".tsv" else ","
    axes = dict(zip("xyz", data.positions.T, strict=False))
    vertices = {"id": np.arange(data.n_vertices), **axes, "fixed": data.is_pin.astype(int)}
    with vertices_path.open("w", newline="", encoding="utf-8") as file:
        if data.cell is not None:
            file.write(f"# cell {' '.join(map(repr, data.cell.ravel().tolist()))}\n")
        frame(vertices).to_csv(file, sep=mark, index=False)
    offsets = np.zeros((data.n_edges, d), int) if data.offsets is None else data.offsets
    edges = dict(zip(("tail", "head", *_OFFSETS[:d]), (*data.edges.T, *offsets.T), strict=True))
    edges |= {**edge_values(data), "length": np.linalg.norm(bond_vectors_of(data), axis=1)}
    frame(edges).to_csv(edges_path, sep=mark, index=False)


def table_paths(path: Path) -> tuple[Path, Path]:
    """The edge table and the vertex table: NAME_edges.csv and NAME_vertices.csv (or NAME_nodes.csv) of NAME.csv."""
    stem = path.stem.removesuffix("_edges").removesuffix("_vertices").removesuffix("_nodes")
    edges, vertices, nodes = (
        path.with_name(f"{stem}_{table}{path.suffix}") for table in ("edges", "vertices", "nodes")
    )
    return edges, nodes if nodes.exists() and not vertices.exists() else vertices


def _table(path: Path) -> Any:
    """The data frame of a table of text, with its header in lower case; without a header the columns are numbered."""
    pandas = import_module("pandas")
    lines = [line.strip(" ") for line in path.read_text(encoding="utf-8-sig").splitlines()]
    first_line = next((line for line in lines if line and not line.startswith("#")), None)
    if first_line is None:
        raise InputError(f"{path} is an empty table: give one row per vertex or edge")
    # The detection of pandas fails for aligned columns; a comma beside another mark is that of decimals.
    mark = next((mark for mark in (";", "\t", ",") if mark in first_line), r"\s+")
    text = StringIO("\n".join(lines))
    try:
        table = pandas.read_csv(text, sep=mark, header=None, comment="#", dtype=str, keep_default_na=False)
    except pandas.errors.ParserError as error:
        raise InputError(f"the rows of {path} differ in their numbers of columns: {error}") from None
    table = table.fillna("").apply(lambda column: column.str.strip())
    number, first = _are_numbers(table), table.iloc[0].str.lower()
    # A first row of text above rows of numbers names the columns, known or not.
    unknown = len(table) > 1 and not number[0].any() and number[1:].all()
    if number[0].all() or not (unknown or set(first) & _KNOWN):
        return table
    if len(table) == 1:
        raise InputError(f"{path} has a header and no rows: give one row per vertex or edge")
    return table.iloc[1:].set_axis(first, axis=1).loc[:, ~first.duplicated().to_numpy()]


def _named(table: Any, names: tuple[str, ...]) -> str | None:
    """The first of these names that a column has."""
    return next((name for name in names if name in table.columns), None)


def _are_numbers(cells: Any) -> NDArray[np.bool_]:
    """Which cells (n, m) of a data frame of text are numbers, with a point or a comma."""
    numbers = cells.replace(",", ".", regex=True).apply(lambda column: column.str.fullmatch(_NUMBER))
    return np.asarray(numbers, dtype=bool)


def _numbers(cells: Any, path: Path) -> Array:
    """The numbers (n, m) of a data frame of text, else an `InputError` that names the first bad row."""
    bad = np.argwhere(~_are_numbers(cells))
    if len(bad):
        row, column = bad[0]
        raise InputError(f"row {row + 1} of {path} has {cells.iloc[row, column]!r}, which is no number: correct it")
    return np.array(cells.replace(",", ".", regex=True).to_numpy(object), dtype=float)


def _cell(path: Path, dimension: int) -> Array | None:
    """The cell (d, d) in a comment line of a vertex table, or None."""
    for line in path.read_text(encoding="utf-8-sig").splitlines():
        words = line.replace(",", " ").split()
        if words[:2] == ["#", "cell"]:
            if len(words) != 2 + dimension**2 or not all(re.fullmatch(_NUMBER, word) for word in words[2:]):
                raise InputError(f"{path}: the line '# cell' must give {dimension**2} numbers, the vectors by rows")
            return np.array(words[2:], dtype=float).reshape(dimension, dimension)
    return None


def _vertices(path: Path) -> tuple[list[str], Array, tuple[int, ...]]:
    """Names (empty: counted), positions and the indices of fixed vertices."""
    table = _table(path)
    columns, name = list(table.columns), _named(table, _ID)
    axes = next((axes for axes in _AXES if {*axes[:2]} <= set(columns)), None)
    if axes is not None:
        columns = [axis for axis in axes if axis in columns]
    elif isinstance(columns[0], str):
        raise InputError(f"{path} has no columns x and y: name the coordinates x, y and z in its header")
    elif len(columns) > 2:
        # Three columns of which the first counts or is text: a name and two coordinates.
        counts = (list(map(str, range(start, start + len(table)))) for start in (0, 1))
        if list(table[0]) in counts or not _are_numbers(table[[0]]).all():
            name, columns = columns[0], columns[1:]
    if not 1 <= len(columns) <= 3:
        raise InputError(f"{path} has {len(columns)} columns of coordinates: give 2 or 3, and names in a column id")
    ids = [] if name is None else list(table[name])
    if len(set(ids)) != len(ids):
        raise InputError(f"{path} gives a vertex twice: names must differ")
    fixed = _named(table, _FIXED)
    marks = () if fixed is None else np.flatnonzero(table[fixed].str.lower().isin(_YES))
    return ids, _numbers(table[columns], path), tuple(map(int, marks))


def _indices(ends: Any, ids: list[str], path: Path) -> IntArray:
    """Edges as indices of rows of the vertex table, or as numbers where the rows have no names."""
    if ids:
        index = {name: n for n, name in enumerate(ids)}
        try:
            return np.array([[index[a], index[b]] for a, b in ends.to_numpy(object)])
        except KeyError as missing:
            raise InputError(f"{path} names the vertex {missing.args[0]!r}, which the vertex table lacks") from None
    if not _are_numbers(ends).all():
        raise InputError(f"{path} names vertices by text, and the vertex table has no column id: add one")
    return integers(_numbers(ends, path), f"the vertices of {path}")
