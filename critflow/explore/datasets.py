"""A dataset of `critflow run` on the page: its cases as points, their curves, statuses, claims and networks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.exchange.convert import network_from
from critflow.explore.model import POPULATIONS, Model, start_of
from critflow.explore.source import check_size
from critflow.networks.network import Array, IntArray
from critflow.result import InputError, Status
from critflow.workflow.dataset import opened_dataset

# Symbols of the claims, with the variables that datasets store them in, exact ones first.
SYMBOLS = {
    "C_B": ("C_B_exact", "C_B"),
    "C_G": ("C_G_exact", "C_G"),
    "G_0": ("shear_modulus_0",),
    "shear modulus": ("shear_modulus_0",),
    "V_L": ("length_variance",),
    "V_τ": ("tension_variance",),
    "κ_force": ("anisotropy_force",),
    "every edge stressed": ("stressed_fraction",),
    "bulk modul": ("bulk_modulus_0",),
}
# Words of the claims that name a population.
_NAMED = {
    "max B_0": "bulk_modulus",
    "max G_0": "shear_modulus",
    "min V_L": "length_variance",
    "min V_τ": "tension_variance",
    "s = 0.1": "random_lengths",
    "s = 0.3": "random_lengths_wide",
    "random stress": "random_stress",
}


@dataclass(frozen=True)
class Filter:
    """What of a dataset is shown: variables on both axes, a status and a claim by its key; empty for all."""

    x: str = ""
    y: str = ""
    status: str = ""
    claim: str = ""


class Dataset:
    """A dataset of the command, opened and verified; its numbers stay in memory, its arrays in the file."""

    def __init__(self, path: Path):
        self.path = path
        with opened_dataset(path) as opened:
            self.axes = tuple(opened.attrs["axes"].split())
            self.title = str(opened.attrs.get("title", path.name))
            self.labels = {axis: [str(label) for label in opened[axis].values] for axis in self.axes}
            self._values = {axis: opened[axis].values for axis in self.axes}
            self.shape = tuple(len(self.labels[axis]) for axis in self.axes)
            cases, inner = set(self.axes), {}
            self.scalars: dict[str, Array] = {}
            self.names: dict[str, str] = {}
            for name, variable in opened.data_vars.items():
                dims = set(variable.dims)
                self.names[str(name)] = str(variable.attrs.get("long_name", name))
                if dims == cases and variable.dtype.kind == "f":
                    self.scalars[str(name)] = np.asarray(variable.transpose(*self.axes).values, float).ravel()
                extra = [dim for dim in variable.dims if dim not in cases]
                if len(extra) == 1 and extra[0] in opened.coords and cases <= dims and variable.dtype.kind == "f":
                    inner[str(name)] = str(extra[0])
            status = opened["status"]
            where = {"status": status} if set(status.dims) == cases else {}
            self.status = (
                np.asarray(status.transpose(*self.axes).values, int).ravel()
                if where
                else np.zeros(int(np.prod(self.shape)), int)
            )
            self.curves = inner
            self._strains = {dim: np.asarray(opened[dim].values, float) for dim in set(inner.values())}
        self.claims = self._read_claims()

    def _read_claims(self) -> list[dict[str, str]]:
        try:
            found = json.loads((self.path.parent / "claims.json").read_text(encoding="utf-8"))
            return [{name: str(claim[name]) for name in ("key", "statement", "value", "verdict")} for claim in found]
        except (OSError, ValueError, KeyError, TypeError):
            return []

    @property
    def n_cases(self) -> int:
        return int(np.prod(self.shape))

    def position(self, case: int) -> dict[str, Any]:
        """Labels of a case by axis."""
        if not 0 <= case < self.n_cases:
            raise InputError(f"the dataset has no case {case}: it has {self.n_cases}")
        index = np.unravel_index(case, self.shape)
        return {axis: self._values[axis][i].item() if hasattr(self._values[axis][i], "item") else self._values[axis][i]
                for axis, i in zip(self.axes, index, strict=True)}  # fmt: skip

    def description(self) -> dict[str, Any]:
        """The choices of cases, variables, statuses and claims."""
        statuses = {Status(code).name: int(np.sum(self.status == code)) for code in np.unique(self.status).tolist()}
        return {
            "title": self.title,
            "axes": [{"name": axis, "labels": self.labels[axis]} for axis in self.axes],
            "variables": {name: self.names[name] for name in self.scalars},
            "statuses": statuses,
            "claims": self.claims,
        }

    def variables(self, chosen: Filter) -> tuple[str, str]:
        """The variables on both axes: as chosen, else those of the claim, else B_0 and C_B, else the first two."""
        names = list(self.scalars)
        if not names:
            return "", ""
        claim = next((claim for claim in self.claims if claim["key"] == chosen.claim), None)
        text = "" if claim is None else f"{claim['key']} {claim['statement']}"
        about = [name for symbol, of in SYMBOLS.items() if symbol in text for name in of if name in names]
        usual = [name for name in ("bulk_modulus_0", "C_B_exact", "C_B") if name in names] or names
        x = chosen.x if chosen.x in names else usual[0]
        y = chosen.y if chosen.y in names else next((name for name in [*about, *usual[1:], *names] if name != x), x)
        return x, y

    def mask(self, chosen: Filter) -> Any:
        """The cases (n_cases,) of a filter."""
        shown = np.ones(self.n_cases, bool)
        if chosen.status:
            shown &= self.status == Status[chosen.status]
        claim = next((claim for claim in self.claims if claim["key"] == chosen.claim), None)
        if claim is not None and "population" in self.labels:
            text = f"{claim['key']} {claim['statement']}"
            named = {name for word, name in _NAMED.items() if word in text}
            # The longer of two names that begin alike is the one of a key.
            named |= {
                name
                for name in self.labels["population"]
                if f"-{name}" in claim["key"] and f"-{name}_" not in claim["key"]
            }
            if named and "all" not in text.split() and "others" not in text:
                index: IntArray = np.unravel_index(np.arange(self.n_cases), self.shape)[self.axes.index("population")]
                shown &= np.array([name in named for name in self.labels["population"]])[index]
        return shown

    def points(self, chosen: Filter) -> list[dict[str, Any]]:
        """One series a population, or one for all: coordinates and the number of the case of each point."""
        x, y = self.variables(chosen)
        if not x:
            return []
        group = "population" if "population" in self.axes else self.axes[-1]
        index = np.unravel_index(np.arange(self.n_cases), self.shape)[self.axes.index(group)]
        shown = self.mask(chosen) & np.isfinite(self.scalars[x]) & np.isfinite(self.scalars[y])
        series = []
        for number, label in enumerate(self.labels[group][:12]):
            cases = np.flatnonzero(shown & (index == number))
            if len(cases):
                series.append(
                    {
                        "label": POPULATIONS.get(label, label),
                        "kind": number,
                        "x": self.scalars[x][cases].tolist(),
                        "y": self.scalars[y][cases].tolist(),
                        "cases": cases.tolist(),
                    }
                )
        return series

    def case_curves(self, case: int, name: str = "") -> dict[str, Any] | None:
        """A curve of a case: the named variable, or the first, against its coordinate."""
        if not self.curves:
            return None
        name = (
            name
            if name in self.curves
            else "bulk_modulus"
            if "bulk_modulus" in self.curves
            else next(iter(self.curves))
        )
        with opened_dataset(self.path) as opened:
            values = np.asarray(opened[name].sel(self.position(case)).values, float)
        dim = self.curves[name]
        known = np.isfinite(values)
        return {"name": name, "along": dim, "x": self._strains[dim][known].tolist(), "y": values[known].tolist()}


@dataclass(frozen=True, eq=False)
class Case:
    """One case of a dataset as a source of a network."""

    dataset: Dataset
    number: int

    @property
    def recipe(self) -> dict[str, Any]:
        return {"file": self.dataset.path.name, "case": self.number}

    @property
    def title(self) -> str:
        return ", ".join(f"{axis} {label}" for axis, label in self.dataset.position(self.number).items())

    def open(self) -> tuple[Model, CriticalConfiguration]:
        position = self.dataset.position(self.number)
        status = Status(int(self.dataset.status[self.number]))
        if status in (Status.failed, Status.missing):
            raise InputError(f"{self.title} has no configuration: {status.message}")
        with opened_dataset(self.dataset.path) as opened:
            imported = network_from(opened.sel(position).load())
        check_size(imported.network.n_vertices)
        seed = position.get("seed", 0)
        model = Model(imported.network, seed if isinstance(seed, int) else 0)
        return model, start_of(model, imported.force_densities)

    def lines(self) -> list[str]:
        return [
            f"dataset = xr.open_dataset({self.dataset.path.name!r})",
            f"imported = network_from(dataset.sel({self.dataset.position(self.number)!r}))",
            "network = imported.network",
            "manifold = CriticalManifold(network)",
            "critical = manifold.configuration(imported.force_densities)",
        ]
