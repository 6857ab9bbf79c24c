"""Random generators derived from what is computed, never from when or where it is computed."""

from __future__ import annotations

import json
from hashlib import blake2b

import numpy as np


def stable_rng(entropy: int, *words: str) -> np.random.Generator:
    """Generator of its own for `(entropy, *words)`, the same on every machine and for every order of the cases.

    `stable_rng(seed, "rest_lengths", population)` draws numbers independent of `stable_rng(seed, "network")`; adding
    seeds or words elsewhere changes none of them.
    """
    digest = blake2b(json.dumps(words).encode(), digest_size=16).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=key))
