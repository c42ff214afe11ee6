"""Hypotheses about what hides along an object, and what each leaves of the chance of a grasp.

Nothing hides; the centre of mass lies somewhere, and what is held far from there turns in the hand;
a zone at one end gives way. These are the causes that can be named. Two more hypotheses stand for
all that these do not foresee: some of the object's length holds and some does not, in any pattern;
and "none of these", where a grasp holds or fails wherever it is.

Places are along the longer side, from the middle, in units of its length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CAUSES_PRIOR", "CENTRES", "MASSES", "MIRRORED", "PRIOR", "STEP", "USUALLY", "ZONES",
    "ZONE_NUMBERS", "allowed", "allowed_by_causes", "log_likelihood",
]  # fmt: skip

_NOTHING, _MASS, _ZONE = 0.6, 0.2, 0.2
"""Chances that nothing hides, that the mass lies anywhere, that a zone is weak."""
_PATTERN, _NONE_OF_THESE = 0.2, 0.2
"""Chances, beside those, of any other pattern, and of none of these."""
CENTRES = np.linspace(-0.45, 0.45, 19)
ZONES = np.array([[end, share] for end in (-1.0, 1.0) for share in (0.3, 0.4, 0.5, 0.6, 0.7)])
STEP = float(CENTRES[1] - CENTRES[0])
_LEVER = 0.12
"""Distance from the centre of mass at which most grasps still hold, standard deviation."""
_RARELY = 0.05
"""Chance to hold against a cause."""
USUALLY = 0.85
"""Chance to hold where nothing speaks against it."""
_HALF = 0.5
"""What is left of the chance of any grasp by "none of these"."""

_CELLS = 10
_SWITCH = 0.2
"""Chance that one tenth of the length holds and the next one does not, or the other way round."""
_TOUCHED = 0.3
"""Part of a cell that a finger must cover to depend on it."""

MASSES = 1 + np.arange(len(CENTRES))
"""Numbers of the hypotheses about the mass."""
ZONE_NUMBERS = 1 + len(CENTRES) + np.arange(len(ZONES))
"""Numbers of the hypotheses about a weak zone."""


def _all_patterns() -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return the patterns of weak cells (p, cells), of which some are weak, and their prior."""
    numbers = np.arange(2**_CELLS - 1)  # a bit that is set is a firm cell
    weak = (numbers[:, None] >> np.arange(_CELLS)) & 1 == 0
    # Firm and weak parts are rarely mixed: each change between neighbours is unlikely.
    switches = (weak[:, 1:] != weak[:, :-1]).sum(axis=1)
    prior = _SWITCH**switches * (1 - _SWITCH) ** (_CELLS - 1 - switches)
    return weak, prior / prior.sum()


_WEAK, _OF_PATTERN = _all_patterns()

CAUSES_PRIOR = np.concatenate([
    [_NOTHING],
    np.full(len(CENTRES), _MASS / len(CENTRES)),
    np.full(len(ZONES), _ZONE / len(ZONES)),
])  # fmt: skip
"""Prior of the hypotheses that can be named, (c,), and of nothing, which is the first."""


def _prior() -> NDArray[np.float64]:
    prior = np.concatenate([CAUSES_PRIOR, _PATTERN * _OF_PATTERN, [_NONE_OF_THESE]])
    return np.asarray(prior / prior.sum())


PRIOR = _prior()
"""Prior of all hypotheses, (h,), before anything was tried."""


def _mirrored() -> NDArray[np.intp]:
    # With the ends exchanged, a pattern is read from its other side.
    patterns = (~_WEAK[:, ::-1]) @ (1 << np.arange(_CELLS))
    half = len(ZONES) // 2
    first = len(CAUSES_PRIOR)
    return np.concatenate([
        [0], MASSES[::-1], np.roll(ZONE_NUMBERS, half), first + patterns, [first + len(_WEAK)],
    ]).astype(np.intp)  # fmt: skip


MIRRORED = _mirrored()
"""Number of each hypothesis with the object's ends exchanged, (h,)."""


def allowed_by_causes(
    places: NDArray[np.float64], half_finger: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return the share (c, n) of each grasp's chance that nothing and each named cause leave.

    Parameters
    ----------
    places : (n,)
        Of the grasps.
    half_finger
        Half the width of a finger, or of each grasp's finger (n,), in units of the length.
    """
    nothing = np.ones((1, len(places)))
    lever = (places[None] - CENTRES[:, None]) / _LEVER
    # Never zero: one grasp that held against it must not rule a cause out for ever.
    mass = np.maximum(np.exp(-(lever**2) / 2), _RARELY)
    reach = ZONES[:, :1] * places[None] + half_finger
    zone = np.where(reach > 0.5 - ZONES[:, 1:], _RARELY, 1.0)
    return np.concatenate([nothing, mass, zone])


def allowed(
    places: NDArray[np.float64], half_finger: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return the share (h, n) of each grasp's chance that each hypothesis leaves.

    The parameters are those of :func:`allowed_by_causes`.
    """
    edges = np.linspace(-0.5, 0.5, _CELLS + 1)[:, None]
    covered = np.minimum(edges[1:], places + half_finger) - np.maximum(
        edges[:-1], places - half_finger
    )
    touched = (covered > _TOUCHED / _CELLS).astype(np.float64)
    pattern = np.where(_WEAK.astype(np.float64) @ touched > 0, _RARELY, 1.0)
    none_of_these = np.full((1, len(places)), _HALF)
    return np.concatenate([allowed_by_causes(places, half_finger), pattern, none_of_these])


def log_likelihood(
    shares: NDArray[np.float64], held: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the log-likelihood (h,) of attempts under hypotheses.

    Parameters
    ----------
    shares : (h, k)
        What the hypotheses leave of the chance of each attempt.
    held, weights : (k,)
        1 for a success, 0 for a failure; how far each attempt counts.
    """
    chance = USUALLY * shares
    return np.asarray(np.log(np.where(held[None] > 0, chance, 1 - chance)) @ weights)
