"""An examination, and its report as lines of text that are also Markdown."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from critflow.checks import components
from critflow.elastic import Elasticity
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network
from critflow.result import InputError, Record, Solution, Status
from critflow_extras.anisotropy.tensors import poisson, young
from critflow_extras.cables.onset_end import CriticalStrain
from critflow_extras.certificates.counts import Rigidity, n_rotations
from critflow_extras.certificates.spaces import zero_modes
from critflow_extras.files.data import counted
from critflow_extras.files.repair import described
from critflow_extras.fronts.leverage import EdgeLeverage
from critflow_extras.inference.nearest import Nearest

# Distance from the nearest critical configuration, in units of the mean edge length, up to which a network counts as
# one that its program has relaxed to a tolerance: the loosest ones in use are 1e-3.
RELAXED = 1e-3
# Participation of a vertex, at most, that does not move.
_AT_REST = 1e-6
_MOST_EDGES = 5
# Floppy modes up to which the vertices that move most say what is loose.
_FEW_MODES = 50
# A descent that ended so still holds a critical configuration.
UNFINISHED = (Status.stalled, Status.step_limit)
# Moduli below this part of the largest component are printed as zero.
_ZERO = 1e-12
# Words for each order of rigidity, and what it means.
_ORDERS = {
    "floppy": ("floppy", "motions exist that change no length to second order"),
    "critical": ("critical", "one self-stress, in tension on every edge, makes it rigid at the transition"),
    "first": ("rigid to first order", "no motion keeps all lengths"),
    "prestress": ("rigid to second order", "a self-stress stabilises every floppy motion"),
    "second": ("rigid to second order", "several self-stresses, of which none alone is enough, stabilise every motion"),
    "undecided": ("undecided", ""),
}
_STRAINS = {
    "dilation": "relative increase of the volume (area in 2D)",
    "simple_shear": "x is shifted by γ y",
    "pure_shear": "x is stretched by 1 + γ, y by 1/(1 + γ)",
    "uniaxial": "x is stretched by 1 + γ, other sides fixed",
}
_UNITS = {2: "that of k", 3: "that of k over length"}


@dataclass(frozen=True, eq=False, repr=False)
class Examination(Record):
    """The answers to the questions about one network; a part that could not be computed is None, with a sentence.

    order         of the coordinates as given: "floppy", "critical" (one self-stress, in tension on every edge), "first"
                  (rigid to first order), "prestress" (a self-stress stabilises all floppy modes), "second" or
                  "undecided"
    rigidity      self-stresses, zero modes and the gap of singular values
    tolerance     singular values below it count as zero
    tension       least |σ| over the largest of the best self-stress in tension on every edge; 0 where none exists
    nearest       the nearest critical configuration, or that towards which the descent tends
    leverage      B_0 of that configuration after the cut of each edge
    critical_elasticity  tensors of that configuration, at the transition
    critical_strains  by name of the deformation, for the rest lengths
    elasticity    tensors at the coordinates, springs at rest; None where the network is critical within a tolerance,
                  whose moduli are those of the nearest critical configuration
    rounding      distance to a critical configuration that rounded coordinates may cause; 0 where they have all digits
    notes         sentences on the source
    names         (N_v,) names of the vertices in the source; empty: their numbers
    failures      sentences on parts that could not be computed
    """

    network: Network
    coordinates: Array
    order: str
    rigidity: Solution[Rigidity]
    tolerance: float
    tension: float | None
    nearest: Nearest | None
    critical_elasticity: Solution[Elasticity] | None
    rounding: float
    critical_strains: dict[str, Solution[CriticalStrain]] = field(default_factory=dict)
    elasticity: Solution[Elasticity] | None = None
    leverage: EdgeLeverage | None = None
    notes: tuple[str, ...] = ()
    names: tuple[str, ...] = field(default=(), repr=False)
    failures: tuple[str, ...] = ()

    @property
    def n_self_stresses(self) -> int:
        """Number of self-stresses at the coordinates."""
        return self.rigidity.value.n_self_stresses

    def vertex_name(self, vertex: int) -> str:
        """Name of a vertex in the source."""
        return self.names[vertex] if self.names else str(vertex)

    def edge_name(self, edge: int) -> str:
        """Number of an edge of the network and the names of its ends."""
        tail, head = self.network.edges[edge]
        return f"{edge} ({self.vertex_name(int(tail))}–{self.vertex_name(int(head))})"

    @property
    def n_floppy_modes(self) -> int:
        """Number of zero modes that are neither translations of a periodic network nor rotations about its pins."""
        counts = self.rigidity.value
        return counts.n_zero_modes - counts.n_trivial - self._rotations

    @property
    def _rotations(self) -> int:
        """Rotations that keep all fixed vertices in place; the cell keeps a periodic network from rotating."""
        return n_rotations(self.network, self.coordinates)

    @property
    def rotates(self) -> bool:
        """Whether rotations about the fixed vertices are the only motions."""
        return self.order == "floppy" and self._rotations > 0 and not self.n_floppy_modes

    @cached_property
    def _floppy_modes(self) -> Array | None:
        """Orthonormal zero modes (n, N_v, d) but the translations; None for too many."""
        try:
            return zero_modes(self.network, self.coordinates, self.tolerance).value.modes
        except InputError:
            return None

    @property
    def participation(self) -> Array | None:
        """Σ over orthonormal floppy modes of |u_i|²/d, (N_v,), the part of each vertex; None for too many modes."""
        modes = self._floppy_modes
        return None if modes is None else np.einsum("mid,mid->i", modes, modes) / self.network.dimension

    @property
    def distance(self) -> float:
        """Distance to the nearest critical configuration in units of the mean edge length; NaN without one."""
        lengths = np.linalg.norm(self.network.bond_vectors(self.coordinates), axis=1)
        return np.nan if self.nearest is None else self.nearest.distance / float(lengths.mean())

    @property
    def critical(self) -> CriticalConfiguration | None:
        """The nearest critical configuration, where its response follows from one self-stress; else None."""
        return None if self.nearest is None or self.critical_elasticity is None else self.nearest.value

    @property
    def nearly_critical(self) -> bool:
        """Whether the network is not critical as given, but within `RELAXED` edges."""
        near, moduli = self.nearest, self.critical_elasticity
        one = near is not None and near.ok and moduli is not None and getattr(moduli, "n_self_stresses", 0) == 1
        return one and self.order not in ("critical", "first") and self.distance <= RELAXED

    @cached_property
    def loose(self) -> tuple[int, int]:
        """Numbers of connected parts that move freely, and of their vertices, in a network that is rigid elsewhere."""
        stiff = self.elasticity is not None and self.elasticity.ok and self.elasticity.value.tensor.any()
        # The modes of a large network take most of the time of an examination.
        modes = self._floppy_modes if self.order == "floppy" and stiff else None
        if modes is None:
            return 0, 0
        # Modes of a periodic network have a mean of zero: the rigid part moves as one, and is the larger one.
        rest = 0.0 if self.network.pins else np.median(modes, axis=1, keepdims=True)
        moves = np.abs(modes - rest).max(axis=(0, 2)) > _AT_REST
        if moves[self.network.free].all():
            return 0, 0
        inside = self.network.edges[moves[self.network.edges].all(axis=1)]
        return len(np.unique(components(inside, len(moves))[moves])), int(moves.sum())

    @property
    def headline(self) -> tuple[str, str]:
        """The rigidity in words, and what they mean."""
        title, meaning = _ORDERS[self.order]
        if self.nearly_critical:
            near = (
                "one self-stress, in tension on every edge, at the nearest critical configuration; strictly, as given,"
            )
            by_digits = self.nearest is not None and self.rounding >= self.nearest.distance
            cause = ", which the digits of the coordinates explain" if by_digits else ""
            return f"critical within {self.distance:.1g} of an edge", f"{near} {title}{cause}"
        if self.rotates:
            return "rigid, but free to rotate", "its fixed vertices lie on one line or point"
        parts, vertices = self.loose
        if parts:
            inner = f"the self-stresses resist strain, and {counted(vertices, 'vertex')} can move without resistance"
            return f"rigid, with {counted(parts, 'loose part')}", inner
        if self.order == "first" and self.network.cell is not None:
            meaning = "no motion in this cell keeps all lengths"
        if self.order == "floppy":
            part = self.n_self_stresses > 0
            meaning += "; the self-stresses stiffen a part of it only" if part else ", and every modulus is zero"
        return title, meaning or self.rigidity.note

    @property
    def title(self) -> str:
        """The rigidity in words."""
        return self.headline[0]

    @property
    def verdict(self) -> str:
        """The rigidity in one sentence, by which rules for fixed vertices are compared."""
        if self.nearly_critical or self.order == "critical":
            return f"{self.title}, one self-stress in tension"
        counts = f"{counted(self.n_self_stresses, 'self-stress')}, {counted(self.n_floppy_modes, 'floppy mode')}"
        if self.nearest is None:
            return f"{self.title}, {counts}"
        limit = "at most " if self.nearest.status in UNFINISHED else ""
        return f"{self.title}, {counts}; {limit}{self.distance:.1g} of an edge from a critical configuration"

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences on what to do next, in Python."""
        return advice_of(self)

    def __str__(self) -> str:
        return "\n".join(report_lines(self))


