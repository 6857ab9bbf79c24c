"""A dataset of `critflow run` on the page: its cases as points of two variables, their statuses and networks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from critflow.command.cases import choose_case
from critflow.engine.dataset import opened_dataset
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.result import InputError, Status
from critflow_extras.explore.model import Model
from critflow_extras.explore.source import Opening, check_size, imported_lines, opened
from critflow_extras.files.convert import network_from

# Variables on the axes of the plane until others are chosen.
_FIRST = ("B_0", "C_B")
# Series of the plane, each with its own colour and shape.
_MOST_SERIES = 12


@dataclass(frozen=True)
class Filter:
    """What of a dataset is shown: the variables on both axes, and cases of one status; empty for a default and all."""

    x: str = ""
    y: str = ""
    status: str = ""


class Dataset:
    """A dataset of the command, opened and verified; its numbers stay in memory, its arrays in the file.

    words    `axis=value`, which choose the case that is shown first
    axes     values of each axis
    scalars  (n_cases,) values of each variable that is a number of a case
    status   (n_cases,)
    """

    def __init__(self, path: Path, words: Sequence[str] = ()):
        self.path = path
        with opened_dataset(path) as dataset:
            chosen = choose_case(dataset, words) if words else None
            self.title = str(dataset.attrs.get("title", path.name))
            self.axes: dict[str, list[Any]] = {
                axis: dataset[axis].values.tolist() for axis in dataset.attrs["axes"].split()
            }
            self.shape = tuple(len(values) for values in self.axes.values())
            of_cases = [variable for variable in dataset.data_vars.values() if set(variable.dims) == set(self.axes)]
            # Names for people, where the dataset has them along an axis.
            self.labels: dict[str, list[str]] = {
                axis: list(map(str, dataset[f"{axis}_label"].values if f"{axis}_label" in dataset.coords else values))
                for axis, values in self.axes.items()
            }
            flat = {str(v.name): np.asarray(v.transpose(*self.axes).values).ravel() for v in of_cases}
            self.names = {str(v.name): str(v.attrs.get("long_name", v.name)) for v in of_cases}
        self.scalars: dict[str, Array] = {name: values for name, values in flat.items() if values.dtype.kind == "f"}
        self.status = flat.get("status", np.zeros(self.n_cases, int))
        self._chosen: int | None = None
        if chosen is not None:
            index = [values.index(chosen[axis].values.tolist()) for axis, values in self.axes.items()]
            self._chosen = int(np.ravel_multi_index(index, self.shape))

    @property
    def n_cases(self) -> int:
        return int(np.prod(self.shape))

    def first_case(self) -> Case:
        """The case that the words choose, or the first whose status is ok."""
        if self._chosen is not None:
            return Case(self, self._chosen)
        ok = np.flatnonzero(self.status == Status.ok)
        if not len(ok):
            raise InputError("no case of this dataset has a configuration: see its statuses")
        return Case(self, int(ok[0]))

    def position(self, case: int) -> dict[str, Any]:
        """Labels of a case by axis."""
        if not 0 <= case < self.n_cases:
            raise InputError(f"the dataset has no case {case}: it has {self.n_cases}")
        index = np.unravel_index(case, self.shape)
        return {axis: values[i] for (axis, values), i in zip(self.axes.items(), index, strict=True)}

    def description(self) -> dict[str, Any]:
        """The choices of cases, variables and statuses."""
        codes, counts = np.unique(self.status, return_counts=True)
        return {
            "title": self.title,
            "axes": [{"name": axis, "labels": labels} for axis, labels in self.labels.items()],
            "variables": {name: self.names[name] for name in self.scalars},
            "statuses": {Status(int(code)).name: int(count) for code, count in zip(codes, counts, strict=True)},
        }

    def variables(self, chosen: Filter) -> tuple[str, str]:
        """The variables on both axes: as chosen, else B_0 and C_B, else the first two."""
        names = list(dict.fromkeys([name for name in _FIRST if name in self.scalars] + list(self.scalars)))
        if not names:
            return "", ""
        x = chosen.x if chosen.x in names else names[0]
        return x, chosen.y if chosen.y in names else next((name for name in names if name != x), x)

    def mask(self, chosen: Filter) -> Any:
        """The cases (n_cases,) of a filter."""
        return self.status == Status[chosen.status] if chosen.status else np.ones(self.n_cases, bool)

    def points(self, chosen: Filter) -> list[dict[str, Any]]:
        """One series a population, or a value of the last axis: coordinates and the case of each point."""
        x, y = self.variables(chosen)
        if not x:
            return []
        names = list(self.axes)
        group = names.index("population") if "population" in names else len(names) - 1
        index = np.unravel_index(np.arange(self.n_cases), self.shape)[group]
        shown = self.mask(chosen) & np.isfinite(self.scalars[x]) & np.isfinite(self.scalars[y])
        series = []
        for number, label in enumerate(self.labels[names[group]][:_MOST_SERIES]):
            cases = np.flatnonzero(shown & (index == number))
            points = {"x": self.scalars[x][cases].tolist(), "y": self.scalars[y][cases].tolist()}
            series.append({"label": label, "kind": number, **points, "cases": cases.tolist()})
        return [one for one in series if one["cases"]]


@dataclass(frozen=True, eq=False)
class Case:
    """One case of a dataset as a source of a network."""

    dataset: Dataset
    number: int

    @property
    def title(self) -> str:
        return ", ".join(f"{axis} {label}" for axis, label in self.dataset.position(self.number).items())

    def open(self) -> Opening:
        position = self.dataset.position(self.number)
        status = Status(int(self.dataset.status[self.number]))
        if status in (Status.failed, Status.missing):
            raise InputError(f"{self.title} has no configuration: {status.message}")
        with opened_dataset(self.dataset.path) as dataset:
            imported = network_from(dataset.sel(position).load())
        check_size(imported.network.n_vertices)
        seed = position.get("seed", 0)
        return opened(Model(imported.network, seed if isinstance(seed, int) else 0), imported.force_densities)

    def lines(self, start: CriticalConfiguration) -> list[str]:
        opening = f"dataset = xr.open_dataset({self.dataset.path.name!r})"
        case = f"dataset.sel({self.dataset.position(self.number)!r})"
        return [opening, *imported_lines(f"network_from({case})", start)]
