"""`network_from` and `write_network`: anything that describes a network in, and any format out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import floats, of_kind, shown
from critflow.networks import Array, Network
from critflow.points import voronoi_network
from critflow.result import CritflowError, InputError, NetworkError, Solution
from critflow_extras.files.boundaries import Pins, hull_volume, with_offsets, with_pins
from critflow_extras.files.data import NetworkData, from_zero
from critflow_extras.files.formats import READ_PICTURES, format_of_object, is_frame, readable_format, writable_format
from critflow_extras.files.labels import from_labels, read_labels
from critflow_extras.files.polygons import from_outlines, from_polygons
from critflow_extras.files.repair import ImportedNetwork, check, imported, in_its_plane
from critflow_extras.files.tables import has_centres, read_centres, read_tables

# Edges of copies that fit into the memory of a usual computer with their file.
_MOST_EDGES = 10_000_000
# Keywords of one kind of source, which the readers of the others leave.
_BELONGS = {"weld": "polygons", "pixel": "a label mask", "traced": "a label mask", "cutoff": "atoms"}


def network_from(
    source: Any = None,
    *,
    cell: ArrayLike | None = None,
    pins: Pins = None,
    nearest: bool = False,
    strict: bool = False,
    contract: bool = False,
    volume: float | str | None = None,
    voronoi: bool = False,
    **given: Any,
) -> ImportedNetwork:
    """A network from a file or an object of another program, checked and repaired, with one sentence for each repair.

    source   a path; two tables, as paths or pandas data frames; a networkx graph; ASE atoms; a meshio mesh; a case of a
             critflow dataset; an object of shapely or geopandas; a `Network`; or None, with the arrays edges= and
             positions= (and offsets= or bond_vectors=), polygons= (and positions=, where they name corners by
             numbers), or labels=, which may be a path
    cell     (d, d) rows are the cell vectors, where the source has none
    pins     fixed vertices: "hull", "degree", "box", "border" of a label mask, a list of vertices, or a mask
    nearest  accept nearest images of edges longer than 0.4 of the height of the cell
    strict   refuse a source that needs any repair
    contract  join the edges of vertices of two edges: springs in series
    volume   V to which the moduli of a network without a cell refer; that of the source, or "hull", the convex hull,
             by default
    voronoi  the source has the centres of cells, as a table with columns x and y or as an array (n, d), and the network
             is that of their borders in a periodic cell

    Many parameters: hints that a source may lack.  Further keywords are those of the source: offsets, bond_vectors,
    stiffness, rest_lengths, force_densities, positions, edges, cutoff, pixel, traced, weld.  Raises `InputError` or
    `NetworkError` with a question where the source is ambiguous, and `EnvironmentFailure` where a package is missing.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.network_from(edges=[[0, 1], [1, 2]], positions=[[0, 0], [1, 1], [2, 0]], pins=[0, 2]).network
    Network(3 vertices, 2 edges, 2 dimensions, 2 pins, z = 1.333)
    """
    of_kind(np.ndarray, None, cell=cell)
    of_kind(bool, nearest=nearest, strict=strict, contract=contract, voronoi=voronoi)
    of_kind(float, str, None, volume=volume)
    data = _overridden(_of_centres(source, cell) if voronoi else _record(source, given), given)
    if cell is not None and not voronoi:
        if data.cell is not None:
            raise InputError(f"the source, {data.source}, has a cell of its own: leave cell= out, or correct it there")
        if data.source == "polygons" and data.ids:
            raise InputError(
                "corners of polygons are welded in the plane, not across a periodic cell: number the corners, with one "
                "number for all images of each, and give positions= and polygons= without weld="
            )
        data = replace(data, cell=_vectors(cell, data.dimension))
    check(data)
    data = in_its_plane(data)
    read = imported(with_pins(with_offsets(data, nearest), pins), strict, contract)
    return _referring(read, data.volume if volume is None else volume)


def write_network(
    network: Any,
    path: str | PathLike[str],
    coordinates: ArrayLike | None = None,
    *,
    rest_lengths: ArrayLike | None = None,
    force_densities: ArrayLike | None = None,
    copies: int | Sequence[int] = 1,
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
    drawings and solids, which are cut at the border of the cell, and by_stiffness: True, the cross section of each
    strut is that of its stiffness; False, all have one; None, the first where k varies, and SVG has colours and a
    legend.  Raises `InputError` where the format cannot hold the network, `EnvironmentFailure` where its package is
    missing.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> import tempfile
    >>> path = tempfile.mkdtemp() + '/network.csv'
    >>> ce.write_network(cf.lattice("honeycomb", 2, 2), path)
    >>> print(ce.network_from(path).network)
    Network(8 vertices, 12 edges, 2 dimensions, periodic, z = 3)
    """
    path = of_kind(str, PathLike, path=path)
    of_kind(np.ndarray, None, coordinates=coordinates, rest_lengths=rest_lengths, force_densities=force_densities)
    copies = of_kind(int, Sequence, copies=copies)
    target, data = Path(path), data_of(network, coordinates, rest_lengths, force_densities)
    known = writable_format(target, data.dimension, options)
    assert known.write is not None
    known.write(_tiled(data, copies), target, **options)