def report_lines(examination: Examination, file: str = "") -> list[str]:
    """The report as lines of text, which are also Markdown: the answer first.

    file  name of the file that was examined, for advice that names commands in place of functions
    """
    k, L = examination.network.stiffness, examination.network.bond_vectors(examination.coordinates)
    stiffness = f"{k.min():.6g}" if k.min() == k.max() else f"from {k.min():.6g} to {k.max():.6g}"
    units = (
        f"units: lengths as in the source, mean edge length {np.linalg.norm(L, axis=1).mean():.6g}; stiffness k "
        f"{stiffness}; moduli are not divided by k, their unit is {_UNITS.get(examination.network.dimension, 'force')}"
    )
    source = [f"- {sentence}" for sentence in (*examination.notes, units)]
    lines = [*_summary(examination, file), "## As read", "", *source, ""]
    lines += [*_rigidity(examination), *_nearest(examination)]
    if examination.critical_strains:
        lines += [
            "## Critical strains",
            "",
            "| deformation | γ_c | taut edges | valid for | γ |",
            "|---|---|---|---|---|",
        ]
        for name, onset in examination.critical_strains.items():
            springs = "springs" if onset.value.valid_for_springs else "cables"
            strain, meaning = f"{onset.value.strain:.8g}", _STRAINS.get(name, "")
            lines.append(f"| {name} | {strain} | {_taut(onset)} | {springs} | {meaning} |")
        lines.append("")
    if examination.elasticity is not None:
        lines += ["## Moduli at these positions, springs at rest", "", *_moduli(examination.elasticity), ""]
    if examination.failures:
        lines += ["## Not computed", "", *(f"- {sentence}" for sentence in examination.failures), ""]
    return lines


