"""What a file of episodes says that cannot be so, or that contradicts what is stored of them.

A report over the network is judged by the engine; a file's statements come past it, and are held to
the same: no times ahead of the clock, which would outdo all that is seen later, no numbers that are
none, no success that missed, and one outcome of an attempt.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from rtask.errors import ConflictError, DataError
from rtask.rdf.namespaces import PROV, RDF, RT, reason
from rtask.rdf.terms import XSD, moment, python_value

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["check_episodes"]

AHEAD_S = 300.0
"""How far the clock of a robot may be ahead of this machine's, as for reports."""
_WIDTHS, _WIDEST_M = (RT.contactWidth, RT.jawOpening), 1.0
_FARTHEST_M = 4.0
"""Bounds of a grasp that is reported: between its fingers, and from its object."""
_TIME, _NUMBERS = XSD + "dateTime", (XSD + "double", XSD + "float")
_OF_ATTEMPTS = (
    PROV.startedAtTime, PROV.endedAtTime, RT.performedBy, RT.activates, RT.executesGrasp,
    RT.hasOutcome,
)  # fmt: skip
_OF_OUTCOMES = (RT.success, RT.hasReason)


def check_episodes(kb: GraphCore, quads: Sequence[Quad], now: dt.datetime | None = None) -> None:
    """Refuse statements of a file that cannot be so, or differ from what is stored.

    Parameters
    ----------
    kb
        The graph that they go to.
    quads
        The statements.
    now
        By this machine's clock; None = by it.

    Raises
    ------
    DataError
        A time lies ahead, a number is NaN or infinite, a grasp is wider than any hand or nowhere
        near its object, or an outcome does not fit its reason.
    ConflictError
        An attempt that is stored ended, or was carried out, otherwise than the file says.
    """
    latest = (now or dt.datetime.now(dt.UTC)) + dt.timedelta(seconds=AHEAD_S)
    for quad in quads:
        if isinstance(quad.object, Literal):
            _check_value(quad, quad.object, latest)
    _check_grasps(quads)
    _check_outcomes(quads)
    for quad, stored in _differing(kb, quads):
        raise ConflictError(
            f"{_quoted(quad)}, and stored is {stored}: one attempt has one outcome; report another "
            "under a name of its own, or have a person judge it (give_feedback)",
            stored=str(stored),
            reported=str(quad.object),
        )


def _number(quad: Quad) -> float:
    """Return a value as a number; infinity and NaN are read as Python writes them, too."""
    try:
        return float(str(python_value(quad.object)))
    except ValueError as error:
        raise DataError(f"{_quoted(quad)}: expected a number") from error


def _quoted(quad: Quad) -> str:
    return f"the file says {quad.subject} {quad.predicate} {quad.object}"


def _check_value(quad: Quad, value: Literal, latest: dt.datetime) -> None:
    kind = value.datatype.value
    if kind in _NUMBERS:
        if not math.isfinite(_number(quad)):
            raise DataError(f"{_quoted(quad)}: expected a finite number")
    elif kind == _TIME and moment(value.value) > latest:
        raise DataError(
            f"{_quoted(quad)}, more than {AHEAD_S:g} s ahead of the clock here: the clock of the "
            "robot was wrong, and what happened later would never outdo it; correct the times"
        )


def _check_grasps(quads: Iterable[Quad]) -> None:
    """Refuse grasps with openings of no hand, or far from their objects."""
    poses = {quad.object for quad in quads if quad.predicate == RT.graspPose}
    places = (RT.x, RT.y, RT.z)
    for quad in quads:
        is_place = quad.predicate in places and quad.subject in poses
        if quad.predicate in _WIDTHS and not 0.0 <= _number(quad) <= _WIDEST_M:
            raise DataError(f"{_quoted(quad)}: expected 0 to {_WIDEST_M:g} m")
        if is_place and abs(_number(quad)) > _FARTHEST_M:
            raise DataError(f"{_quoted(quad)}: more than {_FARTHEST_M:g} m from the object")


def _check_outcomes(quads: Iterable[Quad]) -> None:
    """Refuse successes that have a reason of failures, and failures that have none."""
    held = {q.subject: bool(python_value(q.object)) for q in quads if q.predicate == RT.success}
    for quad in quads:
        if quad.predicate != RT.hasReason or quad.subject not in held:
            continue
        if held[quad.subject] != (quad.object == reason("ok")):
            word = "a success" if held[quad.subject] else "a failure"
            raise DataError(f"{_quoted(quad)}: that does not fit {word}")


def _differing(kb: GraphCore, quads: Iterable[Quad]) -> Iterator[tuple[Quad, object]]:
    """Yield what a file says of stored attempts and their outcomes, and what is stored instead."""
    attempts = {q.subject for q in quads if q.predicate == RDF.type and q.object == RT.GraspAttempt}
    outcomes = {q.object for q in quads if q.predicate == RT.hasOutcome and q.subject in attempts}
    stored_values: dict[tuple[object, NamedNode], set[object]] = {}
    for quad in quads:
        of_attempt = quad.subject in attempts and quad.predicate in _OF_ATTEMPTS
        if not of_attempt and not (quad.subject in outcomes and quad.predicate in _OF_OUTCOMES):
            continue
        assert isinstance(quad.subject, NamedNode | BlankNode)
        about = (quad.subject, quad.predicate)
        if about not in stored_values:
            stored_values[about] = {stored.object for stored in kb.match(*about)}
        if stored_values[about] and quad.object not in stored_values[about]:
            yield quad, sorted(stored_values[about], key=str)[0]
