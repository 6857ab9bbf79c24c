"""From `--set` words to the cases of a run.

One spelling serves every setting, read by the type of its default:

    whole numbers   7    0,3,5    0:100         half-open, as in Python
    decimals        0.1  0.1,0.2  0.001:0.01:0.001   start:stop:step, the stop included
    words           bulk_modulus,random_stress

Every study has the setting `variables`: what is computed and stored, by names of its table, or `scalars` for all that
have no dimensions of their own, or `all`.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import cached_property
from hashlib import sha256
from typing import Any

from critflow.result import CritflowError, StudyError
from critflow.workflow.study import LONGEST, Axis, Study, nearest

_UNREADABLE = re.compile(r"[^A-Za-z0-9_.-]")


@dataclass(frozen=True)
class Case:
    """One unit of work: the parameters and one value of every axis.  Its id depends on nothing else."""

    study: str
    version: int
    parameters: Mapping[str, Any]
    values: Mapping[str, int | str]
    variables: tuple[str, ...] = ()  # what is stored of it; all where none is named

    @cached_property
    def identity(self) -> str:
        """All that tells the case from others, as JSON."""
        identity = [self.study, self.version, dict(self.parameters), dict(self.values)]
        if self.variables:  # shards with fewer variables stand beside the whole ones and never replace them
            identity.append(self.variables)
        return json.dumps(identity, sort_keys=True)

    @cached_property
    def id(self) -> str:
        """Readable name and hash of the identity, so that other axis values never change it."""
        return f"{self.readable}-{sha256(self.identity.encode()).hexdigest()[:16]}"

    @property
    def readable(self) -> str:
        """Axis values in the letters that file names may have."""
        return _readable(self.values)[:80]


@dataclass(frozen=True)
class Named:
    """What the ids of cases take from a study."""

    name: str
    version: int
    selected: tuple[str, ...] = ()  # variables; all where none is named


@dataclass(frozen=True)
class Plan:
    """The cases of one run, enough to name and to count them: parameters and the values along every axis."""

    study: Study | Named
    parameters: Mapping[str, Any]
    axes: Mapping[str, tuple]

    def case(self, **values: int | str) -> Case:
        return Case(self.study.name, self.study.version, self.parameters, values, self.study.selected)

    def batches(self) -> Iterator[list[Case]]:
        """The cases, those of one value of the first axis together."""
        first, *others = self.axes
        for value in self.axes[first]:
            rest = itertools.product(*(self.axes[name] for name in others))
            yield [self.case(**{first: value}, **dict(zip(others, values, strict=True))) for values in rest]

    def cases(self) -> list[Case]:
        return [case for batch in self.batches() for case in batch]

    def case_at(self, place: int) -> Case:
        """The case at this place in their order."""
        values = {}
        for name in reversed(tuple(self.axes)):
            place, row = divmod(place, len(self.axes[name]))
            values[name] = self.axes[name][row]
        return self.case(**{name: values[name] for name in self.axes})

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values there are along each axis."""
        return tuple(len(values) for values in self.axes.values())

    def ids(self) -> Iterator[str]:
        """The ids of the cases in their order, without the cases: what they share is put into words once."""
        begun = json.dumps([self.study.name, self.study.version, dict(self.parameters)], sort_keys=True)[:-1]
        digest_of_begun = sha256(f"{begun}, {{".encode())
        variables = [list(self.study.selected)] if self.study.selected else []
        end = "}" + "".join(f", {json.dumps(item)}" for item in variables) + "]"
        order = sorted(self.axes)
        place = [list(self.axes).index(name) for name in order]
        told = [
            [f'"{name}": {_json(value)}{end if name == order[-1] else ", "}'.encode() for value in values]
            for name, values in self.axes.items()
        ]
        readable = [[_readable({name: value}) for value in values] for name, values in self.axes.items()]
        for pieces, names in zip(itertools.product(*told), itertools.product(*readable), strict=True):
            digest = digest_of_begun.copy()
            digest.update(b"".join([pieces[i] for i in place]))
            yield f"{'-'.join(names)[:80]}-{digest.hexdigest()[:16]}"


