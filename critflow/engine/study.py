"""A study: its axes, its case function, the table of the variables that a case returns, and its claims.

The case function receives the parameters and one value of every axis and returns plain arrays; it uses no files:

    case(parameters, *, seed, population) -> {"status": Status.ok, "sigma": array, ...}

A case function with the keyword `wanted` receives the names of the variables that the run stores and may skip the
computation of all others; other variables that it returns are dropped.

Dimensions, type, units and meaning of the arrays are declared once, in `Study.variables`.
"""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from enum import IntEnum
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np

from critflow.extensions import quantity_entry
from critflow.result import Status, StudyError

if TYPE_CHECKING:  # a case function needs neither library
    import xarray as xr
    from matplotlib.figure import Figure

LONGEST = 1_000_000  # values of one setting, and cases of one run: a larger number is a typing error

THREADS = 1  # of BLAS in a case: their number changes digits

_NAME, _STUDY_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*"), re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
VALID = "valid"  # the variable by which a dataset is masked, which this engine adds to every study
_ALWAYS = ("status", VALID)  # variables that every selection of members needs
# Outcomes with sound numbers: edges may be slack or compressed, and where one shrinks to zero length the limit is near.
SOUND = (Status.ok, Status.slack_edges, Status.compressed_edges, Status.edge_collapse)
_DTYPES = ("f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4")


def nearest(word: str, known: Sequence[str], noun: str) -> str:
    """End of a message about an unknown word: the closest known word, otherwise all of them."""
    close = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"the {noun} are {', '.join(known)}"


def plural(number: int, noun: str) -> str:
    """A number with its noun, which is given for one: "1 network", "3 networks", "2 stresses"."""
    return f"{number} {noun}" + ("" if number == 1 else "es" if noun.endswith("s") else "s")


def require(condition: object, message: str) -> None:
    if not condition:
        raise StudyError(message)


def _set(record: object, **values: Any) -> None:
    """Set fields of a frozen record while it is made."""
    for name, value in values.items():
        object.__setattr__(record, name, value)


@dataclass(frozen=True)
class AxisLabel:
    """A coordinate of the dataset along an axis of words: one text for each word, such as its name in print."""

    name: str
    long_name: str
    texts: Mapping[str, str]


@dataclass(frozen=True)
class Axis:
    """An axis of the study: one case is computed for every combination of axis values.

    The values are whole numbers (from zero), of which a run may have others, or all words that there are.
    """

    name: str  # dimension of the dataset and keyword of the case function, as in "seed"
    values: Sequence[int] | Sequence[str]  # default values
    long_name: str
    key: str = ""  # word of `--set`; the name with an s by default
    noun: str = ""  # for one value, where they are counted; the name and the key by default
    labels: Sequence[AxisLabel] = ()  # texts of every word

    def __post_init__(self) -> None:
        _identifier(self.name, "axis")
        count, name = len(self.values), f"axis {self.name!r}"
        require(count <= LONGEST, f"{name} has {count:,} values: give at most {LONGEST:,}")
        values = tuple(self.values)
        require(values and len(set(values)) == count, f"{name} needs different values")
        kinds = {type(value) for value in values}
        require(kinds in ({int}, {str}), f"{name} needs whole numbers or words, all of one kind")
        negative = any(isinstance(value, int) and value < 0 for value in values)
        require(not negative, f"{name} needs whole numbers from zero")
        for label in self.labels:
            _identifier(label.name, "label")
            bare = [value for value in values if value not in label.texts]
            require(not bare, f"label {label.name!r} of {name} has no text for {''.join(map(str, bare[:1]))!r}: add it")
        _set(self, values=values, labels=tuple(self.labels), key=self.key or f"{self.name}s")

    @property
    def is_words(self) -> bool:
        return isinstance(self.values[0], str)

    def counted(self, number: int) -> str:
        """A number of values with their noun, as in "3 networks"."""
        return plural(number, self.noun) if self.noun else f"{number} {self.name if number == 1 else self.key}"

    def place(self, value: Any) -> tuple[int, str]:
        """Sort key of a value in every dataset: numbers increase, words are as declared, former words come last."""
        if not self.is_words:
            return (value, "")
        return (list(self.values).index(value) if value in self.values else len(self.values), value)


@dataclass(frozen=True)
class Coordinate:
    """An inner dimension labelled by the values of a parameter, for example strains, or by fixed words."""

    name: str
    parameter: str
    long_name: str
    units: str = "1"
    words: Sequence[str] = ()  # labels in place of those of a parameter, such as x and y

    def labels(self, parameters: Mapping[str, Any]) -> Sequence[Any]:
        """One label for each place of the dimension."""
        return self.words or parameters[self.parameter]


