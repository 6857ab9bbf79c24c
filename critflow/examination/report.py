"""An examination, its report as lines of text that are also Markdown, and the advice in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from critflow.critical.nearest import Nearest
from critflow.exchange.repair import described
from critflow.networks.network import Array, Network
from critflow.onset.critical_strain import Onset
from critflow.response.elasticity import Elasticity, Moduli
from critflow.result import Record, Solution, Status
from critflow.rigidity.counts import Rigidity

_MOST_EDGES = 5
# A descent that ended so still holds a critical configuration.
UNFINISHED = (Status.stalled, Status.step_limit)
# Moduli below this part of the largest component are printed as zero.
_ZERO = 1e-12
ORDERS = {
    "floppy": "motions exist that change no length to second order",
    "critical": "one self-stress, in tension on every edge, makes it rigid at the transition",
    "first": "rigid to first order: no motion keeps all lengths",
    "prestress": "rigid to second order: a self-stress stabilises every floppy motion",
    "second": "rigid to second order, by several self-stresses of which none alone is enough",
    "undecided": "undecided",
}
_STRAINS = {
    "dilation": "relative increase of the volume (area in 2D)",
    "simple_shear": "x is shifted by γ y",
    "pure_shear": "x is stretched by 1 + γ, y by 1/(1 + γ)",
    "uniaxial": "x is stretched by 1 + γ, other sides fixed",
}
_UNITS = {2: "stiffness", 3: "stiffness/length"}
# Tensors that agree to this are printed once.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Examination(Record):
    """The answers to the questions about one network; parts that could not be computed are None with a sentence.

    order        "floppy", "critical" (one self-stress, in tension on every edge), "first" (rigid to first order),
                 "prestress" (a self-stress stabilises all floppy modes), "second" or "undecided"
    counts       self-stresses, zero modes and the gap of singular values
    tolerance    singular values below it count as zero
    tension      least |σ| over the largest of the best self-stress in tension everywhere; 0: none exists
    participation  (N_v,) part of each vertex in the floppy motions, at most 1; NaN where they were not computed
    nearest      the nearest critical configuration, or that towards which the descent tends
    critical_tensor  elasticity at the transition, of the nearest critical configuration
    critical_strains  by name of the deformation, for the rest lengths
    tensor       elasticity at the positions
    weights      (N_b,) part of each edge in the energy of the self-stress of the nearest critical configuration
    cuts         (N_b,) relative change of B_0 of the nearest critical configuration by cutting each edge
    names        (N_v,) names of the vertices in the source; empty: their numbers
    failures     sentences on parts that could not be computed
    advice       sentences on what to do next
    """

    network: Network
    coordinates: Array
    rest_lengths: Array
    notes: tuple[str, ...]
    order: str
    counts: Rigidity
    doubt: str
    tolerance: float
    tension: float
    participation: Array
    nearest: Nearest | None
    critical_tensor: Solution[Elasticity] | None
    critical_strains: dict[str, Onset]
    tensor: Solution[Elasticity] | None
    weights: Array
    cuts: Array
    failures: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    names: tuple[str, ...] = field(default=(), repr=False)

    def vertex_name(self, vertex: int) -> str:
        """Name of a vertex in the source."""
        return self.names[vertex] if self.names else str(vertex)

    def edge_name(self, edge: int) -> str:
        """Number of an edge of the network and the names of its ends."""
        tail, head = self.network.edges[edge]
        return f"{edge} ({self.vertex_name(int(tail))}–{self.vertex_name(int(head))})"

    @property
    def title(self) -> str:
        """The order of rigidity in words."""
        return (
            self.order
            if self.order in ("floppy", "critical")
            else ORDERS[self.order].partition(",")[0].partition(":")[0]
        )

    @property
    def n_self_stresses(self) -> int:
        return self.counts.n_self_stresses

    @property
    def n_floppy_modes(self) -> int:
        """Zero modes other than translations."""
        return self.counts.n_zero_modes - self.counts.n_trivial

    @property
    def distance(self) -> float:
        """Root mean square distance to the nearest critical configuration; NaN where none was found."""
        return np.nan if self.nearest is None else self.nearest.distance

    @property
    def moduli(self) -> Solution[Moduli] | None:
        """Bulk and shear modulus at the positions."""
        found = self.tensor
        return None if found is None else Solution(found.value.moduli, found.status, found.stats, found.note)

    @property
    def critical_moduli(self) -> Moduli | None:
        """B_0 and G_0 of the nearest critical configuration."""
        return None if self.critical_tensor is None else self.critical_tensor.value.moduli

    @property
    def heaviest_edges(self) -> list[int]:
        """The edges with the largest weights."""
        if not np.isfinite(self.weights).all():
            return []
        return [int(edge) for edge in np.argsort(self.weights)[::-1][:_MOST_EDGES]]

    @property
    def most_loaded_cuts(self) -> list[int]:
        """The edges whose cut lowers B_0 most, among those whose cut does not open the network."""
        finite = np.flatnonzero(np.isfinite(self.cuts))
        return [int(edge) for edge in finite[np.argsort(self.cuts[finite])][:_MOST_EDGES]]

    @property
    def text(self) -> str:
        """The report as Markdown."""
        return "\n".join(report_lines(self))

    def __str__(self) -> str:
        return self.text


def report_lines(found: Examination) -> list[str]:
    """The report as lines of text, which are also Markdown: the answer first."""
    lines = [*summary_lines(found), "## As read", "", *(f"- {note}" for note in found.notes), f"- {_units(found)}", ""]
    lines += [*_rigidity(found), *_nearest(found), *_strains(found)]
    if found.tensor is not None:
        lines += ["## Moduli at these positions, springs at rest", "", *_moduli(found.tensor), ""]
    if found.failures:
        lines += ["## Not computed", "", *(f"- {sentence}" for sentence in found.failures), ""]
    return lines


def summary_lines(found: Examination) -> list[str]:
    """Title, answer and advice."""
    answer = [f"- {_answer(found)}"]
    known = found.tensor is not None and np.isfinite(found.tensor.value.energy).all()
    if found.tensor is not None and known:
        answer.append(f"- {_bulk_and_shear(found.tensor.value)}")
    if found.critical_tensor is not None and not (known and (found.order == "critical" or _same(found))):
        answer.append(f"- at the nearest critical configuration {_bulk_and_shear(found.critical_tensor.value, '_0')}")
    return [f"# {described(found.network)}", "", *answer, *(f"- next: {sentence}" for sentence in found.advice), ""]


def _answer(found: Examination) -> str:
    """The order of rigidity with its meaning."""
    meaning = ORDERS[found.order]
    if found.order in ("floppy", "critical"):
        meaning = f"{found.order}: {meaning}"
    if found.order == "floppy":
        meaning += (
            "; the self-stresses stiffen a part of it only" if found.n_self_stresses else ", and every modulus is zero"
        )
    if found.order == "undecided" and found.doubt:
        meaning += f": {found.doubt}"
    name, colon, rest = meaning.partition(":")
    return f"**{name}**{colon}{rest}"


def _units(found: Examination) -> str:
    """A sentence on the units of the numbers."""
    length = float(np.linalg.norm(found.network.bond_vectors(found.coordinates), axis=1).mean())
    k = found.network.stiffness
    stiffness = f"{k.min():.6g}" if k.min() == k.max() else f"from {k.min():.6g} to {k.max():.6g}"
    modulus = _UNITS.get(found.network.dimension, "force")
    return (
        f"units: lengths as in the source, mean edge length {length:.6g}; stiffness {stiffness}; moduli in units of "
        f"{modulus}"
    )


def _rigidity(found: Examination) -> list[str]:
    counts = found.counts
    lines = ["## Rigidity", ""]
    if found.doubt and found.order != "undecided":
        lines.append(f"- {found.doubt}")
    if np.isnan(counts.largest_zero):
        return []
    zero = f"{counts.largest_zero:.1e} counts as zero, " if counts.largest_zero else ""
    lines += [
        f"- {_count(counts.n_self_stresses, 'self-stress', 'es')}, {_count(found.n_floppy_modes, 'floppy mode', 's')}",
        f"- singular values: {zero}the least above zero is {counts.smallest_nonzero:.1e} (tolerance "
        f"{found.tolerance:.0e})",
        "- a self-stress in tension on every edge "
        + (f"exists: its least σ is {found.tension:.2g} of the largest" if found.tension > 0 else "does not exist"),
    ]
    moving = found.participation
    if found.n_floppy_modes and np.isfinite(moving).all():
        most = np.argsort(moving)[::-1][:5]
        lines.append(f"- vertices that move most in the floppy motions: {', '.join(map(found.vertex_name, most))}")
    return [*lines, ""]


def _nearest(found: Examination) -> list[str]:
    near = found.nearest
    if near is None:
        return []
    sigma, errors = near.value.sigma, near.stress_error
    known = ""
    if np.isfinite(errors).all():
        # Squares of huge errors overflow.
        error = float(np.sqrt(np.mean(np.minimum(errors, errors.size) ** 2)))
        known = f", relative standard error {error:.1e}" if error < 1 else "; the positions hardly determine them"
    shares = ", ".join(f"{found.edge_name(edge)} {100 * found.weights[edge]:.3g} %" for edge in found.heaviest_edges)
    limit = "at most " if near.status in UNFINISHED else ""
    lines = [
        "## Nearest critical configuration",
        "",
        f"- root mean square distance of the vertices {limit}{near.distance:.3e}, largest "
        f"{np.linalg.norm(near.displacement, axis=1).max():.3e}",
        f"- force densities σ from {float(sigma.min()):.3g} to {float(sigma.max()):.3g} (mean square 1){known}",
        f"- edges with the largest shares of its compliance: {shares}",
    ]
    if cuts := found.most_loaded_cuts:
        named = ", ".join(f"{found.edge_name(edge)} by {-100 * found.cuts[edge]:.3g} %" for edge in cuts)
        lines.append(f"- edges whose cut lowers B_0 most, with the stress of the others unchanged: {named}")
    if limit:
        lines.append("- the search ended before the minimum, so the distance is an upper limit")
    elif near.note:
        lines.append(f"- {near.status.name}: {near.note}")
    if found.critical_tensor is not None:
        lines += ["- moduli: those below"] if _same(found) else _moduli(found.critical_tensor, "_0")
    return [*lines, ""]


def _same(found: Examination) -> bool:
    """Whether the tensors at the positions and of the nearest critical configuration agree."""
    if found.tensor is None or found.critical_tensor is None:
        return False
    here, there = found.tensor.value.energy, found.critical_tensor.value.energy
    return bool(np.abs(here - there).max() <= _SAME * np.abs(there).max())


def _strains(found: Examination) -> list[str]:
    """The table of critical strains."""
    if not found.critical_strains:
        return []
    lines = ["## Critical strains", "", "| deformation | γ_c | taut edges | valid for | γ |", "|---|---|---|---|---|"]
    for name, onset in found.critical_strains.items():
        meaning = _STRAINS.get(name, "")
        springs = "springs" if onset.valid_for_springs else "cables"
        lines.append(f"| {name} | {onset.strain:.8g} | {_taut(onset)} | {springs} | {meaning} |")
    return [*lines, ""]


def _moduli(solution: Solution[Elasticity], index: str = "") -> list[str]:
    """Status, moduli and tensor of an elasticity."""
    tensor = solution.value
    if not np.isfinite(tensor.energy).all():
        return [f"- {solution.status.name}: {solution.reason}"]
    state = "" if solution.ok else f"{solution.status.name}: "
    size = float(np.abs(tensor.energy).max())
    lines = [f"- {state}{_bulk_and_shear(tensor, index)}"]
    if not tensor.energy.any():
        return lines
    x, y = np.eye(tensor.dimension)[:2]
    ratio = tensor.poissons_ratio(x, y)
    if np.isfinite(ratio):
        lines.append(f"- along x: Young's modulus {_number(tensor.youngs_modulus(x))}, Poisson's ratio {ratio:.6g}")
    names = tensor.components
    rows = [
        f"| {name} | {' | '.join(f'{0.0 if abs(c) < _ZERO * size else c:.6g}' for c in row)} |"
        for name, row in zip(names, tensor.energy, strict=True)
    ]
    return [*lines, "", f"| C | {' | '.join(names)} |", "|---" * (1 + len(names)) + "|", *rows]


def _bulk_and_shear(tensor: Elasticity, index: str = "") -> str:
    size = float(np.abs(tensor.energy).max())
    bulk, shear = (_number(0.0 if abs(value) < _ZERO * size else value) for value in (tensor.bulk, tensor.shear))
    return f"B{index} = {bulk}, G{index} = {shear}"


def _count(number: int, noun: str, plural: str) -> str:
    return f"{number} {noun}{plural if number != 1 else ''}"


def _number(value: float) -> str:
    return f"{value:.8g}"


def _taut(onset: Onset) -> str:
    return f"{int(onset.taut.sum())} of {len(onset.taut)}"


def advice_of(found: Examination, margin: float) -> tuple[str, ...]:
    """Sentences on what to do next.

    margin  distance to a critical configuration that rounded coordinates may cause; 0 where they have all digits
    """
    near, advice = found.nearest, []
    within = near is not None and margin > 0 and near.distance <= margin
    if near is not None and within and found.order != "critical":
        advice.append(
            f"the network is critical within its digits: the nearest critical configuration is {near.distance:.1e} "
            f"away, and rounded coordinates explain {margin:.0e}; nearest_critical(...).value restores it"
        )
    if found.order == "floppy" and found.critical_strains:
        name, onset = min(found.critical_strains.items(), key=lambda item: abs(item[1].strain))
        advice.append(
            f"of the deformations below, {name} makes it rigid first, at γ = {onset.strain:.4g} ({_taut(onset)} edges "
            "taut); strain_path follows it from there"
        )
    if found.order == "floppy" and near is not None and not within:
        limit = "at most " if near.status in UNFINISHED else ""
        advice.append(
            f"a critical configuration is {limit}{near.distance:.3g} away (root mean square): nearest_critical(...)"
            ".value; critflow make, or optimize(network, 'bulk_modulus'), gives the stiffest one"
        )
    if found.order == "floppy" and near is None and not found.critical_strains:
        advice.append("add edges or fix vertices: neither a strain nor another configuration is known to make it rigid")
    if found.order == "critical":
        advice.append("transition_moduli and stiffening give its response; strain_path follows it past the transition")
    if found.order == "first":
        advice.append("it is rigid at rest: elasticity gives its tensor; diluted(...) leads to the transition")
    if found.order in ("prestress", "second"):
        advice.append("elasticity gives its tensor at rest; signed_stress and strain_path follow it under stress")
    if found.order == "undecided" and np.isnan(found.counts.largest_zero):
        advice.append("correct the coordinates: the rigidity of edges without length is not defined")
    elif found.order == "undecided":
        advice.append("give coordinates with more digits, or their number of decimals")
    return tuple(advice)