def _summary(examination: Examination, file: str) -> list[str]:
    """Title, answer and advice."""
    here, there = examination.elasticity, examination.critical_elasticity
    title, meaning = examination.headline
    answer = [f"**{title}**" + (f": {meaning}" if meaning else "")]
    known = _finite(here)
    if here is not None and known:
        answer.append(_bulk_and_shear(here.value))
    if there is not None and _finite(there):
        if examination.nearly_critical:
            answer.append(f"{_bulk_and_shear(there.value, '_0')} at that configuration")
        elif not (known and examination.order == "critical"):
            answer.append(f"at the nearest critical configuration {_bulk_and_shear(there.value, '_0')}")
    answer += [f"next: {sentence}" for sentence in advice_of(examination, file)]
    return [f"# {described(examination.network)}", "", *(f"- {sentence}" for sentence in answer), ""]


def _finite(solution: Solution[Elasticity] | None) -> bool:
    """Whether an elasticity is known."""
    return solution is not None and bool(np.isfinite(solution.value.tensor).all())


def _rigidity(examination: Examination) -> list[str]:
    """Counts, the gap behind them, and what moves."""
    rigidity, tension, n_modes = examination.rigidity, examination.tension, examination.n_floppy_modes
    counts, lines = rigidity.value, ["## Rigidity", ""]
    if np.isnan(counts.largest_zero):
        return []
    if rigidity.note and examination.order != "undecided":
        lines.append(f"- {rigidity.note}")
    zero = f"{counts.largest_zero:.1e} counts as zero, " if counts.largest_zero else ""
    # Without the self-stresses the gap of a large network is a limit.
    least = "at least " if len(counts.self_stresses) < counts.n_self_stresses else ""
    rotations = examination._rotations
    lines += [
        f"- {counted(counts.n_self_stresses, 'self-stress')}, {counted(n_modes, 'floppy mode')}"
        + (f", {counted(rotations, 'rotation')} about the fixed vertices" if rotations else ""),
        f"- singular values: {zero}the least above zero is {least}{counts.smallest_nonzero:.1e} (tolerance "
        f"{examination.tolerance:.0e})",
    ]
    lines += _free_cell(examination)
    if tension is not None:
        exists = f"exists: its least σ is {tension:.2g} of the largest" if tension else "does not exist"
        lines.append(f"- a self-stress in tension on every edge {exists}")
    if 0 < n_modes <= _FEW_MODES and examination.participation is not None:
        most = np.argsort(examination.participation)[::-1][:_MOST_EDGES]
        lines.append(
            f"- vertices that move most in the floppy motions: {', '.join(map(examination.vertex_name, most))}"
        )
    return [*lines, ""]


