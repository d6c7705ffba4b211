"""Random streams named after their purpose, so that no draw depends on the order of work."""

import hashlib

import numpy as np


def stream(*keys: str | int) -> np.random.Generator:
    """Return the random generator of a purpose, for example `stream("echo", scenario, seed, k)`.

    Equal keys give equal streams on every machine, in any order of calls, and whatever type holds them: `1` and
    `np.int64(1)` are the same key, `1` and `"1"` are not. Different keys give independent streams.
    Raises TypeError for a key that is neither text nor a whole number.
    """
    digest = hashlib.blake2b("\x1f".join(map(_canonical, keys)).encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(int.from_bytes(digest, "little"))))


def _canonical(key: object) -> str:
    """Return the one form of a key: NumPy's and Python's texts and whole numbers have the same."""
    if isinstance(key, str):
        return repr(str(key))
    # A truth value is a whole number to Python, but `True` and `1` would be the same key by accident.
    if isinstance(key, int | np.integer) and not isinstance(key, bool):
        return repr(int(key))
    raise TypeError(f"a key of a random stream must be text or a whole number, not {key!r}")