@dataclass(frozen=True)
class Selection(Plan):
    """What one run covers: a plan, and the study with the variables asked for."""

    study: Study


@dataclass(frozen=True)
class Cases(Sequence[Case]):
    """Some cases of a plan, each made when it is looked at: there may be very many."""

    plan: Plan
    places: Sequence[int]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, which: Any) -> Any:
        chosen = self.places[which]
        return Cases(self.plan, chosen) if isinstance(which, slice) else self.plan.case_at(chosen)


def select(study: Study, words: Sequence[str] = ()) -> Selection:
    """The study's defaults with the `key=value` words in their place; every bad word is a `StudyError`."""
    given: dict[str, str] = {}
    axes = {axis.key: axis for axis in study.axes}
    keys = [*axes, *study.parameters, "variables"]
    for word in words:
        if not word.isprintable():
            raise StudyError(f"--set {word!a} is not text: leave out what cannot be printed")
        key, equals, text = word.partition("=")
        if not equals:
            raise StudyError(f"--set {word} has no value: write --set {word}=VALUE")
        if key not in keys:
            raise StudyError(f"study {study.name!r} has no setting {key!r}: {nearest(key, keys, 'settings')}")
        if key in given:
            raise StudyError(f"{key} is set twice: give it once, with all its values")
        given[key] = text.strip()
    values = {a.name: _axis_values(a, given[a.key]) if a.key in given else tuple(a.values) for a in study.axes}
    parameters = {k: _parameter(k, given[k], v) if k in given else v for k, v in study.parameters.items()}
    for coordinate in study.coordinates:
        labels = parameters[coordinate.parameter]
        if not isinstance(labels[0], str) and any(later <= earlier for earlier, later in itertools.pairwise(labels)):
            raise StudyError(f"{coordinate.parameter} must increase from each value to the next")
    count = 1
    for chosen in values.values():
        count *= len(chosen)
    if count > LONGEST:
        raise StudyError(f"that makes {count:,} cases: choose at most {LONGEST:,}")
    selection = Selection(study.storing(_variables(study, given.get("variables", "all"))), parameters, values)
    if study.check is not None:
        try:
            study.check(parameters, values)
        except CritflowError:
            raise
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise StudyError(f"the check of study {study.name!r} broke: {told}: mend it in its file") from error
    return selection


def _json(value: int | str) -> str:
    return str(value) if type(value) is int else json.dumps(value)  # ten times faster


def _readable(values: Mapping[str, int | str]) -> str:
    """Axis values in the letters that file names may have; names of axes have no others."""
    return "-".join([f"{k}{v}" if isinstance(v, int) else _UNREADABLE.sub("_", v) for k, v in values.items()])


def decimals(text: str, key: str = "decimals") -> tuple[float, ...]:
    """`start:stop:step` with the stop included, or a comma list, parsed in decimal so that 0.003 is 0.003."""
    if ":" not in text:
        return tuple(_float(_decimal(key, piece)) for piece in _pieces(key, text))
    parts = text.split(":")
    if len(parts) != 3:
        raise StudyError(f"{key}={text} must be start:stop:step, as in {key}=0.001:0.010:0.001")
    start, stop, step = (_decimal(key, part) for part in parts)
    if step <= 0:
        raise StudyError(f"{key}={text} has the step {step}: give a step above zero")
    if stop < start:
        raise StudyError(f"{key}={text} runs backwards: write the smaller end first")
    count = int((stop - start) / step) + 1 if (stop - start) / step < LONGEST else LONGEST + 1
    _check_length(key, text, count)
    return tuple(_float(start + i * step) for i in range(count))


def _axis_values(axis: Axis, text: str) -> tuple:
    if axis.is_words:
        values: tuple = _pieces(axis.key, text)
        for value in values:
            if value not in axis.choices:
                raise StudyError(f"{axis.key} has no {value!r}: {nearest(value, axis.choices, 'choices')}")
    else:
        values = _integers(axis.key, text)
        _refuse_negative(axis.key, values)
    _refuse_duplicates(axis.key, values)
    return values