@dataclass(frozen=True)
class Variable:
    """One row of the table of variables.

    Dimensions that are axes of the study count the cases; the others are dimensions of the array of one case, in this
    order.  All cases that differ only in an axis missing from `dims` must return the same bits.
    """

    name: str
    dims: tuple[str, ...]
    dtype: str  # one of f4 f8 i1 i2 i4 i8 u1 u2 u4
    long_name: str = field(kw_only=True)
    units: str = field(default="1", kw_only=True)
    symbol: str = field(default="", kw_only=True)  # in TeX, for the axes of figures
    flags: type[IntEnum] | None = field(default=None, kw_only=True)  # the meaning of integer codes
    fill: int | None = field(default=None, kw_only=True)  # stands for a missing integer; an end of the dtype by default
    volatile: bool = field(default=False, kw_only=True)  # differs between runs, for example a time
    comment: str = field(default="", kw_only=True)  # what a reader must know beyond the long name
    # Statuses of cases where it is not defined, such as a derivative at a limit: the dataset has a missing value there.
    undefined_at: Sequence[Status] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        _identifier(self.name, "variable")
        name = f"variable {self.name!r}"
        require(not isinstance(self.dims, str), f"dims of {name} must be a tuple: write ({self.dims!r},)")
        _set(self, dims=tuple(self.dims), undefined_at=tuple(self.undefined_at))
        twice = len(set(self.dims)) < len(self.dims)
        require(not twice, f"{name} names a dimension twice: call the second one {self.dims[-1:]}_")
        require(self.dtype in _DTYPES, f"dtype {self.dtype!r} of {name} must be one of {', '.join(_DTYPES)}")
        if self.dtype[0] == "f":
            require(not self.flags and self.fill is None, f"{name} has flags or a fill: give it an integer dtype")
        else:
            limits = np.iinfo(self.dtype)
            fill = self.fill if self.fill is not None else limits.min if self.dtype[0] == "i" else limits.max
            require(limits.min <= fill <= limits.max, f"fill {fill} of {name} does not fit its dtype {self.dtype}")
            _set(self, fill=int(fill))

    @property
    def filler(self) -> float | int:
        """Value of cases without a result: NaN, the code for missing, or the integer fill."""
        if self.flags is Status:
            return int(Status.missing)
        return float("nan") if self.fill is None else self.fill

    def cast(self, value: Any) -> np.ndarray:
        """The value in the declared dtype; `StudyError` if the conversion loses more than digits of a float."""
        given, target = np.asarray(value), np.dtype(self.dtype)
        fits = np.can_cast(given.dtype, target, "same_kind") or {given.dtype.kind, target.kind} <= {"i", "u"}
        require(fits, f"{self.name!r} has dtype {given.dtype}, which cannot be cast to {self.dtype}")
        array = given.astype(target)
        if self.fill is not None:
            require(np.array_equal(array, given), f"{self.name!r} has numbers too large for {self.dtype}")
            require(
                self.flags or self.fill not in array,
                f"{self.name!r} contains {self.fill}, its value for a missing one: declare another",
            )
        return array


class Validity(IntEnum):
    """Whether the numbers of a case are sound; a case without a result has none."""

    invalid = 0
    valid = 1


def _validity(dims: tuple[str, ...], sound: Sequence[Status]) -> Variable:
    """The variable `valid`, over the axes of a study."""
    text = "1 where the numbers of the case are sound; edges may be slack, compressed, or in the limit of zero length"
    if sound != SOUND:
        text = f"1 where the numbers of the case are sound: the status is {', '.join(one.name for one in sound)}"
    return Variable(VALID, dims, "i1", long_name=text, flags=Validity, fill=Validity.invalid)


