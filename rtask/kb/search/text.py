"""Full-text search over names, labels, comments and descriptions (SQLite FTS5)."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pyoxigraph import Literal, NamedNode, Quad

from rtask.errors import UsageError
from rtask.rdf.namespaces import RT

if TYPE_CHECKING:
    import sqlite3

__all__ = ["TextHit", "TextTable", "single_words", "words_of"]

_RDFS = "http://www.w3.org/2000/01/rdf-schema#"
_SKOS = "http://www.w3.org/2004/02/skos/core#"
_DCT = "http://purl.org/dc/terms/"
_SCHEMA = "https://schema.org/"
PROPERTIES = (
    RT.name.value,
    _RDFS + "label",
    _RDFS + "comment",
    _SKOS + "prefLabel",
    _SKOS + "altLabel",
    _SKOS + "definition",
    _DCT + "title",
    _DCT + "description",
    _SCHEMA + "name",
    _SCHEMA + "description",
    RT.wordText.value,
)
_TEXT_TYPES = {
    "http://www.w3.org/2001/XMLSchema#string",
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString",
}


@dataclass(frozen=True)
class TextHit:
    """A search hit: a text and the subject it describes.

    Parameters
    ----------
    subject
        IRI of the thing described; of a word that was read on a view, the object that shows it.
    bearer
        What has the text as its property: the subject itself, or that word.
    score
        Relevance, larger is better (BM25, Robertson and Zaragoza 2009); meaningful only for
        sorting.
    """

    subject: NamedNode
    predicate: NamedNode
    text: str
    language: str | None
    score: float
    bearer: NamedNode


def single_words(text: str) -> list[str]:
    """Return the words of a text as ``rt:wordToken`` has them: small, without accents, each once.

    Examples
    --------
    >>> single_words("Crème BRÛLÉE, 3,5 % crème")
    ['creme', 'brulee', '3', '5']
    """
    apart = unicodedata.normalize("NFKD", text.casefold())
    plain = "".join(c for c in apart if not unicodedata.combining(c))
    return list(dict.fromkeys(re.findall(r"[^\W_]+", plain)))


def words_of(text: str) -> str:
    """Return a search in FTS5 syntax, with each word quoted so that operators have no effect.

    >>> words_of("red cup* OR")
    '"red" "cup"* "OR"'

    Raises
    ------
    UsageError
        If the text contains no word.
    """
    stems = []
    for word in text.split():
        stem = word.rstrip("*")
        if any(c.isalnum() for c in stem):
            stems.append('"' + stem.replace('"', '""') + '"' + ("*" if word != stem else ""))
    if not stems:
        raise UsageError(f"the search text {text!r} contains no word; give at least one")
    return " ".join(stems)


class TextTable:
    """Table of the words in the indexed statements."""

    def __init__(self, properties: tuple[str, ...] = PROPERTIES) -> None:
        self._predicates = frozenset(NamedNode(name) for name in properties)

    @property
    def predicates(self) -> frozenset[NamedNode]:
        """Properties whose texts are indexed."""
        return self._predicates

    def create(self, db: sqlite3.Connection) -> None:
        """Create missing tables."""
        db.execute(
            "CREATE TABLE IF NOT EXISTS texts(id INTEGER PRIMARY KEY, subject TEXT, "
            "predicate TEXT, text TEXT, language TEXT, graph TEXT, "
            "UNIQUE(subject, predicate, graph, language, text))"
        )
        db.execute(
            "CREATE VIRTUAL TABLE IF NOT EXISTS words USING fts5(text, content='texts', "
            "content_rowid='id', tokenize='unicode61 remove_diacritics 2', prefix='2 3')"
        )

    def fill(self, db: sqlite3.Connection, quads: Iterator[Quad]) -> None:
        """Rebuild the table."""
        db.execute("DELETE FROM texts")
        rows = (row for row in map(_row, quads) if row is not None)
        db.executemany(
            "INSERT OR IGNORE INTO texts(subject, predicate, text, language, graph) "
            "VALUES (?, ?, ?, ?, ?)",
            rows,
        )
        db.execute("INSERT INTO words(words) VALUES ('rebuild')")

    def change(self, db: sqlite3.Connection, removed: list[Quad], added: list[Quad]) -> None:
        """Update the table after a commit."""
        for row in filter(None, map(_row, removed)):
            existing = db.execute(
                "SELECT id FROM texts WHERE subject = ? AND predicate = ? AND text = ? "
                "AND language = ? AND graph = ?",
                row,
            ).fetchone()
            if existing is not None:
                db.execute(
                    "INSERT INTO words(words, rowid, text) VALUES ('delete', ?, ?)",
                    (existing[0], row[2]),
                )
                db.execute("DELETE FROM texts WHERE id = ?", existing)
        for row in filter(None, map(_row, added)):
            done = db.execute(
                "INSERT OR IGNORE INTO texts(subject, predicate, text, language, graph) "
                "VALUES (?, ?, ?, ?, ?)",
                row,
            )
            if done.rowcount > 0:
                db.execute("INSERT INTO words(rowid, text) VALUES (?, ?)", (done.lastrowid, row[2]))

    def search(
        self, db: sqlite3.Connection, text: str, language: str | None = None
    ) -> Iterator[TextHit]:
        """Yield hits, best first; a statement in several graphs is yielded once for each."""
        clause, given = "", [words_of(text)]
        if language is not None:
            clause = "AND (language = ? OR language LIKE ? || '-%')"
            given += [language.lower()] * 2
        rows = db.execute(
            "SELECT subject, predicate, texts.text, language, -bm25(words) FROM words "
            f"JOIN texts ON texts.id = words.rowid WHERE words MATCH ? {clause} "
            "ORDER BY bm25(words), subject, texts.text",
            given,
        )
        for subject, predicate, matched_text, tag, score in rows:
            yield TextHit(
                *(NamedNode(subject), NamedNode(predicate), matched_text, tag or None, score),
                NamedNode(subject),
            )


def _row(quad: Quad) -> tuple[str, str, str, str, str] | None:
    value = quad.object
    if not isinstance(value, Literal) or value.datatype.value not in _TEXT_TYPES:
        return None
    assert isinstance(quad.subject, NamedNode)
    graph = getattr(quad.graph_name, "value", "")
    tag = (value.language or "").lower()
    return quad.subject.value, quad.predicate.value, value.value, tag, graph
