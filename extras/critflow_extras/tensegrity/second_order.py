"""Rigidity to first order, by prestress, and to second order.

For self-stresses σ_I and unit zero modes z, q_I(z) = Σ_α σ_Iα |(g z)_α|² = zᵀP(σ_I)z (`SecondOrderRigidity`).
  second-order rigid   no z makes all q_I(z) vanish
  prestress stable     one stress Σ a_I σ_I has Σ a_I q_I(z) > 0 for all z, which is stronger
With one self-stress the two are the same.  With several, a stabilising stress is found by a linear program (all edges
in tension), by the inertia of one factorisation, or by a semidefinite program.  A matrix X ⪰ 0 on the zero modes with
⟨P(σ_I), X⟩ = 0 for all I shows that no such stress exists.  Then either a zero mode escapes, all q_I(z) = 0, or the
next relaxation proves that none does; where neither is found the answer is None.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.networks import Array, Network
from critflow.numerics import EPS, LARGEST_DENSE
from critflow.result import Record, Solution, Stats, Status
from critflow.saddles import Saddle
from critflow.self_stress import ITERATION_ERROR
from critflow_extras.certificates.counts import Rigidity, rigidity, stable_margin, stiffness_error
from critflow_extras.certificates.spaces import zero_modes
from critflow_extras.tensegrity.semidefinite import fourth_order_bound, second_order_relaxation

POSITIVE = 1e-7  # an eigenvalue above this is positive: below, the solutions of semidefinite programs are not accurate
ZERO = 1e-10  # an eigenvalue or form below this is zero to rounding
RESISTED = 1e-4  # A mode with more stiffness than this, under a stress that is nowhere negative, cannot escape
PROGRAM_MODES = 40  # zero modes in a first semidefinite program; larger ones start from a subspace of half this number
FOURTH_ORDER_MODES = 8  # zero modes in the relaxation of fourth order, whose size is their fourth power
LINEAR_PROGRAM = 4_000_000  # entries of the self-stresses up to which a linear program is tried, a limit of time
_ONLY_STRESS = "its only self-stress stabilises it"
MOST_STEPS = 200  # of the search for an escaping mode from one start


@dataclass(frozen=True, eq=False, repr=False)
class SecondOrderRigidity(Record):
    """Order of rigidity of a configuration, with certificates; `print` gives a sentence.

    counts              Maxwell–Calladine counts, self-stresses and the gap of singular values behind them
    first_order_rigid   no zero mode but the translations of a periodic network
    prestress_stable    some self-stress stabilises all zero modes; None: undecided
    second_order_rigid  no zero mode escapes all self-stresses; None: undecided
    stress              a stabilising self-stress of unit norm, (N_b,); None where none was found or needed
    escape              a unit zero mode with q_I = 0 for all I, (N_v, d); None where none was found or none exists
    least_stiffness     least Σσ|g z|² over unit zero modes z for that stress; NaN where only its sign was found
    reason              the argument that decided, or the obstacle to a decision
    """

    counts: Rigidity
    first_order_rigid: bool | None
    prestress_stable: bool | None
    second_order_rigid: bool | None
    stress: Array | None = None
    escape: Array | None = None
    least_stiffness: float = np.nan
    reason: str = ""

    def __str__(self) -> str:
        c = self.counts
        order = {
            (True, True, True): "rigid to first order",
            (False, True, True): "prestress stable, so rigid to second order",
            (False, False, True): "rigid to second order, but no prestress stabilises it",
            (False, False, False): "flexible to second order",
            (False, False, None): "not prestress stable, and undecided whether rigid to second order",
        }.get((self.first_order_rigid, self.prestress_stable, self.second_order_rigid), "undecided")  # type: ignore[arg-type]
        return (
            f"{order}: {self.reason} ({c.n_self_stresses} self-stresses, {c.n_zero_modes} zero modes of which "
            f"{c.n_trivial} trivial, singular values {c.largest_zero:.1e} | {c.smallest_nonzero:.1e})"
        )


@running("second_order_rigidity")
def second_order_rigidity(
    network: Network, coordinates: ArrayLike, tolerance: float | None = None
) -> Solution[SecondOrderRigidity]:
    """Order of rigidity of a configuration (N_v, d), with a certificate for each answer.

    tolerance  singular values of R below it count as zero, as for configurations known to this accuracy only; None:
               1e-6, and they must be zero to rounding, as in `rigidity`

    `Status.floppy` for a configuration without self-stress, `Status.singular` where an edge has no length,
    `Status.undecided` where the counts cannot be trusted, as next to a special position, or second-order rigidity stays
    open; the note is the reason of the value.  Dense matrices of zero modes are limited to 160 MB; a larger network is
    decided where one factorisation suffices.

    >>> import critflow as cf
    >>> from critflow_extras.tensegrity.second_order import second_order_rigidity
    >>> network = cf.lattice("kagome", 2, 2)
    >>> second_order_rigidity(network, network.positions).value.second_order_rigid
    True
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, tolerance=tolerance)
    counted = rigidity(network, coordinates, tolerance, vectors=False)
    counts = counted.value
    if counted.status is Status.singular:
        return _uncertain(counted)
    if counts.first_order_rigid:
        reason = f"every motion{' but a translation' if counts.n_trivial else ''} changes a length"
        return _answer(SecondOrderRigidity(counts, True, True, True, reason=reason), Status.ok)
    n_modes = counts.n_zero_modes - counts.n_trivial
    tallest = max(network.dimension * max(network.n_vertices, network.n_edges), counts.n_self_stresses * n_modes)
    fits = n_modes * tallest <= LARGEST_DENSE
    if counts.n_self_stresses == 0:
        escape = zero_modes(network, coordinates, tolerance).value.modes[0] if fits else None
        reason = "without a self-stress every zero mode extends to second order"
        return _answer(SecondOrderRigidity(counts, False, False, False, escape=escape, reason=reason), Status.floppy)
    if counts.n_self_stresses * network.n_edges > LARGEST_DENSE:
        reason = f"{counts.n_self_stresses} self-stresses are more than fit in memory: take a part of the network"
        return _answer(SecondOrderRigidity(counts, False, None, None, reason=reason), Status.undecided)

    counted = rigidity(network, coordinates, tolerance)
    counts = counted.value
    if counted.status is Status.singular:
        return _uncertain(counted)
    # What only the tolerance counts as zero, it leaves open in the stresses and the modes.
    by_tolerance = tolerance is not None and counts.largest_zero > ITERATION_ERROR
    turned = tolerance / counts.smallest_nonzero if tolerance and by_tolerance else 0.0
    stable = _by_one_stress(network, counts, network.bond_vectors(np.asarray(coordinates, dtype=float)), turned)
    if stable is not None:
        return _answer(stable, Status.ok)
    if not fits:
        reason = f"{n_modes} zero modes are too many for a dense search: take a part of the network"
        return _answer(SecondOrderRigidity(counts, False, None, None, reason=reason), Status.undecided)
    modes = zero_modes(network, coordinates, tolerance).value.modes
    error = max(stiffness_error(network, sigma, turned) for sigma in counts.self_stresses)
    value = _by_forms(counts, modes, forms_on_modes(network.incidence, counts.self_stresses, modes), error)
    return _answer(value, Status.undecided if value.second_order_rigid is None else Status.ok)


