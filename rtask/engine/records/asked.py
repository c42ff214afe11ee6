"""Records of what robots asked: where they saw an object, what they were refused, what was decided.

The answer to a robot does not depend on them, so a copy of the graph, which cannot write, answers
at once and passes them on as JSON. Each may arrive twice: ids and times are made where the robot
asked, so that it is stored once, with the time when it happened. The commit has the time when it
was stored.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from rtask.engine.decisions import Decision
from rtask.engine.records.exemplars import see_exemplar
from rtask.engine.records.places import Located, Sighting, state_seen
from rtask.engine.records.refusals import Refusal, store_refusal
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri
from rtask.world import WorldEdit

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["AskedRecord", "DecisionRecord", "PlaceRecord", "RefusalRecord", "keep", "record_of"]

_SIZE = 4


@dataclass(frozen=True)
class PlaceRecord:
    """Place of an object, as a robot saw it.

    Parameters
    ----------
    estimate
        IRI of the estimate of its pose.
    robot
        IRI of the robot to which the frame belongs.
    frame_from_object
        The 16 numbers of the pose (4, 4), row by row, m.
    seen_at
        ISO 8601.
    exemplar
        IRI of the single thing, as the robot was told; empty from servers that tell of none.
    """

    kind: ClassVar[str] = "place"
    estimate: str
    object: str
    robot: str
    frame_id: str
    frame_from_object: tuple[float, ...]
    confidence: float
    is_round: bool
    seen_at: str
    exemplar: str = ""

    def is_news(self, context: Context, author: Access) -> bool:
        """Whether the graph here has no estimate or no placement that still holds."""
        triples = Triples()
        sighting = self._sighting(context, author)
        edit = WorldEdit(context.world, sighting.graph, self.exemplar)
        exemplar = see_exemplar(context, edit, sighting)
        state_seen(context, triples, replace(sighting, exemplar=exemplar))
        return bool(triples) or bool(edit.statements)

    def exemplar_in(self, context: Context, author: Access) -> tuple[str, bool]:
        """Return which single thing it is of, as far as is known here, and whether it is new."""
        sighting = self._sighting(context, author)
        edit = WorldEdit(context.world, sighting.graph, self.exemplar)
        exemplar = see_exemplar(context, edit, sighting)
        return exemplar, not context.kb.match(iri(exemplar))

    def store(self, context: Context, author: Access) -> None:
        """Store it in the author's graph, unless a newer or the same place is known."""
        triples, sighting = Triples(), self._sighting(context, author)
        with context.writing:
            edit = WorldEdit(context.world, sighting.graph, self.exemplar)
            exemplar = see_exemplar(context, edit, sighting)
            sighting = replace(sighting, exemplar=exemplar)
            withdrawn = state_seen(context, triples, sighting)
            if self.exemplar not in ("", exemplar) and not context.kb.match(iri(self.exemplar)):
                # The robot was told of a new one by a copy that did not know this one yet.
                triples.add(iri(self.exemplar), RT.mergedInto, iri(exemplar))
            triples.extend(edit.statements)
            withdrawn += edit.withdrawn
            if not triples:
                return
            with context.kb.transaction(access=author, note="see an object") as tx:
                for subject, predicate, value in withdrawn:
                    tx.remove(subject, predicate, value)
                triples.write(tx)

    def _sighting(self, context: Context, author: Access) -> Sighting:
        pose = np.array(self.frame_from_object, np.float64).reshape(_SIZE, _SIZE)
        return Sighting(
            iri(self.object), Located(pose, self.frame_id, self.confidence, self.is_round),
            iri(self.robot), context.agent_iri(author), context.home_graph(author),
            dt.datetime.fromisoformat(self.seen_at), estimate=iri(self.estimate),
        )  # fmt: skip


@dataclass(frozen=True)
class RefusalRecord:
    """Decision against a grasp.

    Parameters
    ----------
    node
        IRI of the refusal, which the robot was told.
    decision
        ``too_low``, ``confidence``, ``threshold``, ``text`` and ``advice``.
    refused_at
        ISO 8601.
    """

    kind: ClassVar[str] = "refusal"
    node: str
    task: str
    robot: str
    gripper: str
    object: str
    decision: Mapping[str, Any]
    refused_at: str

    def store(self, context: Context, author: Access) -> None:
        """Store it in the author's graph."""
        store_refusal(context, self.refusal, iri(self.node), author)

    @property
    def refusal(self) -> Refusal:
        """The refusal in the engine's terms."""
        return Refusal(
            self.task, iri(self.robot), iri(self.gripper), self.object, self.decision,
            dt.datetime.fromisoformat(self.refused_at),
        )  # fmt: skip


@dataclass(frozen=True)
class DecisionRecord:
    """What was decided for a task, for the report of its outcome.

    Parameters
    ----------
    times
        Durations of the steps, s.
    exemplar
        IRI of the single thing, empty if unknown.
    offers
        Offered grasps by id, as JSON; see :class:`rtask.engine.decisions.Offer`.
    """

    kind: ClassVar[str] = "decision"
    task: str
    object: str
    seed: int
    times: Mapping[str, float] = field(default_factory=dict)
    exemplar: str = ""
    offers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def store(self, context: Context, author: Access) -> None:
        """Remember it, unless the decision itself was made here."""
        if context.decisions.get(self.task) is None:
            context.decisions.put(self.task, self.decided_for(author.agent or ""))

    def decided_for(self, robot: str) -> Decision:
        """Return the decision in the engine's terms.

        Raises
        ------
        ValueError, TypeError, KeyError, AttributeError
            It is none.
        """
        return Decision.from_json(asdict(self), robot)


AskedRecord: TypeAlias = PlaceRecord | RefusalRecord | DecisionRecord
_KINDS: Mapping[str, type[AskedRecord]] = {
    record.kind: record for record in (PlaceRecord, RefusalRecord, DecisionRecord)
}


def keep(context: Context, record: AskedRecord, author: Access) -> None:
    """Store a record, or pass it on where the graph is the copy of another server's."""
    if context.pass_on is None:
        record.store(context, author)
    elif not isinstance(record, PlaceRecord) or record.is_news(context, author):
        context.pass_on({"kind": record.kind, **asdict(record)}, author)


def record_of(given: Mapping[str, Any]) -> AskedRecord:
    """Return the record that JSON holds.

    Raises
    ------
    UsageError
        It is none.

    Examples
    --------
    >>> record_of({"kind": "decision", "task": "t-1", "object": "", "seed": 3}).seed
    3
    """
    values = dict(given)
    kind = _KINDS.get(str(values.pop("kind", "")))
    if kind is None:
        raise UsageError(f"kind: expected one of {', '.join(_KINDS)}")
    try:
        record = kind(**values)
        if isinstance(record, PlaceRecord):
            pose = np.array(record.frame_from_object, np.float64)
            if pose.shape != (_SIZE * _SIZE,) or not np.isfinite(pose).all():
                raise ValueError("frame_from_object: expected 16 finite numbers")
            dt.datetime.fromisoformat(record.seen_at)
        elif isinstance(record, RefusalRecord):
            _ = record.refusal
        else:
            _ = record.decided_for("")
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise UsageError(f"{kind.kind}: {error}") from None
    return record
