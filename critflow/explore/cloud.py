"""The cloud of the ensemble in the (B_0, C_B) plane, from a small file in the package."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from typing import Any

from critflow.explore.model import POPULATIONS

FILE = "cloud.json"


@lru_cache(maxsize=1)
def cloud() -> dict[str, Any]:
    """The stored cloud: `n_vertices`, `seeds`, and (B_0, C_B) of each seed by population."""
    return json.loads((files("critflow.explore") / FILE).read_text(encoding="utf-8"))


def cloud_series() -> list[dict[str, Any]]:
    """One series a population; the case of a point is the number of its seed and its population."""
    found = cloud()
    return [
        {
            "label": POPULATIONS[name],
            "kind": number,
            "x": found["populations"][name]["bulk_modulus_0"],
            "y": found["populations"][name]["C_B_exact"],
            "cases": [[seed, name] for seed in found["populations"][name]["seed"]],
        }
        for number, name in enumerate(POPULATIONS)
    ]
