"""Generated jaws, so that what differs between hands can be measured on more than two of them."""

from __future__ import annotations

import numpy as np

from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from simulate.world.seeds import stream

__all__ = ["made_hand", "studied_hand"]

_MADE = "made"
_HAND = 51
_STROKES_M, _FORCES_N = (0.04, 0.14), (2.0, 60.0)


def made_hand(seed: int, number: int) -> ParallelGripper:
    """Return generated jaws: stroke 4 to 14 cm, 2 to 60 N, pads, fingers and palm of many sizes.

    Examples
    --------
    >>> hand = made_hand(0, 3)
    >>> hand.gripper_type, 0.04 <= hand.max_opening <= 0.14, hand == made_hand(0, 3)
    ('made:0:3', True, True)
    """
    rng = stream(seed, _HAND, number)
    stroke = float(np.exp(rng.uniform(*np.log(_STROKES_M))))
    force = float(np.exp(rng.uniform(*np.log(_FORCES_N))))
    width, thick, length, tip, palm = (
        float(v)
        for v in stroke * rng.uniform((0.15, 0.1, 0.6, 0.07, 0.5), (0.35, 0.25, 1.0, 0.14, 1.0))
    )
    name = f"{_MADE}:{seed}:{number}"
    return ParallelGripper(
        name, name, 0.0, stroke, finger_width=width, finger_length=length, max_payload=20.0,
        finger_thickness=thick, fingertip=tip, palm=(stroke + 2.5 * thick, palm, palm),
        friction=0.5, max_force=force,
    )  # fmt: skip


def studied_hand(text: str) -> ParallelGripper:
    """Return the hand of a trial: a generated one, or one that :func:`gripper_named` knows."""
    kind, _, rest = text.partition(":")
    if kind != _MADE:
        return gripper_named(text)
    seed, number = rest.split(":")
    return made_hand(int(seed), int(number))
