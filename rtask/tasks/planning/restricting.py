"""Limits in a planning problem: what is left out of it, and what a refusal says of that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import local_name
from rtask.tasks.actions import ActionClass, Select
from rtask.tasks.limits import Limits
from rtask.tasks.names import names_of
from rtask.tasks.plan import Refusal
from rtask.tasks.planning.problem import Problem
from rtask.tasks.planning.unsolvable import Obstacle, explain_unsolvable
from rtask.tasks.steps import Wording

__all__ = ["limits_in_words", "objects_within", "or_without_limits"]

_MAX_NAMED = 6


def objects_within(
    actions: Sequence[ActionClass], objects: Mapping[str, tuple[str, ...]], limits: Limits
) -> Mapping[str, tuple[str, ...]]:
    """Return the objects without the robots that do nothing and the things that stay untouched.

    Facts about them stay: where they stand and what they hold is so whoever works. No step can be
    about them, so that no search can find one, whatever its order.

    Raises
    ------
    UnknownTermError
        Somebody is to do it alone who is no robot that actions are for.
    """
    if not limits:
        return objects
    workers = _kinds(actions, "assignedTo")
    robots = {robot for kind in workers for robot in objects.get(kind, ())}
    for worker in limits.by:
        if worker not in robots:
            raise UnknownTermError(f"the graph has no robot <{worker}> that could do it")
    # A robot may also be a thing to others: one that does nothing can still be carried.
    left = {**objects}
    for kind in workers:
        left[kind] = tuple(
            robot for robot in left.get(kind, ())
            if robot not in limits.not_by and (not limits.by or robot in limits.by)
        )  # fmt: skip
    for kind in left.keys() - workers:
        left[kind] = tuple(item for item in left[kind] if item not in limits.untouched)
    if limits.only_touch is not None:
        for kind in _kinds(actions, "handlesExemplar"):
            left[kind] = tuple(item for item in left.get(kind, ()) if item in limits.only_touch)
    return left


def _kinds(actions: Sequence[ActionClass], name: str) -> set[str]:
    """Return the classes of the parameters that are values of a statement about steps."""
    return {
        dict(action.parameters)[parameter]
        for action in actions
        for prop, parameter in action.statements
        if local_name(prop) == name
    }


def limits_in_words(select: Select, limits: Limits) -> Iterator[str]:
    """Yield what a plan keeps to, for people."""
    names = names_of(select, {*limits.by, *limits.not_by, *limits.untouched})
    if limits.by:
        yield f"by {' and '.join(names[item] for item in limits.by)} alone"
    if limits.not_by:
        yield f"nothing is done by {' or '.join(names[item] for item in limits.not_by)}"
    if limits.untouched:
        listed = sorted(names[item] for item in limits.untouched)
        more = f" and {len(listed) - _MAX_NAMED} more" if len(listed) > _MAX_NAMED else ""
        yield f"not touched: {', '.join(listed[:_MAX_NAMED])}{more}"
    if limits.only_touch is not None:
        yield "nothing else is touched"


def or_without_limits(
    limits: Limits,
    everything: Mapping[str, tuple[str, ...]],
    problem: Problem,
    lack: Refusal,
    obstacle: Obstacle,
    wording: Wording,
) -> Refusal:
    """Return a refusal that says so where only the limits of the goal stand in the way.

    Parameters
    ----------
    everything
        The objects with those that the limits leave out; empty where there are none.
    """
    if not everything:
        return lack
    of_all = replace(problem, objects=everything, goals=(obstacle.goal,))
    if explain_unsolvable(of_all, {}):
        return lack
    subject = obstacle.goal[0][1]
    if subject in limits.untouched or (
        limits.only_touch is not None and subject not in limits.only_touch
    ):
        text = (
            f"{wording.name(subject)} is not to be touched, as the goal says itself: leave out "
            "that, or that it is to be moved"
        )
        return Refusal(lack.goal, text, (), {})
    if limits.not_by or limits.untouched or limits.only_touch is not None:
        limit = "who is not to do it" if limits.not_by else "what is not to be touched"
        limit = "what is not to be" if limits.not_by and limits.untouched else limit
        return replace(lack, text=f"{lack.text}; or allow it: leave out {limit}")
    return replace(lack, text=f"{lack.text}; or let other robots help: leave out who is to do it")
