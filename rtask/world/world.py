"""The world of a knowledge base, as users ask it."""

from __future__ import annotations

import threading
import weakref
from typing import TYPE_CHECKING, Any

from rtask.sparql.place_service import PlaceQuestion, PlaceRow
from rtask.world.asking import answer
from rtask.world.relations import related
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


_worlds: weakref.WeakKeyDictionary[GraphCore, World] = weakref.WeakKeyDictionary()
_lock = threading.Lock()


def world_of(kb: GraphCore) -> World:
    """Return the world of a knowledge base; all who ask share one index."""
    with _lock:
        world = _worlds.get(kb)
        if world is None:
            world = _worlds[kb] = World(kb)
        return world
