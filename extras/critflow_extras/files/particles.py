"""Files of particle simulations: LAMMPS data, GSD, and ASE atoms with bonds."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import floats, integers
from critflow.result import InputError
from critflow_extras.files.boundaries import with_offsets
from critflow_extras.files.data import Array, NetworkData, bond_vectors_of, counted, number, optional
from critflow_extras.pruning.digits import Digits, single_precision

_HEADER = "critflow network"
# First column of the coordinates in each atom style with bonds: after number, molecule, type and charge.
_STYLES = {"bond": 3, "angle": 3, "molecular": 3, "full": 4}


def read_lammps(path: Path) -> NetworkData:
    """A LAMMPS data file with bonds, which LAMMPS measures between nearest images.

    The atom styles bond, angle, molecular and full have bonds.  Harmonic `Bond Coeffs` are E = K (r − r0)², so k = 2 K.
    """
    first, *lines = path.read_text(encoding="utf-8").splitlines() or [""]
    titles, sections = _sections(lines)
    if not sections.get("Bonds"):
        raise InputError(f"{path} has no Bonds section: write the data file with bonds")
    atoms = _atoms(sections.get("Atoms", []), titles.get("Atoms", ""))
    atoms = atoms[np.argsort(atoms[:, 0])]
    bonds = integers([[number(word) for word in line[:4]] for line in sections["Bonds"]], "Bonds")
    ids = integers(atoms[:, 0], "numbers of atoms")
    place = np.minimum(np.searchsorted(ids, bonds[:, 2:4]), len(ids) - 1)
    if (ids[place] != bonds[:, 2:4]).any():
        raise InputError(f"{path} has bonds to atoms that it lacks: write all atoms of the simulation")
    given = re.match(rf"{_HEADER} \(fixed(?:, volume ([^)]+))?\)", first)
    # E = K (r − r0)², so k = 2K and ℓ = r0.
    words = [line for line in sections.get("Bond Coeffs", []) if len(line) == 3]
    table, kinds = {int(number(word)): (number(K), number(r0)) for word, K, r0 in words}, bonds[:, 1].tolist()
    springs = np.array([table[kind] for kind in kinds]) if set(kinds) <= set(table) else None
    return NetworkData(
        edges=place,
        positions=atoms[:, 2:],
        cell=None if given else _box(sections[""]),
        nearest_images=True,
        pins=tuple(np.flatnonzero(atoms[:, 1] == 2).tolist()) if given else (),
        stiffness=None if springs is None else 2 * springs[:, 0],
        rest_lengths=None if springs is None else springs[:, 1],
        volume=number(given[1]) if given and given[1] else None,
        ids=tuple(map(str, ids.tolist())),
        source=f"LAMMPS data {path.name}",
    )


def _sections(lines: Iterable[str]) -> tuple[dict[str, str], dict[str, list[list[str]]]]:
    """The comment on the title of each section, and the words of its lines; those before the first have no title."""
    title, titles, sections = "", dict[str, str](), dict[str, list[list[str]]]({"": []})
    for line in lines:
        words, _, comment = (part.strip() for part in line.partition("#"))
        if words[:1].isalpha():
            title = words
            titles[title], sections[title] = comment, []
        elif words:
            sections[title].append(words.split())
    return titles, sections


def _atoms(words: list[list[str]], style: str) -> Array:
    """Number, type and place (n, 5) of each atom, without its charge and the image in which it lies."""
    columns = len(words[0]) if words else 0
    place = _STYLES.get(style or ("molecular" if columns in (6, 9) else "full"))
    if place is None or columns not in (place + 3, place + 6):
        raise InputError(f"'Atoms # {style}' with {columns} columns is not read: write {', '.join(_STYLES)} atoms")
    used = [0, 2, place, place + 1, place + 2]
    return floats([[number(line[column]) for column in used] for line in words], "the lines of atoms")


def _box(header: list[list[str]]) -> Array:
    """The cell (3, 3) of the lines that end with xlo xhi, ylo yhi, zlo zhi and xy xz yz."""
    limits = [line for line in header if line[-1] in ("xhi", "yhi", "zhi", "yz")]
    known = {line[-1]: [number(word) for word in line[: len(line) // 2]] for line in limits}
    if not {"xhi", "yhi", "zhi"} <= set(known):
        raise InputError("the file has no limits xlo xhi, ylo yhi, zlo zhi: write them")
    lx, ly, lz = (known[f"{axis}hi"][1] - known[f"{axis}hi"][0] for axis in "xyz")
    xy, xz, yz = known.get("yz", (0.0, 0.0, 0.0))
    return np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]])


def write_lammps(data: NetworkData, path: Path) -> None:
    """A LAMMPS data file (units lj, atom_style molecular) with one harmonic bond type for each distinct spring.

    LAMMPS has E = K (r − r0)², so K = k/2; rest lengths are the lengths where none are given.  A plane lies in a slab
    as high as its longest cell vector, a network with fixed vertices in a box around it; they have atom type 2.

    Raises `InputError` where a bond is not the nearest image, which LAMMPS cannot express.
    """
    cell, x, origin = _in_box(data)
    k = np.ones(data.n_edges) if data.stiffness is None else data.stiffness
    rest = np.linalg.norm(bond_vectors_of(data), axis=1) if data.rest_lengths is None else data.rest_lengths
    kinds, kind = np.unique(np.stack([k / 2, rest], axis=1), axis=0, return_inverse=True)
    fixed = np.ones(data.n_vertices, int)
    fixed[list(data.pins)] = 2
    atoms = zip(fixed, x.tolist(), strict=True)
    bonds = zip(kind.ravel().tolist(), data.edges.tolist(), strict=True)
    boundary = "periodic" if data.cell is not None else "fixed" + (f", volume {data.volume!r}" if data.volume else "")
    lines = [
        f"{_HEADER} ({boundary}): units lj, atom_style molecular, bond_style harmonic",
        "",
        *(f"{data.n_vertices} atoms", f"{data.n_edges} bonds", "2 atom types", f"{len(kinds)} bond types", ""),
        *(f"{float(origin[i])!r} {float(origin[i] + cell[i, i])!r} {axis}lo {axis}hi" for i, axis in enumerate("xyz")),
        f"{float(cell[1, 0])!r} {float(cell[2, 0])!r} {float(cell[2, 1])!r} xy xz yz",
        *("", "Masses", "", "1 1.0", "2 1.0", "", "Bond Coeffs # harmonic", ""),
        *(f"{n + 1} {a!r} {b!r}" for n, (a, b) in enumerate(kinds.tolist())),
        *("", "Atoms # molecular", ""),
        *(f"{n + 1} 1 {f} {p[0]!r} {p[1]!r} {p[2]!r}" for n, (f, p) in enumerate(atoms)),
        *("", "Bonds", ""),
        *(f"{n + 1} {b + 1} {i + 1} {j + 1}" for n, (b, (i, j)) in enumerate(bonds)),
        "",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")


def _in_box(data: NetworkData) -> tuple[Array, Array, Array]:
    """A cell (3, 3) with its first vector along x and its second in the plane, wrapped positions, the cell's origin."""
    x, d = data.positions, data.dimension
    if data.cell is None:
        size = 2 * float(np.ptp(x, axis=0).max())
        cell, low = size * np.eye(d), x.min(axis=0) - size / 4
    else:
        cell, low = data.cell, np.zeros(d)
        nearest = with_offsets(replace(data, offsets=None), nearest=True)
        other = np.flatnonzero((np.asarray(nearest.offsets) != data.offsets).any(axis=1))
        x = x - np.floor(x @ np.linalg.inv(cell)) @ cell
        if len(other):
            raise InputError(
                f"{len(other)} edges do not join nearest images, edge {other[0]} first, which this format cannot "
                "express: write several copies of the cell (copies=2), or another format"
            )
        if np.linalg.det(cell) < 0:
            raise InputError("the cell vectors are left-handed: exchange two of them and the columns of the offsets")
        # Turned so that the cell is lower triangular, as LAMMPS requires.
        q, r = np.linalg.qr(cell.T)
        signs = np.sign(np.diag(r))
        if (np.abs(np.triu(cell, 1)) > 0).any() or (np.diag(cell) <= 0).any():
            turn = q * signs
            cell, x = np.tril((r * signs[:, None]).T), x @ turn
    whole = np.eye(3) * float(np.linalg.norm(cell, axis=1).max())
    whole[:d, :d] = cell
    positions, origin = np.zeros((len(x), 3)), np.zeros(3)
    positions[:, :d], origin[:d] = x, low
    # In the plane z = 0, which LAMMPS requires within the box.
    origin[d:] = -0.5 * whole[2, 2]
    return whole, positions, origin


