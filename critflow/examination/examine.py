"""The examination of a network at given positions: counts, stresses, nearest critical configuration, onsets, moduli."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.design.nearest import Nearest, nearest_critical
from critflow.design.onset import Onset, critical_strain
from critflow.design.tensegrity import signed_stress
from critflow.exchange.convert import network_from
from critflow.exchange.repair import ImportedNetwork, described
from critflow.mechanics.elasticity import Moduli
from critflow.mechanics.moduli import elastic_moduli, transition_moduli
from critflow.networks.network import Array, Network, edge_values, validated_coordinates
from critflow.result import CritflowError, InputError, Record, Solution, SolveError, Status
from critflow.rigidity.counts import Rigidity, rigidity, zero_modes
from critflow.rigidity.second_order import second_order_rigidity

Result = TypeVar("Result")

# Rounded coordinates change singular values of the rigidity matrix by about this number of their errors.
_ROUNDING_MARGIN = 10.0
# Singular values below this count as zero where coordinates have all digits, as in `rigidity`.
_TOLERANCE = 1e-6
_MOST_EDGES = 5
_USABLE = (Status.ok, Status.edge_collapse, Status.slack_edges)
DEFORMATIONS = ("dilation", "simple_shear", "pure_shear", "uniaxial")


@dataclass(frozen=True, eq=False)
class Examination(Record):
    """The answers to the questions about one network; parts that could not be computed are None with a sentence.

    order        "floppy", "first-order rigid", "critical", "second-order rigid" or "undecided"
    counts       self-stresses, zero modes and the gap of singular values
    tolerance    singular values below it count as zero
    tension      least |σ| over the largest of the best self-stress in tension everywhere; 0: none exists
    participation  (N_v,) part of each vertex in the floppy motions, at most 1; NaN where they were not computed
    nearest      the nearest critical configuration, or that towards which the descent tends
    critical_moduli  B_0 and G_0 of the nearest critical configuration
    onsets       critical strains by name of the deformation, for the rest lengths
    moduli       bulk and shear modulus at the positions
    weights      (N_b,) part of each edge in the energy of the self-stress of the nearest critical configuration
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
    critical_moduli: Moduli | None
    onsets: dict[str, Onset]
    moduli: Solution | None
    weights: Array
    failures: tuple[str, ...] = ()
    advice: tuple[str, ...] = field(default=())

    @property
    def heaviest_edges(self) -> list[int]:
        """The edges with the largest weights."""
        if not np.isfinite(self.weights).all():
            return []
        return [int(edge) for edge in np.argsort(self.weights)[::-1][:_MOST_EDGES]]

    def __str__(self) -> str:
        return "\n".join(report_lines(self))


@checked
def examine(
    network: Network | ImportedNetwork | str,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    decimals: int | None = None,
    deformations: Sequence[str] = DEFORMATIONS,
) -> Examination:
    """Examine a network, or that of a file, at coordinates (N_v, d), by default its positions; `print` the result.

    rest_lengths  ℓ (N_b,) of the critical strains; the lengths at the coordinates by default
    decimals      decimals that the coordinates have in their file; None: all digits, or those of an imported network
    deformations  names of the deformations whose critical strains are computed

    Raises `InputError` where no positions are known; parts that fail are reported by a sentence, the others stand.
    """
    notes: tuple[str, ...] = ()
    network = network_from(network) if isinstance(network, str) else network
    if isinstance(network, ImportedNetwork):
        notes, read, network = network.notes, network, network.network
        decimals = read.data.decimals if decimals is None else decimals
        rest_lengths = read.rest_lengths if rest_lengths is None else rest_lengths
    x, rest = _state(network, coordinates, rest_lengths)
    rounding = 0.0 if decimals is None else 0.5 * 10.0**-decimals
    tolerance = max(_TOLERANCE, _ROUNDING_MARGIN * rounding / float(rest.mean()))
    attempts = _Attempts()

    counted = rigidity(network, x, tolerance)
    counts = counted.value
    tension = attempts.number("a self-stress in tension", lambda: _tension(network, x, counts))
    nearest = attempts.value("the nearest critical configuration", lambda: nearest_critical(network, x, throw=False))
    if nearest is not None and nearest.status not in _USABLE:
        attempts.failures.append(f"the nearest critical configuration: {nearest.reason}")
        nearest = None
    onsets = _onsets(network, rest, deformations, attempts)
    moduli = critical = None
    if network.cell is not None:
        moduli = attempts.value("the moduli", lambda: elastic_moduli(network, x))
        if nearest is not None and nearest.ok and counts.n_self_stresses <= 1:
            critical = attempts.value("B_0 and G_0", lambda: transition_moduli(nearest.value))
    modes = attempts.value("the floppy motions", lambda: _participation(network, x, tolerance))
    found = Examination(
        network=network,
        coordinates=x,
        rest_lengths=rest,
        notes=notes,
        order=_order(network, x, counted, tension, tolerance, attempts),
        counts=counts,
        doubt=counted.note,
        tolerance=tolerance,
        tension=tension,
        participation=np.full(network.n_vertices, np.nan) if modes is None else modes,
        nearest=nearest,
        critical_moduli=critical,
        onsets=onsets,
        moduli=moduli,
        weights=_weights(nearest),
        failures=tuple(attempts.failures),
    )
    return _advised(found, rounding)


