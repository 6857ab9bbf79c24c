"""Tensegrities: networks with cables, which only pull (σ > 0), and struts, which only push (σ < 0).

A tensegrity is a configuration of the map σ → x with given signs.  Two problems are specific to it: whether a geometry
admits a self-stress of those signs, which is a linear program, and whether that stress makes it stable, which follows
from the inertia of the prestress matrix P.

Free-standing tensegrities need pins like every network: pin vertices that fix the frame.  An affine map that keeps all
pins in place maps one equilibrium of σ to another, so P is singular unless the pins affinely span space (d + 1 of them,
three in the plane not in line): with fewer the coordinates are given and checked, not computed from σ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.manifold import CriticalConfiguration, critical_configuration
from critflow.networks import Array, Network, validated_coordinates
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.self_stress import stabilises
from critflow.sparse import balanced_part, block_laplacian, laplacian, spread_columns

# Largest least |σ| of a linear program without solution, and the accuracy to which linear programs are solved.
NO_SIGNED_STRESS, ACCURACY = 1e-7, 1e-9
# Largest network whose linear program of signs the simplex method solves; interior points are seven times faster at
# 3,000 edges.
SIMPLEX_EDGES = 1000
BALANCED = 1e-8  # relative force balance, and relative distance from the bound, of a modulus that attains its bound
RANK = 1e-9  # singular value that counts as zero, relative to the largest
# Shift of the Hessian of unit springs, relative to ⟨|L|²⟩, which removes the zero modes of any geometry.
SELF_STRESS_SHIFT = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class SignedStress(Record):
    """Whether a geometry has a self-stress of given signs, with its proof.

    critical  the configuration with that σ, Σσ² = N_b, or None without a self-stress
    least     largest possible ratio of the least |σ| to the largest |σ|; 0 without a self-stress
    motion    (N_v, d), without a self-stress: a motion that stretches no cable and shortens no strut but shortens some
              cables or stretches some struts, which excludes a self-stress; None otherwise
    loosened  the cables that `motion` shortens and the struts that it stretches: no self-stress of these signs has a
              stress on them
    """

    critical: CriticalConfiguration | None
    least: float
    motion: Array | None
    loosened: NDArray[np.intp]


@running("signed_stress")
def signed_stress(
    network: Network, coordinates: ArrayLike, signs: ArrayLike, throw: bool = True
) -> Solution[SignedStress]:
    """The self-stress of given signs at coordinates (N_v, d) whose least |σ| is as large as possible.

    signs  (N_b,) +1 for a cable, −1 for a strut, 0 for a bar, which may be in tension or compression

        maximise t  subject to  gᵀ(σ ∘ L) = 0,  s_α σ_α ≥ t,  |σ_α| ≤ 1.

    If the maximum is t = 0, no such self-stress exists, `Status.floppy`: by Stiemke's lemma there is then a motion u
    with s_α L_α·(g u)_α ≤ 0 on every cable and strut, not zero on all, and 0 on bars; it is returned as the proof.
    Where lengths span decades, so that t is too small for a linear program, the tensions σ|L| take the place of σ.
    Raises `InputError` for wrong signs or coordinates, or an edge of no length.

    >>> import critflow as cf
    >>> from critflow_extras.tensegrity.signed_stress import signed_stress
    >>> import numpy as np
    >>> network = cf.lattice("square", 3, 3)
    >>> signed_stress(network, network.positions, np.ones(18, int)).value.least
    1.0
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates, signs=signs)
    of_kind(bool, throw=throw)
    x, s = validated_coordinates(network, coordinates), np.asarray(signs, dtype=float)
    if s.shape != (network.n_edges,) or not np.isin(s, (-1, 0, 1)).all() or not s.any():
        raise InputError(f"signs are +1 (cable), -1 (strut) or 0 (bar) on the {network.n_edges} edges, and not all 0")
    x[list(network.pins)] = network.fixed_positions[list(network.pins)]
    L = network.bond_vectors(x)
    n, signed = network.n_edges, np.flatnonzero(s)
    length = np.linalg.norm(L, axis=1)
    if not length.min() > 0:
        raise InputError(f"edge {int(length.argmin())} has no length, so no direction: move its ends apart")
    weight = np.full(n, float(length.mean()))
    R = spread_columns(network, L / weight[:, None])
    answer = _largest_least(R, s)
    # The maximum of tensions is at most that of σ, which is known to the accuracy, times the spread of the lengths.
    spread = float(length.max() / length.min())
    excluded = answer.status == 0 and spread * max(abs(answer.x[-1]), ACCURACY) <= NO_SIGNED_STRESS
    if answer.status == 0 and not answer.x[-1] > NO_SIGNED_STRESS and not excluded:
        weight, R = length, spread_columns(network, L / length[:, None])
        answer = _largest_least(R, s)
    note = ""
    if answer.status != 0:
        value, status, error = SignedStress(None, np.nan, None, signed[:0]), Status.stalled, np.nan
        note = f"the linear program failed: {answer.message}"
    elif answer.x[-1] > NO_SIGNED_STRESS:
        critical = _balanced(network, x, L / weight[:, None], answer.x[:-1], weight)
        least = float(np.min(s[signed] * critical.sigma[signed]) / np.abs(critical.sigma).max())
        value, status, error = SignedStress(critical, least, None, signed[:0]), Status.ok, critical.residual
    else:
        motion, loosened, error = _loosening(network, spread_columns(network, L), s, answer.eqlin.marginals)
        value, status = SignedStress(None, 0.0, motion, loosened), Status.floppy
        note = (
            f"no self-stress has these signs: a motion loosens {len(loosened)} of {n} edges, edge {int(loosened[0])} "
            "among them, and tightens none; change the signs or the geometry"
        )
    solution = Solution(value, status, Stats("linear program", int(answer.nit), residual=error), note)
    return solution.or_raise("no tensegrity") if throw else solution


