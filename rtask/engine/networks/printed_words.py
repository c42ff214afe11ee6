"""Words on stored views: read once, stated in the graph, and compared with those of a query.

Reading is off unless a reader is given (extra ``words``). A word is what anybody may have printed:
it may refute that a view shows an object, and helps to find one; nothing else follows from it.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.engine.observation import Observation
from rtask.engine.stored import Recent
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.extras import naming_extras
from rtask.kb.search.text import single_words
from rtask.rdf.namespaces import PREFIXES, RT, values
from rtask.rdf.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.geometry import UInt8Array
    from features.recognition.recogniser import Match, Recognition
    from features.words.contradiction import WordContradiction
    from features.words.word import Word, WordReader
    from rtask.graph import Graph
    from rtask.kb.core import GraphCore

__all__ = [
    "PrintedWords",
    "UnreadView",
    "default_reader",
    "objects_that_say",
    "reader_by_environment",
    "state_words",
    "unread_views",
    "words_of_objects",
]

log = logging.getLogger(__name__)

_READING = "reading"
_TOKENS, _NAME = 16, 200
_READINGS = 16
"""Latest readings that are kept: a robot sends a view twice, to ask and to report."""


def default_reader() -> WordReader:
    """Return the reader of the extra ``words``.

    Raises
    ------
    MissingExtraError
        The extra is not installed.
    UsageError
        Its installation lacks a network.
    """
    with naming_extras("reading words"):
        from features.words.rapid import RapidReader

        try:
            return RapidReader()
        except ValueError as error:
            raise UsageError(f"reading words: {error}") from error


def reader_by_environment() -> WordReader | None:
    """Return the reader of the extra where RTASK_WORDS asks for it, else None.

    Raises
    ------
    UsageError
        RTASK_WORDS is neither 0 nor 1.
    MissingExtraError
        It asks for an extra that is not installed.
    """
    asked = os.environ.get("RTASK_WORDS", "0")
    if asked not in ("", "0", "1"):
        raise UsageError(f"RTASK_WORDS is {asked!r}: 1 to read words, 0 not to")
    return default_reader() if asked == "1" else None


@dataclass(frozen=True)
class UnreadView:
    """A stored view whose words nobody has read, with the digest of its picture's blob."""

    view: NamedNode
    picture: str
    graph: NamedNode


class PrintedWords:
    """Words on the views of a knowledge base, read by one program.

    Parameters
    ----------
    reader
        The program.
    """

    def __init__(self, kb: GraphCore, reader: WordReader) -> None:
        self._kb = kb
        self._reader = reader
        self._readings: Recent[tuple[Word, ...]] = Recent(_READINGS)

    @property
    def reader_name(self) -> str:
        """Name and version of the program."""
        return self._reader.name

    def read(self, seen: Observation) -> tuple[Word, ...] | None:
        """Return the words of a look; None without a picture of a camera that can be read."""
        if seen.frame.rgb is None or seen.is_rendered:
            return None
        return self.read_picture(seen.frame.rgb, seen.frame.object_mask())

    def read_picture(self, rgb: UInt8Array, mask: NDArray[np.bool_]) -> tuple[Word, ...] | None:
        """Return the words on an object in a picture (h, w, 3) under a mask (h, w).

        None where the reader fails on it: that is not read, and says nothing.
        """
        from features.words.word import words_of_view

        digest = hashlib.sha256(rgb.tobytes())
        digest.update(mask.tobytes())
        key = digest.hexdigest()
        words = self._readings.get(key)
        if words is None:
            try:
                words = words_of_view(self._reader, rgb, mask)
            except ValueError as error:
                log.warning("not read: %s", error)
                return None
            self._readings.put(key, words)
        return words

    def state(self, triples: Triples, view: NamedNode, words: Sequence[Word]) -> None:
        """State that a view was read, and its words."""
        state_words(triples, view, words, self.reader_name)

    def weigh(self, recognition: Recognition, seen: Observation) -> Recognition:
        """Return an answer, no longer accepted where a word contradicts the object's print.

        Only an object accepted by print is doubted. Nothing else has to point to a sibling: where
        one word in small letters is all that differs, no region of the picture does.
        """
        first = recognition.matches[0] if recognition.accepted else None
        if first is None or first.homography is None:
            return recognition
        contradiction = self._contradiction(first, seen)
        if contradiction is None:
            return recognition
        doubted = replace(first, words=contradiction, confidence=min(first.confidence, 0.5))
        matches = sorted((doubted, *recognition.matches[1:]), key=lambda match: -match.confidence)
        return replace(
            recognition,
            outcome="multiple",
            accepted=False,
            matches=tuple(matches),
            family=first.object_iri,
            ask_again=False,
        )

    def _contradiction(self, match: Match, seen: Observation) -> WordContradiction | None:
        """Return the word that the object does not have, where one was clearly read."""
        from features.words.contradiction import contradicting_word

        by_view = words_of_objects(self._kb, [match.object_iri])
        stored = by_view.get(match.view_iri, ())
        if not stored or match.homography is None:
            return None
        seen_words = self.read(seen)
        if not seen_words:
            return None
        vocabulary = {word.text for words in by_view.values() for word in words}
        return contradicting_word(seen_words, stored, vocabulary, match.homography)