def _variables(study: Study, text: str) -> tuple[str, ...]:
    """Names of the variables that the text asks for."""
    table = [variable.name for variable in study.variables]
    words = {"all": table, "scalars": [name for name in table if not study.inner_dims[name]]}
    words |= {name: [name] for name in table}
    pieces = _pieces("variables", text)
    for piece in pieces:
        if piece not in words:
            raise StudyError(
                f"study {study.name!r} has no variable {piece!r}: {nearest(piece, list(words), 'choices')}"
            )
    _refuse_duplicates("variables", pieces)
    return tuple(name for piece in pieces for name in words[piece])


def _parameter(key: str, text: str, default: Any) -> Any:
    """The text as a value of the default's type; negative numbers only where the default has some."""
    if isinstance(default, bool):
        if text not in ("true", "false"):
            raise StudyError(f"{key}={text} must be true or false")
        return text == "true"
    sample = default[0] if isinstance(default, tuple) else default
    read = {int: _integers, float: _float_list, str: _pieces}[type(sample)]
    values = read(key, text)
    if not isinstance(sample, str) and min(default if isinstance(default, tuple) else (default,)) >= 0:
        _refuse_negative(key, values)
    if isinstance(default, tuple):
        _refuse_duplicates(key, values)
        return values
    if len(values) != 1:
        raise StudyError(f"{key}={text} must be one value, as in {key}={default}")
    return values[0]


def _float_list(key: str, text: str) -> tuple[float, ...]:
    return decimals(text, key)


def _integers(key: str, text: str) -> tuple[int, ...]:
    values: list[int] = []
    for piece in _pieces(key, text):
        if ":" not in piece:
            values.append(_integer(key, piece))
            continue
        ends = piece.split(":")
        if len(ends) != 2:
            raise StudyError(f"{key}={text} must be start:stop, as in {key}=0:100")
        start, stop = (_integer(key, end) for end in ends)
        if stop <= start:
            raise StudyError(f"{key}={piece} is an empty range: the stop is left out, so give one above {start}")
        _check_length(key, text, stop - start + len(values))
        values.extend(range(start, stop))
    return tuple(values)


def _pieces(key: str, text: str) -> tuple[str, ...]:
    pieces = tuple(piece.strip() for piece in text.split(","))
    if "" in pieces:
        raise StudyError(f"{key}={text} has an empty value: write {key}=VALUE or {key}=VALUE,VALUE")
    _check_length(key, "...", len(pieces))
    return pieces


def _integer(key: str, text: str) -> int:
    if not re.fullmatch(r"\s*[+-]?[0-9]{1,18}\s*", text):
        raise StudyError(f"{key} needs whole numbers, not {text!r}")
    return int(text)


def _decimal(key: str, text: str) -> Decimal:
    try:
        value = Decimal(text.strip())
    except InvalidOperation:
        raise StudyError(f"{key} needs numbers, not {text!r}") from None
    if not value.is_finite() or abs(float(value)) == float("inf"):
        raise StudyError(f"{key} needs finite numbers, not {text!r}")
    return value


def _float(value: Decimal) -> float:
    return float(value) + 0.0  # no negative zero: it would be another identity for the same case


def _check_length(key: str, text: str, count: int) -> None:
    if count > LONGEST:
        raise StudyError(f"{key}={text} has {count:,} values or more: choose at most {LONGEST:,}")


def _refuse_negative(key: str, values: Sequence[Any]) -> None:
    if min(values) < 0:
        raise StudyError(f"{key} must not be negative, but {min(values)} is")


def _refuse_duplicates(key: str, values: Sequence[Any]) -> None:
    seen = set()
    for value in values:
        if value in seen:
            raise StudyError(f"{key} contains {value} twice: give every value once")
        seen.add(value)
