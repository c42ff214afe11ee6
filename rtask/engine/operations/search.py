"""Search for known objects that look like an observed one (Gatto 2016, 3.2.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le

from rtask.engine.memory.question import Question, question_for
from rtask.engine.memory.recall import recall
from rtask.engine.memory.statistics import lower_95
from rtask.engine.observation import Observation
from rtask.engine.operations.operation import operation
from rtask.engine.perception.identity import recognise, settle, verdict
from rtask.engine.perception.observation import Looks, observe_all
from rtask.engine.perception.placement import place
from rtask.engine.remembered import Memory, Remembered, RememberedObject
from rtask.engine.stored import view_features
from rtask.engine.words import likeness_words
from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode
from rtask.wire.message import Answer, named
from rtask.wire.types import Probability, Text, Whole

if TYPE_CHECKING:
    from features.recognition.confidence import Evidence
    from features.recognition.recogniser import Match, Recognition
    from features.recognition.views.view import ViewFeatures
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = [
    "SearchObject",
    "SimilarObject",
    "SimilarObjects",
    "best_grasp",
    "match_message",
    "search_object",
    "similar_objects",
    "word_fields",
]


_MAX_RESULTS = 50


class SearchObject(Looks):
    """A request for known objects that look like this one."""

    class_description: Text | None = None
    """restricts the answer to kinds of objects, in words; default: all kinds"""
    max_results: Annotated[Whole, Ge(1), Le(_MAX_RESULTS)] = 10
    """maximum number of objects"""
    min_confidence: Probability | None = None
    """least confidence of an entry; default: by the policy"""


class SimilarObject(Answer):
    """A similar known object, with position and yaw of its best grasp, m and rad, or nulls."""

    class_: str = named("class")
    class_iri: str
    object: str
    label: str
    confidence: float
    X: float | None
    Y: float | None
    Z: float | None
    rad: float | None
    grasp: str | None
    view: str = ""
    """IRI of the stored view that matches best"""
    picture: str = ""
    """SHA-256 of the picture of that view, at /api/blobs; empty if there is none"""
    why: str = ""
    """what the confidence rests on, in words"""


class SimilarObjects(Answer):
    """Similar known objects, best first, or suggested kinds."""

    similar_objects: list[SimilarObject]
    suggestions: list[str]
    outcome: str = "null"
    """null, single or multiple: how many known objects fit"""
    accepted: bool = False
    """whether the first is the object"""
    family: str = ""
    """IRI of the object that it looks like, but differs from; empty otherwise"""
    differs: str = ""
    """where it differs from that: "at the top" and the like"""
    ask_again: bool = False
    """whether a look from another side may decide"""
    in_other_light: bool = False
    """whether a doubt remains because the first was stored in another light than this one"""
    views_untried: int = 0
    """stored views that share some print and were not compared: without an accepted object, it is
    not decided that it is none of theirs"""
    word_seen: str = ""
    """word read in the view in the place of another one of that object; untrusted text, empty if
    words are not read or do not differ"""
    word_stored: str = ""
    """that of the object; untrusted text"""
    message: str = ""
    """which object it is, or why none was accepted, in words"""


@operation("read", "reads", "list known objects that look like this one")
def search_object(context: Context, request: SearchObject, access: Access) -> SimilarObjects:
    """Return the known objects that look alike, best first; write nothing.

    A description restricts the answer to kinds of objects, in the same query.
    """
    seen, looks = observe_all(context, request)
    recognition = recognise(
        context.views.recogniser,
        seen,
        context.policy,
        _MAX_RESULTS,
        request.min_confidence,
        context.views.embeddings,
        looks,
        words=context.words,
    )
    description = request.class_description
    kinds = context.classes.find(description) if description else []
    if description and not kinds:
        suggestions = context.classes.suggestions(description)
        return SimilarObjects(similar_objects=[], suggestions=suggestions)
    only = tuple(kind.iri.value for kind in kinds)
    memory = recall(context.kb, question_for(context.policy, seen, recognition, None, None, only))
    recognition = settle(recognition, memory, seen, context.policy)
    least = request.min_confidence or 0.0
    similar = similar_objects(seen, recognition, memory)
    return SimilarObjects(
        similar_objects=[entry for entry in similar if entry.confidence >= least][
            : request.max_results
        ],
        suggestions=[],
        outcome=recognition.outcome,
        accepted=bool(recognition.accepted),
        family=recognition.family,
        differs=recognition.differs,
        ask_again=bool(recognition.ask_again),
        in_other_light=recognition.is_in_other_light,
        views_untried=recognition.views_untried,
        message=verdict(recognition, memory, seen),
        **word_fields(recognition),
    )


def word_fields(recognition: Recognition) -> dict[str, str]:
    """Return the two words by which a view differs from the object that it looks like."""
    words = recognition.words
    if words is None:
        return {"word_seen": "", "word_stored": ""}
    return {"word_seen": words.seen.text, "word_stored": words.stored.text}


def match_message(match: Match, memory: Memory) -> dict[str, Any]:
    """Return a match in the form used in messages."""
    remembered = memory.objects[match.object_iri]
    return {
        "object": match.object_iri,
        "class_iri": remembered.class_iri,
        "label": remembered.label,
        "confidence": float(match.confidence),
        "inliers": int(match.inliers),
        "view": match.view_iri,
        "picture": memory.pictures.get(match.view_iri, ""),
        "difference": None if match.difference is None else {
            **dict(zip(("left", "top", "width", "height"), match.difference.box, strict=True)),
            "share": float(match.difference.share),
        },
    }  # fmt: skip


def similar_objects(
    seen: Observation, recognition: Recognition, memory: Memory
) -> list[SimilarObject]:
    """Return the matches with the position of each object's best grasp, or nulls without one."""
    answer = []
    for match in recognition.matches:
        remembered = memory.objects.get(match.object_iri)
        if remembered is None:
            continue
        at: dict[str, Any] = {}
        best = best_grasp(memory.of(remembered.iri))
        placement = place(seen, remembered.is_round)
        if best is not None and placement is not None:
            x, y, theta = placement.to_frame(best.x, best.y, best.theta)
            z = float(placement.frame_from_object[2, 3]) + best.z
            at = {"X": x, "Y": y, "Z": z, "rad": theta, "grasp": best.grasp}
        shown = {"view": match.view_iri, "picture": memory.pictures.get(match.view_iri, "")}
        why = likeness_words(match.inliers, match.appearance, match.size_ok)
        answer.append(_entry(remembered, float(match.confidence), why, **shown, **at))
    return answer


