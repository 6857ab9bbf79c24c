"""The examination of a network at given positions: counts, stresses, nearest critical configuration, onsets, moduli."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
from critflow.elastic import Elasticity, elasticity
from critflow.networks import Array, Network, validated_coordinates
from critflow.numerics import EPS, norms
from critflow.result import CritflowError, InputError, NetworkError, Solution, SolveError, Status
from critflow.self_stress import CLEAR_GAP
from critflow_extras.cables.critical_strain import critical_strain
from critflow_extras.cables.onset_end import CriticalStrain
from critflow_extras.certificates.counts import Rigidity, rigidity
from critflow_extras.examine.free_cell import FreeCellCounts, free_cell_counts
from critflow_extras.examine.report import UNFINISHED, Examination
from critflow_extras.files.boundaries import UnheldNetwork, hull_volume
from critflow_extras.files.convert import network_from
from critflow_extras.files.repair import ImportedNetwork
from critflow_extras.fronts.leverage import edge_leverage
from critflow_extras.inference.nearest import Nearest, nearest_critical
from critflow_extras.pruning.digits import Digits
from critflow_extras.tensegrity.second_order import second_order_rigidity
from critflow_extras.tensegrity.signed_stress import signed_stress

Result = TypeVar("Result")

# Singular values below this count as zero where coordinates have all digits, as in `rigidity`.
_TOLERANCE = 1e-6
# Other singular values are hardly smaller than ten times this.
_LARGEST_TOLERANCE = 0.01
# Largest networks of which each edge is cut.
_MOST_CUTS = 3000
# Steps towards the nearest critical configuration for each rule that is tried: near ones take ten.
_TRIAL_STEPS = 20
# Rest lengths that differ from the lengths by less, over the mean edge length, are the same.
_SAME_LENGTH = 1e-9
# Self-stresses beyond which only their number is computed, where it is certain without them.
_MANY_STRESSES = 100
_USABLE = (Status.ok, Status.edge_collapse, Status.slack_edges, *UNFINISHED)
DEFORMATIONS = ("dilation", "simple_shear", "pure_shear", "uniaxial")


@running("examine")
def examine(
    network: Network | ImportedNetwork | str | PathLike,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    decimals: int | None = None,
    deformations: Sequence[str] = DEFORMATIONS,
    progress: Callable[[str], None] = lambda part: None,
) -> Examination:
    """Examine a network, or that of a file, at coordinates (N_v, d), by default its positions; `print` the result.

    rest_lengths  ℓ (N_b,) of the critical strains; the lengths at the coordinates by default
    decimals      decimals that the coordinates have in their file; None: all digits, or those of an imported network
    deformations  names of the deformations whose critical strains are computed
    progress      called with the name of each part before it is computed

    Raises `InputError` where no positions are known, and `NetworkError` for a file of a network that nothing holds,
    with what each rule for fixed vertices gives; parts that fail are reported by a sentence, the others stand.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> examination = ce.examine(cf.lattice("honeycomb", 2, 2), deformations=())
    >>> examination.order, examination.n_self_stresses
    ('critical', 1)
    """
    network = of_kind(str, Network, ImportedNetwork, PathLike, network=network)
    of_kind(np.ndarray, None, coordinates=coordinates, rest_lengths=rest_lengths)
    decimals = of_kind(int, None, decimals=decimals)
    of_kind(Sequence, deformations=deformations)
    of_kind(Callable, progress=progress)
    if isinstance(network, str | PathLike):
        network = read_held(partial(network_from, network), progress)
    if decimals is not None and not 0 <= decimals <= 15:
        raise InputError(f"decimals must be from 0 to 15, not {decimals}: leave them out where all digits are known")
    subject, attempts = _subject(network, coordinates, rest_lengths, decimals), _Attempts(progress)
    judged = _judged(subject, attempts)
    strains = _critical_strains(judged, subject, deformations, attempts)
    moduli = leverage = None
    if judged.network.dimension < 2:
        attempts.failures.append("the moduli: in one dimension there is no shear")
    elif not judged.nearly_critical:
        moduli = attempts.value("the moduli", lambda: elasticity(judged.network, subject.x))
    free_cell = attempts.value("the counts on a free cell", lambda: _on_a_free_cell(judged, moduli))
    if (critical := judged.critical) is not None and critical.network.n_edges <= _MOST_CUTS:
        leverage = attempts.value("the cuts of edges", lambda: edge_leverage(critical).value)
    failures = tuple(attempts.failures)
    return replace(
        judged,
        critical_strains=strains,
        elasticity=moduli,
        leverage=leverage,
        free_cell=free_cell,
        failures=failures,
    )


def read_held(read: Callable[..., ImportedNetwork], progress: Callable[[str], None]) -> ImportedNetwork:
    """The network that read() gives; where nothing holds it, `NetworkError` with what every rule of `pins` gives.

    read  takes the keyword `pins`
    """
    try:
        return read()
    except UnheldNetwork as question:
        unheld = question
    answers = []
    for rule in unheld.rules:
        progress(f"pins='{rule}'")
        try:
            held = read(pins=rule)
            verdict = _judged(_subject(held), _Attempts(progress), _TRIAL_STEPS).verdict
            answer = f"fixes {len(held.network.pins)}: {verdict}"
        except CritflowError as refusal:
            answer = f"is refused, {refusal}"
        answers.append(f"pins='{rule}' {answer}")
    raise NetworkError(
        f"the network has neither a cell nor fixed vertices, so it collapses: say which vertices are fixed. "
        f"{'. '.join(answers)}. Or give a list of vertices, or a cell"
    )


def _judged(subject: _Subject, attempts: _Attempts, max_steps: int = 200) -> Examination:
    """The order of rigidity, and the nearest critical configuration with its moduli.

    max_steps  of the search for that configuration
    """
    network, x = subject.network, subject.x
    # A count is certain where singular values lie below the tolerance by CLEAR_GAP.
    tolerance = max(_TOLERANCE, min(CLEAR_GAP * subject.rounding, _LARGEST_TOLERANCE))
    attempts.progress("self-stresses and zero modes")
    many = network.least_self_stresses > _MANY_STRESSES
    counted = rigidity(network, x, tolerance, vectors=not many)
    # Without a zero mode no singular value lies below the tolerance, so that the number of self-stresses is certain.
    if many and not counted.value.first_order_rigid:
        counted = rigidity(network, x, tolerance)
    counts = counted.value
    tension = attempts.value("a self-stress in tension", lambda: _tension(network, x, counts))
    nearest = _nearest(network, x, counts, attempts, max_steps)
    # The configuration at the transition, where its moduli follow from one self-stress.
    critical = nearest.value if nearest and counts.n_self_stresses <= 1 and network.dimension > 1 else None
    return Examination(
        network=network,
        coordinates=x,
        order=_order(network, x, counted, tension, tolerance, attempts),
        rigidity=counted,
        tolerance=tolerance,
        tension=tension,
        nearest=nearest,
        critical_elasticity=attempts.value("B_0 and G_0", lambda: elasticity(critical)) if critical else None,
        rounding=subject.rounding * float(subject.rest.mean()),
        notes=subject.notes,
        names=subject.names,
    )


@dataclass(frozen=True, eq=False)
class _Subject:
    """A network at coordinates (N_v, d), rest lengths (N_b,), and sentences and names of its source.

    rounding  singular values that rounded coordinates may cause
    """

    network: Network
    x: Array
    rest: Array
    rounding: float
    notes: tuple[str, ...]
    names: tuple[str, ...]


def _subject(
    source: Network | ImportedNetwork,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    decimals: int | None = None,
) -> _Subject:
    """The subject of an examination: at the positions and with the lengths there, where none are given."""
    notes, names, digits = tuple[str, ...](), tuple[str, ...](), Digits(None, 0.0)
    if isinstance(source, ImportedNetwork):
        network, digits, names = source.network, source.data.digits, source.vertex_names
        notes = (f"source: {source.data.source}", *source.notes)
        rest_lengths = source.rest_lengths if rest_lengths is None else rest_lengths
    else:
        network = source
    given = network.positions if coordinates is None else coordinates
    if given is None:
        raise InputError("the network has no positions: give the coordinates at which it is examined")
    x = validated_coordinates(network, given)
    rest = lengths = np.linalg.norm(network.bond_vectors(x), axis=1)
    if rest_lengths is not None:
        rest = edge_values(rest_lengths, network.n_edges, "rest_lengths")
        if (largest := float(np.abs(rest - lengths).max() / (lengths.mean() or 1.0))) > _SAME_LENGTH:
            notes = (
                *notes,
                f"rest lengths differ from the lengths by up to {largest:.2g} of the mean edge length: the critical "
                "strains alone use them, all else takes springs at rest at these positions",
            )
    if not network.has_volume and network.dimension > 1:
        network = network.with_volume(hull_volume(x))
        notes = (*notes, f"moduli refer to the convex hull, V = {network.volume:.6g}, unless another volume is given")
    if decimals is not None:
        digits = Digits(decimals, 0.5 * 10.0**-decimals)
    # Few digits may be those of a grid, unless the user says that the coordinates were rounded.
    return _Subject(network, x, rest, digits.effect(rest, grids=decimals is None), notes, names)


class _Attempts:
    """Runs parts of an examination; a refusal becomes a sentence."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        self.progress = progress
        self.failures: list[str] = []

    def value(self, part: str, compute: Callable[[], Result]) -> Result | None:
        """The result of a part, or None."""
        self.progress(part)
        try:
            return compute()
        except CritflowError as error:
            self.failures.append(f"{part}: {error}")
            return None


