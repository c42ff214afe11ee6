"""What is where, since when, and how sure: things, their places in time, and frames.

A *product* is what robots share for a grasp, a kind of carton; a *thing* is one carton, an exemplar
of it (:mod:`rtask.world.identities.identity`). A thing is at one place at a time: each
:class:`Placement` is an interval that lasts until another placement, or an end, is stated.

:class:`World` reads and asks; :class:`WorldEdit` says what changes when something was seen, held,
put somewhere, or lost.
"""

from __future__ import annotations

from rtask.world.edit import WorldEdit
from rtask.world.placement import Placement, Relation
from rtask.world.uncertainty import Spread
from rtask.world.whereabouts import Question, Whereabouts
from rtask.world.world import World, world_of

__all__ = [
    "Placement", "Question", "Relation", "Spread", "Whereabouts", "World", "WorldEdit", "world_of",
]  # fmt: skip
