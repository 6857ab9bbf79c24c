"""The dataset of a folder put together in memory: what the merge, which walks slabs, is held against."""

from functools import partial

import numpy as np

from critflow.workflow.provenance import Origins
from critflow.workflow.schema import Table, told, variable_attributes
from critflow.workflow.store import read_shard


def merge(selection, shards):
    """All cases of the selection in one dataset; failed and missing ones are filled and say so in `status`."""
    table, origins = Table(selection), Origins(selection.study)
    table.take(partial(read_shard, shards, selection.study), origins)
    data = {v.name: (v.dims, table.array(v), variable_attributes(v)) for v in selection.study.variables}
    whole = table.labels().assign(data).assign_attrs(told(origins.attributes()))
    for held in whole.data_vars.values():  # integers with a fill value would be read as decimals
        held.encoding["_FillValue"] = held.dtype.type(np.nan) if held.dtype.kind == "f" else None
    return whole