def _nearest(network: Network, x: Array, counts: Rigidity, attempts: _Attempts, max_steps: int) -> Nearest | None:
    """The nearest critical configuration; none where several self-stresses make the network rigid to first order."""
    if counts.first_order_rigid and counts.n_self_stresses > 1:
        return None
    nearest = attempts.value(
        "the nearest critical configuration", lambda: nearest_critical(network, x, max_steps=max_steps, throw=False)
    )
    if nearest is None or nearest.status in _USABLE:
        return nearest
    attempts.failures.append(f"the nearest critical configuration: {nearest.reason}")
    return None


def _on_a_free_cell(judged: Examination, moduli: Solution[Elasticity] | None) -> FreeCellCounts | None:
    """The counts on a free cell; None with fixed vertices, where counts are in doubt, or without moduli."""
    network = judged.network
    if network.pins or judged.rigidity.status is Status.singular or moduli is None:
        return None
    if np.ptp(network.stiffness):
        # Soft springs are no motions.
        moduli = elasticity(network.with_stiffness(1.0), judged.coordinates)
    if not np.isfinite(moduli.value.tensor).all():
        return None
    return free_cell_counts(judged.rigidity.value, moduli.value, judged.tolerance)


def _critical_strains(
    judged: Examination, subject: _Subject, deformations: Sequence[str], attempts: _Attempts
) -> dict[str, Solution[CriticalStrain]]:
    """Critical strains of the rest lengths; none where the network is rigid at strain zero."""
    network, rest = judged.network, subject.rest
    lengths, rounding = norms(network.bond_vectors(subject.x)), 4 * EPS * np.abs(subject.x).max()
    if judged.order not in ("floppy", "undecided") and np.allclose(rest, lengths, rtol=0, atol=rounding):
        return {}
    onsets: dict[str, Solution[CriticalStrain]] = {}
    if deformations and not (rest > 0).all():
        attempts.failures.append("the critical strains: an edge has no rest length: give a positive one to each")
        return onsets
    for name in deformations:
        attempts.progress(f"the critical strain in {name}")
        try:
            onsets[name] = critical_strain(network, rest, name)
        except CritflowError as error:
            solution = error.solution if isinstance(error, SolveError) else None
            if solution is not None and solution.status in (Status.rigid, Status.undecided):
                return {}
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
    network: Network,
    x: Array,
    counted: Solution[Rigidity],
    tension: float | None,
    tolerance: float,
    attempts: _Attempts,
) -> str:
    """The order of rigidity, a word of `Examination`; "undecided" where the counts are in doubt."""
    counts = counted.value
    if counted.status is Status.singular:
        return "undecided"
    if counts.first_order_rigid:
        return "first"
    if counts.n_self_stresses == 0:
        return "floppy"
    if counts.rigid and counts.n_self_stresses == 1:
        return "critical" if tension else "prestress"
    second = attempts.value("rigidity to second order", lambda: second_order_rigidity(network, x, tolerance))
    if second is None or second.value.second_order_rigid is None:
        return "undecided"
    if not second.value.second_order_rigid:
        return "floppy"
    if not second.value.prestress_stable:
        return "second"
    return "critical" if tension and counts.n_self_stresses == 1 else "prestress"
