"""Which other stored objects look like a stored one?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.perception.views import view_features
from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.recognition.views.view import ViewFeatures
    from rtask.engine.engine import Engine

__all__ = ["look_alikes"]


def look_alikes(engine: Engine, thing: NamedNode, description: str | None) -> dict[str, Any]:
    """Answer with the other objects that look like a stored one, best first; writes nothing.

    Its newest view is compared as if the object itself were not stored, for it would outdo all
    others.

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

    kinds = engine.classes.find(description) if description else []
    answer: dict[str, Any] = {"similar_objects": [], "suggestions": []}
    if description and not kinds:
        return {**answer, "suggestions": engine.classes.suggestions(description)}
    snapshot = engine.index.snapshot()
    found = [
        (candidate, snapshot.object_iris[candidate.object_number])
        for candidate in engine.recogniser.gather(_newest(engine, thing), snapshot)
    ]
    others = [(candidate, name) for candidate, name in found if name != thing.value]
    constants = engine.recogniser.params.confidence
    sure = confidences([candidate.evidence for candidate, _ in others], constants)
    question = Question(
        objects=tuple(name for _, name in others), only=tuple(kind.iri.value for kind in kinds)
    )
    memory = recall(engine.kb, question).objects
    for k in sorted(range(len(others)), key=lambda k: -sure[k]):
        known = memory.get(others[k][1])
        if known is not None:
            answer["similar_objects"].append(
                {
                    "class": known.short_id,
                    "class_iri": known.class_iri,
                    "object": known.iri,
                    "label": known.label,
                    "confidence": float(sure[k]),
                    **dict.fromkeys(("X", "Y", "Z", "rad", "grasp")),
                }
            )
    return answer


def _newest(engine: Engine, thing: NamedNode) -> ViewFeatures:
    """Return what the newest view of an object shows; the names of views sort by age."""
    for quad in sorted(engine.kb.match(thing, RT.hasView), key=str, reverse=True):
        assert isinstance(quad.object, NamedNode)
        features = view_features(engine.kb, quad.object)
        if features is not None:
            return features
    raise UnknownTermError(f"object: no view of {thing.value} can be compared", field="object")
