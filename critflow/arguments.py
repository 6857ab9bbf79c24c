"""Arguments of public functions are checked against their annotations before the call.

    @checked
    def stiffening(network: Network | CriticalManifold, critical: CriticalConfiguration) -> ...

raises one sentence, `InputError`, for a word in place of a number or a ragged list in place of an array.  A solution
stands for its value; one that failed is refused.  What holds a network stands for it.  Values, shapes and ranges are
the business of the function.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import cache, reduce, wraps
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np
from threadpoolctl import ThreadpoolController

from critflow.progress import running
from critflow.result import InputError, Solution

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")

_ARRAYS = {"ArrayLike", "Array", "IntArray", "Mask"}
_NUMBERS = {"float": "a number", "int": "a whole number"}
# What makes the objects that calls take most often.
_MAKERS = {
    "CriticalConfiguration": "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one",
    "SpringState": "spring_state(network, coordinates) makes one",
}


def checked(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Raise `InputError` for arguments whose kind does not match the annotation of their parameter."""
    signature = inspect.signature(function)
    tests: dict[str, _Kinds] = {}

    @wraps(function)
    def call(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Returned:
        if not tests:
            # At the first call, when all names of the module exist.
            names = getattr(function, "__globals__", {})
            tests.update({name: _Kinds(parameter, names) for name, parameter in signature.parameters.items()})
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # with Python's message on the number and names of arguments
        for name, value in bound.arguments.items():
            bound.arguments[name] = tests[name].converted(name, value)
        with running(function.__name__), _one_thread():
            return function(*bound.args, **bound.kwargs)

    return call


@cache
def _controller() -> ThreadpoolController:
    # To find the libraries takes milliseconds, to set their threads microseconds.
    return ThreadpoolController()


def _one_thread() -> Any:
    """A context in which BLAS uses one thread; calls inside it find it so, and set nothing.

    Digits and times then do not depend on other processes: threads that wait for each other while processes are busy
    take seconds for the small dense matrices of this library.
    """
    controller = _controller()
    blas = (library.num_threads for library in controller.lib_controllers if library.user_api == "blas")
    return nullcontext() if all(n == 1 for n in blas) else controller.limit(limits=1, user_api="blas")


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


def of_kind(name: str, value: Any, kinds: tuple[type, ...], takes: Callable[[type], bool]) -> Any:
    """What an argument is or holds of these kinds, or of its own kind if a function takes it, else an `InputError`."""
    own = type(value.value if isinstance(value, Solution) else value)
    words = {kind.__name__: kind for kind in (*kinds, *((own,) if takes(own) else ()))}
    annotation = " | ".join(words)
    kind = inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=annotation)
    return _Kinds(kind, words).converted(name, value)


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


class _Kinds:
    """The kinds of arguments that an annotation admits: names of kinds, classes, or anything."""

    def __init__(self, parameter: inspect.Parameter, names: Mapping[str, Any]):
        self.words, self.classes, self.anything = set[str](), list[type](), False
        if parameter.annotation is parameter.empty or parameter.kind in (
            parameter.VAR_POSITIONAL,
            parameter.VAR_KEYWORD,
        ):
            self.anything = True
            return
        for text in str(parameter.annotation).split(" | "):
            if text in _ARRAYS or text in _NUMBERS or text in ("str", "bool", "None"):
                self.words.add(text)
            else:
                first, *rest = text.split("[")[0].split(".")
                self._add(reduce(lambda value, name: getattr(value, name, Any), rest, names.get(first, Any)))

    def _add(self, hint: Any) -> None:
        if get_origin(hint) in (Union, UnionType):
            for member in get_args(hint):
                self._add(member)
            return
        if isinstance(hint, TypeVar):
            hint = hint.__bound__
        kind = get_origin(hint) or hint
        if isinstance(kind, type) and kind is not Any and not getattr(kind, "_is_protocol", False):
            self.classes.append(kind)
        else:
            self.anything = True

    def converted(self, name: str, value: Any) -> Any:
        """The value, whole numbers as integers; `InputError` if it is of none of these kinds."""
        words = self.words
        if self.anything or (value is None and "None" in words) or isinstance(value, tuple(self.classes)):
            return value
        if ("str" in words and isinstance(value, str)) or ("bool" in words and isinstance(value, bool | np.bool_)):
            return value
        if words & _NUMBERS.keys() and is_number(value) and ("float" in words or float(value).is_integer()):
            return value if "float" in words else int(value)
        if words & _ARRAYS and _is_array(value):
            return value
        found = held(value, tuple(self.classes))
        if found is not None:
            if not isinstance(value, Solution) or value:
                return found
            raise InputError(f"{name} is a solution that failed: {value.reason}: its last state is its .value")
        raise InputError(f"{name} must be {self._expected()}, not {shown(value)}{self._advice(value)}")

    def _expected(self) -> str:
        kinds = ["an array of numbers"] if self.words & _ARRAYS else []
        kinds += [_NUMBERS[word] for word in _NUMBERS if word in self.words]
        kinds += ["a name"] * ("str" in self.words) + ["True or False"] * ("bool" in self.words)
        kinds += [_with_article(kind.__name__) for kind in self.classes]
        return " or ".join(kinds)

    def _advice(self, value: Any) -> str:
        """Where the value contains a suitable one."""
        if np.random.Generator in self.classes and is_number(value):
            return f": use numpy.random.default_rng({value})"
        if reason := getattr(value.value if isinstance(value, Solution) else value, "alone", ""):
            return f": {reason}"
        if isinstance(value, Solution):
            return ": use its .value"
        return next((f": {_MAKERS[kind.__name__]}" for kind in self.classes if kind.__name__ in _MAKERS), "")


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
