"""Random streams named after their purpose, so that no draw depends on the order of work."""

import hashlib

import numpy as np


def stream(*keys: str | int) -> np.random.Generator:
    """Return the random generator of a purpose, for example `stream("echo", scenario, seed, k)`.

    Equal keys give equal streams on every machine and in any order of calls. Different keys give independent streams.
    """
    digest = hashlib.blake2b("\x1f".join(map(repr, keys)).encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(int.from_bytes(digest, "little"))))