def _vectors(cell: ArrayLike, d: int) -> Array:
    """Cell vectors (d, d) as rows, of side lengths or vectors."""
    vectors = floats(cell, "the cell")
    vectors = vectors * np.eye(d) if vectors.ndim == 0 else np.diag(vectors) if vectors.ndim == 1 else vectors
    if vectors.shape not in ((d, d), (3, 3)):
        raise InputError(f"the cell must be {d} side lengths or as many vectors as rows, not {vectors.shape}")
    # A plane may be given in space.
    return vectors[:d, :d]


def _of_centres(source: Any, cell: ArrayLike | None) -> NetworkData:
    """The record of the periodic Voronoi network of centres."""
    if _is_path(source) or is_frame(source):
        name = str(source) if _is_path(source) else shown(source)
        with _one_sentence(name, "a table of centres"):
            centres = read_centres(Path(source) if _is_path(source) else source)
    else:
        name, centres = "the array", floats(source, "the centres")
    if cell is None:
        raise InputError(f"{name}: centres of cells need the periodic cell that they lie in: give cell=, its sides")
    if centres.ndim != 2 or centres.shape[1] not in (2, 3):
        raise InputError(f"{name}: centres have two or three columns, not the shape {centres.shape}")
    vectors = _vectors(cell, centres.shape[1])
    points = np.linalg.solve(vectors.T, centres.T).T
    if (span := float(np.ptp(points, axis=0).max())) > 1:
        raise InputError(
            f"{name}: the centres span {span:.3g} cells: give the cell that they lie in, or take them modulo it"
        )
    network = voronoi_network(points=points, cell=vectors)
    note = f"the edges are the borders of the Voronoi cells of {len(centres):,} centres"
    return replace(data_of(network), source=f"centres in {name}").noting(note)


