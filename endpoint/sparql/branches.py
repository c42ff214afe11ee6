"""Queries and updates of a branch: ``branch=NAME``."""

from __future__ import annotations

import threading

from endpoint.http.messages import RefusedError, Response
from endpoint.served import ServedGraph, embedded
from endpoint.settings import Config
from endpoint.sparql.answers import Answers, Question
from rtask.errors import UnknownTermError
from rtask.kb.branches.branch import Branch
from rtask.knowledge_base import KnowledgeBase

__all__ = ["BranchStates", "open_named"]


def open_named(kb: ServedGraph, name: str) -> Branch[KnowledgeBase]:
    """Open a branch of the graph that is served.

    Raises
    ------
    RefusedError
        404: there is none of this name.
    UnsupportedError
        The graph can have no branches.
    """
    try:
        return embedded(kb, "branches").open_branch(name)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", str(error)) from error


class BranchStates:
    """What answers queries of the branches of one graph.

    Parameters
    ----------
    kb
        The trunk.
    config
        Limits of one answer.
    """

    def __init__(self, kb: ServedGraph, config: Config) -> None:
        self._kb = kb
        self._config = config
        self._lock = threading.Lock()
        self._answers: dict[str, tuple[KnowledgeBase, Answers]] = {}

    def open(self, question: Question, name: str) -> Response:
        """Open an answer from a branch; ``RTASK-Branch`` names its last commit.

        Raises
        ------
        RefusedError, UnsupportedError
            As :func:`open_named`.
        QueryTimeout
            The time is up.
        """
        graph = open_named(self._kb, name).graph
        response = self._of(name, graph).open(question, point=False)
        return response.with_headers(("RTASK-Branch", f"{name}:{graph.seq}"))

    def _of(self, name: str, graph: KnowledgeBase) -> Answers:
        """Return what answers from a branch, and forget those that are closed."""
        with self._lock:
            held = self._answers.items()
            current = {other: pair for other, pair in held if pair[0].store.is_open}
            there = current.get(name)
            if there is None or there[0] is not graph:
                there = current[name] = (graph, Answers(graph, self._config))
            self._answers = current
        return there[1]
