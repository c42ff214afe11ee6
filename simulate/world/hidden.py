"""Products whose best grasp cannot be seen: where the mass is, which end breaks.

Each family looks like a box. Its print tells the ends apart, never the secret, which is drawn from
the product's number like its size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

__all__ = [
    "HIDDEN_KINDS",
    "NO_SECRET",
    "UNFORESEEN_KINDS",
    "HiddenKind",
    "Part",
    "Secret",
    "draw_hidden",
]

HiddenKind = Literal[
    "bar", "flask", "carton", "rod", "brittle", "banded", "ribbed", "lidded", "shifting"
]

UNFORESEEN_KINDS: tuple[HiddenKind, ...] = ("brittle", "banded", "ribbed", "lidded", "shifting")
"""Families whose secret is none of the causes that the graph infers: both ends break and a part in
between holds; a band around the thing is slippery; only two ribs hold, beside the middle; a lid in
the middle gives way; a loose weight slides from end to end."""

HIDDEN_KINDS: tuple[HiddenKind, ...] = ("bar", "flask", "carton", "rod", *UNFORESEEN_KINDS)
"""Families with a secret: mass near one end (a tool, a half full flask lying down, a light rod),
one end that breaks when it is pressed (a carton), and the unforeseen ones."""

Range = tuple[float, float]

_SIZES: dict[str, tuple[Range, Range, Range]] = {
    "bar": ((0.100, 0.130), (0.020, 0.030), (0.024, 0.030)),
    "flask": ((0.095, 0.120), (0.028, 0.036), (0.028, 0.036)),
    "carton": ((0.088, 0.110), (0.026, 0.036), (0.032, 0.050)),
    "rod": ((0.100, 0.130), (0.018, 0.026), (0.022, 0.030)),
    "brittle": ((0.095, 0.115), (0.026, 0.036), (0.032, 0.050)),
    "banded": ((0.095, 0.120), (0.024, 0.034), (0.028, 0.044)),
    "ribbed": ((0.095, 0.115), (0.026, 0.036), (0.032, 0.050)),
    "lidded": ((0.095, 0.115), (0.026, 0.036), (0.032, 0.050)),
    "shifting": ((0.100, 0.130), (0.020, 0.030), (0.024, 0.030)),
}
_MASSES: dict[str, Range] = {
    "bar": (0.9, 1.2),
    "flask": (0.9, 1.2),
    "carton": (0.03, 0.07),
    "rod": (0.07, 0.15),
    "brittle": (0.03, 0.07),
    "banded": (0.10, 0.20),
    "ribbed": (0.03, 0.07),
    "lidded": (0.03, 0.07),
    "shifting": (0.9, 1.2),
}
_OFF_CENTRE = (0.34, 0.42)
_WEAK_SHARE = (0.56, 0.66)
_BREAKS_AT_N = 1.5
_FIRM_SHARE, _FIRM_OFF = (0.30, 0.38), (0.10, 0.18)
_BAND_SHARE, _BAND_OFF = (0.40, 0.50), (0.05, 0.18)
_SLIPPERY = 0.003
_RIB_SHARE, _RIB_AT, _RIB_OFF = (0.25, 0.28), (0.16, 0.17), 0.01
_LID_SHARE, _LID_OFF = (0.22, 0.34), (0.0, 0.06)
_TRAVEL = (0.30, 0.38)


@dataclass(frozen=True)
class Part:
    """One box of a product.

    Parameters
    ----------
    size, position
        Edges and middle along x, y, z of the body frame, m.
    breaks_at_n
        Force of a single contact that breaks it, N; infinite for a part that does not break.
    lateral
        Coulomb coefficient of its surface, as Bullet takes it; None = that of the product.
    """

    size: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    breaks_at_n: float = float("inf")
    lateral: float | None = None


@dataclass(frozen=True)
class Secret:
    """Properties of a product that no camera sees.

    Parameters
    ----------
    mass_offset_m
        From the middle to the centre of mass, along x of the body frame.
    parts
        Boxes of which the product consists; empty for a single one.
    travel_m
        How far to either side of the middle a loose weight slides, which lies at the side of its
        sign; 0 = there is none.
    """

    mass_offset_m: float = 0.0
    parts: tuple[Part, ...] = ()
    travel_m: float = 0.0

    def mirrored(self) -> Secret:
        """Return the secret with its ends exchanged."""
        parts = tuple(
            replace(part, position=(-part.position[0], *part.position[1:])) for part in self.parts
        )
        return Secret(-self.mass_offset_m, parts, -self.travel_m)


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
    if kind == "shifting":
        return (x, y, z), mass, Secret(travel_m=end * round(float(rng.uniform(*_TRAVEL)) * x, 4))
    if kind in UNFORESEEN_KINDS:
        return (x, y, z), mass, Secret(parts=_sections(kind, (x, y, z), end, rng))
    share = float(rng.uniform(*_WEAK_SHARE))
    weak, strong = round(share * x, 4), round(x - round(share * x, 4), 4)
    parts = (
        Part((strong, y, z), (-end * weak / 2, 0.0, 0.0)),
        Part((weak, y, z), (end * strong / 2, 0.0, 0.0), breaks_at_n=_BREAKS_AT_N),
    )
    return (x, y, z), mass, Secret(parts=parts)


def _sections(
    kind: HiddenKind, size: tuple[float, float, float], end: float, rng: np.random.Generator
) -> tuple[Part, ...]:
    """Return the parts of a product along its length; the first carries the mass."""
    x, y, z = size
    order: tuple[int, ...]
    odd: tuple[int, ...]
    if kind == "ribbed":
        share, at = float(rng.uniform(*_RIB_SHARE)), float(rng.uniform(*_RIB_AT))
        ribs = end * _RIB_OFF - at, end * _RIB_OFF + at
        edges = [-0.5, *(rib + side * share / 2 for rib in ribs for side in (-1, 1)), 0.5]
        order, odd = (3, 0, 1, 2, 4), (0, 2, 4)
    else:
        shares, offs = {
            "brittle": (_FIRM_SHARE, _FIRM_OFF), "banded": (_BAND_SHARE, _BAND_OFF),
            "lidded": (_LID_SHARE, _LID_OFF),
        }[kind]  # fmt: skip
        share, off = float(rng.uniform(*shares)), end * float(rng.uniform(*offs))
        edges = [-0.5, off - share / 2, off + share / 2, 0.5]
        order = (2, 0, 1) if kind == "lidded" else (1, 0, 2)
        odd = (0, 2) if kind == "brittle" else (1,)
    return tuple(
        Part(
            ((edges[k + 1] - edges[k]) * x, y, z),
            ((edges[k + 1] + edges[k]) / 2 * x, 0.0, 0.0),
            breaks_at_n=_BREAKS_AT_N if k in odd and kind != "banded" else float("inf"),
            lateral=_SLIPPERY if k in odd and kind == "banded" else None,
        )
        for k in order
    )