def _free_cell(examination: Examination) -> list[str]:
    """Counts where the cell may deform too, N_s − rank C and N_0 + d(d + 1)/2 − rank C, with the gap of the rank.

    C is the tensor of the springs at rest (Guest and Hutchinson 2003; Borcea and Streinu 2010).
    """
    network = examination.network
    found = examination.critical_elasticity if examination.order == "critical" else examination.elasticity
    if network.cell is None or network.pins or examination.order == "undecided" or not _finite(found):
        return []
    assert found is not None
    values = np.linalg.eigvalsh(found.value.tensor)[::-1]
    rank = int(np.sum(values > _ZERO * values[0]))
    stresses, motions = examination.n_self_stresses - rank, examination.n_floppy_modes + len(values) - rank
    gap = f", eigenvalues {values[rank - 1]:.1e} and {values[rank]:.1e}" if 0 < rank < len(values) else ""
    counts = f"{counted(stresses, 'self-stress')}, {counted(motions, 'floppy mode')}"
    return [f"- in a cell that may deform: {counts} (the rank of C is {rank} of {len(values)}{gap})"]


def _nearest(examination: Examination) -> list[str]:
    """Distance, stresses, and the edges that matter most in the nearest critical configuration."""
    near = examination.nearest
    if near is None:
        return []
    sigma, errors = near.value.sigma, near.stress_error
    known = ""
    if np.isfinite(errors).all():
        # Squares of huge errors overflow.
        error = float(np.sqrt(np.mean(np.minimum(errors, errors.size) ** 2)))
        known = f", relative standard error {error:.1e}" if error < 1 else "; the positions hardly determine them"
    limit = "at most " if near.status in UNFINISHED else ""
    lines = [
        "## Nearest critical configuration",
        "",
        f"- root mean square distance of the vertices {limit}{near.distance:.3e}, largest "
        f"{np.linalg.norm(near.displacement, axis=1).max():.3e}",
        f"- force densities σ from {float(sigma.min()):.3g} to {float(sigma.max()):.3g} (mean square 1){known}",
    ]
    # σ²|L|²/k over its sum: the part of each edge in the compliance at the transition.
    energy = near.value.tensions**2 / near.value.network.stiffness
    lines += _edges(examination, "edges with the largest shares of its compliance", energy / energy.sum())
    if examination.leverage is not None:
        lowered = 0.0 - examination.leverage.change / examination.leverage.before
        lines += _edges(
            examination, "edges whose cut lowers B_0 most, with the stress of the others unchanged", lowered
        )
    if limit:
        lines.append("- the search ended before the minimum, so the distance is an upper limit")
    elif near.note:
        lines.append(f"- {near.status.name}: {near.note}")
    if examination.critical_elasticity is not None:
        same = examination.order == "critical"
        lines += ["- moduli: those below"] if same else _moduli(examination.critical_elasticity, "_0")
    return [*lines, ""]


def _edges(examination: Examination, what: str, parts: Array) -> list[str]:
    """The edges of the largest parts (N_b,), of those that are finite, in per cent."""
    finite = np.flatnonzero(np.isfinite(parts))
    largest = finite[np.argsort(-parts[finite], kind="stable")][:_MOST_EDGES]
    named = (f"{examination.edge_name(int(edge))} {100 * parts[edge]:.3g} %" for edge in largest)
    return [f"- {what}: {', '.join(named)}"] if len(largest) else []


def _taut(onset: Solution[CriticalStrain]) -> str:
    return f"{int(onset.value.taut.sum())} of {len(onset.value.taut)}"