def _balanced(network: Network, x: Array, scaled: Array, tension: Array, weight: Array) -> CriticalConfiguration:
    """The configuration of the tensions τ (N_b,) of a linear program, in units w of L, in balance to rounding."""
    shift = SELF_STRESS_SHIFT * float(np.mean(scaled**2))
    tension = balanced_part(network, scaled, tension, block_laplacian(network), shift)
    return critical_configuration(network, tension * (weight.mean() / weight), x)


def _largest_least(R: sp.csr_array, signs: Array) -> Any:
    """SciPy's result for unknowns (τ, t): maximise t with Rᵀτ = 0, s_α τ_α ≥ t and |τ_α| ≤ 1."""
    n, signed = len(signs), np.flatnonzero(signs)
    at_least = sp.csr_array((-signs[signed], (np.arange(len(signed)), signed)), shape=(len(signed), n))
    return scipy.optimize.linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=sp.hstack([at_least, np.ones((len(signed), 1))]),
        b_ub=np.zeros(len(signed)),
        A_eq=sp.hstack([R.T, sp.csr_array((R.shape[1], 1))]),
        b_eq=np.zeros(R.shape[1]),
        bounds=[(-1.0, 1.0)] * n + [(None, 1.0)],
        method="highs" if n <= SIMPLEX_EDGES else "highs-ipm",
    )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Stability(Solution[CriticalConfiguration]):
    """Stability of a configuration under its stress.

    n_negative        negative eigenvalues of the prestress matrix P
    n_null            zero eigenvalues of P
    n_affine          zero eigenvalues due to affine maps: affine functions that vanish on every pin
    prestress_stable  whether P is positive on every first-order flex: springs under a small multiple of that stress
                      are then in a strict minimum; a frame that can rotate about its pins never is.  None: undecided
    super_stable      whether P has no negative and no further zero eigenvalue and no affine map but a rigid motion
                      keeps every length: stable at any stress and any stiffness, and the only such configuration.
                      None: undecided
    """

    n_negative: int
    n_null: int
    n_affine: int
    prestress_stable: bool | None
    super_stable: bool | None


