"""What a run is: its settings, the identities and random streams of its cases, and its workers.

One spelling of `--set` serves every setting; the type of the default decides how it is read:

    whole numbers   7    0,3,5    0:100         half-open, as in Python
    decimals        0.1  0.1,0.2  0.001:0.01:0.001   start:stop:step, stop included
    words           max_B_0,random_stress

Every study has the setting `variables`: names of its table to compute and store, `scalars` for all variables without
inner dimensions, or `all`.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import cached_property
from hashlib import blake2b, sha256
from typing import Any

import numpy as np

from critflow.engine.study import LONGEST, Study, nearest, require
from critflow.result import CritflowError, InputError, StudyError

HOUR = 3600.0
# Derivation of every random number, stored in the files that contain some.
SEED_ENTROPY = (
    "numpy.random.default_rng(SeedSequence(entropy, spawn_key)): entropy is the value of the axis seed, or a number "
    "in the source; spawn_key is the BLAKE2b-128 of the words of the stream as JSON, in four little-endian words"
)

_COMMA = re.compile(r",(?![^\[\]]*\])")  # outside brackets, as in local[0-1,2-3]
_UNREADABLE = re.compile(r"[^A-Za-z0-9_.-]")


def stable_rng(entropy: int, *words: str) -> np.random.Generator:
    """Independent generator of the stream `(entropy, *words)`, equal on every machine and in every order of cases.

    `stable_rng(seed, "rest_lengths", population)` is independent of `stable_rng(seed, "network")`; further seeds or
    words change neither.
    """
    digest = blake2b(json.dumps(words).encode(), digest_size=16).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=key))


@dataclass(frozen=True)
class Case:
    """One unit of computation: the parameters and one value of every axis.  Its id depends on nothing else."""

    study: Study  # restricted to the stored variables
    parameters: Mapping[str, Any]
    values: Mapping[str, int | str]

    @cached_property
    def id(self) -> str:
        """Axis values, and the hash of all that distinguishes the case, in characters that are valid in file names."""
        identity = [self.study.name, self.study.version, dict(self.parameters), dict(self.values)]
        if self.study.selected:  # shards with fewer variables never replace complete ones
            identity.append(self.study.selected)
        digest = sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]
        values = [f"{k}{v}" if isinstance(v, int) else _UNREADABLE.sub("_", v) for k, v in self.values.items()]
        return f"{'-'.join(values)[:80]}-{digest}"

    @cached_property
    def shard(self) -> str:
        """Name of the file that stores all cases with this value of the first axis and these parameters."""
        return Case(self.study, self.parameters, dict([*self.values.items()][:1])).id


@dataclass(frozen=True)
class Selection:
    """The cases of one run: a study restricted to the stored variables, its parameters and the values of every axis."""

    study: Study
    parameters: Mapping[str, Any]
    axes: Mapping[str, tuple]

    @classmethod
    def of(
        cls, study: Study, variables: Sequence[str], parameters: Mapping[str, Any], axes: Mapping[str, tuple]
    ) -> Selection:
        """The cases of a whole study; its code counts the quantities that the settings name."""
        return cls(study.storing(variables).counting(parameters), parameters, axes)

    def case(self, **values: int | str) -> Case:
        return Case(self.study, self.parameters, values)

    @cached_property
    def cases(self) -> Sequence[Case]:
        """All cases, with their identities; the first axis varies slowest.  A run may have 10⁶."""
        values = itertools.product(*self.axes.values())
        return tuple(self.case(**dict(zip(self.axes, one, strict=True))) for one in values)

    @property
    def count(self) -> int:
        return math.prod(len(values) for values in self.axes.values())

    @property
    def sizes(self) -> str:
        """Number of values of each axis, as text."""
        axes = zip(self.study.axes, self.axes.values(), strict=True)
        return " × ".join(f"{len(v)} {axis.name if len(v) == 1 else axis.key}" for axis, v in axes)


def select(study: Study, words: Sequence[str] = ()) -> Selection:
    """The defaults of the study with the `key=value` words in their place; `StudyError` for any invalid word."""
    given: dict[str, str] = {}  # text of each setting
    keys = [*(axis.key for axis in study.axes), *study.parameters, "variables"]
    for word in words:
        require(word.isprintable(), f"--set {word!a} contains unprintable characters")
        key, equals, text = word.partition("=")
        require(equals, f"--set {word} has no value: write --set {word}=VALUE")
        require(key in keys, f"study {study.name!r} has no setting {key!r}: {nearest(key, keys, 'settings')}")
        require(key not in given, f"{key} is set twice: give it once, with all its values")
        given[key] = text.strip()
    axes = dict[str, tuple]()
    for axis in study.axes:
        choices = axis.values if axis.is_words else ()
        values = _setting(axis.key, given[axis.key], axis.values, choices) if axis.key in given else axis.values
        axes[axis.name] = tuple(sorted(values, key=axis.place))
    chosen = {k: _setting(k, given[k], v) if k in given else v for k, v in study.parameters.items()}
    # An empty word is no setting, so that a new one leaves the identity of stored cases.
    parameters: Mapping[str, Any] = {k: v for k, v in chosen.items() if v != ""}
    if study.complete is not None:
        parameters = study.complete(parameters)
    for coordinate in study.coordinates:
        labels = coordinate.labels(parameters)
        if not isinstance(labels[0], str) and any(later <= earlier for earlier, later in itertools.pairwise(labels)):
            raise StudyError(f"{coordinate.parameter} must increase from each value to the next")
    selection = Selection.of(study, _variables(study, given.get("variables", "all")), parameters, axes)
    count = selection.count
    require(count <= LONGEST, f"these settings give {count:,} cases: choose at most {LONGEST:,}")
    if study.check is not None:
        try:
            study.check(parameters, axes)
        except CritflowError:
            raise
        except Exception as error:
            raise StudyError(
                f"the check of study {study.name!r} failed: {type(error).__name__}: {error}: correct its file"
            ) from error
    return selection


def spelled(value: Any) -> str:
    """A value as `--set` reads it; successive whole numbers as a range."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, (list, tuple)):
        return str(value)
    if len(value) > 2 and type(value[0]) is int and value == tuple(range(value[0], value[0] + len(value))):
        return f"{value[0]}:{value[-1] + 1}"
    return ",".join(map(str, value))


