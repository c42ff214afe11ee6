"""Products whose best grasp cannot be seen: where the mass is, which end breaks.

Each family looks like a box. Its print tells the ends apart, never the secret, which is drawn from
the product's number like its size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

__all__ = ["HIDDEN_KINDS", "NO_SECRET", "HiddenKind", "Part", "Secret", "draw_hidden"]

HiddenKind = Literal["bar", "flask", "carton", "rod"]

HIDDEN_KINDS: tuple[HiddenKind, ...] = ("bar", "flask", "carton", "rod")
"""Families with a secret: mass near one end (a tool, a half full flask lying down, a light rod), or
one end that breaks when it is pressed (a carton)."""

Range = tuple[float, float]

_SIZES: dict[str, tuple[Range, Range, Range]] = {
    "bar": ((0.100, 0.130), (0.020, 0.030), (0.024, 0.030)),
    "flask": ((0.095, 0.120), (0.028, 0.036), (0.028, 0.036)),
    "carton": ((0.088, 0.110), (0.026, 0.036), (0.032, 0.050)),
    "rod": ((0.100, 0.130), (0.018, 0.026), (0.022, 0.030)),
}
_MASSES: dict[str, Range] = {
    "bar": (0.9, 1.2),
    "flask": (0.9, 1.2),
    "carton": (0.03, 0.07),
    "rod": (0.07, 0.15),
}
_OFF_CENTRE = (0.34, 0.42)
_WEAK_SHARE = (0.56, 0.66)
_BREAKS_AT_N = 1.5


@dataclass(frozen=True)
class Part:
    """One box of a product.

    Parameters
    ----------
    size, position
        Edges and middle along x, y, z of the body frame, m.
    breaks_at_n
        Force of a single contact that breaks it, N; infinite for a part that does not break.
    """

    size: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    breaks_at_n: float = float("inf")


@dataclass(frozen=True)
class Secret:
    """Properties of a product that no camera sees.

    Parameters
    ----------
    mass_offset_m
        From the middle to the centre of mass, along x of the body frame.
    parts
        Boxes of which the product consists; empty for a single one.
    """

    mass_offset_m: float = 0.0
    parts: tuple[Part, ...] = ()

    def mirrored(self) -> Secret:
        """Return the secret with its ends exchanged."""
        parts = tuple(
            replace(part, position=(-part.position[0], *part.position[1:])) for part in self.parts
        )
        return Secret(-self.mass_offset_m, parts)


NO_SECRET = Secret()
"""Of a product that is what it looks like."""


def draw_hidden(
    kind: HiddenKind, rng: np.random.Generator
) -> tuple[tuple[float, float, float], float, Secret]:
    """Draw size (m), mass (kg) and secret of a product."""
    x, y, z = (round(float(rng.uniform(low, high)), 4) for low, high in _SIZES[kind])
    mass = round(float(rng.uniform(*_MASSES[kind])), 4)
    end = 1.0 if rng.random() < 0.5 else -1.0
    if kind in ("bar", "flask", "rod"):
        offset = end * round(float(rng.uniform(*_OFF_CENTRE)) * x, 4)
        return (x, y, z), mass, Secret(mass_offset_m=offset)
    share = float(rng.uniform(*_WEAK_SHARE))
    weak, strong = round(share * x, 4), round(x - round(share * x, 4), 4)
    parts = (
        Part((strong, y, z), (-end * weak / 2, 0.0, 0.0)),
        Part((weak, y, z), (end * strong / 2, 0.0, 0.0), breaks_at_n=_BREAKS_AT_N),
    )
    return (x, y, z), mass, Secret(parts=parts)
