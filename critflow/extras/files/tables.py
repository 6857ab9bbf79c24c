"""Tables of vertices and edges, as text or in a workbook, with or without header, counted from 0 or 1 or named.

pandas is loaded at its first use: it takes longer than the rest of the package.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.extras.files.data import (
    EDGE_VALUES,
    NUMBER,
    Array,
    IntArray,
    NetworkData,
    bond_vectors_of,
    edge_values,
    from_zero,
    optional,
    require_regular,
    unread,
)
from critflow.networks.checks import integers
from critflow.result import InputError

# Names of columns, in lower case, that are recognised in a header.
_TAIL = ("tail", "source", "from", "i", "u", "node1", "vertex1", "id1", "start")
_HEAD = ("head", "target", "to", "j", "v", "node2", "vertex2", "id2", "end")
_ID = ("id", "vertex", "node", "index", "name", "label")
_AXES = (("x", "y", "z"), ("pos_x", "pos_y", "pos_z"), ("x0", "x1", "x2"))
_COORDINATES = tuple(axis for axes in _AXES for axis in axes)
_FIXED, _YES = ("fixed", "pinned", "pin"), ("1", "true", "yes")
_OFFSETS = ("offset_x", "offset_y", "offset_z")
# The length, and the number of an edge, follow from the rest.
_READ = {*_TAIL, *_HEAD, *_OFFSETS, *(name for names in EDGE_VALUES.values() for name in names), "length", "edge", "id"}
_KNOWN = {*_TAIL, *_HEAD, *_ID, *_COORDINATES}


def read_tables(path: Path | Sequence[Path]) -> NetworkData:
    """The network of an edge table and a vertex table: two files in any order, one name for both, or one workbook.

    Edge columns: tail and head, then optional offsets, stiffness, rest length and force density by name.  Vertex
    columns: coordinates, with an optional first column of names.  Without a header columns are taken in this order.
    Comment lines of the vertex table give the cell vectors, row by row, and the volume: `# cell` with d² numbers,
    `# volume` with one.
    """
    (edges_name, lines), (vertices_name, vertex_lines) = sources = _sources(path)
    table, vertices = (_table(*source) for source in sources)
    if {*_COORDINATES} & set(table.columns) and not {*_COORDINATES} & set(vertices.columns):
        table, edges_name, vertices, vertices_name, vertex_lines = vertices, vertices_name, table, edges_name, lines
    ids, positions, pinned = _vertices(vertices, vertices_name)
    d = positions.shape[1]
    ends = [_named(table, _TAIL), _named(table, _HEAD)]
    if not set(table.columns) & _READ and table.shape[1] > 1:
        ends = list(table.columns[:2])
    if None in ends:
        raise InputError(f"{edges_name} has no columns for tail and head: name them tail and head, or put them first")
    offsets = [name for name in _OFFSETS[:d] if name in table.columns]
    columns = {field: name for field, names in EDGE_VALUES.items() if (name := _named(table, names)) is not None}
    values: dict[str, Any] = {field: _numbers(table[[name]], edges_name)[:, 0] for field, name in columns.items()}
    cell, volume = (_comment(vertex_lines, word, n, vertices_name) for word, n in (("cell", d**2), ("volume", 1)))
    data = NetworkData(
        edges=_indices(table[ends], ids, edges_name),
        positions=positions,
        offsets=_numbers(table[offsets], edges_name) if len(offsets) == d else None,  # type: ignore[arg-type]
        cell=None if cell is None else cell.reshape(d, d),
        volume=None if volume is None else float(volume[0]),
        pins=pinned,
        ids=tuple(ids),
        source=f"tables {edges_name} and {vertices_name}",
        notes=unread([name for name in table.columns if name not in ends and isinstance(name, str)], _READ),
        **values,
    )
    return data if ids else from_zero(data)


def write_tables(data: NetworkData, path: Path) -> None:
    """Write an edge table and a vertex table with headers and all digits, vertices counted from 0."""
    pandas, d = import_module("pandas"), data.dimension
    axes = dict(zip("xyz", data.positions.T, strict=False))
    vertices = pandas.DataFrame({"id": np.arange(data.n_vertices), **axes, "fixed": data.is_pin.astype(int)})
    offsets = np.zeros((data.n_edges, d), int) if data.offsets is None else data.offsets
    edges = dict(zip(("tail", "head", *_OFFSETS[:d]), (*data.edges.T, *offsets.T), strict=True))
    edges |= {**edge_values(data), "length": np.linalg.norm(bond_vectors_of(data), axis=1)}
    known = {"cell": data.cell, "volume": data.volume}
    comments = [f"# {name} {' '.join(map(repr, np.ravel(v).tolist()))}" for name, v in known.items() if v is not None]
    if path.suffix.lower() == ".xlsx":
        with pandas.ExcelWriter(path, engine="openpyxl") as book:
            vertices.to_excel(book, sheet_name="vertices", index=False, startrow=len(comments))
            for row, comment in enumerate(comments):
                book.sheets["vertices"].cell(row + 1, 1, comment)
            pandas.DataFrame(edges).to_excel(book, sheet_name="edges", index=False)
        return
    edges_path, vertices_path = table_paths(path)
    mark = "\t" if path.suffix.lower() == ".tsv" else ","
    with vertices_path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"{comment}\n" for comment in comments)
        vertices.to_csv(file, sep=mark, index=False)
    pandas.DataFrame(edges).to_csv(edges_path, sep=mark, index=False)


def table_paths(path: Path) -> tuple[Path, Path]:
    """The edge table and the vertex table: NAME_edges.csv and NAME_vertices.csv (or NAME_nodes.csv) of NAME.csv."""
    stem = path.stem.removesuffix("_edges").removesuffix("_vertices").removesuffix("_nodes")
    edges, vertices, nodes = (
        path.with_name(f"{stem}_{table}{path.suffix}") for table in ("edges", "vertices", "nodes")
    )
    return edges, nodes if nodes.exists() and not vertices.exists() else vertices


def _sources(path: Path | Sequence[Path]) -> list[tuple[str, list[str]]]:
    """Names and lines of two tables, that of edges first if their names say so."""
    if isinstance(path, Path) and path.suffix.lower() == ".xlsx":
        book = optional("openpyxl").load_workbook(path, read_only=True, data_only=True)
        sheets = {
            f"sheet {sheet.title}": ["\t".join("" if v is None else str(v) for v in row) for row in sheet.values]
            for sheet in book.worksheets
        }
        book.close()
        tables = sorted(sheets.items(), key=lambda sheet: not re.search("edge|bond|link", sheet[0], re.IGNORECASE))[:2]
    else:
        paths = table_paths(path) if isinstance(path, Path) else path
        for part in paths:
            require_regular(part)
        tables = [(part.name, part.read_text(encoding="utf-8-sig").splitlines()) for part in paths]
    if len(tables) != 2:
        raise InputError("a network needs two tables: give one of edges and one of vertices")
    return tables


def _table(name: str, text: list[str]) -> Any:
    """The data frame of lines of text, with its header in lower case; without a header the columns are numbered."""
    pandas = import_module("pandas")
    lines = [line.strip(" ") for line in text]
    first_line = next((line for line in lines if line.strip() and not line.startswith("#")), None)
    if first_line is None:
        raise InputError(f"{name} is an empty table: give one row per vertex or edge")
    # The detection of pandas fails for aligned columns; a comma next to another mark is that of decimals.
    blanks = re.search(r"[0-9] +[-+.0-9]", first_line)
    mark = next((mark for mark in (";", "\t", *("," * (not blanks))) if mark in first_line), r"\s+")
    try:
        table = pandas.read_csv(
            StringIO("\n".join(lines)), sep=mark, header=None, comment="#", dtype=str, keep_default_na=False
        )
    except pandas.errors.ParserError as error:
        raise InputError(f"the rows of {name} differ in their numbers of columns: {error}") from None
    table = table.fillna("").apply(lambda column: column.str.strip())
    number, first = _are_numbers(table), table.iloc[0].str.lower()
    # A first row of text above rows of numbers names the columns, known or not.
    unknown = len(table) > 1 and not number[0].any() and number[1:].all()
    if number[0].all() or not (unknown or set(first) & _KNOWN):
        return table
    if len(table) == 1:
        raise InputError(f"{name} has a header and no rows: give one row per vertex or edge")
    return table.iloc[1:].set_axis(first, axis=1).loc[:, ~first.duplicated().to_numpy()]


def _named(table: Any, names: tuple[str, ...]) -> str | None:
    """The first of these names that a column has."""
    return next((name for name in names if name in table.columns), None)


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


def _comment(lines: list[str], word: str, count: int, name: str) -> Array | None:
    """The numbers (count,) in the comment line of a table that begins with a word, or None."""
    spaced = (line.replace("#", "# ").replace(";", " ") for line in lines if line.lstrip().startswith("#"))
    line = next((line for line in spaced if line.split()[:2] == ["#", word]), None)
    if line is None:
        return None
    numbers = line.partition(word)[2]
    # A comma is that of decimals, or separates.
    for text in (numbers.replace(",", "."), numbers.replace(",", " ")):
        words = text.split()
        if len(words) == count and all(re.fullmatch(NUMBER, each) for each in words):
            return np.array(words, dtype=float)
    raise InputError(f"{name}: the line '# {word}' must give {count} numbers{', the vectors by rows' * (count > 1)}")


def _vertices(table: Any, source: str) -> tuple[list[str], Array, tuple[int, ...]]:
    """Names (empty: counted), positions and the indices of fixed vertices."""
    columns, name = list(table.columns), _named(table, _ID)
    axes = next((axes for axes in _AXES if {*axes[:2]} <= set(columns)), None)
    if axes is not None:
        columns = [axis for axis in axes if axis in columns]
    elif isinstance(columns[0], str):
        raise InputError(f"{source} has no columns x and y: name the coordinates x, y and z in its header")
    elif len(columns) > 2:
        # Three columns of which the first counts or is text: a name and two coordinates.
        counts = (list(map(str, range(start, start + len(table)))) for start in (0, 1))
        if list(table[0]) in counts or not _are_numbers(table[[0]]).all():
            name, columns = columns[0], columns[1:]
    if not 1 <= len(columns) <= 3:
        raise InputError(f"{source} has {len(columns)} columns of coordinates: give 2 or 3, and names in a column id")
    ids = [] if name is None else list(table[name])
    if len(set(ids)) != len(ids):
        raise InputError(f"{source} gives a vertex twice: names must differ")
    fixed = _named(table, _FIXED)
    marks = () if fixed is None else np.flatnonzero(table[fixed].str.lower().isin(_YES))
    return ids, _numbers(table[columns], source), tuple(map(int, marks))


def _indices(ends: Any, ids: list[str], source: str) -> IntArray:
    """Edges as indices of rows of the vertex table, or as numbers where the rows have no names."""
    if ids:
        index = {name: n for n, name in enumerate(ids)}
        try:
            return np.array([[index[a], index[b]] for a, b in ends.to_numpy(object)])
        except KeyError as missing:
            raise InputError(
                f"{source} names the vertex {missing.args[0]!r}, which the vertex table lacks: correct it, or name the "
                "columns tail and head if it is the title of one"
            ) from None
    if not _are_numbers(ends).all():
        raise InputError(f"{source} names vertices by text, and the vertex table has no column id: add one")
    return integers(_numbers(ends, source), f"the vertices of {source}")