def words_of_case(case: Case) -> list[str]:
    """The `key=value` words that select exactly this case."""
    study = case.study
    words = [f"{axis.key}={spelled(case.values[axis.name])}" for axis in study.axes]
    words += [f"{k}={spelled(value)}" for k, value in case.parameters.items() if value != study.parameters[k]]
    return words + ([f"variables={spelled(study.selected)}"] if study.selected else [])


def decimals(text: str) -> tuple[float, ...]:
    """`start:stop:step` with the stop included, or a comma list; decimal arithmetic gives 0.003 exactly."""
    return _numbers("decimals", text, float)


def _variables(study: Study, text: str) -> tuple[str, ...]:
    """Names of the requested variables."""
    table = [variable.name for variable in study.variables]
    scalars = [name for name in table if not study.inner_dims[name]]
    words = {"all": table, "scalars": scalars, **{name: [name] for name in table}}
    pieces = _pieces("variables", text)
    for piece in pieces:
        known = piece in words
        require(known, f"study {study.name!r} has no variable {piece!r}: {nearest(piece, list(words), 'choices')}")
    _refuse_duplicates("variables", pieces)
    return tuple(name for piece in pieces for name in words[piece])


def _setting(key: str, text: str, default: Any, choices: Sequence[Any] = ()) -> Any:
    """The text as the default is: a truth value, words, or numbers, which are negative only if it contains some.

    choices  all words that there are, if not every word is one
    """
    if isinstance(default, bool):
        require(text in ("true", "false"), f"{key}={text} must be true or false")
        return text == "true"
    known = default if isinstance(default, tuple) else (default,)
    words = isinstance(known[0], str)
    values: tuple = _pieces(key, text) if words else _numbers(key, text, type(known[0]))
    negative = not words and min(known) >= 0 > min(values)
    require(not negative, f"{key} must not be negative, but {min(values)} is")
    for value in values if choices else ():
        require(value in choices, f"{key} has no {value!r}: {nearest(value, choices, 'choices')}")
    if isinstance(default, tuple):
        _refuse_duplicates(key, values)
        return values
    require(len(values) == 1, f"{key}={text} must be one value, as in {key}={default}")
    return values[0]


