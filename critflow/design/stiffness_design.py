"""Design of stiffnesses: springs at rest in a given configuration with requested moduli or a requested tensor.

With relaxed extensions ε_a = n·(E_a L + g u_a), n = L/|L|, under the strains E_a of `strain_basis`
    V C_ab = min_u Σ k ε_a ε_b,   so   ∂C_ab/∂k_α = ε_aα ε_bα/V,
exactly and without another solve: C is stationary in the relaxations u.  The unknowns are θ = log k, so every stiffness
stays positive, and the solution nearest to the given stiffnesses is selected as in `design`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.design.result import Design, Interval, all_limits, of_targets, outcome
from critflow.linalg.matrices import block_laplacian, edge_blocks
from critflow.networks.checks import edge_values
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.response.at_rest import response_at_rest
from critflow.response.tensor import Elasticity
from critflow.result import InputError, Stats
from critflow.rigidity.counts import rigidity
from critflow.solvers.constrained import Minimum, Point, minimise_constrained

TARGET_STATIONARY = 1e-5  # largest gradient of ½|Δ log k|² at the end, relative to 1 + max |Δ log k|
POSITIVE_TENSOR = 1e-12  # eigenvalues of a requested tensor below this part of the largest one count as zero

_MOST_STEPS = 200
# Longest change of log k in one step.
_LONGEST = 1.0
# Targets smaller than this part of the largest one have absolute errors.
_SMALL = 1e-2


@dataclass(frozen=True, eq=False, kw_only=True)
class StiffnessDesign(Design[Network]):
    """A network whose stiffnesses give its configuration the requested elasticity; unknowns are log k.

    elasticity  tensor of the springs at rest, with error bounds
    """

    elasticity: Elasticity = field(repr=False)


@checked
def design_stiffness(
    network: Network,
    coordinates: ArrayLike,
    targets: Mapping[str, Interval],
    *,
    start: ArrayLike | None = None,
    max_steps: int = _MOST_STEPS,
    throw: bool = True,
) -> StiffnessDesign:
    """Stiffnesses k > 0 (N_b,) that give springs at rest at coordinates (N_v, d) the requested elasticity.

    targets  name → value, or (low, high), in units of k: "bulk_modulus", "shear_modulus" (of the plane xy), and the
             components "C_xxxx", "C_xxyy", ... of the relaxed tensor in the order of `strain_basis`;
             `isotropic_targets` lists all components for a Young's modulus and a Poisson's ratio
    start    stiffnesses k_0 (N_b,) that are changed least; those of the network by default

    `stats.residual` is the largest error of a target relative to its size, `stats.error_bound` (estimate) the rounding
    error of the achieved values in the same units.
    Error bound (proof): `Status.infeasible` with a reason in the note, for tensors that are not positive semidefinite
    and for those of a higher rank than the number of self-stresses.
    Otherwise `Status.infeasible` means that the search could not reduce the errors of all targets together.
    Raises `InputError` for unknown targets, pinned networks and floppy ones, `SolveError` with `throw`.
    """
    x = validated_coordinates(network, coordinates)
    k = edge_values(network.stiffness if start is None else start, network.n_edges, "start")
    n_self_stresses = _self_stresses(network, x)
    goals = TensorGoals(network, x, targets, k)
    reason = goals.excess(n_self_stresses)
    with np.errstate(all="ignore"):
        # Trial stiffnesses of extreme contrast have values that are not finite, and are refused.
        steps = 0 if reason else max_steps
        found = minimise_constrained(goals, goals.origin, TARGET_STATIONARY, _LONGEST, steps)
    solution = goals.report(found, reason)
    return solution.or_raise("no stiffnesses with this elasticity were found") if throw else solution


@checked
def isotropic_targets(dimension: int, youngs_modulus: float, poissons_ratio: float) -> dict[str, float]:
    """All components of the isotropic tensor with Young's modulus E and Poisson's ratio ν, −1 < ν < 1/(d − 1).

    C = λ 1⊗1 + 2μ 𝟙 with μ = E/(2(1 + ν)) and λ = E ν/((1 + ν)(1 − (d − 1)ν)): targets of `design_stiffness`.
    Raises `InputError` for ν at or beyond its limits, and E that is not positive.

    >>> import critflow as cf
    >>> cf.isotropic_targets(2, youngs_modulus=1.0, poissons_ratio=0.0)
    {'C_xxxx': 1.0, 'C_xxyy': 0.0, 'C_xxxy': 0.0, 'C_yyyy': 1.0, 'C_yyxy': 0.0, 'C_xyxy': 0.5}
    """
    d, E, nu = dimension, youngs_modulus, poissons_ratio
    if d not in (2, 3):
        raise InputError(f"isotropic tensors have dimension 2 or 3, not {d}")
    if not 0 < E < np.inf:
        raise InputError(f"Young's modulus must be positive and finite, not {E}")
    if not -1 < nu < 1 / (d - 1):
        raise InputError(f"Poisson's ratio is between -1 and {1 / (d - 1):g} in {d} dimensions, not {nu}: change it")
    shear, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - (d - 1) * nu))
    tensor = np.diag(np.repeat([2 * shear, shear], [d, d * (d - 1) // 2]))
    tensor[:d, :d] += lame
    return {name: float(tensor[index]) for name, index in _components(d).items()}


def _components(dimension: int) -> dict[str, tuple[int, int]]:
    """Names of the independent components of the tensor, such as C_xxyy, with their indices."""
    names = strain_basis(dimension)[0]
    return {f"C_{names[a]}{names[b]}": (int(a), int(b)) for a, b in zip(*np.triu_indices(len(names)), strict=True)}


def _self_stresses(network: Network, coordinates: Array) -> int:
    """The number of self-stresses of a network that only these resist."""
    if network.pins or network.cell is None:
        raise InputError("elasticity is that of a periodic cell: give a network without pins")
    if network.dimension < 2:
        raise InputError("a tensor to be designed needs two or three dimensions")
    counts = rigidity(network, coordinates, vectors=False)
    if not counts.value.first_order_rigid:
        n_modes = counts.value.n_zero_modes - counts.value.n_trivial
        raise InputError(
            f"the network has {n_modes} zero modes at these coordinates, so stiffnesses do not fix its response: give "
            "one with more edges, such as delaunay_network()"
        )
    return int(counts.value.n_self_stresses)


class TensorGoals:
    """Targets that are linear in the tensor: weights W (n, m, m), limits and sizes."""

    def __init__(self, network: Network, coordinates: Array, targets: Mapping[str, Interval], start: Array):
        d = network.dimension
        if not targets:
            raise InputError("give at least one target, such as {'bulk_modulus': 0.25}")
        table = _weights(d)
        unknown = [name for name in targets if name not in table]
        if unknown:
            raise InputError(f"no target is called {unknown[0]!r}: choose from {', '.join(table)}")
        self._network, self._coordinates, self.origin = network, coordinates, np.log(start)
        self.names = tuple(targets)
        self._W = np.array([table[name] for name in self.names])
        self._low, self._high = all_limits(targets)
        L = network.bond_vectors(coordinates)
        length = np.linalg.norm(L, axis=1)
        self._pattern, self._unit = block_laplacian(network), L / length[:, None]
        basis = strain_basis(d)[1]
        self._affine = np.einsum("ei,aij,ej->ea", self._unit, basis, L, optimize=True)
        ends = np.maximum(np.abs(self._low), np.abs(self._high))
        ends = np.where(np.isfinite(ends), ends, np.minimum(np.abs(self._low), np.abs(self._high)))
        largest = float(ends.max()) or float(np.abs(self._tensor(self.origin)[0]).max())
        self._scale = np.maximum(ends, _SMALL * largest)
        self.low, self.high = self._low / self._scale, self._high / self._scale

    def _tensor(self, theta: Array) -> tuple[Array, Array]:
        """C (m, m) and the relaxed extensions (N_b, m)."""
        k, unit, network = np.exp(theta), self._unit, self._network
        factor = self._pattern.factorize(edge_blocks(k, unit, np.zeros(len(k))))
        m, d = self._affine.shape[1], unit.shape[1]
        tension = k[:, None] * self._affine
        force = network.divergence @ (tension[:, None, :] * unit[:, :, None]).reshape(len(k), d * m)
        u = factor.solve(np.asarray(force).reshape(-1, m))
        motion = (network.free_incidence @ u.reshape(-1, d * m)).reshape(len(k), d, m)
        extension = self._affine - np.einsum("ei,eia->ea", unit, motion)
        C = (extension.T * k) @ extension / network.volume
        return 0.5 * (C + C.T), extension

    def at(self, z: Array) -> Point:
        """Half the square of the change of θ, and the targets relative to their sizes."""
        C, extension = self._tensor(z)
        weighted = np.einsum("ea,nab,eb->ne", extension, self._W, extension, optimize=True)
        rows = weighted * np.exp(z) / (self._network.volume * self._scale[:, None])
        change = z - self.origin
        values = self._values(C) / self._scale
        return Point(z, 0.5 * float(change @ change), change, values, lambda indices: rows[indices])

    def _values(self, C: Array) -> Array:
        return np.einsum("nab,ab->n", self._W, C)

    def excess(self, n_self_stresses: int) -> str:
        """A sentence where the targets contradict any network of this many self-stresses, else an empty string."""
        wanted = _components(self._network.dimension)
        given = dict(zip(self.names, zip(self._low, self._high, strict=True), strict=True))
        if not all(name in given and given[name][0] == given[name][1] for name in wanted):
            return ""
        m = self._affine.shape[1]
        C = np.zeros((m, m))
        for name, (a, b) in wanted.items():
            C[a, b] = C[b, a] = given[name][0]
        values = np.linalg.eigvalsh(C)
        if values[0] < -POSITIVE_TENSOR * np.abs(values).max():
            return f"the requested tensor has a negative eigenvalue, {values[0]:.3g}: springs at rest never soften"
        rank = int(np.count_nonzero(values > POSITIVE_TENSOR * values[-1]))
        if rank > n_self_stresses:
            return f"the requested tensor has rank {rank}, and {n_self_stresses} self-stresses give at most that rank"
        return ""

    def report(self, found: Minimum, reason: str) -> StiffnessDesign:
        """The design at the end of a search, its tensor computed again with error bounds."""
        theta = found.point.z
        network = self._network.with_stiffness(np.exp(theta))
        response = response_at_rest(network, self._coordinates, network.volume)
        values = self._values(response.value.tensor)
        bounds = np.einsum("nab,ab->n", np.abs(self._W), response.value.errors.tensor)
        error = np.abs(values - np.clip(values, self._low, self._high)) / self._scale
        unreached = "the errors of the targets cannot be reduced together from here: relax one, or give another start"
        status, note = outcome(found, reason, unreached)
        if not response.ok:
            status, note = response.status, response.note
        rows = found.point.rows(np.arange(len(self.names))) * self._scale[:, None]
        return StiffnessDesign(
            value=network,
            status=status,
            stats=Stats("sqp", found.steps, float(error.max()), error_bound=float((bounds / self._scale).max())),
            note=note,
            elasticity=response.value,
            preference=found.point.value,
            distance=float(np.sqrt(np.mean((theta - self.origin) ** 2))),
            **of_targets(self.names, values, bounds, -found.multipliers / self._scale, rows),
        )


def _weights(dimension: int) -> dict[str, Array]:
    """Weights (m, m) of the targets by name: value = W : C."""
    d, components = dimension, _components(dimension)
    m = d * (d + 1) // 2
    table = {"bulk_modulus": np.zeros((m, m)), "shear_modulus": np.zeros((m, m))}
    table["bulk_modulus"][:d, :d] = 1 / d**2
    table["shear_modulus"][-1, -1] = 1.0
    for name, (a, b) in components.items():
        table[name] = np.zeros((m, m))
        table[name][a, b] += 0.5
        table[name][b, a] += 0.5
    return table