def forms_on_modes(incidence: sp.csr_array, stresses: Array, modes: Array) -> Array:
    """Zᵀ P(σ) Z of stresses (n, N_b) on orthonormal motions Z (m, n_vertices, d), (n, m, m).

    incidence  of the edges on the vertices that move, (N_b, n_vertices)
    """
    stretch = np.concatenate([np.asarray(incidence @ component.T) for component in np.moveaxis(modes, 2, 0)])
    return np.stack([stretch.T @ (weights[:, None] * stretch) for weights in np.tile(stresses, modes.shape[2])])


def _answer(value: SecondOrderRigidity, status: Status) -> Solution[SecondOrderRigidity]:
    return Solution(value, status, Stats("second order"), value.reason)


def _uncertain(counted: Solution[Rigidity]) -> Solution[SecondOrderRigidity]:
    value = SecondOrderRigidity(counted.value, None, None, None, reason=counted.note)
    return _answer(value, Status.singular if np.isnan(counted.value.largest_zero) else Status.undecided)


def _by_one_stress(network: Network, counts: Rigidity, L: Array, turned: float) -> SecondOrderRigidity | None:
    """A stabilising stress from sparse factorisations and a linear program, or None."""
    S = counts.self_stresses
    if len(S) == 1:
        stable = SecondOrderRigidity(counts, False, True, True, S[0], reason=_ONLY_STRESS)
        return stable if counts.prestress_stable else None
    # The self-stress nearest to equal force densities often has no compression.
    sigma = S.sum(axis=1) @ S
    if not sigma.min() > max(POSITIVE, turned) * np.abs(sigma).max():
        found = _tension(S) if S.size <= LINEAR_PROGRAM else None
        margin = np.nan if found is None else stable_margin(network, found, turned, counts.largest_zero)
        if found is None or not Saddle(network).stable(found, L, margin):
            return None
        sigma = found
    sigma = sigma / np.linalg.norm(sigma)
    slack = int(np.count_nonzero(sigma <= POSITIVE * sigma.max()))
    tense = f"{slack} slack edges and the others in tension" if slack else "every edge in tension"
    return SecondOrderRigidity(counts, False, True, True, sigma, reason=f"a self-stress with {tense} stabilises it")