@running("stability")
def stability(critical: CriticalConfiguration, margin: float = 1e-8) -> Stability:
    """Stability of a configuration under its stress, from the inertia of P(σ) and of P on the first-order flexes.

    Eigenvalues of P within `margin` times the mean |σ| of zero count as zero.  If all σ > 0, P is positive definite:
    no eigenvalue is computed (Connelly's theorem).

    `Status.undecided` where an eigenvalue that no affine map explains, or the stiffness of a flex, is too small to have
    a sign; what is open is None.  `Status.ill_conditioned` where σ does not balance at the coordinates.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.stability(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).ok
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    of_kind(float, margin=margin)
    network, sigma = critical.network, critical.sigma
    affine = _affine_maps(network, critical.coordinates)
    if (sigma > 0).all():
        n_negative = n_null = 0
        affine = affine[:0]
    else:
        shift, pattern = margin * float(np.mean(np.abs(sigma))), laplacian(network)
        # By Sylvester's law the pivots of P ± shift count the eigenvalues beyond the margin.
        n_negative = pattern.factorize(sigma, shift).n_negative
        n_null = pattern.factorize(sigma, -shift).n_negative - n_negative
    # With two independent affine functions that vanish on the pins, a rotation keeps the pins and every length.
    stable = stabilises(network, critical.coordinates, critical.bond_vectors, sigma) if len(affine) < 2 else False
    best: bool | None = n_negative == 0 and _lengths_fix(affine, critical)
    status, note = Status.ok, ""
    if not critical.residual < BALANCED:
        stable = best = None
        status, note = Status.ill_conditioned, "the stress does not balance at these coordinates: give one that does"
    elif best and n_null != len(affine):
        best, status = None, Status.undecided
        note = (
            f"{n_null} eigenvalues of P lie within {margin:.1e} of zero, of which affine maps explain {len(affine)}: "
            "give a smaller margin, or stresses of more similar magnitude"
        )
    elif stable is None:
        status = Status.undecided
        note = "the stiffness of a flex under this stress, or the count of flexes, is rounding"
    counts = {"n_negative": n_negative, "n_null": n_null, "n_affine": len(affine)}
    stats = Stats("inertia", 1, residual=critical.residual)
    return Stability(critical, status, stats, note, **counts, prestress_stable=stable, super_stable=best)


def _loosening(
    network: Network, R: sp.csr_array, signs: Array, multipliers: Array
) -> tuple[Array, NDArray[np.intp], float]:
    """The multipliers of the balance as a motion that loosens edges, the loosened edges, and its largest violation."""
    elongation = R @ multipliers
    size = float(np.abs(elongation).max())
    loosening = -signs * elongation / size
    motion = np.zeros((network.n_vertices, network.dimension))
    motion[network.free] = (multipliers / size).reshape(-1, network.dimension)
    error = max(0.0, float(-loosening.min()), float(np.abs(elongation[signs == 0]).max(initial=0.0)) / size)
    return motion, np.flatnonzero(loosening > NO_SIGNED_STRESS), error


def _affine_maps(network: Network, coordinates: Array) -> Array:
    """Linear parts w (n, d) of the affine functions w·x + c that vanish on every pin, but not on all vertices (N_v, d).

    A cell admits none.
    """
    if not network.pins or (network.cell is not None and network.offsets.any()):
        return np.zeros((0, network.dimension))
    pins = np.array(list(network.pins.values()))
    centre = pins.mean(axis=0)
    across = scipy.linalg.null_space(pins - centre, rcond=RANK).T
    # Directions across the pins in which no vertex lies, either, are no part of the affine span.
    reach = (coordinates - centre) @ across.T
    values, right = np.linalg.svd(reach, full_matrices=False)[1:]
    size = max(float(np.abs(pins - centre).max()), float(np.abs(coordinates - centre).max()))
    spanned = int(np.count_nonzero(values > RANK * size))
    return right[:spanned] @ across


def _lengths_fix(affine: Array, critical: CriticalConfiguration) -> bool:
    """Whether no affine motion f(x) e with f zero on the pins, but a rigid one, keeps every length to first order."""
    m, L = len(affine), critical.bond_vectors
    if m == 0:
        return True
    unit = L / critical.lengths[:, None]
    elongations = np.einsum("am,ad->amd", unit @ affine.T, unit).reshape(len(L), -1)
    values = np.linalg.svd(elongations, compute_uv=False)
    rank = int(np.count_nonzero(values > RANK * values.max()))
    # Rigid motions that keep the pins in place, m(m − 1)/2 of them, keep lengths as they must.
    return rank == m * L.shape[1] - m * (m - 1) // 2