def _numbers(key: str, text: str, kind: type) -> tuple:
    """Numbers and ranges of a comma list: of whole numbers without the stop, of decimals with a step and the stop."""
    values, whole = list[Any](), kind is int
    for piece in _pieces(key, text):
        start, *more = (_number(key, part, whole) for part in piece.split(":"))
        example = f"start:stop, as in {key}=0:100" if whole else f"start:stop:step, as in {key}=0.001:0.010:0.001"
        require(len(more) in (0, 1 if whole else 2), f"{key}={piece} must be {example}")
        if not more:
            values.append(kind(start) + 0)  # no negative zero
            continue
        stop, step = (*more, Decimal(1))[:2]
        require(step > 0, f"{key}={piece} has the step {step}: give a step above zero")
        forwards = stop > start if whole else stop >= start
        require(forwards, f"{key}={piece} is an empty range or runs backwards: give a stop above {start}")
        count = int(min((stop - start) / step, Decimal(LONGEST + 1))) + (not whole)
        _refuse_length(key, text, len(values) + count)
        values += [kind(start + i * step) + 0 for i in range(count)]
    return tuple(values)


def _pieces(key: str, text: str) -> tuple[str, ...]:
    pieces = tuple(piece.strip() for piece in _COMMA.split(text))
    require("" not in pieces, f"{key}={text} has an empty value: write {key}=VALUE or {key}=VALUE,VALUE")
    _refuse_length(key, "...", len(pieces))
    return pieces


def _number(key: str, text: str, whole: bool) -> Decimal:
    """The number that a text is, exactly."""
    value, valid = Decimal(0), False
    with suppress(InvalidOperation):
        value = Decimal(text.strip())
        finite = value.is_finite() and math.isfinite(float(value))
        valid = bool(re.fullmatch(r"\s*[+-]?[0-9]{1,18}\s*", text)) if whole else finite
    require(valid, f"{key} needs {'whole' if whole else 'finite'} numbers, not {text!r}")
    return value


def _refuse_length(key: str, text: str, count: int) -> None:
    require(count <= LONGEST, f"{key}={text} has {count:,} values or more: choose at most {LONGEST:,}")


def _refuse_duplicates(key: str, values: Sequence[Any]) -> None:
    twice = [value for value, count in Counter(values).items() if count > 1]
    require(not twice, f"{key} contains {spelled(twice[:1])} twice: give every value once")


@dataclass(frozen=True)
class Workers:
    """Where cases are computed, and their limits; `InputError` for contradicting options."""

    processes: int = 0  # local worker processes; 0 is this process
    scheduler: str = ""  # address of a dask scheduler
    insecure: bool = False  # allows one without encryption
    case_seconds: float = HOUR
    gigabytes: float | None = None  # memory of a local worker; an equal share by default

    def __post_init__(self) -> None:
        encrypted = not self.scheduler or self.scheduler.startswith("tls://") or self.insecure
        limited = (self.case_seconds, self.gigabytes) != (HOUR, None)
        for option, value in (("--time-limit", self.case_seconds), ("--memory-limit", self.gigabytes)):
            if value is not None and not 0 < value < math.inf:
                raise InputError(f"{option} {value:g} must be a number above zero")
        for wrong, sentence in (
            (self.processes < 0, "--workers must not be negative"),
            (not encrypted, f"the scheduler at {self.scheduler!r} is not encrypted: use tls://, or add --insecure"),
            (limited and not self.processes and not self.scheduler, "limits need worker processes: give --workers 1"),
            (self.scheduler and self.gigabytes, "--memory-limit applies to local workers: leave it out"),
        ):
            if wrong:
                raise InputError(sentence)

    @property
    def place(self) -> str:
        """Where the cases are computed, without addresses."""
        local = f"{self.processes} worker process{'es' * (self.processes > 1)}" if self.processes else "one process"
        return "a dask scheduler" if self.scheduler else local

    @property
    def options(self) -> tuple[str, ...]:
        """Words that give one case alone the same limits."""
        limits = [] if self.case_seconds == HOUR else [f"--time-limit={self.case_seconds:g}"]
        return ("--workers=1", *limits, *([] if self.gigabytes is None else [f"--memory-limit={self.gigabytes:g}"]))
