"""Tables of vertices and edges with a header, as text or data frames of pandas, counted from 0 or 1 or named.

pandas is loaded at its first use: it takes longer than the rest of the package.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import integers
from critflow.network_files import OFFSETS, Tables, table_paths, tables_of
from critflow.result import CritflowError, InputError
from critflow_extras.files.data import (
    EDGE_VALUES,
    NUMBER,
    Array,
    IntArray,
    NetworkData,
    bond_vectors_of,
    edge_values,
    from_zero,
    require_regular,
    unread,
)

# Names of columns, in lower case, that are recognised in a header.
_TAIL = ("tail", "source", "from", "i", "u", "node1", "vertex1", "id1", "start")
_HEAD = ("head", "target", "to", "j", "v", "node2", "vertex2", "id2", "end")
_ID = ("id", "vertex", "node", "index", "name", "label")
_AXES = (("x", "y", "z"), ("pos_x", "pos_y", "pos_z"), ("x0", "x1", "x2"))
_COORDINATES = tuple(axis for axes in _AXES for axis in axes)
_FIXED, _YES = ("fixed", "pinned", "pin"), ("1", "true", "yes")
# The length, and the number of an edge, follow from the rest.
_READ = {*_TAIL, *_HEAD, *OFFSETS, *(name for names in EDGE_VALUES.values() for name in names), "length", "edge", "id"}


class _Table(NamedTuple):
    """A table as text: its name in messages, the data frame of its cells, and its comment lines."""

    name: str
    cells: Any
    comments: Sequence[str] = ()

    def column(self, names: Sequence[str]) -> str | None:
        """The first of these names that a column has."""
        return next((name for name in names if name in self.cells.columns), None)


def read_tables(source: Path | Sequence[Any] | Any) -> NetworkData:
    """The network of an edge table and a vertex table: one name for both files, or two files or frames in any order.

    Edge columns: tail and head, then optional offsets, stiffness, rest length and force density.  Vertex columns:
    coordinates, with optional names and marks of fixed vertices.  Comment lines of the vertex table give the cell
    vectors, row by row, and the volume: `# cell` with d² numbers, `# volume` with one.
    """
    edges, vertices = _sources(source)
    if edges.column(_COORDINATES) and not vertices.column(_COORDINATES):
        edges, vertices = vertices, edges
    ids, positions, pinned = _vertices(vertices)
    d, table = positions.shape[1], edges.cells
    ends = [edges.column(_TAIL), edges.column(_HEAD)]
    if None in ends:
        raise InputError(f"{edges.name} has no columns for tail and head: name them tail and head in its header")
    offsets = [name for name in OFFSETS[:d] if name in table.columns]
    columns = {field: name for field, names in EDGE_VALUES.items() if (name := edges.column(names)) is not None}
    values: dict[str, Any] = {field: _numbers(table[[name]], edges.name)[:, 0] for field, name in columns.items()}
    cell, volume = _comment(vertices, "cell", d**2), _comment(vertices, "volume", 1)
    data = NetworkData(
        edges=_indices(table[ends], ids, edges.name),
        positions=positions,
        offsets=_numbers(table[offsets], edges.name) if len(offsets) == d else None,  # type: ignore[arg-type]
        cell=None if cell is None else cell.reshape(d, d),
        volume=None if volume is None else float(volume[0]),
        pins=pinned,
        ids=tuple(ids),
        source=f"tables {edges.name} and {vertices.name}",
        notes=unread(table.columns, _READ),
        **values,
    )
    return data if ids else from_zero(data)


def read_centres(source: Path | Any) -> Array:
    """Positions (n, d) of a single table, which need not be vertices."""
    return _vertices(_of_file(source) if isinstance(source, Path) else _of_frame(source, "the table"))[1]


def has_centres(path: Path) -> bool:
    """Whether a table has coordinates and no edges."""
    try:
        table = _of_file(path)
    except (CritflowError, ValueError, OSError):
        return False
    return table.column(_COORDINATES) is not None and table.column(_TAIL) is None


def frames(data: NetworkData) -> Tables:
    """The tables of edges and vertices of a record, vertices counted from 0."""
    offsets = np.zeros((data.n_edges, data.dimension), int) if data.offsets is None else data.offsets
    values = {**edge_values(data), "length": np.linalg.norm(bond_vectors_of(data), axis=1)}
    boundary = {"cell": data.cell, "volume": data.volume}
    return tables_of(data.edges, offsets, values, data.positions, data.is_pin.astype(int), boundary)


def _sources(source: Path | Sequence[Any] | Any) -> list[_Table]:
    """Two tables, that of edges first if their names say so."""
    pair = table_paths(source) if isinstance(source, Path) else source
    if isinstance(pair, import_module("pandas").DataFrame):
        raise InputError("a network needs two tables: give one of edges and one of vertices")
    named = zip(("the first table", "the second table"), pair, strict=True)
    return [_of_file(one) if isinstance(one, Path) else _of_frame(one, name) for name, one in named]


def _of_file(path: Path) -> _Table:
    """A file of text with a header: separated by semicolons, tabs, commas or blanks."""
    require_regular(path)
    pandas = import_module("pandas")
    lines = [line.strip(" ") for line in path.read_text(encoding="utf-8-sig").splitlines()]
    header = next((line for line in lines if line.strip() and not line.startswith("#")), None)
    if header is None:
        raise InputError(f"{path.name} is an empty table: give one row per vertex or edge")
    # The detection of pandas fails for aligned columns.
    mark = next((mark for mark in (";", "\t", ",") if mark in header), r"\s+")
    try:
        table = pandas.read_csv(
            StringIO("\n".join(lines)), sep=mark, header=None, comment="#", dtype=str, keep_default_na=False
        )
    except pandas.errors.ParserError as error:
        raise InputError(f"the rows of {path.name} differ in their numbers of columns: {error}") from None
    table = table.fillna("").apply(lambda column: column.str.strip())
    if _are_numbers(table.iloc[[0]]).all():
        raise InputError(f"{path.name} has no header: name the columns tail and head, or x and y, in its first line")
    if len(table) == 1:
        raise InputError(f"{path.name} has a header and no rows: give one row per vertex or edge")
    comments = [line for line in lines if line.startswith("#")]
    return _Table(path.name, _titled(table.iloc[1:], list(table.iloc[0])), comments)


def _of_frame(frame: Any, name: str) -> _Table:
    """A data frame of pandas."""
    if not len(frame):
        raise InputError(f"{name} has a header and no rows: give one row per vertex or edge")
    return _Table(name, _titled(frame.astype(object).map(_text).mask(frame.isna(), ""), list(frame.columns)))


def _text(cell: Any) -> str:
    """A cell as in a table of text, with all digits: 3 for 3.0."""
    if not isinstance(cell, float | np.floating):
        return str(cell).strip()
    number = float(cell)
    return str(int(number)) if number.is_integer() and number else repr(number)


def _titled(table: Any, titles: Sequence[Any]) -> Any:
    """A table with its titles in lower case, the first column of each."""
    lower = [str(title).strip().lower() for title in titles]
    return table.set_axis(lower, axis=1).iloc[:, [n for n, title in enumerate(lower) if title not in lower[:n]]]


def _are_numbers(cells: Any) -> NDArray[np.bool_]:
    """Which cells (n, m) of a data frame of text are numbers, with a point or a comma."""
    numbers = cells.replace(",", ".", regex=True).apply(lambda column: column.str.fullmatch(NUMBER))
    return np.asarray(numbers, dtype=bool)


def _numbers(cells: Any, source: str) -> Array:
    """The numbers (n, m) of a data frame of text, else an `InputError` that names the first bad row."""
    bad = np.argwhere(~_are_numbers(cells))
    if len(bad):
        row, column = bad[0]
        raise InputError(f"row {row + 1} of {source} has {cells.iloc[row, column]!r}, which is no number: correct it")
    return np.array(cells.replace(",", ".", regex=True).to_numpy(object), dtype=float)


def _comment(table: _Table, word: str, count: int) -> Array | None:
    """The numbers (count,) in the comment line of a table that begins with a word, or None."""
    spaced = (line.replace("#", "# ").replace(";", " ") for line in table.comments)
    line = next((line for line in spaced if line.split()[:2] == ["#", word]), None)
    if line is None:
        return None
    numbers = line.partition(word)[2]
    # A comma is that of decimals, or separates.
    for text in (numbers.replace(",", "."), numbers.replace(",", " ")):
        words = text.split()
        if len(words) == count and all(re.fullmatch(NUMBER, each) for each in words):
            return np.array(words, dtype=float)
    rows = ", the vectors by rows" * (count > 1)
    raise InputError(f"{table.name}: the line '# {word}' must give {count} numbers{rows}")


def _vertices(table: _Table) -> tuple[list[str], Array, tuple[int, ...]]:
    """Names (empty: counted), positions and the indices of fixed vertices."""
    name, fixed, present = table.column(_ID), table.column(_FIXED), set(table.cells.columns)
    axes = next((axes for axes in _AXES if {*axes[:2]} <= present), None)
    if axes is None:
        raise InputError(f"{table.name} has no columns x and y: name the coordinates x, y and z in its header")
    ids = [] if name is None else list(table.cells[name])
    if len(set(ids)) != len(ids):
        raise InputError(f"{table.name} gives a vertex twice: names must differ")
    marks = () if fixed is None else np.flatnonzero(table.cells[fixed].str.lower().isin(_YES))
    positions = _numbers(table.cells[[axis for axis in axes if axis in present]], table.name)
    return ids, positions, tuple(map(int, marks))


def _indices(ends: Any, ids: list[str], source: str) -> IntArray:
    """Edges as indices of rows of the vertex table, or as numbers where the rows have no names."""
    if ids:
        index = {name: n for n, name in enumerate(ids)}
        try:
            return np.array([[index[a], index[b]] for a, b in ends.to_numpy(object)])
        except KeyError as missing:
            raise InputError(
                f"{source} names the vertex {missing.args[0]!r}, which the vertex table lacks: correct it"
            ) from None
    if not _are_numbers(ends).all():
        raise InputError(f"{source} names vertices by text, and the vertex table has no column id: add one")
    return integers(_numbers(ends, source), f"the vertices of {source}")
