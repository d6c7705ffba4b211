"""Random streams named by what they are for, so that no draw depends on the order of work."""

import hashlib

import numpy as np


def stream(*keys: str | int) -> np.random.Generator:
    """The random generator of a purpose, e.g. `stream("echo", scenario, seed, k)`.

    Equal keys give equal streams on every machine and in any order of calls; different keys give independent ones.
    """
    digest = hashlib.blake2b("\x1f".join(map(repr, keys)).encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(int.from_bytes(digest, "little"))))
