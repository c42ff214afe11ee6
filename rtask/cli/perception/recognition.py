"""Recognition of the objects in a file, without writing to the knowledge base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from features.geometry import Frame
    from features.recognition import Recognition as Answer
    from features.recognition import RecognitionIndex, ViewFeatures
    from rtask.engine.networks.printed_words import PrintedWords
    from rtask.engine.observation import Observation
    from rtask.engine.perception.poses import ObjectPose
    from rtask.engine.stored import Models
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["Seen", "index_of", "look", "short_name", "with_pose"]


@dataclass(frozen=True)
class Seen:
    """One object in a view, with its features, the answer of recognition and its pose.

    ``names`` holds what people call the objects that match, by IRI.
    """

    label: int
    crop: Frame
    features: ViewFeatures
    answer: Answer
    pose: ObjectPose | None = None
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Short label: what it is, the two things that it may be, or a question mark."""
        if self.answer.outcome == "multiple" and not self.answer.accepted:
            both = " or ".join(short_name(match.object_iri) for match in self.answer.matches[:2])
            return f"{self.label}: {both}?"
        if not self.answer.accepted:
            return f"{self.label}: ?"
        first = self.answer.matches[0]
        short = self.names.get(first.object_iri) or short_name(first.object_iri)
        name = f"{self.label}: {short} {first.confidence:.2f}"
        return name if self.pose is None else f"{name}, pose {self.pose.confidence:.2f}"


def index_of(kb: KnowledgeBase) -> RecognitionIndex:
    """Return an index in memory, built from the graph; the one on disk belongs to the server."""
    from features.recognition import RecognitionIndex
    from rtask.engine.stored import stored_views

    index = RecognitionIndex()
    for row in stored_views(kb):
        features = row.features(kb)
        if features is not None:
            index.add(row.view, row.object, row.class_iri, features)
    index.save()
    return index


def look(
    crops: list[tuple[int, Frame]],
    index: RecognitionIndex,
    min_confidence: float | None,
    further: Sequence[Frame] = (),
    words: PrintedWords | None = None,
) -> list[Seen]:
    """Recognise the objects of a view.

    Parameters
    ----------
    crops
        Label and crop of each object.
    min_confidence
        Lowest confidence of an accepted answer; ``None`` for the recogniser's own.
    further
        The only object of ``crops`` from other sides.
    words
        Words on stored views, with what reads those of the crops; None = they are not read.
    """
    from features.recognition import Recogniser, Recognition, describe_frame, fuse
    from rtask.engine.perception.identity import has_rivals
    from rtask.engine.policy import Policy

    recogniser = Recogniser(index)
    # A single known object has no rival to be compared with: more inliers are required, as in the
    # engine.
    least = 0 if has_rivals(index) else Policy().inliers_when_alone

    def answer_to(crop: Frame, features: ViewFeatures) -> Recognition:
        answer = recogniser.recognise(features, min_confidence=min_confidence)
        is_doubtful = answer.accepted and answer.matches[0].inliers < least
        answer = replace(answer, accepted=False) if is_doubtful else answer
        return answer if words is None else words.weigh(answer, _observed(crop, features))

    others = [answer_to(crop, describe_frame(crop)) for crop in further]
    seen = []
    for label, crop in crops:
        features = describe_frame(crop)
        answer = fuse([answer_to(crop, features), *others], min_confidence=min_confidence)
        seen.append(Seen(label, crop, features, answer))
    return seen


def _observed(crop: Frame, features: ViewFeatures) -> Observation:
    """Return an observation of which only the camera is known, not where the table is."""
    import numpy as np

    from rtask.engine.observation import Observation

    nothing = np.empty((0, 3))
    return Observation(b"", crop, features, np.eye(4), nothing, None, is_posed=False)


def with_pose(models: Models, view: Seen) -> Seen:
    """Return an object with names, and its pose where a stored model or view determines it."""
    from rtask.engine.memory.question import Question
    from rtask.engine.memory.recall import recall
    from rtask.engine.perception.poses import find_pose

    iris = tuple(match.object_iri for match in view.answer.matches)
    if not iris:
        return view
    remembered = recall(models.kb, Question(objects=iris)).objects
    view = replace(
        view,
        names={name: remembered_object.label for name, remembered_object in remembered.items()},
    )
    if not view.answer.accepted:
        return view
    match = view.answer.matches[0]
    memory = recall(models.kb, Question(objects=(match.object_iri,), views=(match.view_iri,)))
    seen = _observed(view.crop, view.features)
    remembered_object = memory.objects.get(match.object_iri)
    return replace(view, pose=find_pose(models, seen, remembered_object, match, memory))


def short_name(name: str) -> str:
    """Return the last two parts of an IRI.

    >>> short_name("https://example.org/lab/object/7/")
    'object/7'
    """
    return "/".join(name.rstrip("/").split("/")[-2:])