def valid_members(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset with NaN in place of the numbers of members that are not sound."""
    sound = dataset[VALID] == Validity.valid
    if sound.all():
        return dataset
    of_members = {
        name: values.where(sound)
        for name, values in dataset.data_vars.items()
        if values.dtype.kind == "f" and set(sound.dims) <= set(values.dims)
    }
    return dataset.assign(of_members)


# Kinds of claims, verdicts, and why a statement of the paper and the measurement disagree.
KINDS = {"paper": "statements of the paper", "ours": "what we found", "check": "checks of the library"}
VERDICTS = ("holds", "differs", "undecided", "measured")
DIFFERENCES = {
    "proof": "the paper is wrong, with a proof",
    "text": "the text contradicts itself",
    "number": "the number is another",
}


@dataclass(frozen=True)
class Claim:
    """A statement, the criterion of its verdict, and the value measured in the dataset.

    The criterion follows from the statement and is chosen before the value is known.
    """

    key: str
    statement: str
    paper: str  # value printed there
    value: str  # measured, with its spread
    verdict: str  # "holds", "differs", or "undecided" between them; "measured" without a criterion
    because: str = ""  # required when it differs or is undecided
    criterion: str = ""  # tolerance of the verdict, required with one
    sample: str = ""  # what was measured, for example "84 networks"; values of the first axis by default
    kind: str = "ours"
    place: str = ""  # where the paper makes the statement: section, equation, figure
    difference: str = ""  # one of `DIFFERENCES`, where a statement of the paper differs
    rows: Sequence[Mapping[str, str]] = ()  # measurements under the statement: variant, value, n, verdict

    def __post_init__(self) -> None:
        claim = f"claim {self.key!r}"
        require(self.verdict in VERDICTS, f"verdict {self.verdict!r} of {claim} must be one of {', '.join(VERDICTS)}")
        require(self.kind in KINDS, f"kind {self.kind!r} of {claim} must be one of {', '.join(KINDS)}")
        require(
            self.difference in ("", *DIFFERENCES),
            f"difference {self.difference!r} of {claim} must be one of {', '.join(DIFFERENCES)}",
        )
        explained = self.verdict in ("holds", "measured") or self.because.strip()
        require(explained, f"{claim} {self.verdict}: give the reason in `because`")
        require(self.verdict == "measured" or self.criterion, f"{claim} {self.verdict}: state its `criterion`")

    @classmethod
    def tested(
        cls, key: str, statement: str, paper: str, value: str, holds: object, because: str = "", note: str = "",
        **more: Any,
    ) -> Claim:  # fmt: skip
        """The claim with the verdict of one condition, "undecided" if it is None.

        because  reason if it does not hold, dropped otherwise; `note` is stored in both cases
        more     criterion, sample and kind
        """
        reasons = "; ".join(filter(None, (note,) if holds else (because, note)))
        verdict = "undecided" if holds is None else "holds" if holds else "differs"
        return cls(key, statement, paper, value, verdict, reasons, **more)


@dataclass(frozen=True, kw_only=True)
class Study:
    """Axes, case function and table of variables, with the figures, claims and checks made from the dataset.

    Raise `version` when the same parameters must give other numbers: all cases are then computed again.
    """

    name: str
    title: str
    axes: Sequence[Axis]  # the cases of one value of the first axis form one task
    parameters: Mapping[str, Any]  # defaults; numbers, words, truth values, or lists of one of them
    case: Callable[..., Mapping[str, Any]]
    variables: Sequence[Variable]
    coordinates: Sequence[Coordinate] = ()
    version: int = 1
    check: Callable[[Mapping[str, Any], Mapping[str, tuple]], None] | None = None  # raises StudyError for bad settings
    # Adds to the settings before cases have identities, for example the digest of a file.
    complete: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    figures: Mapping[str, Callable[[xr.Dataset], Figure]] = field(default_factory=dict)
    animations: Mapping[str, Callable[[xr.Dataset], Iterable[Figure]]] = field(default_factory=dict)  # frames in turn
    claims: Callable[[xr.Dataset], Sequence[Claim]] | None = None
    summary: Callable[[xr.Dataset], Mapping[str, Any]] | None = None
    verify: Callable[[xr.Dataset], Sequence[str]] | None = None  # recomputes results; a line per contradiction
    references: str = ""  # dataset attribute of the same name
    committed: str = ""  # results of the authors' own run in a few words, printed after the verdicts of a run
    # Variables that a figure, an animation, "claims", "summary" or "verify" reads; all variables without an entry.
    needs: Mapping[str, Sequence[str]] = field(default_factory=dict)
    workers: int | None = None  # largest number of simultaneous cases: 1 if cases measure time
    extras: Sequence[str] = ()  # names of critflow-extras that cases use without an import or a setting
    sound: Sequence[Status] = SOUND  # statuses of cases with sound numbers, where `valid` is 1
    left_out: Sequence[Variable] = ()  # rows of the table that are not stored; set by `storing`

    def __post_init__(self) -> None:
        name = f"study {self.name!r}"
        require(_STUDY_NAME.fullmatch(self.name), f"study name {self.name!r} must be letters, digits, - and _")
        listed = ("axes", "variables", "coordinates", "extras", "sound", "left_out")
        parameters = {key: _plain_parameter(key, value) for key, value in self.parameters.items()}
        _set(self, parameters=parameters, **{key: tuple(getattr(self, key)) for key in listed})
        require(self.axes, f"{name} needs at least one axis")
        # After the status, which it follows from.
        place, dims = next(((n, v.dims) for n, v in enumerate(self.variables, 1) if v.name == "status"), (0, ()))
        valid, declared = _validity(dims, self.sound), [v for v in self.variables if v.name == VALID]
        require(declared in ([], [valid]), f"{name} declares {VALID!r}, which the engine adds: leave it out")
        if place and not declared:
            _set(self, variables=(*self.variables[:place], valid, *self.variables[place:]))
        require(
            type(self.version) is int and self.version > 0,
            f"version {self.version!r} of {name} must be a whole number above zero",
        )
        for part in (*self.figures, *self.animations):
            _identifier(part, "figure")
        require(self.workers is None or self.workers > 0, f"{name} must allow one worker, or omit `workers`")
        # The case function takes the axes.
        require(callable(self.case), f"case of {name} must be a function, not {self.case!r}")
        signature = inspect.signature(self.case)
        wanted = {"wanted"} & signature.parameters.keys()
        try:
            signature.bind({}, **dict.fromkeys((*self.axis_names, *wanted)))
        except TypeError as error:
            expected = f"case(parameters, *, {', '.join(self.axis_names)})"
            raise StudyError(f"the case function of {name} must be {expected}: {error}") from error
        # Parts of the report need variables that are declared.
        parts = [*self.figures, *self.animations, "claims", "summary", "verify"]
        variables = [variable.name for variable in (*self.variables, *self.left_out)]
        for part, names in self.needs.items():
            require(part in parts, f"needs of {name} names {part!r}: {nearest(part, parts, 'parts')}")
            require(not isinstance(names, str), f"needs of {part!r} must be a tuple of names: write ({names!r},)")
            for word in set(names).difference(variables):
                raise StudyError(f"{part!r} needs {word!r}, not declared: {nearest(word, variables, 'variables')}")
        self._check_table()

    def _check_table(self) -> None:
        """Raise unless names are unique and axes, parameters, coordinates and variables agree."""
        name, parameters = f"study {self.name!r}", self.parameters
        labels = [*self.axis_names, *(c.name for c in self.coordinates), *(v.name for v in self.variables)]
        labels += [label.name for axis in self.axes for label in axis.labels]
        for names in (labels, ["variables", *(axis.key for axis in self.axes), *parameters]):
            twice = sorted({word for word in names if names.count(word) > 1})
            require(not twice, f"{name} uses the name {''.join(twice[:1])!r} twice")
        for reserved in {"code", "environment", "stored_case"} & {
            *labels,
            *(dim for v in self.variables for dim in v.dims),
        }:
            raise StudyError(f"{name} uses the name {reserved!r}, which the engine writes: choose another")
        for c in self.coordinates:
            listed = c.words or isinstance(parameters.get(c.parameter), tuple)
            require(listed, f"coordinate {c.name!r} needs a parameter {c.parameter!r} with a list")
        axes = set(self.axis_names)
        for v in self.variables:
            own = "volatile" if v.volatile else "undefined at a status" if v.undefined_at else ""
            require(
                not own or axes <= set(v.dims),
                f"variable {v.name!r} is {own}, so cases cannot share it: add every axis",
            )
        status = [set(v.dims) for v in self.variables if v.name == "status" and v.flags is Status]
        require(status == [axes], f"{name} needs a variable 'status' over exactly its axes with flags=Status")

    def worker_count(self, requested: int | None, available: int) -> int:
        """Number of worker processes: the requested number, otherwise one per CPU within the limit of the study."""
        limit = self.workers or max(available, requested or 0)
        require(
            requested is None or requested <= limit,
            f"--workers {requested} disturbs the times that {self.name!r} measures: give at most {limit}",
        )
        return min(available, limit) if requested is None else requested

    def can_report(self, part: str) -> bool:
        """Whether all variables that a part of the report needs are stored."""
        stored = {variable.name for variable in self.variables}
        return set(self.needs[part]) <= stored if part in self.needs else not self.left_out

    @cached_property
    def axis_names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @cached_property
    def returned(self) -> tuple[Variable, ...]:
        """The stored variables that the case function returns."""
        return tuple(variable for variable in self.variables if variable.name != VALID)

    @cached_property
    def inner_dims(self) -> Mapping[str, tuple[str, ...]]:
        """Dimensions of the array of one case, for every variable."""
        return {v.name: tuple(dim for dim in v.dims if dim not in self.axis_names) for v in self.variables}

    @cached_property
    def table_digest(self) -> str:
        """Digest of names, inner dimensions and dtypes: a shard with another one is computed again."""
        table = [[v.name, self.inner_dims[v.name], v.dtype] for v in self.returned]
        return sha256(json.dumps(table).encode()).hexdigest()[:16]

    @cached_property
    def selected(self) -> tuple[str, ...]:
        """Names of the stored variables if they are a part of the table; empty if all are stored."""
        return tuple(variable.name for variable in self.variables) if self.left_out else ()

    def storing(self, names: Sequence[str]) -> Study:
        """The study with these variables and `_ALWAYS` only, in the order of the table; no name selects all."""
        kept = [variable for variable in self.variables if variable.name in (*names, *_ALWAYS)]
        if not names or len(kept) == len(self.variables):
            return self
        left_out = [variable for variable in self.variables if variable not in kept]
        dims = {dim for variable in kept for dim in variable.dims}
        labels = [coordinate for coordinate in self.coordinates if coordinate.name in dims]
        return replace(self, variables=kept, coordinates=labels, left_out=left_out)

    def counting(self, parameters: Mapping[str, Any]) -> Study:
        """The study whose code counts the quantities, of packages that joined, which the settings name."""
        settings = [*parameters.values(), *(axis.values for axis in self.axes if axis.is_words)]
        values = (one for value in settings for one in (value if isinstance(value, tuple) else (value,)))
        named = {one for one in values if isinstance(one, str) and quantity_entry(one)}.difference(self.extras)
        return replace(self, extras=(*self.extras, *sorted(named))) if named else self

    def computed(self, parameters: Mapping[str, Any], values: Mapping[str, int | str]) -> dict[str, np.ndarray]:
        """Arrays of one case, computed and checked."""
        stored = {"wanted": frozenset(variable.name for variable in self.variables)}
        selective = "wanted" in inspect.signature(self.case).parameters
        return self.arrays(self.case(parameters, **values, **(stored if selective else {})), parameters)

    def arrays(self, returned: Any, parameters: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The returned arrays, checked against the table and cast; variables may be missing unless the status is ok."""
        given = isinstance(returned, Mapping) and "status" in returned
        require(given, "the case function must return a dict with at least 'status'")
        status = Status(int(returned["status"]))
        names = [variable.name for variable in self.returned]
        declared = [*names, *(variable.name for variable in self.left_out)]
        for name in set(returned).difference(declared):
            hint = "the engine adds it: leave it out" if name == VALID else nearest(name, declared, "variables")
            raise StudyError(f"the case function returned {name!r}, which no variable declares: {hint}")
        if status is Status.ok and (missing := [name for name in names if name not in returned]):
            raise StudyError(f"the case function returned status ok without {', '.join(missing)}")
        sizes = {coordinate.name: len(coordinate.labels(parameters)) for coordinate in self.coordinates}
        arrays = {}
        for variable in (one for one in self.variables if one.name in returned):
            array, dims = variable.cast(returned[variable.name]), self.inner_dims[variable.name]
            name, fits = repr(variable.name), array.ndim == len(dims) and 0 not in array.shape
            require(fits, f"{name} has shape {array.shape} in a case, its inner dimensions are {dims}")
            for dim, size in zip(dims, array.shape, strict=True):
                sizes.setdefault(dim, size)
                require(size == sizes[dim], f"{name} has length {size} in {dim!r}, not {sizes[dim]}")
            arrays[variable.name] = array
        return arrays


def _identifier(name: str, kind: str) -> None:
    require(_NAME.fullmatch(name), f"{kind} name {name!r} must be a word of letters, digits and _")


def _plain_parameter(key: str, value: Any) -> Any:
    """The default as a plain Python number, word, truth value or tuple: equal values have one identity."""
    _identifier(key, "parameter")
    listed = isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, str)
    items = tuple(item.item() if isinstance(item, np.generic) else item for item in (value if listed else (value,)))
    if {type(item) for item in items} == {int, float}:
        items = tuple(float(item) for item in items)
    finite = all(math.isfinite(item) for item in items if isinstance(item, float))
    require(finite, f"parameter {key!r} must default to finite numbers, not {value}")
    kinds, known = {type(item) for item in items}, {int, float, str} if listed else {bool, int, float, str}
    require(
        len(kinds) == 1 and kinds <= known,
        f"parameter {key!r} must default to a number, word or truth value, or a list of numbers or words",
    )
    return items if listed else items[0]
