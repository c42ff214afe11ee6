"""Insertion of observed objects and grasp outcomes (Gatto 2016, 3.2.4: insert a new object).

One call is one commit in the caller's own graph: new objects, views with their bytes, grasps,
attempts, outcomes, counts. The views are added to the recognition index right after the commit.
"""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import MaxLen, MinLen
from numpy.typing import NDArray
from pydantic import Field

from rtask.engine.curation.naming import described_class, short_id_of
from rtask.engine.memory.causes import StatingCauses, state_causes
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.memory.statistics import Pending
from rtask.engine.names import slug, tail
from rtask.engine.observation import Observation
from rtask.engine.operations.operation import operation
from rtask.engine.perception.growth import grow, old_models, state_model
from rtask.engine.perception.identity import weakness
from rtask.engine.perception.poses import note_heading
from rtask.engine.records.clock import clocked
from rtask.engine.records.exemplars import see_exemplar
from rtask.engine.records.objects import (
    ObjectRecord,
    Sight,
    state_object,
    state_view,
)
from rtask.engine.records.places import Sighting, may_have_moved, state_seen
from rtask.engine.records.prepared import (
    NewObject,
    Prepared,
    Repeated,
    prepare,
    stored_before,
)
from rtask.engine.records.record import (
    Earlier,
    Entry,
    Withdrawn,
    record,
    resolve_grasp,
)
from rtask.engine.terms import find_function, folded
from rtask.engine.triples import Triples
from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Answer, Message, named
from rtask.world import WorldEdit

if TYPE_CHECKING:
    from features.modelling import ObjectModel
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["InsertObject", "Inserted", "InsertedObject", "insert_object"]

log = logging.getLogger(__name__)

_UNKNOWN_GRIPPER = "unknown"


class InsertObject(Message):
    """A list of observed objects, or the fields of a single one."""

    entries = "objects"
    objects: Annotated[list[NewObject], MinLen(1), MaxLen(32)]
    """the observed objects"""


class Resembled(Answer):
    """A stored object that a new one may be."""

    object: str
    label: str
    confidence: float


class InsertedObject(Answer):
    """Result for one entry."""

    object: str
    class_: str = named("class")
    class_iri: str
    label: str
    grasp: str
    view: str
    new: bool
    features: int
    commit: str
    thing: str = ""
    """IRI of the single thing that was seen; empty if its place is not certain"""
    same_print: list[str] = Field(default_factory=list)
    """IRIs of other objects that carry the print of this view: sight does not tell them apart"""
    resembles: Resembled | None = None
    """the stored object that a new one may be: another view decides; absent without one"""
    message: str = ""
    """both in words, what was wrong with the robot's clock, and that a view shows hardly any print;
    empty if nothing is to be said"""


class Inserted(Answer):
    """Result of an insertion."""

    stored: int
    """number of newly stored entries"""
    commit: str
    objects: list[InsertedObject]


@operation("write", "writes", "store what was seen and the outcome of grasping it", deferrable=True)
def insert_object(context: Context, request: InsertObject, access: Access) -> Inserted:
    """Store a list of objects in one commit; one invalid entry rejects them all."""
    prepared = []
    for k, item in enumerate(request.objects):
        where = f"objects[{k}]."
        try:
            prepared.append(prepare(context, item, where, access))
        except UnknownTermError as error:
            raise type(error)(f"{where.rstrip('.')}: {error}", **error.details) from error
    grippers = [
        prepared_item.gripper for prepared_item in prepared if prepared_item.gripper is not None
    ]
    fallback = grippers[0].robot_name if grippers else None
    with context.writing:
        author = context.author(access, fallback)
        writer = _Writer(context, author, access)
        entries = [writer.write(prepared_item) for prepared_item in prepared]
        rights = StatingCauses.of(author)
        with context.kb.transaction(access=rights, note="insert objects") as tx:
            for subject, predicate, value in writer.withdrawn:
                tx.remove(subject, predicate, value)
            writer.triples.write(tx)
            state_causes(writer.pending.causes, tx)
        commit = context.commit_id(tx.commit) if tx.commit.added else ""
        for view, object_iri, class_iri, seen in writer.views:
            context.views.learn(view, object_iri, class_iri, seen.features)
        if context.views.embeddings is not None:
            for view, object_iri, class_iri, vector in writer.vectors:
                context.views.embeddings.learn(view.value, object_iri.value, class_iri, vector)
        for blob, model in writer.models:
            context.models.keep(blob, model)
    if writer.views:
        context.views.prepare([view for view, *_ in writer.views])
    stored = {view.value for view, *_ in writer.views}
    objects = [
        InsertedObject(**{**entry, "commit": commit, **_others(context, entry, stored)})
        for entry in entries
    ]
    return Inserted(stored=writer.stored, commit=commit, objects=objects)