def _tension(S: Array) -> Array | None:
    """A self-stress Σ a_I σ_I >= 0 that is positive on as many edges as any, or None.

    Maximise Σ s over 0 <= s <= 1, s <= σ: a cone of stresses has a member that reaches 1 wherever one is positive.
    """
    n_stresses, n_edges = S.shape
    cost = np.concatenate([np.zeros(n_stresses), -np.ones(n_edges)])
    below = sp.hstack([sp.csr_array(-S.T), sp.eye_array(n_edges)], format="csr")
    bounds = [(None, None)] * n_stresses + [(0.0, 1.0)] * n_edges
    answer = scipy.optimize.linprog(cost, A_ub=below, b_ub=np.zeros(n_edges), bounds=bounds, method="highs")
    if answer.status != 0 or not -answer.fun > 0.5:
        return None
    return np.asarray(answer.x[:n_stresses] @ S)


def _by_forms(counts: Rigidity, modes: Array, forms: Array, error: float) -> SecondOrderRigidity:
    """Decide by the quadratic forms of all self-stresses on all zero modes, where they exceed an error of them."""
    answer = partial(SecondOrderRigidity, counts, False)
    scale = max(float(np.abs(np.linalg.eigvalsh(Q)).max()) for Q in forms)
    hidden = answer(None, None, reason="the tolerance hides the stiffness of a zero mode")
    if error and not scale > error:
        return hidden
    if not scale > ZERO * np.abs(counts.self_stresses).max():
        return answer(False, False, escape=modes[0], reason="no self-stress resists any zero mode")
    unit = forms / scale
    if len(forms) == 1:
        return _one_stress(counts, modes, unit[0], scale, error / scale)

    least, multipliers, X, support = _program(unit)
    if error and not least > error / scale:
        return hidden
    if least > POSITIVE:
        reason = f"a combination of its {len(forms)} self-stresses stabilises it"
        return answer(True, True, multipliers @ counts.self_stresses, None, scale * least, reason)
    z = _common_zero(unit, X)
    if z is not None:
        return answer(False, False, None, np.tensordot(z, modes, 1), reason="a zero mode escapes all self-stresses")
    if X is None or not np.linalg.norm(np.tensordot(unit, X, 2)) < POSITIVE:
        reason = "no self-stress was found that stabilises it, and no zero mode that escapes them all"
        return answer(None, None, reason=reason)
    if _none_escapes(unit, support):
        reason = "no zero mode escapes all self-stresses, as a relaxation of fourth order proves"
        return answer(False, True, reason=reason)
    return answer(
        False, None, reason="no zero mode was found that escapes all self-stresses, nor a proof that none does"
    )


def _one_stress(counts: Rigidity, modes: Array, Q: Array, scale: float, error: float) -> SecondOrderRigidity:
    """With one self-stress the eigenvalues of its form decide, where they exceed an error of it."""
    answer = partial(SecondOrderRigidity, counts, False)
    values, vectors = np.linalg.eigh(Q)
    for sign, least in ((1.0, float(values[0])), (-1.0, -float(values[-1]))):
        if least > max(POSITIVE, error):
            return answer(True, True, sign * counts.self_stresses[0], None, scale * least, _ONLY_STRESS)
    nearest = int(np.abs(values).argmin())
    if not error and abs(values[nearest]) < ZERO:
        z, reason = vectors[:, nearest], "its only self-stress does not resist some zero mode"
    elif values[0] < -error <= 0 <= error < values[-1]:
        z = np.sqrt(values[-1]) * vectors[:, 0] + np.sqrt(-values[0]) * vectors[:, -1]
        z, reason = z / np.linalg.norm(z), "its only self-stress pushes some zero modes and pulls others"
    else:
        reason = f"the least stiffness of a zero mode, {scale * abs(values[nearest]):.1e}, is zero to rounding or not"
        return answer(None, None, reason=reason)
    return answer(False, False, escape=np.tensordot(z, modes, 1), reason=reason)


