"""The world of a knowledge base, as users ask it."""

from __future__ import annotations

import threading
import time
import weakref
from typing import TYPE_CHECKING, Any

from rtask.sparql.place_service import PlaceQuestion, PlaceRow
from rtask.world.asking import answer
from rtask.world.relations import related
from rtask.world.scene import Scene, read_scene
from rtask.world.scene.grasps import DEFAULT_GRASPS
from rtask.world.state import WorldState
from rtask.world.whereabouts import Question, Whereis

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["World", "world_of"]


class World(WorldState):
    """Where things are and were; see :func:`world_of`.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:", ontologies=False) as kb:
    ...     print(kb.world.where_is("blue cup").text)
    not known: nothing is called "blue cup"
    """

    def where_is(self, name: str, **question: Any) -> Whereis:
        """Return where things are, or were.

        Parameters
        ----------
        name
            IRI or name of a thing or product, an objectId, or a kind such as ``cup``.
        **question
            ``at``, ``frame``, ``near``, ``radius_m`` and ``max_things`` of a
            :class:`~rtask.world.whereabouts.Question`.

        Raises
        ------
        UnknownTermError
            A frame or place of the question is not in the graph.
        UsageError
            Several frames have the name.
        """
        return answer(self, Question(name, **question))

    def related(self, question: PlaceQuestion) -> list[PlaceRow]:
        """Return the pairs between which a spatial relation holds; see :func:`related`."""
        return related(self, question)

    def scene(
        self,
        at: float | None = None,
        frame: str | None = None,
        max_grasps: int = DEFAULT_GRASPS,
        surfaces: bool = True,
    ) -> Scene:
        """Return what is where in one tree of frames, to be drawn or written for other programs.

        Parameters
        ----------
        at
            Unix time, s; default: now.
        frame
            Name or IRI of any frame of the tree; default: the tree in which most things are.
        max_grasps
            Grasps of a thing, those that held most often first.
        surfaces
            Whether to read the reconstructed surfaces of products, some 100 kB each.

        Raises
        ------
        UnknownTermError, UsageError
            There is no such frame, or several have the name.
        TooLargeError
            There are more things or frames than one scene may have.

        Examples
        --------
        >>> import rtask
        >>> from rtask.world.scene import glb, usda
        >>> with rtask.open(":memory:", ontologies=False) as kb:
        ...     scene = kb.world.scene()
        >>> scene.nodes, len(glb(scene)) > 0, usda(scene).startswith("#usda 1.0")
        ((), True, True)
        """
        return read_scene(self, time.time() if at is None else at, frame, max_grasps, surfaces)


_worlds: weakref.WeakKeyDictionary[GraphCore, World] = weakref.WeakKeyDictionary()
_lock = threading.Lock()


def world_of(kb: GraphCore) -> World:
    """Return the world of a knowledge base; all who ask share one index."""
    with _lock:
        world = _worlds.get(kb)
        if world is None:
            world = _worlds[kb] = World(kb)
        return world
