"""Hidden causes as facts: what the outcomes of all robots say about an object.

A cause (:func:`grasp.learning.causes.hidden_causes`) is a property of the object and holds for
every hand. It is stated in the graph of causes, derived from the attempts that it was inferred
from, in the same commit as the outcome, verdict or correction that changes it. What is stated
depends on the latest 200 judged attempts alone, so that it is the same whatever the order in which
they came and went, and an outcome costs no more when thousands came before it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grasp.learning.causes import hidden_causes
from rtask.engine.policy import LOST_CODE, UNJUDGED
from rtask.engine.triples import Triples
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PROV, RDF, RT, local_name, reason
from rtask.rdf.terms import GraphName, NamedNode, Quad, iri, object_term, python_value

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.transaction import Transaction

__all__ = [
    "Causes", "StatingCauses", "Tried", "place_along", "restate", "state_causes", "stated_causes",
]  # fmt: skip

MIN_PROBABILITY = 0.3
MAX_TRIED = 200
"""Attempts at an object that speak about its causes, the latest ones."""
_FRAGILE, _COMES_OFF = "crushed", "came_apart"
_SLIPS = ("slip_lift", "slip_hold")

Match = Callable[..., Sequence[Quad]]
"""Statements by pattern, as they are or as they will be; see :meth:`Edit.after`."""


@dataclass(frozen=True)
class StatingCauses(Access):
    """Rights of an author, extended to the graph of causes, which the outcome changes."""

    def may_write(self, graph: GraphName) -> bool:
        return super().may_write(graph) or (self.graphs is not None and graph == self.graphs.causes)

    @property
    def may_state_axioms(self) -> bool:
        """Always: the engine words these statements, such as those of a new class of objects."""
        return True

    @classmethod
    def of(cls, author: Access) -> StatingCauses:
        """Return the extended rights of an author."""
        return cls(author.agent, author.role, author.rights, of_owner=author.of_owner)


@dataclass(frozen=True)
class Tried:
    """A judged attempt from above at an object.

    Parameters
    ----------
    x
        Place of the grasp along the longer side, object frame, m.
    finger_width
        Of the hand, m; 0 if it is not known.
    reason
        Code of the reason that the robot reported.
    """

    attempt: NamedNode
    x: float
    held: bool
    finger_width: float
    reason: str


class Causes:
    """Causes that a commit restates.

    Parameters
    ----------
    context
        What is stored.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._tried: dict[NamedNode, list[Tried]] = {}
        self._judged: dict[NamedNode, dict[NamedNode, bool | None]] = {}
        self._length: dict[NamedNode, float] = {}

    def add(self, object_iri: NamedNode, tried: Tried) -> None:
        """Add an attempt of this commit."""
        self._tried.setdefault(object_iri, []).append(tried)

    def judge(self, grasp: NamedNode, attempt: NamedNode, held: bool | None) -> None:
        """Judge a stored attempt otherwise; None = it counts no more."""
        for link in self._context.kb.match(None, RT.hasGrasp, grasp):
            # A thing inherits the grasps of its product, and their causes with them.
            if isinstance(link.subject, NamedNode) and not self._is_exemplar(link.subject):
                self._judged.setdefault(link.subject, {})[attempt] = held

    def _is_exemplar(self, node: NamedNode) -> bool:
        return bool(self._context.kb.match(node, RDF.type, RT.Exemplar))

    def size(self, object_iri: NamedNode, triples: Triples) -> None:
        """Take the length of a new object from the triples of this commit."""
        lengths = [v for s, p, v in triples if s == object_iri and p == RT.extentX]
        if lengths and isinstance(lengths[0], float):
            self._length[object_iri] = lengths[0]

    def changes(self) -> tuple[list[Quad], list[Quad]]:
        """Return the statements that go and those that come."""
        gone: list[Quad] = []
        added: list[Quad] = []
        for object_iri in sorted({*self._tried, *self._judged}, key=str):
            now = _stated(
                self._context, self._context.kb.match, object_iri, self._tried.get(object_iri, ()),
                self._judged.get(object_iri, {}), self._length.get(object_iri),
            )  # fmt: skip
            old = stated_causes(self._context, object_iri)
            gone += [quad for quad in old if quad not in now]
            added += [quad for quad in now if quad not in old]
        return gone, added


