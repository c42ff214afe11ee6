"""Decide whether a view that looks like a known object is that object.

Recognition compares images. Before an outcome is credited to an object, the size must agree with
the stored one. While the index holds a single object, more evidence is required as well, because
there is no other object that the view could resemble more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rtask.engine.observation import Observation
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, RememberedObject
from rtask.engine.words import contradiction_words

if TYPE_CHECKING:
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.recognition.recogniser import Recogniser, Recognition
    from rtask.engine.networks.embeddings import Embeddings
    from rtask.engine.networks.printed_words import PrintedWords

__all__ = [
    "NEIGHBOUR",
    "has_rivals",
    "is_plausible",
    "neighbour_words",
    "recognise",
    "settle",
    "verdict",
    "weakness",
]

NEIGHBOUR = "also looks like "
"""Begins the sentence about another thing in the picture."""
_FEW_KEYPOINTS = 12
"""Of a view: half of them match at best, and six matches are the least that is compared."""


def recognise(
    recogniser: Recogniser,
    seen: Observation,
    policy: Policy,
    max_results: int,
    min_confidence: float | None = None,
    embeddings: Embeddings | None = None,
    looks: Sequence[Observation] = (),
    min_fused: float | None = None,
    words: PrintedWords | None = None,
) -> Recognition:
    """Match a view, and further ``looks`` at the same object, against the index.

    Where no print was matched, ``embeddings`` propose objects below the confidence of acceptance.
    Where print was, ``words`` are read that may refute it.

    Parameters
    ----------
    min_confidence
        Least confidence of a single look that is accepted.
    min_fused
        The same of several looks of which one is accepted; two that are agree, and need no more.
        None = ``min_confidence``, and where that is None, too, the default of the fusion.
    """
    from features.recognition.fusion import fuse

    answers = [
        _recognise_view(recogniser, look, policy, max_results, min_confidence, embeddings)
        for look in (seen, *looks)
    ]
    if words is not None:
        pairs = zip(answers, (seen, *looks), strict=True)
        answers = [words.weigh(answer, look) for answer, look in pairs]
    return fuse(answers, min_confidence=min_confidence if min_fused is None else min_fused)


def _recognise_view(
    recogniser: Recogniser,
    seen: Observation,
    policy: Policy,
    max_results: int,
    min_confidence: float | None,
    embeddings: Embeddings | None,
) -> Recognition:
    """Match one view; lower the confidence if the index holds a single object.

    Other objects are counted first, so that one inserted by another robot meanwhile is ignored.
    """
    with_rivals = has_rivals(recogniser.index)
    recognition = recogniser.recognise(
        seen.features, min_confidence=min_confidence, max_results=max_results
    )
    if embeddings is not None and not recognition.accepted:
        return embeddings.propose(recognition, seen, max_results, policy.suggestion)
    if with_rivals or not recognition.accepted:
        return recognition
    first = recognition.matches[0]
    if first.by_print or first.inliers >= policy.inliers_when_alone:
        return recognition
    doubted = replace(first, confidence=min(first.confidence, policy.suggestion))
    return replace(recognition, accepted=False, matches=(doubted, *recognition.matches[1:]))


def settle(
    recognition: Recognition, memory: Memory, seen: Observation, policy: Policy
) -> Recognition:
    """Remove the matches from a recognition that the graph contradicts.

    A match is removed if the object is not in the graph or its size differs. The answer stays
    accepted, and another view may decide, only if its first match remains.
    """
    plausible = tuple(
        match
        for match in recognition.matches
        if match.object_iri in memory.objects
        and is_plausible(memory.objects[match.object_iri], seen, policy)
    )
    is_first = bool(plausible) and plausible[0] is recognition.matches[0]
    if not is_first:  # nothing is beside a match that is gone
        plausible = tuple(replace(match, beside="") for match in plausible)
    return replace(
        recognition,
        accepted=recognition.accepted and is_first,
        matches=plausible,
        ask_again=recognition.ask_again and is_first,
    )


def verdict(recognition: Recognition, memory: Memory, seen: Observation | None = None) -> str:
    """Return in a sentence what was recognised, or why nothing was accepted.

    Of a look that nothing was accepted for, ``seen`` says what its picture lacks: a dark one
    resembles nothing, which does not mean that the object is not stored.
    """
    doubts = () if seen is None else seen.frame.doubts
    labels = {iri: item.label for iri, item in memory.objects.items()}
    sentence = _verdict(recognition, memory) + neighbour_words(recognition, labels)
    sentence = "; ".join((sentence, *doubts))
    if recognition.accepted or seen is None or seen.frame.rgb is None:
        return sentence
    from features.imaging.exposure import lacking

    return "; ".join((sentence, *lacking(seen.frame.rgb)))


def _verdict(recognition: Recognition, memory: Memory) -> str:
    if not recognition.matches:
        untried = recognition.views_untried
        if untried:
            views = "1 view that shares" if untried == 1 else f"{untried} views that share"
            was = "was" if untried == 1 else "were"
            return f"resembles no object compared; not decided: {views} its print {was} left out"
        return "resembles no stored object"
    first = recognition.matches[0]
    remembered = memory.objects.get(first.object_iri)
    name = (remembered.label if remembered is not None else "") or first.object_iri
    if recognition.accepted:
        return f"is {name}"
    if recognition.words is not None:
        words = recognition.words
        told = contradiction_words(words.seen.text, words.stored.text, name)
        return f"looks like {name}, but {told}"
    if recognition.differs:
        return f"looks like {name}, but differs {recognition.differs}"
    if recognition.outcome == "null":
        return f"resembles no stored object much; the nearest is {name}"
    if not recognition.ask_again:
        return f"may be {name}"
    if recognition.is_in_other_light:
        return f"may be {name} in another light; a view stored in this light may decide"
    return f"may be {name}; another view may decide"


def neighbour_words(recognition: Recognition, labels: Mapping[str, str]) -> str:
    """Say which other things are in the picture of the first match; empty if none is known.

    Parameters
    ----------
    labels
        What people call the objects, by IRI.
    """
    beside = [
        f"{labels.get(match.object_iri) or match.object_iri}, {match.beside}"
        for match in recognition.matches[1:]
        if match.beside
    ]
    if not beside:
        return ""
    return f"; {NEIGHBOUR}{' and '.join(beside)}: give a box or mask of one of them"


def weakness(seen: Observation) -> str:
    """Return in a sentence why a stored view will hardly be recognised, empty where it may be.

    Without depth print decides alone: a view without any is stored, and never found again.
    """
    count = len(seen.features)
    if count >= _FEW_KEYPOINTS or np.isfinite(seen.features.size_m) or seen.frame.rgb is None:
        return ""
    from features.imaging.exposure import lacking

    sentence = (
        f"hardly any print is seen ({count} keypoint{'' if count == 1 else 's'}), and without "
        "depth nothing else is recognised: store another picture"
    )
    return "; ".join((sentence, *lacking(seen.frame.rgb)))


def is_plausible(remembered: RememberedObject, seen: Observation, policy: Policy) -> bool:
    """Tell whether the measured size can be that of a known object.

    The three extents are compared in order of size, since an object that has fallen over shows
    other sides. An object cut off by the border of the image may look smaller than it is, and one
    seen without a camera pose has no size.
    """
    if remembered.size is None or seen.shape is None or not seen.is_posed:
        return True
    here = np.sort([seen.shape.length, seen.shape.width, seen.shape.height])
    there = np.sort(remembered.size)
    too_large = here > there * policy.size_gate + policy.size_gate_m
    too_small = here < there / policy.size_gate - policy.size_gate_m
    return not (too_large.any() or (too_small.any() and not seen.features.is_cut))


def has_rivals(index: RecognitionIndex) -> bool:
    """Tell whether the index holds views of more than one object."""
    first = ""
    for name in index.views():
        if first and name.object_iri != first:
            return True
        first = name.object_iri
    return False
