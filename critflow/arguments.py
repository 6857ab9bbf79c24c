"""The kinds of arguments of public functions, checked by calls at the top of the function.

    network = of_kind(Network, CriticalManifold, network=network)
    of_kind(float, tolerance=tolerance, threshold=threshold)

raise one sentence, `InputError`, for a word in place of a number or a ragged list in place of an array.  A solution
stands for its value; one that failed is refused.  What holds a network stands for it.  Values, shapes and ranges are
the business of the function.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.result import InputError, Solution

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
    if reason := getattr(value.value if isinstance(value, Solution) else value, "alone", ""):
        return f": {reason}"
    if isinstance(value, Solution):
        return ": use its .value"
    return next((f": {_MAKERS[kind.__name__]}" for kind in classes if kind.__name__ in _MAKERS), "")


def held(holder: Any, kinds: tuple[type, ...]) -> Any:
    """What a holder or its value is or holds of these kinds: itself, its `configuration` or `network`; None without.

    A class whose network is another problem without the rest says so by a sentence `alone`, and holds nothing.
    """
    if isinstance(holder, kinds):
        return holder
    one = holder.value if isinstance(holder, Solution) else holder
    if getattr(one, "alone", ""):
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


def shown(value: object) -> str:
    """A value in one short line; arrays and objects by their kind."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    if value is None or isinstance(value, str | int | float | complex | np.generic | list | tuple | dict):
        return " ".join(f"{value!r:.60}".split())
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