def state_causes(causes: Causes | None, tx: Transaction) -> None:
    """Write what a commit changes about causes; needs the rights of :class:`StatingCauses`."""
    if causes is not None:
        gone, added = causes.changes()
        tx.remove_quads(gone)
        tx.add_quads(added)


def stated_causes(context: Context, object_iri: NamedNode) -> list[Quad]:
    """Return what the graph of causes says about an object."""
    kb, graph = context.kb, context.kb.graphs.causes
    links = list(kb.match(object_iri, RT.hasHiddenCause, None, graph))
    return [
        *links,
        *(q for link in links if isinstance(link.object, NamedNode)
          for q in kb.match(link.object, None, None, graph)),
    ]  # fmt: skip


def restate(context: Context, match: Match, object_iri: NamedNode) -> tuple[list[Quad], list[Quad]]:
    """Return the statements about an object's causes that go and those that come.

    Parameters
    ----------
    match
        Statements as they will be.
    """
    now, old = _stated(context, match, object_iri), stated_causes(context, object_iri)
    return [q for q in old if q not in now], [q for q in now if q not in old]


def _stated(
    context: Context,
    match: Match,
    object_iri: NamedNode,
    more: Iterable[Tried] = (),
    judged: Mapping[NamedNode, bool | None] | None = None,
    length: float | None = None,
) -> dict[Quad, None]:
    """Return the statements about an object that its attempts imply."""
    lengths = [_number(q.object) for q in match(object_iri, RT.extentX)]
    length = min(lengths, default=length)
    if not length:
        return {}
    tries = _attempts(context, match, object_iri, more, judged or {})
    x, fingers, held = (
        np.array([getattr(tried, name) for tried in tries], np.float64)
        for name in ("x", "finger_width", "held")
    )
    triples = Triples()
    for cause in hidden_causes(x / length, fingers / 2 / length, held, MIN_PROBABILITY):
        start, end = cause.start * length, cause.end * length
        side = "positive" if start + end > 0 else "negative"
        node = iri(f"{object_iri.value}/cause/{cause.kind}-{side}")
        explained = [
            tried for tried in tries
            if not tried.held and _touches(tried, start, end) is (cause.kind == "zone")
        ]  # fmt: skip
        reasons = Counter(tried.reason for tried in explained)
        triples.add(object_iri, RT.hasHiddenCause, node)
        triples.node(node, [RT.HiddenCause], {RT.causeProbability: cause.probability})
        for code in sorted(reasons):
            triples.add(node, RT.explainsReason, reason(code))
        for tried in explained:
            triples.add(node, RT.explainsFailure, tried.attempt)
        for tried in tries:
            triples.add(node, PROV.wasDerivedFrom, tried.attempt)
        if cause.kind == "mass":
            middle, spread = (start + end) / 2, (end - start) / 2
            numbers = {RT.centreAlongX: middle, RT.centreOfMassSigma: spread}
            triples.node(node, [RT.MassOffCentre], numbers)
            continue
        kind = _zone_kind(reasons)
        zone = {RT.zoneStart: start, RT.zoneEnd: end, RT.zoneKind: kind}
        triples.node(node, [RT.GraspZone], zone)
    graph = context.kb.graphs.causes
    return dict.fromkeys(Quad(s, p, object_term(v), graph) for s, p, v in triples)


def _touches(tried: Tried, start: float, end: float) -> bool:
    half = tried.finger_width / 2
    return tried.x + half >= start and tried.x - half <= end


