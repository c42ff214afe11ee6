"""Outline of a SPARQL update: its operations, their targets and the spans of their blocks.

Recursive descent over the update grammar only (SPARQL 1.1 Update, 3). The store's parser has
already checked the text, so this one need not detect every error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from rtask.errors import QuerySyntaxError
from rtask.sparql.lexer import find_block_end, tokenise
from rtask.sparql.misspelt import misplaced
from rtask.sparql.tokens import Token, line_and_column

__all__ = ["Block", "Operation", "Target", "read_update"]

_READ_AGAIN = 4_000


@dataclass(frozen=True)
class Block:
    """A ``{ ... }`` block, as tokens ``[start, end)`` including the braces."""

    start: int
    end: int


@dataclass(frozen=True)
class Target:
    """Graph or graphs named by CLEAR, DROP, CREATE, ADD, MOVE, COPY or LOAD.

    Parameters
    ----------
    scope
        ``GRAPH``, ``DEFAULT``, ``NAMED`` or ``ALL``.
    name
        The graph's IRI as written, for ``GRAPH``.
    """

    scope: str
    name: str = ""


@dataclass(frozen=True)
class Operation:
    """One operation of an update.

    Parameters
    ----------
    kind
        ``INSERT DATA``, ``DELETE DATA``, ``MODIFY``, ``LOAD``, ``CLEAR``, ``DROP``, ``CREATE``,
        ``ADD``, ``MOVE`` or ``COPY``.
    prologue
        BASE and PREFIX lines in force.
    delete, insert, where
        Blocks of MODIFY; ``DELETE WHERE`` has the same block twice. DATA blocks are in ``insert``
        or ``delete``.
    with_graph, using, using_named
        IRIs as written.
    source, target, silent
        Of the graph management operations.
    """

    kind: str
    prologue: str
    delete: Block | None = None
    insert: Block | None = None
    where: Block | None = None
    with_graph: str | None = None
    using: tuple[str, ...] = ()
    using_named: tuple[str, ...] = ()
    source: Target | None = None
    target: Target | None = None
    silent: bool = False


@dataclass(frozen=True)
class Update:
    """A whole request.

    Parameters
    ----------
    declarations
        All BASE and PREFIX lines of the text.
    body
        The text with its declarations blanked out, so that positions are unchanged.
    """

    text: str
    tokens: list[Token]
    operations: list[Operation]
    declarations: str
    body: str

    def source(self, block: Block) -> str:
        """Return the text of a block, braces included."""
        return self.text[self.tokens[block.start].start : self.tokens[block.end - 1].end]


def read_update(text: str) -> Update:
    """Return the outline of an update.

    >>> [op.kind for op in read_update("CLEAR ALL ; DELETE WHERE { ?s ?p 1 }").operations]
    ['CLEAR', 'MODIFY']

    Raises
    ------
    QuerySyntaxError
        The text does not parse; gives line and column.
    """
    # A robot repeats few short updates; a long one is a load, and would only fill the cache.
    return _recent(text) if len(text) <= _READ_AGAIN else _read(text)


@lru_cache(maxsize=16)
def _recent(text: str) -> Update:
    """Return the outline of a short text; on its way to the store each is read a few times."""
    return _read(text)


def _read(text: str) -> Update:
    reader = _Reader(text)
    operations = reader.operations()
    body = text
    for start, end in reader.declared:
        # Blanked, not cut out: the line and column of an error in the rest stay those of the text.
        blank = re.sub(r"[^\n]", " ", text[start:end])
        body = body[:start] + blank + body[end:]
    return Update(text, reader.tokens, operations, reader.prologue, body)


class _Reader:
    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = tokenise(text)
        self.at = 0
        self.prologue = ""
        self.declared: list[tuple[int, int]] = []

    def operations(self) -> list[Operation]:
        operations = []
        self._read_prologue()
        while self.tokens[self.at].kind != "end":
            operations.append(self._operation())
            if not self._take_mark(";"):
                break
            self._read_prologue()
        if self.tokens[self.at].kind != "end":
            self._fail("';' or the end")
        return operations

    def _read_prologue(self) -> None:
        while self.tokens[self.at].is_word("PREFIX", "BASE", "VERSION"):
            start = self.tokens[self.at].start
            word = self._need("PREFIX BASE VERSION")
            if word == "PREFIX":
                self._expect("name", "a prefix")
            value = self._expect("string" if word == "VERSION" else "iri", "its value")
            self.declared.append((start, value.end))
            if word != "VERSION":
                self.prologue += self.text[start : value.end] + "\n"

    def _expect(self, kind: str, what: str) -> Token:
        token = self.tokens[self.at]
        if token.kind != kind:
            self._fail(what)
        self.at += 1
        return token

    def _operation(self) -> Operation:
        kind = self._need("LOAD CLEAR DROP CREATE ADD MOVE COPY INSERT DELETE WITH")
        if kind in ("INSERT", "DELETE", "WITH"):
            return self._data(kind) if self._take("DATA") else self._modify(kind)
        silent = bool(self._take("SILENT"))
        if kind == "LOAD":
            source = Target("GRAPH", self._iri())
            into = self._take("INTO")
            return Operation(
                kind,
                self.prologue,
                source=source,
                target=self._target() if into else Target("DEFAULT"),
                silent=silent,
            )
        if kind in ("CLEAR", "DROP", "CREATE"):
            return Operation(kind, self.prologue, target=self._target(), silent=silent)
        source = self._target()
        self._need("TO")
        return Operation(kind, self.prologue, source=source, target=self._target(), silent=silent)

    def _target(self) -> Target:
        scope = self._take("GRAPH", "DEFAULT", "NAMED", "ALL")
        if scope in ("DEFAULT", "NAMED", "ALL"):
            return Target(scope)
        return Target("GRAPH", self._iri())

    def _data(self, kind: str) -> Operation:
        block = self._block()
        if kind == "INSERT":
            return Operation("INSERT DATA", self.prologue, insert=block)
        return Operation("DELETE DATA", self.prologue, delete=block)

    def _modify(self, kind: str) -> Operation:
        with_graph = None
        if kind == "WITH":
            with_graph = self._iri()
            kind = self._need("INSERT DELETE")
        if kind == "DELETE" and self._take("WHERE"):
            block = self._block()
            return Operation("MODIFY", self.prologue, delete=block, where=block)
        delete = self._block() if kind == "DELETE" else None
        insert = self._block() if kind == "INSERT" or self._take("INSERT") else None
        using: list[str] = []
        named: list[str] = []
        while self._take("USING"):
            (named if self._take("NAMED") else using).append(self._iri())
        self._need("WHERE")
        return Operation(
            "MODIFY",
            self.prologue,
            delete=delete,
            insert=insert,
            where=self._block(),
            with_graph=with_graph,
            using=tuple(using),
            using_named=tuple(named),
        )

    def _block(self) -> Block:
        if not self.tokens[self.at].is_mark("{"):
            self._fail("'{'")
        block = Block(self.at, find_block_end(self.tokens, self.at))
        self.at = block.end
        return block

    def _iri(self) -> str:
        token = self.tokens[self.at]
        if token.kind not in ("iri", "name"):
            self._fail("an IRI")
        self.at += 1
        return token.text

    def _take(self, *words: str) -> str | None:
        if not self.tokens[self.at].is_word(*words):
            return None
        self.at += 1
        return self.tokens[self.at - 1].text.upper()

    def _take_mark(self, mark: str) -> bool:
        taken = self.tokens[self.at].is_mark(mark)
        # A bool counts as 0 or 1.
        self.at += taken
        return taken

    def _need(self, words: str) -> str:
        return self._take(*words.split()) or self._fail(words.replace(" ", ", "))

    def _fail(self, expected: str) -> str:
        token = self.tokens[self.at]
        line, column = line_and_column(self.text, token.start)
        message = misplaced(token, expected)
        raise QuerySyntaxError(f"update {line}:{column}: {message}", line=line, column=column)