def state_words(triples: Triples, view: NamedNode, words: Sequence[Word], reader: str) -> None:
    """State the words of a view as one reading, which may have none."""
    reading = iri(f"{view.value}/{_READING}")
    triples.add(view, RT.viewContent, reading)
    triples.node(reading, [RT.TextReading], {RT.readBy: reader[:_NAME]})
    for number, word in enumerate(words, 1):
        node = iri(f"{reading.value}/{number}")
        triples.add(reading, RT.hasWord, node)
        triples.node(
            node,
            [RT.PrintedWord],
            {
                RT.wordText: word.text,
                RT.readingScore: float(word.score),
                RT.wordU: float(word.centre[0]),
                RT.wordV: float(word.centre[1]),
                RT.wordLength: float(word.length),
                RT.wordHeight: float(word.height),
                RT.wordAngle: float(word.angle),
            },
        )
        for token in single_words(word.text)[:_TOKENS]:
            triples.add(node, RT.wordToken, token)


def objects_that_say(kb: GraphCore, tokens: Iterable[str], most: int) -> dict[str, tuple[str, ...]]:
    """Return the IRIs of at most so many objects on whose views each word was read.

    Parameters
    ----------
    tokens
        As :func:`rtask.kb.search.text.single_words` gives them; words that none shows are left out.
    """
    objects = {}
    for token in dict.fromkeys(tokens):
        rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?object WHERE {{
  ?word rt:wordToken {literal(token)} . ?reading rt:hasWord ?word .
  ?view rt:viewContent ?reading . ?object rt:hasView ?view
}} ORDER BY ?object LIMIT {most}""")
        if rows:
            objects[token] = tuple(str(row.value("object")) for row in rows)
    return objects


def words_of_objects(kb: GraphCore | Graph, objects: Iterable[str]) -> dict[str, tuple[Word, ...]]:
    """Return the stored words of each view of some objects, the surest first, by its IRI."""
    from features.words.word import Word, cleaned

    rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?view ?word ?text ?score ?u ?v ?length ?height ?angle WHERE {{
  VALUES ?object {{ {values(objects)} }}
  ?object rt:hasView ?view . ?view rt:viewContent ?reading . ?reading rt:hasWord ?word .
  ?word rt:wordText ?text ; rt:readingScore ?score ; rt:wordU ?u ; rt:wordV ?v ;
    rt:wordLength ?length ; rt:wordHeight ?height ; rt:wordAngle ?angle
}}""")
    by_view: dict[str, list[Word]] = {}
    for row in rows:
        score, u, v, length, height, angle = (
            float(str(row.value(name))) for name in ("score", "u", "v", "length", "height", "angle")
        )
        # Anybody may have stored it, by another way than this.
        text = cleaned(str(row.value("text")))
        if text and min(length, height) > 0:
            word = Word(text, min(max(score, 0.0), 1.0), (u, v), length, height, angle)
            by_view.setdefault(str(row.value("view")), []).append(word)
    return {
        view: tuple(sorted(words, key=lambda word: (-word.score, word.text)))
        for view, words in by_view.items()
    }


def unread_views(kb: GraphCore) -> list[UnreadView]:
    """Return the views with a picture of a camera and no reading, in the order of their IRIs."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?view (MIN(STR(?blob)) AS ?picture) (MIN(STR(?g)) AS ?graph) WHERE {{
  GRAPH ?g {{ ?view rt:viewContent ?image }} FILTER(?g != {kb.graphs.inferred})
  ?object rt:hasView ?view . ?image a rt:ColorImage ; rt:hasBlob ?blob
  FILTER NOT EXISTS {{ ?image a rt:CloudImage }}
  FILTER NOT EXISTS {{ ?view rt:viewContent/rt:readBy ?reader }}
}} GROUP BY ?view ORDER BY ?view""")
    return [
        UnreadView(
            iri(str(row.value("view"))), str(row.value("picture")), iri(str(row.value("graph")))
        )
        for row in rows
    ]