def _program(forms: Array) -> tuple[float, Array, Array | None, Array]:
    """The largest λ_min(Σ a_I Q_I) that semidefinite programs find, its a, |a| = 1, and the obstruction to a larger.

    The obstruction X ⪰ 0 of trace 1 has the least |⟨Q_I, X⟩|; None: unknown.  Last come the multipliers of the last
    program: where no stress stabilises, those of one that resists most modes.
    The program is restricted to a subspace W of the modes, which grows by the modes that its solution leaves unstable:
    its cost is that of the few modes that matter.
    """
    n = forms.shape[1]
    # Initial guess: the stress with the largest sum of stiffnesses over all modes.
    best, least = np.trace(forms, axis1=1, axis2=2), -np.inf
    best = best / (np.linalg.norm(best) or 1.0)
    W = np.eye(n) if n <= PROGRAM_MODES else np.linalg.eigh(np.tensordot(best, forms, 1))[1][:, : PROGRAM_MODES // 2]
    while True:
        relaxed = second_order_relaxation(np.einsum("ik,aij,jl->akl", W, forms, W, optimize=True))
        a, X = relaxed.multipliers, W @ relaxed.moments @ W.T
        if not relaxed.solved:
            return least, best, None, a
        norm = float(np.linalg.norm(a))
        if norm > POSITIVE:
            values, vectors = np.linalg.eigh(np.tensordot(a / norm, forms, 1))
            if values[0] > least:
                best, least = a / norm, float(values[0])
        if least > POSITIVE or relaxed.bound < POSITIVE or W.shape[1] == n:
            return least, best, X, a
        if W.shape[1] > 2 * PROGRAM_MODES:
            return least, best, None, a
        W = np.linalg.qr(np.hstack([W, vectors[:, :5]]))[0]


def _none_escapes(forms: Array, support: Array) -> bool:
    """Whether the fourth-order relaxation proves that the forms have no common zero.

    A stress without negative eigenvalue stops every mode that it resists, so only the modes that it does not resist
    remain.
    """
    values, vectors = np.linalg.eigh(np.tensordot(support, forms, 1))
    below = max(-float(values[0]), 1e-12)
    remaining, certain = vectors, 10 * POSITIVE
    if below < ZERO:
        # The component of an escaping mode outside the remaining ones is at most √(below/RESISTED).
        remaining, certain = vectors[:, values < RESISTED], 10 * np.sqrt(below / RESISTED)
    if not 0 < remaining.shape[1] <= FOURTH_ORDER_MODES:
        return False
    bound = fourth_order_bound(np.einsum("ik,aij,jl->akl", remaining, forms, remaining, optimize=True))
    return bool(bound > certain)


def _common_zero(forms: Array, X: Array | None, n_starts: int = 40) -> Array | None:
    """A unit z with zᵀQ_I z = 0 for all I, by Levenberg–Marquardt from several starts; None where none was found.

    Every such z lies in the range of an X of the largest rank, so starts are drawn from there first.
    """
    n = forms.shape[1]
    rng = np.random.default_rng(0)
    starts = rng.standard_normal((n_starts, n))
    if X is not None:
        values, vectors = np.linalg.eigh(X)
        inside = vectors * np.sqrt(np.maximum(values, 0.0))
        starts = np.concatenate([inside.T[::-1][:n_starts], starts @ inside.T, starts])
    for start in starts:
        z = _descend(forms, start)
        if z is not None:
            return z
    return None


def _descend(forms: Array, start: Array) -> Array | None:
    """A unit z with zᵀQ_I z = 0 near a start, by Levenberg–Marquardt iteration, or None."""
    norm, (count, n) = float(np.linalg.norm(start)), forms.shape[:2]
    if norm < ZERO:
        return None
    # The algorithm needs as many equations as unknowns.
    empty = max(n - count - 1, 0)
    z = scipy.optimize.least_squares(
        lambda z: np.concatenate([forms @ z @ z, [z @ z - 1], np.zeros(empty)]),
        start / norm,
        lambda z: np.concatenate([2 * forms @ z, [2 * z], np.zeros((empty, n))]),
        method="lm", ftol=EPS, xtol=EPS, gtol=EPS, max_nfev=MOST_STEPS,
    ).x  # fmt: skip
    z = z / np.linalg.norm(z)
    return z if np.linalg.norm(forms @ z @ z) < ZERO else None
