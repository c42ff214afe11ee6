"""Terms as people paste them: every form that a command, a page or an error prints is read here.

A term is ``<IRI>``, a full IRI, a prefixed name (slashes allowed, ``kb:`` for the base of the
graph), either of these with the label that is printed behind it, a name, or a literal as in Turtle.
A name needs quotes only where a literal could stand as well. What is left over after a term is an
error that shows it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias
from typing import Literal as Choice

from pyoxigraph import RdfFormat, parse

import ontology
from rtask.errors import DataError, UnknownTermError, UsageError, nearest
from rtask.kb.store.naming import MAX_LABEL
from rtask.rdf.terms import (
    RDF_TYPE,
    BlankNode,
    Literal,
    NamedNode,
    Subject,
    Term,
    TripleKey,
    iri,
    prologue,
    stored,
)

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Reader", "Role", "reader_of"]

Role: TypeAlias = Choice["subject", "predicate", "object"]
_IRI = re.compile(r"<([^\x00-\x20<>\"{}|^`\\]*)>")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'(?:[^\\]|\\.)*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'',
    re.S,
)
_SUFFIX = re.compile(r"@[A-Za-z]+(?:-[A-Za-z0-9]+)*|\^\^(?:<[^>\s]*>|\S+)")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|true|false")
_PREFIXED = re.compile(r"([A-Za-z][\w.\-]*|):(\S*)")
_BARE_NAME = re.compile(r"[^\W_][^:<>\"'\[\](){}]*")
_ESCAPED = re.compile(r"\\([_~.\-!$&'()*+,;=/?#@%])")
_SCHEMES = ("urn", "mailto", "tag", "file", "data", "did", "info", "doi")
_LANGUAGES = (None, "en", "de", "fr", "es", "it", "nl")
_LISTED = 5
_LABELS = (NamedNode(ontology.NS + "name"), NamedNode(ontology.PREFIXES["rdfs"] + "label"))
_OBJECT_PROPERTY = NamedNode(ontology.PREFIXES["owl"] + "ObjectProperty")


def _nothing_named(_: str) -> Sequence[str]:
    return ()


def _no_labels(_: NamedNode) -> Sequence[str]:
    return ()


def _unknown(_: NamedNode) -> bool:
    return False


@dataclass(frozen=True)
class Reader:
    """Reads terms against one graph, or against the ontology's prefixes alone.

    Parameters
    ----------
    base
        What ``kb:`` stands for; empty where it is not known.
    named
        Returns the IRIs of what has a name.
    labels
        Returns the names of a thing.
    takes_resources
        Whether the values of a property are things, so that a quoted value is a name.
    is_used
        Whether the graph mentions an IRI.
    """

    base: str = ""
    named: Callable[[str], Sequence[str]] = _nothing_named
    labels: Callable[[NamedNode], Sequence[str]] = _no_labels
    takes_resources: Callable[[NamedNode], bool] = _unknown
    is_used: Callable[[NamedNode], bool] = _unknown
    prefixes: Mapping[str, str] = field(init=False)

    def __post_init__(self) -> None:
        own = {"kb": self.base} if self.base else {}
        object.__setattr__(self, "prefixes", {**ontology.PREFIXES, **own})

    def statement(self, subject: str, predicate: str, value: str) -> TripleKey:
        """Return a statement; a value without prefix is a name where the property relates things.

        Raises
        ------
        UsageError
            A part is no term, or the subject or predicate is no IRI.
        UnknownTermError
            Nothing has that name.
        """
        predicate_term = self.term(predicate, "predicate")
        if not isinstance(predicate_term, NamedNode):
            raise UsageError(f"the predicate is an IRI, not {predicate!r}")
        about = self.term(subject, "subject")
        if not isinstance(about, NamedNode):
            raise UsageError(f"the subject is an IRI or a name in quotes, not {subject!r}")
        role: Role = "subject" if self._takes_resources(predicate_term) else "object"
        return about, predicate_term, stored(self.term(value, role))

    def _takes_resources(self, predicate: NamedNode) -> bool:
        return predicate == RDF_TYPE or self.takes_resources(predicate)

    def term(self, text: str, role: Role = "object") -> Term:
        """Return the term of a text.

        Raises
        ------
        UsageError
            The text is no term, or something is left over behind one.
        UnknownTermError
            A name in quotes that nothing has, where only a thing can stand.

        Examples
        --------
        >>> Reader("urn:lab/").term("kb:robot/panda-1")
        <NamedNode value=urn:lab/robot/panda-1>
        >>> Reader().term("rt:Mug extra")
        Traceback (most recent call last):
        rtask.errors.UsageError: 'extra' is left over after the term rt:Mug
        """
        text = text.strip()
        if role == "predicate" and text == "a":
            return RDF_TYPE
        # A shell takes the quotes of a name away before a command sees it.
        if role == "subject" and _BARE_NAME.fullmatch(text) and self.named(text):
            return self.thing(text)
        try:
            term_read = self._whole(text)
        except UsageError:
            name = self._name_as_printed(text) if role == "subject" else ""
            if not name:
                raise
            return self.thing(name)
        if role != "object" and isinstance(term_read, Literal) and _is_plain(term_read):
            return self.thing(term_read.value)
        return term_read

    def _whole(self, text: str) -> Term:
        """Return the term that a text consists of, the label behind it aside."""
        term_read, end = self._read(text)
        rest = text[end:].strip()
        if rest and not (isinstance(term_read, NamedNode) and self._is_label(rest, term_read)):
            raise UsageError(f"{rest[:100]!r} is left over after the term {text[:end]}")
        return term_read

    def _name_as_printed(self, text: str) -> str:
        """Return the name that a text is, with or without quotes around it; empty for none.

        A name may have quotes and backslashes in it, which are printed as they are.
        """
        if not text.isprintable():
            return ""  # an undecodable byte of a command line is in no name
        quoted = text[1:-1] if len(text) > 2 and text[0] == text[-1] == '"' else ""
        return next((name for name in (quoted, text) if name and self.named(name)), "")

    def resource(self, text: str) -> NamedNode:
        """Return the IRI of a thing, class, property or graph, given in any form.

        Raises
        ------
        UsageError, UnknownTermError
            As :meth:`term`, or it is a literal.
        """
        term_read = self.term(text, "subject")
        if not isinstance(term_read, NamedNode):
            raise UsageError(f"expected an IRI, a prefixed name or a name in quotes, not {text!r}")
        return term_read

    def mentioned(self, text: str) -> NamedNode:
        """Return the IRI of what the graph speaks of, given in any form.

        Raises
        ------
        UsageError
            As :meth:`resource`.
        UnknownTermError
            As :meth:`resource`, or no statement mentions it: a question about it would find
            nothing, whatever the graph holds.
        """
        term_read = self.resource(text)
        if not self.is_used(term_read):
            raise UnknownTermError(
                f"no statement mentions {text} ({term_read}); `rtask search` looks for words"
            )
        return term_read

    def thing(self, name: str) -> NamedNode:
        """Return what has a name.

        Raises
        ------
        UnknownTermError
            Nothing has it.
        UsageError
            Several things have it.
        """
        iris = self.named(name)
        if not iris:
            raise UnknownTermError(f'nothing is called "{name}"; `rtask search` looks for words')
        if len(iris) > 1:
            listed = ", ".join(f"<{iri_found}>" for iri_found in iris[:_LISTED])
            more = f" and {len(iris) - _LISTED} more" if len(iris) > _LISTED else ""
            raise UsageError(f'{len(iris)} things are called "{name}": {listed}{more}')
        return iri(iris[0])

    def _read(self, text: str) -> tuple[Term, int]:
        """Return the term at the beginning of a text, and where it ends."""
        if not text:
            raise UsageError("an empty text is not an RDF term")
        if text.startswith(("<<", "[", "(")):
            return self._turtle(text, text), len(text)
        if bracketed := _IRI.match(text):
            return self._iri(bracketed[1], text), bracketed.end()
        if string := _STRING.match(text):
            suffix = _SUFFIX.match(text, string.end())
            end = suffix.end() if suffix else string.end()
            return self._turtle(text[:end], text), end
        if text.startswith("_:"):
            raise UsageError(f"{text!r} is anonymous: it has no name by which it can be given")
        token = text.split(maxsplit=1)[0]
        if _NUMBER.fullmatch(token):
            return self._turtle(token, text), len(token)
        return self._name(token, text), len(token)

    def _name(self, token: str, text: str) -> NamedNode:
        """Return the IRI of a prefixed name, or of a full IRI without brackets."""
        parts = _PREFIXED.fullmatch(token)
        if parts is None:
            raise self._no_term(text)
        prefix, local = parts[1], parts[2]
        namespace = self.prefixes.get(prefix)
        if namespace is not None and not local.startswith("//"):
            return self._iri(namespace + _ESCAPED.sub(r"\1", local), text)
        whole = self._iri(token, text) if prefix else None
        is_iri = prefix.lower() in _SCHEMES or local.startswith("//")
        if whole is None or not (is_iri or self.is_used(whole)):
            raise self._no_term(text, nearest(prefix, list(self.prefixes)))
        return whole

    def _iri(self, value: str, text: str) -> NamedNode:
        try:
            return iri(value)
        except DataError as error:
            raise UsageError(f"{text[:200]!r} is not an RDF term: {error}") from error

    def _turtle(self, piece: str, text: str) -> Term:
        document = f"{prologue(self.prefixes)}<urn:s> <urn:p> {piece} .".encode()
        try:
            (triple,) = parse(document, format=RdfFormat.TURTLE)
        except (SyntaxError, ValueError) as error:
            raise self._no_term(text) from error
        term: Term = triple.object
        if isinstance(term, BlankNode):
            raise UsageError(f"{text!r} is anonymous: it has no name by which it can be given")
        return term

    def _no_term(self, text: str, hint: str = "") -> UsageError:
        return UsageError(
            f"{text[:200]!r} is not an RDF term; write <IRI>, a prefixed name "
            f"(known prefixes: {', '.join(self.prefixes)}), a name in quotes or a literal{hint}"
        )

    def _is_label(self, rest: str, term: NamedNode) -> bool:
        """Return whether a text is the label that is printed behind a term."""
        return rest in {f'"{label[:MAX_LABEL]}"' for label in self.labels(term)}


def _is_plain(value: Literal) -> bool:
    return value.language is None and value.datatype.value.endswith("#string")


def reader_of(kb: GraphCore) -> Reader:
    """Return the reader of terms of a graph."""

    def named(name: str) -> list[str]:
        subjects: set[Subject] = {
            quad.subject
            for label in _LABELS
            for language in _LANGUAGES
            for quad in kb.match(None, label, Literal(name, language=language))
        }
        return sorted(subject.value for subject in subjects if isinstance(subject, NamedNode))

    def labels(term: NamedNode) -> list[str]:
        values = (quad.object for label in _LABELS for quad in kb.match(term, label))
        return [value.value for value in values if isinstance(value, Literal)]

    def takes_resources(predicate: NamedNode) -> bool:
        return bool(kb.match(predicate, RDF_TYPE, _OBJECT_PROPERTY))

    def is_used(term: NamedNode) -> bool:
        quads = kb.store.quads_for_pattern
        matches = (
            quads(term, None, None, None),
            quads(None, term, None, None),
            quads(None, None, term, None),
        )
        if any(next(iter(rows), None) is not None for rows in matches):
            return True
        return term in kb.store.named_graphs()

    return Reader(kb.base, named, labels, takes_resources, is_used)
