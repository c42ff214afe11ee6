"""What attempts say about causes that cannot be seen: where the mass is, and which part is weak.

A failure says more than that this grasp fails. Of a long thing, either nothing hides; or its centre
of mass lies somewhere along it, and whatever is held far from there turns in the hand; or a zone
at one end, of any share of the length, gives way wherever fingers touch it. Each is a hypothesis;
attempts make them more or less likely by Bayes' rule. What follows holds for every hand.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["hidden_share"]

_NOTHING, _MASS, _ZONE = 0.6, 0.2, 0.2
"""Chances that nothing hides, that the mass lies anywhere, that a zone is weak."""
_CENTRES = np.linspace(-0.45, 0.45, 19)
_ZONES = np.array([[end, share] for end in (-1.0, 1.0) for share in (0.3, 0.4, 0.5, 0.6, 0.7)])
_LEVER = 0.12
"""Distance from the centre of mass at which most grasps still hold, standard deviation."""
_RARELY = 0.05
"""Chance to hold against a cause."""
_USUALLY = 0.85
"""Chance to hold where nothing speaks against it."""


def hidden_share(
    places: NDArray[np.float64],
    half_finger: float,
    tried: NDArray[np.float64],
    held: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return by what factor attempts lower the chance of grasps along an object, (n,).

    1 for the grasps for which most speaks, and for all without attempts: nothing is assumed to hide
    before something was tried, and where all grasps are in one place nothing follows.

    Parameters
    ----------
    places : (n,)
        Of the grasps along the longer side, from its middle, in units of its length.
    half_finger
        Half the width of a finger, in the same units.
    tried : (k,)
        Places of the attempts.
    held : (k,)
        1 for a success, 0 for a failure.
    weights : (k,)
        How far each attempt counts, 0 and up.

    Examples
    --------
    >>> along = np.array([-0.3, 0.0, 0.3])
    >>> failed = np.array([0.0, 0.3])
    >>> hidden_share(along, 0.1, failed, np.zeros(2), np.ones(2)).round(1).tolist()
    [1.0, 0.3, 0.4]
    """
    if len(tried) == 0 or len(places) == 0:
        return np.ones(len(places))
    prior = np.concatenate([
        [_NOTHING],
        np.full(len(_CENTRES), _MASS / len(_CENTRES)),
        np.full(len(_ZONES), _ZONE / len(_ZONES)),
    ])  # fmt: skip
    chance = _USUALLY * _allowed(tried, half_finger)
    likelihood = np.log(np.where(held[None] > 0, chance, 1 - chance)) @ weights
    posterior = prior * np.exp(likelihood - likelihood.max())
    posterior /= posterior.sum()
    allowed = _allowed(places, half_finger)
    # Rounded, so that the order of the attempts does not affect the last bit.
    share = (posterior @ allowed) / (prior @ allowed)
    return np.asarray(np.round(share / share.max(), 9))


def _allowed(places: NDArray[np.float64], half_finger: float) -> NDArray[np.float64]:
    """Return the share (h, n) of each grasp's chance that each hypothesis leaves."""
    nothing = np.ones((1, len(places)))
    lever = (places[None] - _CENTRES[:, None]) / _LEVER
    mass = np.maximum(np.exp(-(lever**2) / 2), _RARELY)
    reach = _ZONES[:, :1] * places[None] + half_finger
    zone = np.where(reach > 0.5 - _ZONES[:, 1:], _RARELY, 1.0)
    return np.concatenate([nothing, mass, zone])
