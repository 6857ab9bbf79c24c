"""Write the cloud of points of the page from a dataset of the study `ensemble`.

critflow run ensemble --set seeds=0:25 --set variables=bulk_modulus_0,C_B_exact --out results/cloud
python -m workflows.benchmarks.explore.cloud results/cloud/ensemble.nc
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

import critflow
from critflow.explore.cloud import FILE
from critflow.explore.model import POPULATIONS
from critflow.workflow.dataset import opened_dataset

# Digits that a screen can show.
_DIGITS = 5


def main(words: list[str]) -> int:
    """Write the file from the dataset of the first argument."""
    (path,) = words
    with opened_dataset(Path(path)) as dataset:
        record = {"n_vertices": 1000, "populations": {}}
        for name in POPULATIONS:
            one = dataset.sel(population=name)
            x, y = one.bulk_modulus_0.values, one.C_B_exact.values
            known = np.isfinite(x) & np.isfinite(y)
            record["populations"][name] = {
                "seed": one.seed.values[known].tolist(),
                "bulk_modulus_0": [round(value, _DIGITS) for value in x[known].tolist()],
                "C_B_exact": [round(value, _DIGITS) for value in y[known].tolist()],
            }
    target = Path(critflow.__file__).parent / "explore" / FILE
    target.write_text(json.dumps(record, separators=(",", ":")) + "\n", encoding="utf-8")
    print(f"{target.name}: {sum(len(one['seed']) for one in record['populations'].values())} points")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
