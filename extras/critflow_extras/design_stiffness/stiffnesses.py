"""Stiffnesses as the variables of a design: springs at rest with requested moduli or a requested tensor, z = log k.

With relaxed extensions ε_a = n·(E_a L + g u_a), n = L/|L|, under the strains E_a of `strain_basis`
    V C_ab = min_u Σ k ε_a ε_b,   so   ∂C_ab/∂k_α = ε_aα ε_bα/V,
exactly and without another solve: C is stationary in the relaxations u.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import edge_values, of_kind
from critflow.deformation import strain_basis
from critflow.networks import Array, Network
from critflow.quantities import Quantity, TransitionModulus
from critflow.result import InputError
from critflow.sparse import block_laplacian, edge_blocks
from critflow.springs import SpringState, spring_state
from critflow_extras.certificates.counts import rigidity
from critflow_extras.design_names.components import TensorComponent
from critflow_extras.design_stiffness.poisson import (
    NAME,
    TensorRatio,
    poisson_refusal,
    poisson_targets,
    with_poisson,
)
from critflow_extras.rest.at_rest import response_at_rest
from critflow_extras.targets.problem import DesignOptions, DesignResult, EdgeLimits, Target, Variables, limit_sizes
from critflow_extras.targets.stress_form import tensor_weights

POSITIVE_TENSOR = 1e-12  # eigenvalues of a requested tensor below this part of the largest one count as zero

ISOTROPIC = 1e-2  # deviation from an isotropic tensor, in units of the bulk modulus, that counts as none

# Targets smaller than this part of the largest one have absolute errors.
_SMALL = 1e-2


class AtRest(NamedTuple):
    """Stiffnesses k (N_b,), the tensor C (m, m) of the springs at rest, and the relaxed extensions (N_b, m)."""

    stiffness: Array
    tensor: Array
    extensions: Array


class Stiffnesses(Variables):
    """log k (N_b,) of springs at rest at the coordinates of a state."""

    limited_quantities = ("stiffnesses",)
    own_targets = (NAME,)
    longest = 1.0
    tolerance = 1e-5  # largest gradient of ½|Δ log k|² along the targets, relative to 1 + max |Δ log k|

    def __init__(self, state: SpringState, start: ArrayLike | None = None, limits: Sequence[EdgeLimits] = ()):
        network, x = state.network, state.coordinates
        k = edge_values(network.stiffness if start is None else start, network.n_edges, "start")
        self.network, self.state, self.n_self_stresses = network, state, _self_stresses(network, x)
        self.origin, d = np.log(k), network.dimension
        L = network.bond_vectors(x)
        length = np.linalg.norm(L, axis=1)
        self._pattern, self._unit = block_laplacian(network), L / length[:, None]
        self._affine = np.einsum("ei,aij,ej->ea", self._unit, strain_basis(d)[1], L, optimize=True)
        with np.errstate(divide="ignore"):
            self.low = np.concatenate([np.zeros(0), *(np.log(np.maximum(limit.low, 0)) for limit in limits)])
            self.high = np.concatenate([np.zeros(0), *(np.log(limit.high) for limit in limits)])

    @classmethod
    def all_targets(cls, network: Network, targets: Mapping[Any, Any]) -> Mapping[Any, Any]:
        return with_poisson(network.dimension, targets)

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        limits = options.limits(cls)
        options.require_unused("signs", "free")
        return cls(options.springs(start), options.initial, limits)

    def at(self, z: Array) -> AtRest:
        k, unit, network = np.exp(z), self._unit, self.network
        factor = self._pattern.factorize(edge_blocks(k, unit, np.zeros(len(k))))
        m, d = self._affine.shape[1], unit.shape[1]
        tension = k[:, None] * self._affine
        force = network.divergence @ (tension[:, None, :] * unit[:, :, None]).reshape(len(k), d * m)
        u = factor.solve(np.asarray(force).reshape(-1, m))
        motion = (network.free_incidence @ u.reshape(-1, d * m)).reshape(len(k), d, m)
        extension = self._affine - np.einsum("ei,eia->ea", unit, motion)
        C = (extension.T * k) @ extension / network.volume
        return AtRest(k, 0.5 * (C + C.T), extension)

    def values(self, state: AtRest, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        values, W = _of_tensor(quantities, state.tensor, self.network.dimension)
        extension = state.extensions
        weighted = np.einsum("ea,nab,eb->ne", extension, W, extension, optimize=True)
        return values, weighted * state.stiffness / self.network.volume

    def limited(self, state: AtRest) -> Array:
        return np.log(state.stiffness) if len(self.low) else np.zeros(0)

    def limited_rows(self, state: AtRest, indices: NDArray[np.intp]) -> Array:
        rows = np.zeros((len(indices), len(self.origin)))
        rows[np.arange(len(indices)), indices] = 1.0
        return rows

    def sizes(self, targets: Sequence[Target]) -> Array:
        """The size of each target, and at least a hundredth of the largest component; ratios have the size one."""
        sizes = limit_sizes(targets)
        ratios = np.array([isinstance(target.quantity, TensorRatio) for target in targets], bool)
        largest = float(sizes[~ratios].max(initial=0.0)) or float(np.abs(self.at(self.origin).tensor).max())
        return np.where(ratios, np.maximum(sizes, 1.0), np.maximum(sizes, _SMALL * largest))

    def refusal(self, targets: Sequence[Target]) -> str:
        """A sentence where the targets contradict any network of this many self-stresses, else an empty string."""
        d = self.network.dimension
        if refusal := poisson_refusal(d, targets, self.n_self_stresses):
            return refusal
        given = {target.quantity.name: target for target in targets}
        components = component_names(d)
        if not all(name in given and given[name].low == given[name].high for name in components):
            negative = [target.name for target in targets if target.high < 0 and _is_square(target.quantity)]
            return f"{negative[0]} of springs at rest is never negative: raise it" if negative else ""
        m = self._affine.shape[1]
        C = np.zeros((m, m))
        for name, (a, b) in components.items():
            C[a, b] = C[b, a] = given[name].low
        values = np.linalg.eigvalsh(C)
        if values[0] < -POSITIVE_TENSOR * np.abs(values).max():
            return f"the requested tensor has a negative eigenvalue, {values[0]:.3g}: springs at rest never soften"
        rank = int(np.count_nonzero(values > POSITIVE_TENSOR * values[-1]))
        if rank > self.n_self_stresses:
            most = self.n_self_stresses
            return f"the requested tensor has rank {rank}, and {most} self-stresses give at most that rank"
        return ""

    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        """The state with these stiffnesses; its tensor is computed again with error bounds."""
        network = self.network.with_stiffness(np.exp(z))
        response = response_at_rest(network, self.state.coordinates, network.volume)
        values, W = _of_tensor(quantities, response.value.tensor, network.dimension)
        errors = np.einsum("nab,ab->n", np.abs(W), response.value.errors.tensor)
        value = spring_state(network, self.state.rest_lengths, self.state.coordinates, self.state.law)
        return DesignResult(value, response, values, errors, self.values(self.at(z), quantities)[1])

    def remark(self, result: DesignResult, targets: Sequence[Target]) -> str:
        """The components in which the tensor of a design for moduli alone deviates most from an isotropic one."""
        if not all(isinstance(target.quantity, TransitionModulus) for target in targets):
            return ""
        d, C = self.network.dimension, result.solved.value.tensor
        apart = {one.name: abs(one.of_tensor(C)[0]) for one in poisson_targets(d, 0.0) if one.name != NAME}
        largest, names = max(apart, key=apart.__getitem__), component_names(d)
        if not apart[largest] > ISOTROPIC:
            return ""
        values = ", ".join(f"{name} = {C[names[name]]:.3g}" for name in sorted(re.findall("C_[xyz]+", largest)))
        return f"the tensor is anisotropic, {values}: for an isotropic one give 'poisson' and one modulus"


def _is_square(quantity: Quantity) -> bool:
    """Whether a quantity is A:C:A of a strain A, which no springs at rest make negative."""
    if isinstance(quantity, TensorComponent):
        return quantity.first is quantity.second
    return isinstance(quantity, TransitionModulus)


def _of_tensor(quantities: Sequence[Quantity], C: Array, dimension: int) -> tuple[Array, Array]:
    """Values (n,) of functions of the tensor C (m, m) and their derivatives by it, (n, m, m)."""
    values, weights = np.zeros(len(quantities)), np.zeros((len(quantities), *C.shape))
    for n, quantity in enumerate(quantities):
        if isinstance(quantity, TensorRatio):
            values[n], weights[n] = quantity.of_tensor(C)
        else:
            weights[n] = tensor_weights(quantity, dimension)
            values[n] = np.sum(weights[n] * C)
    return values, weights


def isotropic_targets(dimension: int, youngs_modulus: float, poissons_ratio: float) -> dict[str, float]:
    """All components of the isotropic tensor with Young's modulus E and Poisson's ratio ν, −1 < ν < 1/(d − 1).

    C = λ 1⊗1 + 2μ 𝟙 with μ = E/(2(1 + ν)) and λ = E ν/((1 + ν)(1 − (d − 1)ν)): targets of a change of stiffnesses.
    Raises `InputError` for ν at or beyond its limits, and E that is not positive.

    >>> from critflow_extras.design_stiffness.stiffnesses import isotropic_targets
    >>> isotropic_targets(2, youngs_modulus=1.0, poissons_ratio=0.0)
    {'C_xxxx': 1.0, 'C_xxyy': 0.0, 'C_xxxy': 0.0, 'C_yyyy': 1.0, 'C_yyxy': 0.0, 'C_xyxy': 0.5}
    """
    dimension = of_kind(int, dimension=dimension)
    of_kind(float, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio)
    d, E, nu = dimension, youngs_modulus, poissons_ratio
    if d not in (2, 3):
        raise InputError(f"the tensor is that of two or three dimensions, not of {d}")
    if not 0 < E < np.inf:
        raise InputError(f"Young's modulus must be positive and finite, not {E}")
    if not -1 < nu < 1 / (d - 1):
        raise InputError(f"Poisson's ratio is between -1 and {1 / (d - 1):g} in {d} dimensions, not {nu}: change it")
    shear, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - (d - 1) * nu))
    tensor = np.diag(np.repeat([2 * shear, shear], [d, d * (d - 1) // 2]))
    tensor[:d, :d] += lame
    return {name: float(tensor[index]) for name, index in component_names(d).items()}


def component_names(dimension: int) -> dict[str, tuple[int, int]]:
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