def read_gsd(path: Path) -> NetworkData:
    """The last frame of a GSD file with bonds, which join nearest images; box (lx, ly, lz, xy, xz, yz)."""
    hoomd = optional("gsd.hoomd")
    with hoomd.open(str(path), "r") as trajectory:
        frame = trajectory[-1]
    if not frame.bonds.N:
        raise InputError(f"{path} has no bonds: write them with the particles")
    lx, ly, lz, xy, xz, yz = (float(value) for value in frame.configuration.box)
    d = int(frame.configuration.dimensions or 3)
    cell = np.array([[lx, 0, 0], [xy * ly, ly, 0], [xz * lz, yz * lz, lz]])[:d, :d]
    fixed = frame.particles.types.index("fixed") if "fixed" in frame.particles.types else -1
    pins = np.flatnonzero(np.asarray(frame.particles.typeid) == fixed)
    return NetworkData(
        edges=frame.bonds.group,
        # The cell of GSD is centred at the origin.
        positions=np.asarray(frame.particles.position, dtype=float)[:, :d] + 0.5 * cell.sum(axis=0),
        cell=None if len(pins) else cell,
        nearest_images=True,
        pins=tuple(pins.tolist()),
        volume=float(frame.log["volume"][0]) if "volume" in frame.log else None,
        source=f"GSD {path.name}",
        # As the file has them, before the shift to the corner of the cell.
        known_digits=Digits(None, single_precision(float(np.abs(frame.particles.position).max()))),
    )