def _zone_kind(reasons: Mapping[str, int]) -> NamedNode | None:
    """Return in which way a zone gives way, as far as the reasons tell."""
    if reasons.get(_FRAGILE):
        return RT.zone_fragile
    if reasons.get(_COMES_OFF):
        return RT.zone_comes_off
    return RT.zone_slippery if any(reasons.get(code) for code in _SLIPS) else None


def _attempts(
    context: Context,
    match: Match,
    object_iri: NamedNode,
    more: Iterable[Tried],
    judged: Mapping[NamedNode, bool | None],
) -> list[Tried]:
    """Return the latest judged attempts from above at an object; their names tell when they were.

    Parameters
    ----------
    more
        Attempts that are not stored yet.
    """
    new = {tried.attempt: tried for tried in more}
    places: dict[NamedNode, float] = dict.fromkeys(new, 0.0)
    for grasp in {q.object for q in match(object_iri, RT.hasGrasp)}:
        x = place_along(match, grasp)
        if x is not None:
            tries = (q.subject for q in match(None, RT.executesGrasp, grasp))
            places.update((tried, x) for tried in tries if isinstance(tried, NamedNode))
    all_tries: list[Tried] = []
    for attempt in sorted(places, key=lambda tried: tried.value, reverse=True):
        tried = new.get(attempt) or _judged(context, match, attempt, places[attempt], judged)
        if tried is not None and (tried.held or tried.reason != LOST_CODE):
            all_tries.append(tried)
            if len(all_tries) == MAX_TRIED:
                break
    return all_tries


def _judged(
    context: Context,
    match: Match,
    attempt: NamedNode,
    x: float,
    judged: Mapping[NamedNode, bool | None],
) -> Tried | None:
    """Return a stored attempt, None if it does not count."""
    # By predicate, because a look-up costs less than what an attempt says besides.
    for outcome in sorted({q.object for q in match(attempt, RT.hasOutcome)}, key=str):
        held, code = _label(match, outcome)
        held = judged.get(attempt, held)
        if held is not None:
            hands = {q.object for q in match(attempt, RT.activates)}
            widths = (float(stored.gripper.finger_width) for stored in context.grippers.all()
                      if stored.iri in hands)  # fmt: skip
            return Tried(attempt, x, held, max(widths, default=0.0), code)
    return None


def place_along(match: Match, grasp: object) -> float | None:
    """Return the place of a grasp from above along x of its object, m; None for one in space."""
    for link in match(grasp, RT.graspPose):
        properties = {q.predicate: q.object for q in match(link.object)}
        if RT.theta in properties and RT.x in properties:
            return _number(properties[RT.x])
    return None


def _label(match: Match, outcome: object) -> tuple[bool | None, str]:
    """Return whether an attempt held, as :func:`rtask.engine.memory.verdicts.label_of` does.

    None if it does not count; also the code of the reason that the robot reported.
    """
    decided, code = None, ""
    latest: dict[object, tuple[str, bool]] = {}
    for quad in match(outcome, RT.success):
        decided = bool(python_value(object_term(quad.object)))
    for quad in match(outcome, RT.hasReason):
        if isinstance(quad.object, NamedNode):
            code = local_name(quad.object.value).removeprefix("reason_")
    for quad in match(outcome, RT.hasFeedback):
        properties = {q.predicate: q.object for q in match(quad.object) if q.predicate != RDF.type}
        if {RT.verdict, PROV.wasAttributedTo, RT.atTime} <= properties.keys():
            when = str(python_value(object_term(properties[RT.atTime])))
            held = bool(python_value(object_term(properties[RT.verdict])))
            who = properties[PROV.wasAttributedTo]
            latest[who] = max(latest.get(who, ("", False)), (when, held))
    if decided is None:
        return None, code
    votes = [held for _, held in latest.values()]
    if votes and 2 * sum(votes) == len(votes):
        return None, code
    label = 2 * sum(votes) > len(votes) if votes else decided
    return (None if label == decided and code in UNJUDGED else label), code


def _number(value: object) -> float:
    return float(str(python_value(object_term(value))))  # type: ignore[arg-type]  # a stored term