class _Writer:
    """Converts prepared entries to triples; the caller holds the engine's write lock."""

    def __init__(self, context: Context, author: Access, access: Access) -> None:
        self.context = context
        self.author = author
        self.access = access
        self.graph = context.home_graph(author)
        self.agent = context.agent_iri(author)
        self.triples = Triples()
        self.pending = Pending()
        self.withdrawn: Withdrawn = []
        self.views: list[tuple[NamedNode, NamedNode, str, Observation]] = []
        self.vectors: list[tuple[NamedNode, NamedNode, str, NDArray[np.float32]]] = []
        self.models: list[tuple[str, ObjectModel]] = []
        self.stored = 0
        self._grown_objects: set[NamedNode] = set()
        self._answered: dict[str, dict[str, Any]] = {}

    def write(self, prepared: Prepared | Repeated) -> dict[str, Any]:
        """Add the triples of one entry unless its id is already stored; return its result."""
        if isinstance(prepared, Repeated):
            return self._answer_again(prepared.before)
        task_id = prepared.item.task_id
        if task_id in self._answered:
            return {**self._answered[task_id], "new": False}
        # Checked again under the lock, since the same request may arrive twice at once.
        before = stored_before(self.context, task_id, self.author, prepared.gripper)
        if before is not None:
            return self._answer_again(before)
        if self._may_be_twin(prepared):
            again = prepare(self.context, prepared.item, prepared.where, self.access)
            if isinstance(again, Repeated):
                return self._answer_again(again.before)
            prepared = again
        answer = self._write_new(
            prepared, task_id or self.context.names.task(self.author.agent).value
        )
        self.stored += 1
        if task_id:
            self._answered[task_id] = answer
        return answer

    def _may_be_twin(self, prepared: Prepared) -> bool:
        """Tell whether an unknown object may have been stored since recognition.

        Robots that insert the same product at the same time all find it unknown. All but the
        first must recognise it again, or one product becomes several objects.
        """
        return (
            prepared.existing is None
            and prepared.item.merge
            and prepared.generation != self.context.views.generation
        )

    def _answer_again(self, before: Earlier) -> dict[str, Any]:
        """Return the result of a repeated request: what the first one stored."""
        question = Question(objects=(before.object_iri,))
        existing = recall(self.context.kb, question).objects.get(before.object_iri)
        return _entry(
            before.object_iri,
            existing.class_iri if existing else "",
            existing.short_id if existing else "",
            existing.label if existing else "",
            before.grasp,
            before.view,
            False,
            0,
        )

    def _write_new(self, prepared: Prepared, task_id: str) -> dict[str, Any]:
        context, is_new = self.context, prepared.existing is None
        if prepared.existing is None:
            object_iri, class_iri, short_id, label = self._new_object(prepared)
        else:
            object_iri, class_iri = iri(prepared.existing.iri), prepared.existing.class_iri
            short_id, label = prepared.existing.short_id, prepared.existing.label
        robot = prepared.gripper.robot if prepared.gripper else None
        note_heading(context, robot, object_iri.value, prepared.seen, prepared.placement)
        event, view = context.names.unique("observation"), prepared.view
        now = dt.datetime.now(dt.UTC)
        time, wrong = clocked(prepared.seen.stamp_s, context.policy.clock_ahead_s, now)
        camera = prepared.gripper.camera if prepared.gripper else None
        state_view(
            context,
            self.triples,
            object_iri,
            Sight(
                prepared.seen,
                prepared.placement,
                view,
                event,
                camera,
                self.agent,
                task_id,
                time,
                self._grown(prepared, object_iri),
            ),
        )
        exemplar = self._see(prepared, object_iri, event, time, now)
        embeddings = context.views.embeddings
        if embeddings is not None and prepared.vector is not None:
            embeddings.state(self.triples, view, prepared.vector)
            self.vectors.append((view, object_iri, class_iri, prepared.vector))
        if context.words is not None and prepared.words is not None:
            context.words.state(self.triples, view, prepared.words)
        grasp, handled = self._grasp(prepared, object_iri, task_id, event, (time, now), exemplar)
        self.views.append((view, object_iri, class_iri, prepared.seen))
        features = len(prepared.seen.features)
        entry = _entry(
            object_iri.value,
            class_iri,
            short_id,
            label,
            grasp.value if grasp else "",
            view.value,
            is_new,
            features,
        )
        clock = wrong or (prepared.outcome.clock if prepared.outcome else "")
        doubts = prepared.seen.frame.doubts
        remarks = [remark for remark in (clock, *doubts, weakness(prepared.seen)) if remark]
        message = {"message": "; ".join(remarks)} if remarks else {}
        return {**entry, "thing": handled, **self._resembled(prepared, object_iri), **message}

    def _see(
        self,
        prepared: Prepared,
        object_iri: NamedNode,
        event: NamedNode,
        time: dt.datetime,
        now: dt.datetime,
    ) -> str:
        """State where the object is; return the single thing, or "" if the place is not certain."""
        if prepared.located is None:
            return ""
        moved = None
        if prepared.outcome is not None and may_have_moved(prepared.outcome):
            _, moved = prepared.outcome.span(now)
        robot = prepared.gripper.robot if prepared.gripper else self.agent
        sighting = Sighting(
            object_iri, prepared.located, robot, self.agent, self.graph, time, event, moved=moved
        )
        edit = self.pending.world = self.pending.world or WorldEdit(self.context.world, self.graph)
        exemplar = see_exemplar(self.context, edit, sighting, prepared.item.thing or "")
        sighting = replace(sighting, exemplar=exemplar)
        self.withdrawn += state_seen(self.context, self.triples, sighting)
        added, removed = edit.drain()
        self.triples.extend(added)
        self.withdrawn += removed
        return exemplar

    def _resembled(self, prepared: Prepared, object_iri: NamedNode) -> dict[str, Any]:
        """State which object a new one may be, for the search for twins; return it."""
        if prepared.resembles is None:
            return {}
        other, confidence = prepared.resembles
        reifier = self.context.names.unique("statement")
        self.triples.with_confidence(reifier, object_iri, RT.similarTo, iri(other.iri), confidence)
        return {"resembles": Resembled(object=other.iri, label=other.label, confidence=confidence)}

    def _grown(self, prepared: Prepared, object_iri: NamedNode) -> NDArray[np.float64] | None:
        """Add the model grown by this view; return the pose of the camera by the model."""
        growth, context = prepared.growth, self.context
        if growth is None:
            return None
        is_new = context.names.is_new(object_iri)
        now = None if is_new else context.models.of(object_iri)
        if object_iri in self._grown_objects or growth.before != (
            "" if now is None else now[0].blob
        ):
            # Another view was added in between and would be lost.
            if object_iri in self._grown_objects:
                return None
            growth = grow(
                context.models,
                object_iri,
                prepared.seen,
                growth.registration.object_from_camera,
                prepared.view,
                prepared.placement is not None and prepared.placement.is_round,
            )
            if growth is None:
                return None
        self._grown_objects.add(object_iri)
        if not is_new:
            self.withdrawn += [old[:3] for old in old_models(context.kb, object_iri, self.graph)]
        _, blob = state_model(context, self.triples, object_iri, growth.model)
        self.models.append((blob, growth.model))
        existing = prepared.existing is not None and prepared.existing.is_round
        return None if existing else growth.registration.object_from_camera

    def _grasp(
        self,
        prepared: Prepared,
        object_iri: NamedNode,
        task_id: str,
        event: NamedNode,
        times: tuple[dt.datetime, dt.datetime],
        exemplar: str,
    ) -> tuple[NamedNode | None, str]:
        """Store the attempt of an entry; return its grasp and the single thing.

        Parameters
        ----------
        times
            When the object was seen, and now.
        """
        seen_at, now = times
        if prepared.grasp is None or prepared.outcome is None:
            return None, exemplar
        if prepared.gripper is None:
            grasp, _ = resolve_grasp(
                self.context, self.triples, object_iri, _UNKNOWN_GRIPPER, prepared.grasp
            )
            return grasp, exemplar
        decision = self.context.decisions.get(prepared.item.task_id)
        recorded = record(
            self.context,
            self.triples,
            Entry(
                object_iri,
                prepared.gripper,
                prepared.grasp,
                prepared.outcome,
                prepared.item.task,
                task_id,
                now,
                self.graph,
                decision,
                event,
                exemplar,
                None if prepared.located is None else (prepared.located, seen_at),
            ),
            self.pending,
        )
        self.withdrawn += recorded.withdrawn
        return recorded.grasp, recorded.exemplar

    def _new_object(self, prepared: Prepared) -> tuple[NamedNode, str, str, str]:
        """Add a new object; return it with class, short id and label."""
        context = self.context
        object_iri = context.names.counted("object")
        guess = prepared.seen.guess
        confidence: float | None = None
        class_iri: NamedNode | None = None
        if prepared.item.class_description:
            class_iri = described_class(context, self.triples, prepared.item.class_description)
        elif guess is not None:
            class_iri, confidence = guess
        kind = context.classes.get((class_iri or RT.ManipulableObject).value)
        label = folded(prepared.item.class_description or kind.label)
        name = prepared.item.name or f"{label} {tail(object_iri)}"
        function = prepared.item.function
        state_object(
            context,
            self.triples,
            ObjectRecord(
                iri=object_iri,
                object_id=f"{slug(self.author.agent or 'shared')}/{tail(object_iri)}",
                name=name,
                class_iri=class_iri,
                class_confidence=confidence,
                function=find_function(context.kb, function) if function else None,
            ),
            prepared.seen,
        )
        short_id = short_id_of(context, self.triples, class_iri or RT.ManipulableObject)
        return object_iri, (class_iri or RT.ManipulableObject).value, short_id, name


