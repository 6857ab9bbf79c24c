"""Random generators derived from what is computed, never from when or where it is computed."""

from __future__ import annotations

import json
from hashlib import blake2b

import numpy as np

# How every random number is derived, for the files that hold some.
SEED_ENTROPY = (
    "numpy.random.default_rng(SeedSequence(entropy, spawn_key)): entropy is the value of the axis seed, or a number "
    "in the source; spawn_key is the BLAKE2b-128 of the words of the stream as JSON, in four little-endian words"
)


def stable_rng(entropy: int, *words: str) -> np.random.Generator:
    """Generator of its own for `(entropy, *words)`, the same on every machine and for every order of the cases.

    `stable_rng(seed, "rest_lengths", population)` draws numbers independent of `stable_rng(seed, "network")`; adding
    seeds or words elsewhere changes none of them.
    """
    digest = blake2b(json.dumps(words).encode(), digest_size=16).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=key))