def _moduli(solution: Solution[Elasticity], index: str = "") -> list[str]:
    """Status, moduli and tensor of an elasticity."""
    tensor = solution.value
    if not np.isfinite(tensor.tensor).all():
        return [f"- {solution.status.name}: {solution.reason}"]
    lines = [f"- {'' if solution.ok else f'{solution.status.name}: '}{_bulk_and_shear(tensor, index)}"]
    if not tensor.tensor.any():
        return lines
    x, y = np.eye(tensor.dimension)[:2]
    ratio = poisson(tensor, x, y)
    if np.isfinite(ratio):
        lines.append(f"- along x: Young's modulus {young(tensor, x):.8g}, Poisson's ratio {ratio:.6g}")
    names, energy = tensor.components, _without_rounding(tensor, tensor.tensor)
    rows = [f"| {name} | {' | '.join(f'{c:.6g}' for c in row)} |" for name, row in zip(names, energy, strict=True)]
    return [*lines, "", f"| C | {' | '.join(names)} |", "|---" * (1 + len(names)) + "|", *rows]


def _bulk_and_shear(tensor: Elasticity, index: str = "") -> str:
    bulk, shear = _without_rounding(tensor, np.array([tensor.bulk, tensor.shear]))
    return f"B{index} = {bulk:.8g}, G{index} = {shear:.8g}"


def _without_rounding(tensor: Elasticity, moduli: Array) -> Array:
    """Moduli with zeros in place of what rounding leaves of them."""
    return np.where(np.abs(moduli) < _ZERO * np.abs(tensor.tensor).max(), 0.0, moduli)


# What to do next in Python, and as commands.
_FUNCTIONS = {
    "strain": "strain_path follows it from there",
    "stiffest": "nearest_critical(...).value is it, optimize(network, 'bulk_modulus') gives the stiffest one",
    "critical": "elasticity and stiffening give its response; strain_path follows it past the transition",
    "nearly": "nearest.value is the critical configuration: elasticity and stiffening give its response",
    "first": "it is rigid at rest: elasticity gives its tensor; diluted(...) leads to the transition",
    "prestress": "elasticity gives its tensor at rest; signed_stress and strain_path follow it under stress",
}
_COMMANDS = {
    "strain": "others follow at the strains below",
    "stiffest": "critflow make FILE --objective nearest --out OUT gives it, and without --objective the stiffest one",
    "critical": "critflow explore FILE strains it past the transition; critflow make FILE --out OUT --target C_B=0 "
    "changes its stiffening",
    "nearly": "critflow make FILE --objective nearest --out OUT gives that configuration, and without --objective the "
    "one of the largest B_0; critflow explore FILE strains it past the transition",
    "first": "it is rigid at rest, with the moduli below",
    "prestress": "it is rigid at rest, with the moduli below; critflow make FILE --out OUT gives the stress of the "
    "largest bulk modulus",
}


def advice_of(examination: Examination, file: str = "") -> tuple[str, ...]:
    """Sentences on what to do next: functions of Python, or with the name of a file, commands."""
    words = {name: text.replace("FILE", file) for name, text in (_COMMANDS if file else _FUNCTIONS).items()}
    near, order, strains = examination.nearest, examination.order, examination.critical_strains
    if examination.nearly_critical:
        return (words["nearly"],)
    if examination.rotates:
        return ("fix a vertex that is not in line with the fixed ones, and it cannot rotate",)
    advice = []
    if order == "floppy" and strains:
        name, onset = min(strains.items(), key=lambda item: abs(item[1].value.strain))
        advice.append(
            f"of the deformations below, {name} makes it rigid first, at γ = {onset.value.strain:.4g} ({_taut(onset)} "
            f"edges taut); {words['strain']}"
        )
    if order == "floppy" and near is not None:
        limit = "at most " if near.status in UNFINISHED else ""
        advice.append(
            f"a critical configuration is {limit}{near.distance:.3g} away (root mean square): {words['stiffest']}"
        )
    if order == "floppy" and near is None and not strains:
        advice.append("add edges or fix vertices: neither a strain nor another configuration is known to make it rigid")
    if order in ("critical", "first", "prestress", "second"):
        advice.append(words["prestress" if order == "second" else order])
    if order == "undecided" and np.isnan(examination.rigidity.value.largest_zero):
        advice.append("correct the coordinates: the rigidity of edges without length is not defined")
    elif order == "undecided":
        advice.append("give coordinates with more digits, or their number of decimals")
    return tuple(advice)
