"""Checks of the arguments of public functions: their kinds, and arrays of numbers.

    network = of_kind(Network, CriticalManifold, network=network)
    of_kind(float, tolerance=tolerance, threshold=threshold)

at the top of a function raise one sentence, `InputError`, for a word in place of a number or a ragged list in place of
an array.  A solution stands for its value; one that failed is refused.  What holds a network stands for it.  Values per
edge and rows of numbers are checked by functions that name the first bad one; ranges are the business of the function.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.result import InputError, NetworkError, Solution

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

_LONGEST = 60  # characters of a value in a sentence
# The words of the kinds of values.
_WORDS = {
    np.ndarray: "an array of numbers",
    float: "a number",
    int: "a whole number",
    str: "a name",
    bool: "True or False",
}
# What makes the objects that calls take most often.
_MAKERS = {
    "CriticalConfiguration": "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one",
    "SpringState": "spring_state(network, coordinates) makes one",
}


def of_kind(*kinds: Any, **values: Any) -> Any:
    """The values of arguments by name, each of one of these kinds, else an `InputError`: one value, or a tuple.

    kinds  classes, and None.  `float` and `int` stand for numbers of every type, and `np.ndarray` for all that NumPy
           makes an array of numbers

    Whole numbers are returned as `int`, and a solution or another holder as what it holds.
    """
    converted = tuple(_converted(name, value, kinds) for name, value in values.items())
    return converted if len(converted) > 1 else converted[0]


def _converted(name: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    if type(value) in kinds and type(value) is not np.ndarray:
        return value
    classes = tuple(kind for kind in kinds if kind is not None and kind not in _WORDS)
    if (
        (value is None and None in kinds)
        or (str in kinds and isinstance(value, str))
        or (bool in kinds and isinstance(value, bool | np.bool_))
        or (float in kinds and is_number(value))
    ):
        return value
    if int in kinds and is_number(value) and float(value).is_integer():
        return int(value)
    if np.ndarray in kinds and _is_array(value):
        return value
    content = held(value, classes)
    if content is None:
        words = [_WORDS[kind] for kind in _WORDS if kind in kinds]
        expected = " or ".join([*words, *(_with_article(kind.__name__) for kind in classes)])
        raise InputError(f"{name} must be {expected}, not {shown(value)}{_advice(value, classes)}")
    if isinstance(value, Solution) and not value:
        raise InputError(f"{name} is a solution that failed: {value.reason}: its last state is its .value")
    return content


def _advice(value: Any, classes: tuple[type[Any], ...]) -> str:
    """Where the value contains one of these classes, or what makes one."""
    if np.random.Generator in classes and is_number(value):
        return f": use numpy.random.default_rng({value})"
    if reason := getattr(value.value if isinstance(value, Solution) else value, "network_refusal", ""):
        return f": {reason}"
    if isinstance(value, Solution):
        return ": use its .value"
    return next((f": {_MAKERS[kind.__name__]}" for kind in classes if kind.__name__ in _MAKERS), "")


def held(holder: Any, kinds: tuple[type, ...]) -> Any:
    """What a holder or its value is or holds of these kinds: itself, its `configuration` or `network`; None without.

    A class whose network is another problem without the rest says so by a sentence, `network_refusal`.
    """
    if isinstance(holder, kinds):
        return holder
    one = holder.value if isinstance(holder, Solution) else holder
    if getattr(one, "network_refusal", ""):
        return one if isinstance(one, kinds) else None
    for part in (one, getattr(one, "configuration", None), getattr(one, "network", None)):
        if isinstance(part, kinds):
            return part
    return None


def of_known_kind(function: Any, *kinds: type[Any], **values: Any) -> Any:
    """As `of_kind`, where a `singledispatch` function also takes the kinds that are registered for it."""
    own = (type(value.value if isinstance(value, Solution) else value) for value in values.values())
    return of_kind(
        *kinds,
        *(kind for kind in own if kind not in kinds and function.dispatch(kind) is not function.dispatch(object)),
        **values,
    )


def generator(seed: int | np.random.Generator) -> np.random.Generator:
    """The random generator itself, or that of a seed."""
    if isinstance(seed, np.random.Generator):
        return seed
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed must be a whole number from zero or a numpy random Generator, not {shown(seed)}")
    return np.random.default_rng(int(seed))


def edge_values(
    values: ArrayLike, n_edges: int, name: str, positive: bool = True, place: str = "edge", equal: bool = False
) -> Array:
    """Values per edge, or face, as floats (N_b,), finite and positive, else a `NetworkError` on the first bad one.

    equal  one number stands for all
    """
    array = floats(values, name)
    if equal and array.ndim == 0:
        array = np.full(n_edges, float(array))
    if array.shape != (n_edges,):
        raise NetworkError(f"{name} must have one value per {place}, shape ({n_edges},), not {array.shape}")
    bad = ~np.isfinite(array) | (positive & ~(array > 0))
    if bad.any():
        edge = int(np.flatnonzero(bad)[0])
        rule = "positive and finite" if positive else "finite"
        raise NetworkError(f"{name} must be {rule} on every {place}, but {name}[{edge}] = {array[edge]}: correct it")
    return array


def finite_rows(array: Array, name: str, shape: tuple[int, ...]) -> Array:
    """The array if it has this shape and is finite, else a `NetworkError` that names the first bad row."""
    if array.shape != shape:
        raise NetworkError(f"{name} must have shape {shape}, not {array.shape}: give one row for each")
    bad = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
    if len(bad):
        raise NetworkError(f"{name} must be finite, but {name}[{bad[0]}] = {array[bad[0]].tolist()}: correct that row")
    return array


def floats(values: ArrayLike, name: str) -> Array:
    """A copy of the values as floats, else a `NetworkError`."""
    try:
        array = np.array(values)
        if array.dtype.kind == "c":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise NetworkError(f"{name} must be real numbers in rows of equal length, not {shown(values)}") from None


def integers(values: ArrayLike, name: str) -> IntArray:
    """A copy of the values as integers, else a `NetworkError`."""
    try:
        array = np.array(values)
    except ValueError:
        raise NetworkError(f"{name} must be rows of equal length, not {shown(values)}") from None
    kind, bad = array.dtype.kind, np.zeros(array.shape, bool)
    if kind == "f":
        bad = ~((array == np.round(array)) & (np.abs(array) < 2.0**63))
    elif kind == "u":
        bad = array >= 2**63
    if kind not in "iuf" or bad.any():
        value = array[bad][0] if bad.any() else array.dtype
        raise NetworkError(f"{name} must be whole numbers, not {value}: they count vertices and cell images")
    return array.astype(np.int64)


def shown(value: object) -> str:
    """A value in one short line; arrays and objects by their kind."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    if value is None or isinstance(value, str | int | float | complex | np.generic | list | tuple | dict):
        text = " ".join(repr(value).split())
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
    return _with_article(type(value).__name__)


def is_number(value: Any) -> bool:
    """Whether a value is a real number, which True and False are not."""
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return real or (isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf")


def _is_array(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except (TypeError, ValueError):
        return False


def _with_article(noun: str) -> str:
    return f"a{'n' * (noun[0] in 'AEIOaeio')} {noun}"
