"""Check of the directions in which a robot's joints turn: an arm whose axes are all parallel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from simulate.robots.description import Floats, Joint

__all__ = ["doubtful_axes"]

_FEWEST = 5
"""Turning joints of a chain; planar examples and SCARA arms have fewer."""
_PARALLEL = 0.999


def doubtful_axes(joints: Sequence[Joint]) -> Iterator[str]:
    """Yield a sentence for each chain of five or more turning joints about one direction.

    It moves in a plane, whatever the joints do. Axes that are not stated are (1, 0, 0), each in the
    frame of its own joint, so that files without them often come to that.

    Parameters
    ----------
    joints
        Parents before children.
    """
    turned: dict[str, Floats] = {}
    chains: dict[str, tuple[str, ...]] = {}
    axes: dict[str, list[Floats]] = {}
    parents = {joint.parent for joint in joints}
    for joint in joints:
        rotation = turned.get(joint.parent, np.eye(3)) @ joint.pose.matrix[:3, :3]
        turned[joint.child] = rotation
        chain, before = chains.get(joint.parent, ()), axes.get(joint.parent, [])
        # One that follows another is a finger's, or a bar of a linkage.
        if joint.kind == "revolute" and joint.mimic is None:
            chain, before = (*chain, joint.name), [*before, rotation @ np.array(joint.axis)]
        chains[joint.child], axes[joint.child] = chain, before
        if joint.child in parents or len(chain) < _FEWEST:
            continue
        along = np.abs(np.stack(before) @ before[0])
        if (along > _PARALLEL).all():
            yield (
                f"the {len(chain)} joints {', '.join(chain)} all turn about one direction: the arm "
                "moves in a plane; are their axes those that were meant?"
            )