def write_gsd(data: NetworkData, path: Path) -> None:
    """One GSD frame with bonds; GSD has single precision and joins nearest images.  Fixed vertices have typeid 1."""
    hoomd = optional("gsd.hoomd")
    cell, x, origin = _in_box(data)
    frame = hoomd.Frame()
    (lx, ly, lz), height = np.diag(cell), 0 if data.dimension == 2 else cell[2, 2]
    frame.configuration.box = [lx, ly, height, cell[1, 0] / ly, cell[2, 0] / lz, cell[2, 1] / lz]
    frame.configuration.dimensions = data.dimension
    frame.particles.N = data.n_vertices
    # The cell of GSD is centred at the origin.
    centre = (origin + 0.5 * cell.sum(axis=0)) * (np.arange(3) < data.dimension)
    frame.particles.position = (x - centre).astype(np.float32)
    frame.particles.types = ["free", "fixed"]
    kinds = np.zeros(data.n_vertices, np.uint32)
    kinds[list(data.pins)] = 1
    frame.particles.typeid = kinds
    frame.bonds.N = data.n_edges
    frame.bonds.types = ["edge"]
    frame.bonds.typeid = np.zeros(data.n_edges, np.uint32)
    frame.bonds.group = data.edges.astype(np.uint32)
    if data.volume is not None:
        frame.log["volume"] = np.array([data.volume])
    with hoomd.open(str(path), "w") as file:
        file.append(frame)


def from_atoms(
    atoms: Any, edges: ArrayLike | None = None, offsets: ArrayLike | None = None, cutoff: Any = None
) -> NetworkData:
    """ASE atoms with edges: pairs with their cell shifts S (`neighbor_list("ijS")`), a cutoff, or an array of bonds.

    Without periodic directions the atoms are a free patch; a direction that alone is not periodic must be flat.  Atoms
    of `FixAtoms` are fixed; other constraints are named in a note.
    """
    if edges is None and cutoff is not None:
        first, second, shift = optional("ase.neighborlist").neighbor_list("ijS", atoms, cutoff)
        edges, offsets = np.stack([first, second], axis=1), shift
    if edges is None:
        raise InputError("the atoms have no bonds: give edges= (and offsets=, the cell shifts S), or cutoff=")
    periodic = np.asarray(atoms.get_pbc())
    x = np.asarray(atoms.get_positions(), dtype=float)
    cell = np.asarray(atoms.get_cell()[:], dtype=float)
    if periodic.any() and not periodic.all():
        if not abs(np.linalg.det(cell)) > 0:
            cell = np.where(np.linalg.norm(cell, axis=1)[:, None] > 0, cell, np.eye(3) * (1 + np.ptp(x)))
    constraints = [(type(one).__name__, one) for one in atoms.constraints]
    fixed = [one.get_indices() for kind, one in constraints if kind == "FixAtoms"]
    pins = np.unique(np.concatenate(fixed)) if fixed else np.zeros(0, int)
    other = sorted({kind for kind, _ in constraints if kind != "FixAtoms"})
    known = (f"{counted(len(pins), 'vertex', 'is')} fixed (FixAtoms)",) if len(pins) else ()
    unknown = (f"constraints that were not read: {', '.join(other)}",) if other else ()
    return NetworkData(
        edges=edges,  # type: ignore[arg-type]
        positions=x,
        cell=cell if periodic.any() else None,
        offsets=offsets if periodic.any() else None,  # type: ignore[arg-type]
        pins=tuple(pins.tolist()),
        source="ASE atoms",
        notes=(*known, *unknown),
    )
