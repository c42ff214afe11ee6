"""Independent random streams per purpose, so that further draws in one do not change another.

A module of its own without other imports, because processes that never load the physics need it.
"""

from __future__ import annotations

import numpy as np

__all__ = ["mix_seed", "stream"]


def stream(seed: int, *purpose: int) -> np.random.Generator:
    """Return the generator of one purpose.

    >>> stream(1, 2).random() == stream(1, 2).random() != stream(1, 3).random()
    True
    """
    return np.random.default_rng(np.random.SeedSequence((seed, *purpose)))


def mix_seed(*parts: int) -> int:
    """Mix numbers into one seed below 2^31, the same on every machine."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0] >> 1)