def _state(network: Network, coordinates: ArrayLike | None, rest_lengths: ArrayLike | None) -> tuple[Array, Array]:
    """Coordinates (N_v, d), by default the positions, and rest lengths (N_b,), by default the lengths there."""
    given = network.positions if coordinates is None else coordinates
    if given is None:
        raise InputError("the network has no positions: give the coordinates at which it is examined")
    x = validated_coordinates(network, given)
    if rest_lengths is not None:
        return x, edge_values(rest_lengths, network.n_edges, "rest_lengths")
    return x, np.linalg.norm(network.bond_vectors(x), axis=1)


class _Attempts:
    """Runs parts of an examination; a refusal becomes a sentence."""

    def __init__(self) -> None:
        self.failures: list[str] = []

    def value(self, what: str, compute: Callable[[], Result]) -> Result | None:
        """The result of a part, or None."""
        try:
            return compute()
        except CritflowError as error:
            self.failures.append(f"{what}: {error}")
            return None

    def number(self, what: str, compute: Callable[[], float]) -> float:
        """The number of a part, or NaN."""
        value = self.value(what, compute)
        return np.nan if value is None else float(value)


def _onsets(network: Network, rest: Array, deformations: Sequence[str], attempts: _Attempts) -> dict[str, Onset]:
    """Critical strains of the rest lengths; none where the network is rigid at strain zero."""
    onsets: dict[str, Onset] = {}
    for name in deformations:
        try:
            onsets[name] = critical_strain(network, rest, name)
        except SolveError as error:
            if error.solution is not None and error.solution.status is Status.rigid:
                return {}
            attempts.failures.append(f"the critical strain in {name}: {error}")
        except CritflowError as error:
            attempts.failures.append(f"the critical strain in {name}: {error}")
    return onsets


def _tension(network: Network, x: Array, counts: Rigidity) -> float:
    """Least over largest |σ| of a self-stress in tension on every edge; 0 where none exists."""
    if counts.n_self_stresses == 0:
        return 0.0
    if counts.n_self_stresses == 1:
        sigma = counts.self_stresses[0] * np.sign(counts.self_stresses[0].sum() or 1.0)
        return max(0.0, float(sigma.min() / np.abs(sigma).max()))
    return signed_stress(network, x, np.ones(network.n_edges, int), throw=False).value.least


def _order(
    network: Network, x: Array, counted: Solution[Rigidity], tension: float, tolerance: float, attempts: _Attempts
) -> str:
    counts = counted.value
    if counts.first_order_rigid:
        return "first-order rigid"
    if counts.n_self_stresses == 0:
        return "floppy"
    if counts.rigid and counts.n_self_stresses == 1:
        return "critical" if tension > 0 else "second-order rigid"
    second = attempts.value("rigidity to second order", lambda: second_order_rigidity(network, x, tolerance))
    if second is None or second.value.second_order_rigid is None:
        return "undecided"
    return "second-order rigid" if second.value.second_order_rigid else "floppy"


def _participation(network: Network, x: Array, tolerance: float) -> Array:
    """Σ over orthonormal floppy modes of |u_i|²/d, (N_v,)."""
    modes = zero_modes(network, x, tolerance).value.modes
    return np.asarray(np.einsum("mid,mid->i", modes, modes) / network.dimension)