def _others(context: Context, entry: Mapping[str, Any], stored: Collection[str]) -> dict[str, Any]:
    """Return what the answer says of objects that the one of a stored view is like."""
    view, fields = entry["view"], dict[str, Any]()
    clauses = [entry["message"]] if entry.get("message") else list[str]()
    others = context.views.same_print(iri(view)) if view in stored else ()
    if others:
        existing = recall(context.kb, Question(objects=others)).objects
        names = [existing[name].label if name in existing else name for name in others]
        clauses.append(f"the same print as {', '.join(names)}: sight does not tell them apart")
        fields["same_print"] = list(others)
    resembled: Resembled | None = entry.get("resembles")
    if resembled is not None:
        clauses.append(
            f"stored as new, but may be {resembled.label} ({resembled.confidence:.2f}): before an "
            "insertion, ask recognise_for_grasp with a look from another side as well; `rtask "
            "objects twins` compares the two"
        )
    return {**fields, "message": "; ".join(clauses)} if clauses else {}


def _entry(
    object_iri: str,
    class_iri: str,
    short_id: str,
    label: str,
    grasp: str,
    view: str,
    is_new: bool,
    features: int,
) -> dict[str, Any]:
    return {
        "object": object_iri,
        "class_": short_id,
        "class_iri": class_iri,
        "label": label,
        "grasp": grasp,
        "view": view,
        "new": is_new,
        "features": features,
    }
