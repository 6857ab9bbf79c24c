"""Tables of vertices and edges as text, with or without header, vertices counted from 0 or 1 or named."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from critflow.exchange.data import Array, IntArray, NetworkData, bond_vectors_of, from_zero, unread
from critflow.result import InputError

# Names of columns, in lower case, that are recognised in a header.
_TAIL = ("tail", "source", "from", "i", "u", "node1", "vertex1", "id1", "start")
_HEAD = ("head", "target", "to", "j", "v", "node2", "vertex2", "id2", "end")
_ID = ("id", "vertex", "node", "index", "name", "label")
_AXES = (("x", "y", "z"), ("pos_x", "pos_y", "pos_z"), ("x0", "x1", "x2"))
_OFFSETS = ("offset_x", "offset_y", "offset_z")
_EDGE_VALUES = {
    "stiffness": ("stiffness", "k"),
    "rest_lengths": ("rest_length", "rest_lengths", "length0", "l0"),
    "force_densities": ("force_density", "sigma", "q"),
}
# The length, and the number of an edge, follow from the rest.
_READ = {
    *_TAIL,
    *_HEAD,
    *_OFFSETS,
    *(name for names in _EDGE_VALUES.values() for name in names),
    "length",
    "edge",
    "id",
}


def read_tables(edges_path: Path, vertices_path: Path) -> NetworkData:
    """The network of an edge table and a vertex table.

    Edge columns: tail and head, then optional offsets, stiffness, rest length and force density by name.  Vertex
    columns: coordinates, with an optional first column of names.  Without a header columns are taken in this order.
    A comment line `# cell` with d² numbers in the vertex table gives the cell vectors, row by row.
    """
    ids, positions, pinned = _vertices(vertices_path)
    header, rows = _rows(edges_path)
    width = len(rows[0])
    tail, head = (_column(header, names, k) for k, names in enumerate((_TAIL, _HEAD)))
    if header and tail is None and head is None and not set(header) & _READ:
        tail, head = 0, 1
    if width < 2 or tail is None or head is None:
        raise InputError(f"{edges_path} has no columns for tail and head: name them tail and head, or put them first")
    edges = _indices([(row[tail], row[head]) for row in rows], ids, edges_path)
    d = positions.shape[1]
    columns = [_named(header, (name,)) for name in _OFFSETS[:d]]
    given = [c for c in columns if c is not None]
    offsets = None
    if header and len(given) == d:
        offsets = _numbers(rows, given, edges_path).astype(np.int64)
    values = {
        name: None if (c := _named(header, names)) is None else _numbers(rows, [c], edges_path)[:, 0]
        for name, names in _EDGE_VALUES.items()
    }
    data = NetworkData(
        edges=edges,
        positions=positions,
        offsets=offsets,
        cell=_cell(vertices_path, d),
        pins=pinned,
        ids=tuple(ids),
        source=f"tables {edges_path.name} and {vertices_path.name}",
        notes=unread([name for n, name in enumerate(header) if n not in (tail, head)], _READ),
        stiffness=values["stiffness"],
        rest_lengths=values["rest_lengths"],
        force_densities=values["force_densities"],
    )
    return data if ids else from_zero(data)


def write_tables(data: NetworkData, edges_path: Path, vertices_path: Path) -> None:
    """Write an edge table and a vertex table with headers and all digits, vertices counted from 0."""
    d = data.dimension
    fixed = np.zeros(data.n_vertices, int)
    fixed[list(data.pins)] = 1
    head = ["id", *"xyz"[:d], "fixed"]
    body = ([n, *map(repr, map(float, x)), int(f)] for n, (x, f) in enumerate(zip(data.positions, fixed, strict=True)))
    cell = "" if data.cell is None else f"# cell {' '.join(map(repr, map(float, data.cell.ravel())))}\n"
    _write(vertices_path, head, body, cell)
    offsets = np.zeros((data.n_edges, d), int) if data.offsets is None else data.offsets
    names = [name for name in _EDGE_VALUES if getattr(data, name) is not None]
    columns = [getattr(data, name) for name in names]
    length = np.linalg.norm(bond_vectors_of(data), axis=1)
    head = ["tail", "head", *_OFFSETS[:d], *(_EDGE_VALUES[name][0] for name in names), "length"]
    rows = (
        [*map(int, edge), *map(int, offset), *(repr(float(c[n])) for c in columns), repr(float(length[n]))]
        for n, (edge, offset) in enumerate(zip(data.edges, offsets, strict=True))
    )
    _write(edges_path, head, rows)


def _cell(path: Path, dimension: int) -> Array | None:
    """The cell (d, d) in a comment line of a vertex table, or None."""
    for line in path.read_text(encoding="utf-8-sig").splitlines():
        words = line.replace(",", " ").split()
        if words[:2] == ["#", "cell"]:
            if len(words) != 2 + dimension**2 or not all(map(_is_number, words[2:])):
                raise InputError(
                    f"{path}: the line '# cell' must give {dimension**2} numbers, the cell vectors by rows"
                )
            return np.array([float(word) for word in words[2:]]).reshape(dimension, dimension)
    return None


def _write(path: Path, head: list[str], rows: object, comment: str = "") -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(comment)
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)  # type: ignore[arg-type]


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header (empty without one) and rows of a table, separated by commas, semicolons, tabs or blanks."""
    text = path.read_text(encoding="utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(f"{path} is an empty table: give one row per vertex or edge")
    separator = next((mark for mark in (",", ";", "\t") if mark in lines[0]), None)
    rows = [[cell.strip().strip('"') for cell in line.split(separator)] for line in lines]
    known = {*_TAIL, *_HEAD, *_ID, *(axis for axes in _AXES for axis in axes)}
    words = not all(map(_is_number, rows[0]))
    # A first row of text above rows of numbers names the columns, known or not.
    has_header = words and (
        any(cell.lower() in known for cell in rows[0])
        or (len(rows) > 1 and not any(map(_is_number, rows[0])) and all(all(map(_is_number, row)) for row in rows[1:]))
    )
    header = [cell.lower() for cell in rows.pop(0)] if has_header else []
    if not rows:
        raise InputError(f"{path} has a header and no rows: give one row per vertex or edge")
    for n, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise InputError(
                f"row {n + 1} of {path} has {len(row)} columns and the first row {len(rows[0])}: correct it"
            )
    return header, rows


def _vertices(path: Path) -> tuple[list[str], Array, tuple[int, ...]]:
    """Names (empty: counted), positions and the indices of fixed vertices."""
    header, rows = _rows(path)
    if header:
        axes = next((axes for axes in _AXES if axes[0] in header and axes[1] in header), None)
        if axes is None:
            raise InputError(f"{path} has no columns x and y: name the coordinates x, y and z in its header")
        columns = [header.index(axis) for axis in axes if axis in header]
        name = _named(header, _ID)
    else:
        # Three columns of which the first counts or is text: a name and two coordinates.
        first = [row[0] for row in rows]
        counts = first in ([str(n) for n in range(len(rows))], [str(n + 1) for n in range(len(rows))])
        name = 0 if len(rows[0]) > 2 and (counts or not all(map(_is_number, first))) else None
        columns = list(range(0 if name is None else 1, len(rows[0])))
    if not 1 <= len(columns) <= 3:
        raise InputError(f"{path} has {len(columns)} columns of coordinates: give 2 or 3, and names in a column id")
    ids = [] if name is None else [row[name] for row in rows]
    if len(set(ids)) != len(ids):
        raise InputError(f"{path} gives a vertex twice: names must differ")
    fixed = _named(header, ("fixed", "pinned", "pin"))
    marks = [] if fixed is None else [n for n, row in enumerate(rows) if row[fixed].lower() in ("1", "true", "yes")]
    return ids, _numbers(rows, columns, path), tuple(marks)


def _indices(pairs: list[tuple[str, str]], ids: list[str], path: Path) -> IntArray:
    """Edges as indices of rows of the vertex table, or as numbers where the rows have no names."""
    if ids:
        index = {name: n for n, name in enumerate(ids)}
        try:
            return np.array([[index[a], index[b]] for a, b in pairs])
        except KeyError as missing:
            raise InputError(f"{path} names the vertex {missing.args[0]!r}, which the vertex table lacks") from None
    try:
        return np.array([[int(a), int(b)] for a, b in pairs])
    except ValueError:
        raise InputError(f"{path} names vertices by text, and the vertex table has no column id: add one") from None


def _column(header: list[str], names: tuple[str, ...], place: int) -> int | None:
    return _named(header, names) if header else place


def _named(header: list[str], names: tuple[str, ...]) -> int | None:
    return next((header.index(name) for name in names if name in header), None)


def _numbers(rows: list[list[str]], columns: list[int], path: Path) -> Array:
    try:
        return np.array([[float(row[c]) for c in columns] for row in rows])
    except ValueError as error:
        raise InputError(f"{path}: {error}: correct that row") from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