def _entry(remembered: RememberedObject, confidence: float, why: str, **at: Any) -> SimilarObject:
    """Return an entry of the answer; nulls stand for the position of a grasp that is not given."""
    return SimilarObject(
        class_=remembered.short_id,
        class_iri=remembered.class_iri,
        object=remembered.iri,
        label=remembered.label,
        confidence=confidence,
        why=why,
        **{**dict.fromkeys(("X", "Y", "Z", "rad", "grasp")), **at},
    )


def best_grasp(grasps: list[Remembered]) -> Remembered | None:
    """Return the most reliable grasp, by its outcomes and then by geometry."""
    return max(
        grasps,
        key=lambda g: (lower_95(g.successes, g.attempts), g.successes, g.quality, g.x, g.y),
        default=None,
    )


def look_alikes(context: Context, object_iri: NamedNode, description: str | None) -> SimilarObjects:
    """Return the other objects that look like a stored one, best first; write nothing.

    Its newest view is compared as if the object itself were not stored, since it would match
    best.

    Parameters
    ----------
    description
        Only objects of the kinds that these words mean.

    Raises
    ------
    UnknownTermError
        The object has no view that can be compared.
    """
    from features.recognition.confidence import confidences

    kinds = context.classes.find(description) if description else []
    if description and not kinds:
        suggestions = context.classes.suggestions(description)
        return SimilarObjects(similar_objects=[], suggestions=suggestions)
    snapshot = context.views.index.snapshot()
    gathered, untried = context.views.recogniser.gather_counted(
        _newest(context, object_iri), snapshot
    )
    candidates = [
        (candidate, snapshot.object_iris[candidate.object_number]) for candidate in gathered
    ]
    others = [(candidate, name) for candidate, name in candidates if name != object_iri.value]
    constants = context.views.recogniser.params.confidence
    sure = confidences([candidate.evidence for candidate, _ in others], constants)
    views = [snapshot.view_iris[candidate.views[0]] for candidate, _ in others]
    question = Question(
        objects=tuple(name for _, name in others), only=tuple(kind.iri.value for kind in kinds),
        views=tuple(sorted(views)),
    )  # fmt: skip
    memory = recall(context.kb, question)
    similar = [
        _entry(
            memory.objects[others[k][1]],
            float(sure[k]),
            _why(others[k][0].evidence),
            view=views[k],
            picture=memory.pictures.get(views[k], ""),
        )
        for k in sorted(range(len(others)), key=lambda k: -sure[k])
        if others[k][1] in memory.objects
    ]
    return SimilarObjects(
        similar_objects=similar, suggestions=[], views_untried=0 if similar else untried
    )


def _why(evidence: Evidence) -> str:
    return likeness_words(evidence.inliers, evidence.appearance, evidence.size_ok)


def _newest(context: Context, object_iri: NamedNode) -> ViewFeatures:
    """Return the features of an object's newest view; names of views sort by age."""
    for quad in sorted(context.kb.match(object_iri, RT.hasView), key=str, reverse=True):
        assert isinstance(quad.object, NamedNode)
        features = view_features(context.kb, quad.object)
        if features is not None:
            return features
    raise UnknownTermError(f"object: no view of {object_iri.value} can be compared", field="object")
