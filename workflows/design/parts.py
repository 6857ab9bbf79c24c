"""Joins modules that answer one question each: their settings, variables, cases and reports carry the module's name."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow import Status
from critflow.workflow import Variable

from ..shared.reports import parameters as parameters_of


def name_of(module):
    """Name of the part: that of its file."""
    return module.__name__.rsplit(".", 1)[-1]


def all_parameters(modules):
    """Settings of the study: those of each module with its name in front."""
    return {f"{name_of(m)}_{key}": value for m in modules for key, value in m.PARAMETERS.items()}


def own_parameters(module, parameters):
    """The settings of one module under the names that it uses."""
    return {key: parameters[f"{name_of(module)}_{key}"] for key in module.PARAMETERS}


def table(modules):
    """The variables of all modules, with the name of the module in front of variables and inner dimensions."""
    for module in modules:
        part = name_of(module)
        for name, (dims, long_name) in module.VARIABLES.items():
            outcome = name.endswith("status")
            yield Variable(
                f"{part}_{name}",
                ("part", "seed", *(f"{part}_{dim}" for dim in dims)),
                "i1" if outcome else "f8",
                long_name=long_name,
                flags=Status if outcome else None,
                volatile=name.endswith("seconds"),
            )


def undefined(variables, sizes):
    """Arrays of all variables of a module before anything is computed: NaN, and `Status.missing` for outcomes."""
    return {
        key: np.full([sizes[dim] for dim in dims], int(Status.missing) if key.endswith("status") else np.nan)
        for key, (dims, _) in variables.items()
    }


def complete(modules, part, parameters, found):
    """The variables of one case; those of other modules, and those that were not computed, are undefined."""
    values = {"status": found.get("status", Status.ok)}
    for module in modules:
        name = name_of(module)
        sizes = module.sizes(own_parameters(module, parameters))
        for key, value in undefined(module.VARIABLES, sizes).items():
            if name == part and key in found:
                shape, value = value.shape, np.asarray(found[key])
                if value.shape != shape:
                    raise ValueError(f"{key} of {part} has shape {value.shape}, and sizes() makes it {shape}")
            values[f"{name}_{key}"] = value
    return values


def of_part(ds, module):
    """The dataset of one module under the names that it uses, dimensions (seed, ...); None where it was not run."""
    part = name_of(module)
    if part not in ds.part.values:
        return None
    names = {f"{part}_{name}": name for name in module.VARIABLES}
    one = ds[["status", *names]].sel(part=part).transpose("seed", ...)
    dims = {dim: str(dim).removeprefix(f"{part}_") for dim in one.dims}
    return one.rename({**names, **dims})


def figure_of(module):
    """The function that draws the figure of a module, a line of text where it was not run."""

    def draw(ds):
        one = of_part(ds, module)
        if one is not None and (one.status == Status.ok).any():
            return module.figure(one, own_parameters(module, parameters_of(ds)))
        figure = Figure(figsize=(6, 1))
        figure.text(0.5, 0.5, f"the part {name_of(module)} was not run", ha="center", va="center")
        return figure

    return draw


def reported(ds, modules, name):
    """(module, result) of the function `name` of each module that was run and has it."""
    for module in modules:
        one = of_part(ds, module)
        if hasattr(module, name) and one is not None and (one.status == Status.ok).any():
            yield module, getattr(module, name)(one, own_parameters(module, parameters_of(ds)))