def _tiled(data: NetworkData, copies: int | Sequence[int]) -> NetworkData:
    """The record of copies of the cell along each cell vector, one number or d numbers, joined as one periodic network.

    Raises `InputError` for numbers that are not positive and whole, and where there is no cell to repeat.
    """
    counts, d = np.asarray(copies), data.dimension
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (1,), (d,)) or (counts < 1).any():
        raise InputError(f"copies must be a whole number from 1, or {d} of them, not {copies!r:.40}")
    counts = np.broadcast_to(counts, (d,)).astype(np.int64)
    if (counts == 1).all():
        return data
    if data.cell is None or data.offsets is None:
        raise InputError("copies repeat a periodic cell, and this network has none: leave copies out")
    edges = data.n_edges * float(np.prod(counts, dtype=float))
    if edges > _MOST_EDGES:
        raise InputError(f"these copies have {edges:.1e} edges, more than {_MOST_EDGES:.0e}: give fewer copies")
    images = np.array(list(product(*map(range, counts))))
    m, n = len(images), data.n_vertices
    # The image of each head, counted in old cells, and the copy and the larger cell in which it lies.
    target = images[:, None] + data.offsets[None]
    copy = np.ravel_multi_index(tuple(np.moveaxis(target % counts, -1, 0)), tuple(counts))
    tails = data.edges[None, :, 0] + n * np.arange(m)[:, None]
    heads = data.edges[None, :, 1] + n * copy

    whole = data.with_edges(np.tile(np.arange(data.n_edges), m))
    return replace(
        whole,
        edges=np.stack([tails.ravel(), heads.ravel()], axis=1),
        positions=(data.positions[None] + (images @ data.cell)[:, None]).reshape(m * n, -1),
        cell=counts[:, None] * data.cell,
        offsets=(target // counts).reshape(-1, data.dimension),
        pins=tuple(pin + n * k for k in range(m) for pin in data.pins),
        ids=(),
    )


def _referring(read: ImportedNetwork, volume: float | str | None) -> ImportedNetwork:
    """The network with the volume to which its moduli refer: that of the convex hull where none is named."""
    network, note = read.value, ""
    if volume is None and (network.cell is not None or network.dimension == 1):
        return read
    if volume is None or volume == "hull":
        try:
            hull = hull_volume(read.positions)
        except InputError:
            if volume is None:
                return read
            raise
        volume, note = hull, f"moduli refer to the convex hull, V = {hull:.8g}, unless another volume is given"
    if isinstance(volume, str):
        raise InputError(f"the volume must be a number or 'hull', not {volume!r}")
    if read.data.volume not in (None, volume):
        note = "; ".join(filter(None, (note, f"V = {volume:.8g} in place of the {read.data.volume:.8g} of the source")))
    return replace(read, value=network.with_volume(volume), data=read.data.noting(*([note] if note else [])))


def data_of(
    thing: Any,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    force_densities: ArrayLike | None = None,
) -> NetworkData:
    """The record of a network, or of a configuration or state with those of its values that are not given."""
    thing = thing.value if isinstance(thing, Solution) and not isinstance(thing, ImportedNetwork) else thing
    network = thing if isinstance(thing, Network) else getattr(thing, "network", None)
    if not isinstance(network, Network):
        raise InputError(f"{shown(thing)} cannot be written: give a network, a configuration or a state")

    def known(value: ArrayLike | None, *names: str) -> Any:
        """A value, or the first of these attributes that the thing has."""
        return next((v for v in (value, *(getattr(thing, name, None) for name in names)) if v is not None), None)

    places = known(coordinates, "coordinates")
    if (places := network.positions if places is None else places) is None:
        raise InputError("the network has no positions to write: give coordinates, such as those of a configuration")
    x, pins = np.array(places, dtype=float), sorted(network.pins)
    if x.shape != (network.n_vertices, network.dimension):
        raise InputError(f"coordinates must have shape {(network.n_vertices, network.dimension)}, not {x.shape}")
    x[pins] = network.fixed_positions[pins]
    return NetworkData(
        edges=network.edges,
        positions=x,
        cell=network.cell,
        offsets=network.offsets,
        pins=tuple(pins),
        stiffness=network.stiffness,
        rest_lengths=known(rest_lengths, "rest_lengths"),
        force_densities=known(force_densities, "force_densities", "sigma"),
        volume=network.reference_volume,
        source="critflow",
    )


def _record(source: Any, given: dict[str, Any]) -> NetworkData:
    """The record of a source: files, arrays, an object with a network, or one of another library."""
    if _is_path(source):
        known = readable_format(Path(source))
        assert known.read is not None
        with _one_sentence(source, known.name):
            data = known.read(Path(source), **_taken(given, known.keywords))
    elif isinstance(source, Sequence) and len(source) == 2 and all(_is_path(one) or is_frame(one) for one in source):
        with _one_sentence(" and ".join(str(one) if _is_path(one) else shown(one) for one in source), "tables"):
            data = read_tables([Path(one) if _is_path(one) else one for one in source])
    elif source is None or isinstance(source, Sequence | np.ndarray):
        data = _from_keywords(given if source is None else given | {"edges": source})
    elif isinstance(source, Network | Solution) or isinstance(getattr(source, "network", None), Network):
        data = data_of(source, given.pop("positions", None), None, None)
    elif hasattr(source, "__geo_interface__"):
        data = _of_polygons(source, given)
    else:
        known = format_of_object(source)
        assert known.convert is not None
        with _one_sentence(shown(source), "a network"):
            data = known.convert(source, **_taken(given, known.keywords))
    return data


def _is_path(source: object) -> bool:
    return isinstance(source, str | PathLike)


def _taken(given: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """The keywords of these names, which leave the others."""
    return {name: given.pop(name) for name in names if name in given}


@contextmanager
def _one_sentence(source: object, kind: str) -> Iterator[None]:
    """Errors of readers and their libraries, of any class, as `InputError` with the name of the source."""
    try:
        yield
    except NetworkError as error:
        raise NetworkError(f"{source}: {error}") from None
    except CritflowError:
        raise
    except FileNotFoundError as missing:
        advice = "check its name; the tables of NAME.csv are NAME_edges.csv and NAME_vertices.csv"
        if _is_path(source) and Path(str(source)).exists():
            advice = f"{source} is one of two tables: give the other one after it"
            if has_centres(Path(str(source))):
                advice += "; or voronoi=True and the cell, if its rows are centres of cells: their Voronoi network"
        raise InputError(f"there is no file {missing.filename or source}: {advice}") from None
    except Exception as error:
        text = isinstance(error, UnicodeDecodeError)
        reason = "it is no text in UTF-8: check its name, or save it so" if text else " ".join(str(error).split())
        raise InputError(f"{source} cannot be read as {kind}: {reason or type(error).__name__:.300}") from error


def _from_keywords(given: dict[str, Any]) -> NetworkData:
    if "picture" in given:
        raise InputError(f"a picture {READ_PICTURES}")
    kind = next((kind for kind in ("edges", "polygons", "labels") if kind in given), None)
    if kind is None:
        raise InputError("give a source: a file, an object, or one of edges=, polygons=, labels=")
    value = given.pop(kind)
    if kind == "labels":
        with _one_sentence(value if _is_path(value) else "the array", "a picture"):
            mask = read_labels(Path(value)) if _is_path(value) else value
        return from_labels(mask, **_taken(given, ("pixel", "traced")))
    if kind == "polygons":
        return _of_polygons(value, given)
    if "positions" not in given:
        raise InputError(f"{kind}= needs positions=, one row for each vertex")
    positions = given.pop("positions")
    return from_zero(NetworkData(value, positions))


def _of_polygons(value: Any, given: dict[str, Any]) -> NetworkData:
    """The record of polygons that name their corners by numbers, or that have corners of their own."""
    weld = given.pop("weld", None)
    if "positions" in given:
        return from_polygons(given.pop("positions"), value, weld)
    with _one_sentence(shown(value), "polygons"):
        return from_outlines(value, weld)


def _overridden(data: NetworkData, given: dict[str, Any]) -> NetworkData:
    """The record with values given by keyword, each of one row for an edge."""
    known = ("offsets", "bond_vectors", "stiffness", "rest_lengths", "force_densities")
    for name in sorted(set(given) - set(known)):
        if name in _BELONGS:
            raise InputError(f"{name}= belongs to {_BELONGS[name]}, not to this source: leave it out")
        raise InputError(f"this source takes no keyword {name!r}: choose from {', '.join(known)}")
    values = {name: value for name, value in given.items() if value is not None}
    if np.ndim(values.get("stiffness", ())) == 0:
        values["stiffness"] = np.full(data.n_edges, values["stiffness"])
    return replace(data, **values)
