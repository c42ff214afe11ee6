"""Random numbers by purpose: one more draw for one changes nothing for another."""

from __future__ import annotations

import numpy as np

__all__ = ["stream"]


def stream(seed: int, *purpose: int) -> np.random.Generator:
    """Return the random numbers of one purpose.

    >>> stream(1, 2).random() == stream(1, 2).random() != stream(1, 3).random()
    True
    """
    return np.random.default_rng(np.random.SeedSequence((seed, *purpose)))
