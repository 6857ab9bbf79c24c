"""The dataset of a run, written slab by slab: however many cases there are, memory holds some megabytes of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from critflow.workflow import faults
from critflow.workflow.plan import Selection
from critflow.workflow.provenance import Origins, written_at
from critflow.workflow.schema import Reader, Table, told, variable_attributes
from critflow.workflow.store import append_seal, read_shard, written_beside
from critflow.workflow.study import Variable

SLAB_BYTES = 2**26  # of the arrays that are in memory at a time; one value of the longest axis at least


def write_dataset(selection: Selection, shards: Path, path: Path, command: str) -> None:
    """Put the file in its place at once; its `history` is the one attribute that differs between equal runs."""
    history = f"{written_at()} {command}"
    read, origins = partial(read_shard, shards, selection.study), Origins(selection.study)
    whole = empty_table(selection, read)
    with written_beside(path) as beside:
        # Labels and attributes go the way of xarray; the data follow into the same file.
        whole.labels().assign_attrs(history=history).to_netcdf(beside, engine="netcdf4", format="NETCDF4")
        with netCDF4.Dataset(beside, "a") as file:
            file.set_fill_off()  # every element is written below
            _declare(file, whole)
            faults.passing("merge.declared")
            for variable, place, array in merged(whole, read, origins):
                file[variable.name][place] = array
            file.setncatts(told(origins.attributes()))
        with xr.open_dataset(beside, engine="netcdf4") as written:
            if not dict(written.sizes).items() >= whole.sizes.items():
                raise OSError("it does not read back as written")
        append_seal(beside)


def empty_table(selection: Selection, read: Reader) -> Table:
    """The table of all cases without their data: the sizes of its dimensions are known.

    Those inside a case come from the first cases that tell them; they are zero where no case does.
    """
    study = selection.study
    sizes = {c.name: len(selection.parameters[c.parameter]) for c in study.coordinates}
    unknown = {dim for dims in study.inner_dims.values() for dim in dims} - set(sizes)
    for case in itertools.chain.from_iterable(selection.batches()):
        if not unknown:
            break
        shard = read(case)
        for name, array in shard.arrays.items() if shard is not None else ():
            sizes |= {d: n for d, n in zip(study.inner_dims[name], array.shape, strict=True) if d in unknown}
        unknown -= set(sizes)
    return Table(selection, sizes | dict.fromkeys(unknown, 0))


def _declare(file: netCDF4.Dataset, whole: Table) -> None:
    for dim, size in whole.sizes.items():
        if dim not in file.dimensions:
            file.createDimension(dim, size)
    for variable in whole.selection.study.variables:
        fill = np.nan if variable.dtype[0] == "f" else None
        made = file.createVariable(variable.name, variable.dtype, variable.dims, fill_value=fill)
        made.setncatts(variable_attributes(variable))


def merged(whole: Table, read: Reader, origins: Origins) -> Iterator[tuple[Variable, Any, np.ndarray]]:
    """All data of an empty table in parts: a variable, a place in it, and what stands there."""
    selection = whole.selection
    longest = max(selection.axes, key=lambda name: len(selection.axes[name]))
    apart = [variable for variable in selection.study.variables if longest in variable.dims]
    shared = [variable for variable in selection.study.variables if longest not in variable.dims]
    table = whole
    for start, part in _slabs(selection, longest, whole.sizes):
        table = table.next_slab(part, [variable.name for variable in shared])
        table.take(read, origins)
        rows = slice(start, start + len(part.axes[longest]))
        for variable in apart:
            place = tuple(rows if dim == longest else slice(None) for dim in variable.dims)
            yield variable, place, table.array(variable)
        faults.passing("merge.slab")
    for variable in shared:
        yield variable, ..., table.array(variable)


def _slabs(selection: Selection, axis: str, sizes: dict[str, int]) -> Iterator[tuple[int, Selection]]:
    """The selection in parts along one axis, with the row where each begins."""
    values = selection.axes[axis]
    each = sum(
        np.dtype(variable.dtype).itemsize * math.prod(sizes[dim] for dim in variable.dims if dim != axis)
        for variable in selection.study.variables
        if axis in variable.dims
    )
    count = max(1, SLAB_BYTES // max(each, 1))
    for start in range(0, len(values), count):
        yield start, replace(selection, axes={**selection.axes, axis: values[start : start + count]})
