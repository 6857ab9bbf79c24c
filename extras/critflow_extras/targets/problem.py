"""The constrained problem of a design: its targets, the limits of edges, and the variables that it may change.

Each kind of variables z maps z to what the quantities are evaluated on, and gives their gradients by z: stresses
(`stresses`) and amplitudes of faces (`faces`); other kinds of `Variables` are in the folders `design_...`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import edge_values, of_kind
from critflow.manifold import Balance
from critflow.networks import Array, Network
from critflow.quantities import Quantity, own, quantity, require_valid
from critflow.result import InputError, Solution
from critflow.springs import SpringState
from critflow_extras.targets.constrained import Minimum, Point, Problem, minimise_constrained
from critflow_extras.targets.stress_form import same

# Other spellings of the quantities of edges: `change="stiffness"` and `network.stiffness` are singular.
_PLURALS = {"length": "lengths", "tension": "tensions", "force_density": "force_densities", "stiffness": "stiffnesses"}
EXTREMES = ("largest", "smallest")
# Powers of σ and |L| in the quantities of an edge that a stress sets.
POWERS = {"lengths": (0, 1), "tensions": (1, 1), "force_densities": (1, 0)}
ABSOLUTE = ("lengths", "stiffnesses")  # the others are in units of their mean


class Target(NamedTuple):
    """One target: its name as given, the quantity, its limits, and 1 or −1 where the smallest or largest is sought."""

    name: str
    quantity: Quantity
    low: float
    high: float
    sense: int


def parse_targets(network: Network, targets: Mapping[Any, object]) -> list[Target]:
    """The targets in their order; raises `InputError` for unknown names, and for values that are no targets."""
    if not targets:
        raise InputError("give at least one target, such as {'B_0': 0.25}")
    parsed = list[Target]()
    for key, value in targets.items():
        function = quantity(network, key)
        name = key if isinstance(key, str) else function.name
        for other in parsed:
            if same(function, other.quantity):
                raise InputError(f"the targets {other.name} and {name} are the same: give one of them")
        if isinstance(value, str):
            if value not in EXTREMES:
                raise InputError(f"{name} must be a number, limits, 'largest' or 'smallest', not {value!r:.40}")
            parsed.append(Target(name, function, -np.inf, np.inf, 1 if value == "smallest" else -1))
        else:
            parsed.append(Target(name, function, *limits_of(name, value), 0))
    extremes = [target.name for target in parsed if target.sense]
    if len(extremes) > 1:
        raise InputError(f"only one of {' and '.join(extremes)} can be largest or smallest: give the others limits")
    return parsed


def limit_sizes(targets: Sequence[Target]) -> Array:
    """The largest finite limit of each target, by its magnitude (n,)."""
    limits = np.abs([(target.low, target.high) for target in targets]).reshape(-1, 2)
    return np.where(np.isfinite(limits), limits, 0.0).max(axis=1)


def limits_of(name: str, value: object) -> tuple[float, float]:
    """Low and high limit of a target."""
    low, high = value if isinstance(value, tuple | list) and len(value) == 2 else (value, value)
    try:
        limits = float(low), float(high)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"the target {name} must be a number or a pair of limits, not {value!r:.40}") from None
    if np.isnan(limits).any() or limits[0] > limits[1] or np.isinf(limits).all():
        raise InputError(f"the target {name} must be a number or a pair (low, high), not {value!r:.40}")
    return limits


@dataclass(frozen=True, eq=False)
class EdgeLimits:
    """Limits (N_b,) of one quantity q of every edge: its length, or its tension or σ in units of their mean."""

    name: str
    low: Array
    high: Array

    @classmethod
    def of(cls, name: str, value: object, n_edges: int) -> EdgeLimits:
        """Limits from a pair of numbers or of arrays; None is no limit."""
        if not (isinstance(value, tuple | list) and len(value) == 2):
            raise InputError(f"the limits of {name} must be a pair (low, high), each a number, one an edge, or None")
        low, high = np.full(n_edges, -np.inf), np.full(n_edges, np.inf)
        for end, limit in zip((low, high), value, strict=True):
            if limit is not None:
                each = np.full(n_edges, limit) if np.ndim(limit) == 0 else limit
                end[:] = edge_values(each, n_edges, f"limit of {name}", positive=False)
        if (low > high).any():
            raise InputError(f"the lower limit of {name} is above the upper one at edge {int(np.argmax(low > high))}")
        if name in ABSOLUTE and (high <= 0).any():
            raise InputError(f"the upper limit of the {name} must be positive")
        if name not in ABSOLUTE and ((low > 1).all() or (high < 1).all()):
            raise InputError(f"the limits of {name} are in units of their mean: they must enclose 1")
        return cls(name, low, high)

    def values(self, balance: Balance) -> Array:
        """q, (N_b,)."""
        q, mean, _, _ = self._quantities(balance)
        return q / mean

    def rows(self, balance: Balance, edges: NDArray[np.intp]) -> Array:
        """dq/dσ of chosen edges, (m, N_b): one solve with P each."""
        L, g, m = balance.bond_vectors, balance.network.free_incidence, len(edges)
        q, mean, by_sigma, by_L = self._quantities(balance)
        rows = np.zeros((m, len(q)))
        if by_L.any():
            # ∂|L_β|/∂σ_α = −(g P⁻¹ gᵀ)_αβ L_α·L_β/|L_β|
            rows -= ((g @ balance.factor.solve(g[edges].T.toarray())) * (L @ by_L[edges].T)).T
        rows[np.arange(m), edges] += by_sigma[edges]
        if self.name in ABSOLUTE:
            return rows
        of_mean = balance.pull_back(by_sigma / len(q), by_L / len(q))[0]
        return np.asarray((rows - (q[edges] / mean)[:, None] * of_mean) / mean)

    def _quantities(self, balance: Balance) -> tuple[Array, float, Array, Array]:
        """q before its division by the mean of all, or by 1; that number; and ∂q/∂σ (N_b,) and ∂q/∂L (N_b, d)."""
        a, b = POWERS[self.name]
        sigma, L = balance.sigma, balance.bond_vectors
        length = np.linalg.norm(L, axis=1)
        q = sigma**a * length**b
        by_L = (b * sigma**a / length)[:, None] * L
        return q, 1.0 if self.name in ABSOLUTE else float(q.mean()), a * length**b, by_L


def edge_limits(n_edges: int, within: Mapping[str, object], quantities: Sequence[str]) -> list[EdgeLimits]:
    """The limits of edges, those without any left out.

    quantities  of the edges that may have limits
    """
    limits = dict[str, object]()
    for name, value in within.items():
        plural = _PLURALS.get(name, name)
        if plural not in quantities:
            raise InputError(f"edges have no quantity {name!r:.40}: choose from {', '.join(quantities) or 'none'}")
        if plural in limits:
            raise InputError(f"the limits of {plural} are given twice: give them once")
        limits[plural] = value
    every = [EdgeLimits.of(name, value, n_edges) for name, value in limits.items()]
    return [limits for limits in every if np.isfinite(limits.low).any() or np.isfinite(limits.high).any()]


@dataclass(frozen=True, eq=False)
class DesignOptions:
    """Arguments of `design` from which a kind of variables takes those that apply to it; None where not given."""

    network: Network
    change: str
    prefer: Any = "least_change"
    within: Mapping[str, Any] | None = None
    signs: str | ArrayLike | None = None
    free: ArrayLike | None = None
    initial: ArrayLike | None = None

    def __post_init__(self) -> None:
        of_kind(Mapping, None, within=self.within)
        of_kind(np.ndarray, str, None, signs=self.signs)
        of_kind(np.ndarray, None, free=self.free, initial=self.initial)

    def limits(self, variables: type[Variables]) -> list[EdgeLimits]:
        """The limits of edges; `InputError` for a quantity that the variables do not limit."""
        return edge_limits(self.network.n_edges, self.within or {}, variables.limited_quantities)

    def prefers(self, name: str) -> bool:
        """Whether a preference is given by this name."""
        return isinstance(self.prefer, str) and self.prefer == name

    def require_unused(self, *names: str) -> None:
        """Raise `InputError` for arguments that do not apply to the variables."""
        for name in names:
            if getattr(self, name) is not None:
                raise InputError(f"{name} does not apply to change={self.change!r}: omit it")

    def springs(self, start: Any) -> SpringState:
        """The start, if it is a state of springs on edges; else `InputError`."""
        if type(start) is not SpringState:
            raise InputError(f"change={self.change!r} starts from springs on edges: give spring_state(network, ...)")
        return start


@dataclass(frozen=True, eq=False)
class DesignResult:
    """The end of a design: its value, the solve behind it, and values, errors (n,) and gradients by z (n, N)."""

    value: Any
    solved: Solution[Any]
    values: Array
    errors: Array
    rows: Array
    error_bound: float = np.nan


class Variables(ABC):
    """Variables z (N,) of a design.

    network             of which they are
    origin              z_0, (N,)
    low, high           limits (m,) of the values of `limited`
    limited_quantities  of the edges that may have limits
    own_targets         names of targets that are no quantities, which `all_targets` replaces by others
    preferences         names of preferences that the variables themselves satisfy
    starts              further classes of starts than networks, configurations and states of springs
    longest             largest change of a component of z in one step
    tolerance           residual of the first-order conditions at which the least change has been selected
    """

    network: Network
    origin: Array
    low: Array = np.zeros(0)
    high: Array = np.zeros(0)
    limited_quantities: ClassVar[tuple[str, ...]] = ()
    own_targets: ClassVar[tuple[str, ...]] = ()
    preferences: ClassVar[tuple[str, ...]] = ()
    starts: ClassVar[tuple[type, ...]] = ()
    longest: ClassVar[float]
    tolerance: ClassVar[float]

    @classmethod
    @abstractmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        """The variables of a start and the arguments of `design`; `InputError` for arguments that do not apply."""

    @classmethod
    def all_targets(cls, network: Network, targets: Mapping[Any, Any]) -> Mapping[Any, Any]:
        """The targets with quantities in place of `own_targets`."""
        return targets

    @property
    def size(self) -> int:
        """A number by which preferences are multiplied, so that components of their gradients are of order one."""
        return len(self.origin)

    @abstractmethod
    def at(self, z: Array) -> Any:
        """What quantities are evaluated on at z."""

    @abstractmethod
    def values(self, state: Any, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        """Values (n,) of quantities and their gradients by z, (n, N)."""

    @abstractmethod
    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        """The end of a design at z, solved to the last digit."""

    def at_configuration(self, solved: Solution[Any], z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        """The end at a refined configuration, to which the errors refer."""
        value = solved.value
        values, errors = np.array([(one.evaluate(value)[0], one.error(value)) for one in quantities]).reshape(-1, 2).T
        return DesignResult(value, solved, values, errors, self.values(self.at(z), quantities)[1], value.error_bound)

    def change(self, state: Any, z: Array) -> tuple[float, Array]:
        """Half the square of the change, and its gradient by z (N,)."""
        change = z - self.origin
        return 0.5 * float(change @ change), change

    def limited(self, state: Any) -> Array:
        """Values (m,) that have limits."""
        return np.zeros(0)

    def limited_rows(self, state: Any, indices: NDArray[np.intp]) -> Array:
        """Gradients by z of limited values, (len(indices), N)."""
        return np.zeros((0, len(self.origin)))

    def unit_of(self, quantity: Quantity) -> float:
        """The natural unit of a quantity."""
        return quantity.unit(self.network)

    def sizes(self, targets: Sequence[Target]) -> Array:
        """Errors of targets are relative to these (n,), and absolute below a hundredth of their units."""
        units = np.array([self.unit_of(target.quantity) for target in targets])
        return np.maximum(limit_sizes(targets), 1e-2 * units)

    def refusal(self, targets: Sequence[Target]) -> str:
        """A sentence where a proof excludes the targets, else an empty string."""
        return ""

    def remark(self, result: DesignResult, targets: Sequence[Target]) -> str:
        """A sentence on what a design has besides its targets, else an empty string."""
        return ""

    def distance(self, z: Array) -> float:
        """Root mean square of the change."""
        return float(np.sqrt(np.mean((z - self.origin) ** 2)))

    def search(self, problem: Problem, tolerance: float, max_steps: int) -> Minimum:
        """The end of the search for the targets."""
        return minimise_constrained(problem, self.origin, tolerance, self.longest, max_steps)


def require_all_valid(variables: Variables, targets: Sequence[Target]) -> None:
    """Raise `InputError` where `evaluate` of a class of the user does not return what it must, at the start."""
    if not all(own(target.quantity) for target in targets):
        state = variables.at(variables.origin)
        for target in targets:
            require_valid(target.quantity, state)


class Preference(NamedTuple):
    """What selects among the values of the variables with the targets, as a function to be minimised."""

    name: str
    tolerance: float
    # its value and gradient by z (n,), from what quantities are evaluated on, and z
    at: Callable[[Any, Array], tuple[float, Array]]
    size: float = 1.0  # of the value, over that in the units of the user


class TargetProblem:
    """A preference and targets as a `critflow_extras.targets.constrained.Problem`, in units of their sizes.

    The first constraints are the targets with limits, the others the limits of what is changed.
    """

    def __init__(self, variables: Variables, preference: Preference, targets: Sequence[Target]):
        self.variables, self.preference = variables, preference
        self.targets = [target for target in targets if not target.sense]
        self.sizes = variables.sizes(self.targets)
        low, high = (np.array([getattr(t, end) for t in self.targets]) for end in ("low", "high"))
        self.low = np.concatenate([low / self.sizes, variables.low])
        self.high = np.concatenate([high / self.sizes, variables.high])

    def at(self, z: Array) -> Point:
        state, n = self.variables.at(z), len(self.targets)
        with np.errstate(all="ignore"):
            # Trial values far from the solution may not be finite, and are refused.
            value, gradient = self.preference.at(state, z)
            values, rows = self.variables.values(state, [target.quantity for target in self.targets])
            limited = self.variables.limited(state)
        rows = rows / self.sizes[:, None]

        def of(indices: NDArray[np.intp]) -> Array:
            limits = self.variables.limited_rows(state, indices[indices >= n] - n)
            return np.concatenate([rows[indices[indices < n]], limits])

        return Point(z, value, gradient, np.concatenate([values / self.sizes, limited]), of)