def _weights(nearest: Nearest | None) -> Array:
    """σ²|L|²/k over its sum: the part of each edge in D, and so in the compliance at the transition."""
    if nearest is None:
        return np.full(1, np.nan)
    critical = nearest.value
    energy = critical.tensions**2 / critical.network.stiffness
    return np.asarray(energy / energy.sum())


def _advised(found: Examination, rounding: float) -> Examination:
    """The examination with sentences on what to do next."""
    advice = []
    near = found.nearest
    critical_in_file = bool(
        near is not None and rounding and near.distance <= _ROUNDING_MARGIN * rounding and found.order != "critical"
    )
    if critical_in_file and near is not None:
        advice.append(
            f"the network is critical within its digits: the nearest critical configuration is {near.distance:.1e} "
            f"away, and coordinates are rounded to {rounding:.0e}; nearest_critical(...).value restores it"
        )
    elif found.order == "floppy" and near is not None:
        advice.append(
            f"a critical configuration is {near.distance:.3g} away (root mean square): nearest_critical(...).value; "
            "optimize(network, 'bulk_modulus') gives the stiffest one"
        )
    if found.order == "floppy" and found.onsets:
        name, onset = min(found.onsets.items(), key=lambda item: abs(item[1].strain))
        advice.append(
            f"it becomes rigid first in {name}, at strain {onset.strain:.4g}; strain_path follows it from there"
        )
    if found.order == "critical":
        advice.append("transition_moduli and stiffening give its response; strain_path follows it past the transition")
    if found.order == "first-order rigid":
        advice.append("it is rigid at rest: elastic_moduli gives its moduli; dilute it to reach the transition")
    if found.order == "undecided":
        advice.append("singular values lie too close to the tolerance: give more digits or another tolerance")
    return replace(found, advice=tuple(advice))


def report_lines(found: Examination) -> list[str]:
    """The report as lines of text, which are also Markdown."""
    counts, near = found.counts, found.nearest
    lines = [f"# {described(found.network)}", ""]
    if found.notes:
        lines += ["## As read", "", *(f"- {note}" for note in found.notes), ""]
    lines += ["## Rigidity", "", f"- **{found.order}**" + (f" ({found.doubt})" if found.doubt else "")]
    lines += [
        f"- {counts.n_self_stresses} self-stresses, {counts.n_zero_modes - counts.n_trivial} floppy modes",
        f"- singular values: {counts.largest_zero:.1e} counts as zero, the next is {counts.smallest_nonzero:.1e} "
        f"(tolerance {found.tolerance:.0e})",
        "- a self-stress in tension on every edge "
        + (f"exists, least over largest σ {found.tension:.2g}" if found.tension > 0 else "does not exist"),
        "",
    ]
    if near is not None:
        weakest, strongest = float(near.value.sigma.min()), float(near.value.sigma.max())
        lines += [
            "## Nearest critical configuration",
            "",
            f"- root mean square distance {near.distance:.3e}, largest {np.abs(near.displacement).max():.3e}",
            f"- stresses from {weakest:.3g} to {strongest:.3g} (mean square 1), relative standard error "
            f"{np.sqrt(np.mean(near.stress_error**2)):.1e}",
            f"- edges with the largest part in its compliance: {', '.join(map(str, found.heaviest_edges))}",
        ]
        if near.note:
            lines.append(f"- {near.status.name}: {near.note}")
        if found.critical_moduli is not None:
            moduli = found.critical_moduli
            lines.append(f"- B_0 = {moduli.bulk:.8g}, G_0 = {moduli.shear:.8g}")
        lines.append("")
    if found.onsets:
        lines += ["## Critical strains", "", "| deformation | γ_c | taut edges | exact for |", "|---|---|---|---|"]
        for name, onset in found.onsets.items():
            lines.append(f"| {name} | {onset.strain:.8g} | {_taut(onset)} | {onset.value.exact_for} |")
        lines.append("")
    if found.moduli is not None:
        value = found.moduli.value
        lines += [
            "## Moduli at rest",
            "",
            f"- {found.moduli.status.name}: B = {value.bulk:.8g}, G = {value.shear:.8g}",
            "",
        ]
    if found.failures:
        lines += ["## Not computed", "", *(f"- {sentence}" for sentence in found.failures), ""]
    return [*lines, "## Next", "", *(f"- {sentence}" for sentence in found.advice)]


def _taut(onset: Onset) -> str:
    return f"{int(onset.value.taut.sum())} of {len(onset.value.taut)}"
