"""Precedence of a name's owner over what others have stated of the name.

Robots state facts about the names of each other. Whoever spoke first of another's name would have
the owner's own statements refused, so the owner goes first: statements of others about the name
which contradict the owner's, or make the name one with another, are set aside in the owner's
commit. They go to quarantine, where `rtask quarantine` lists them and puts them back. Only the
statements on which the proof of the contradiction rests are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import Any

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.errors import ForbiddenError, InconsistentError
from rtask.kb.commit.access import Access
from rtask.kb.commit.foreign.supports import Support, support_of
from rtask.kb.commit.quarantine import RESTS_IN, record, records_in
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.minters import Minters
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import Term, TripleKey, triple_key

__all__ = ["MAX_RECORDED", "MAX_SET_ASIDE", "NamePrecedence", "minted_by"]

_SAME_AS = NamedNode(ontology.PREFIXES["owl"] + "sameAs")
_OBJECT_ID = NamedNode(ontology.NS + "objectId")
_ROUNDS = 20
_PRECISE = 2
"""Rounds after which all goes that those at fault have stated of the names, not only what a proof
rests on: a thousand statements could each give one more proof."""
MAX_RECORDED = 500
"""Statements of one commit that go to quarantine; more are only withdrawn, as its record says."""
MAX_SET_ASIDE = 20_000
"""Statements that one commit sets aside."""
_MAX_NAMES = 1_000
"""Names of a change whose identities are looked at."""


def minted_by(term: Term, graphs: Graphs) -> str | None:
    """Return the robot or person in whose namespace a term is, or ``None``.

    >>> minted_by(NamedNode("urn:lab/robot/nao-2/cup"), Graphs("urn:lab/"))
    'nao-2'
    >>> minted_by(NamedNode("urn:cup"), Graphs("urn:lab/")) is None
    True
    """
    return Minters(graphs.base)(term.value) if isinstance(term, NamedNode) else None


class NamePrecedence:
    """Sets aside, for one commit, what others have stated of the author's own names.

    For an operator, each name is treated as its owner would treat it.

    Parameters
    ----------
    access
        The author.
    store
        What is stored before the change.
    seq
        Number of the commit.
    has_schema
        Whether a contributor of a name has the right ``schema``; its statements stay.

    Attributes
    ----------
    supports : list of Support
        What statements have been set aside for, to do so again in a second try.
    moved : list of Quad
        The statements that were set aside.
    """

    def __init__(
        self,
        access: Access,
        graphs: Graphs,
        store: GraphStore,
        seq: int,
        has_schema: Callable[[str], bool],
    ) -> None:
        self._access, self._graphs, self._store, self._seq = access, graphs, store, seq
        self._has_schema = has_schema
        self._rounds = 0
        self.supports: list[Support] = []
        self.moved: list[Quad] = []

    def give_way(self, change: Overlay, supports: Iterable[Support]) -> bool:
        """Withdraw what others have stated of the author's names; return whether there was any."""
        self._rounds += 1
        if self._rounds > _ROUNDS:
            return False
        # Asked again after each round: what is withdrawn may uncover another proof.
        before = len(self.moved)
        for support in supports:
            reason = self._own_statement(support, change)
            if reason is None:
                continue
            words = f"{self._who()} states {_words(reason)}"
            quads = [*self._in_the_way(support)]
            if quads:
                self.supports.append(support)
            for quad in quads:
                self._set_aside(change, quad, words)
            if self._rounds > _PRECISE:
                # Only of those whose statements stood in the way: others may have spoken of the
                # same names with good reason.
                authors = {quad.graph_name for quad in quads}
                terms = {term for quad in quads for term in (quad.subject, quad.object)}
                for quad in list(self._about(terms)):
                    if quad.graph_name in authors:
                        self._set_aside(change, quad, words)
        return len(self.moved) > before

    def _in_the_way(self, support: Support) -> Iterator[Quad]:
        for triple in support.statements:
            yield from self._of_strangers(triple)
        yield from self._about(support.unproven)

    def _about(self, terms: Iterable[Term]) -> Iterator[Quad]:
        """Yield what others have stated of those terms that are the author's own."""
        find = self._store.quads_for_pattern
        for name in filter(self._is_own, terms):
            assert isinstance(name, NamedNode)
            either = chain(find(name, None, None, None), find(None, None, name, None))
            yield from filter(self._is_strangers, either)

    def would_give_way(self, supports: Iterable[Support]) -> bool:
        """Whether there are statements to be set aside."""
        return any(
            next(self._in_the_way(support), None) is not None
            for support in supports
            if support.unproven or self._own_statement(support) is not None
        )

    def give_way_to_ids(self, change: Overlay) -> None:
        """Withdraw the ids that others have given and that the author now gives to its own names.

        Those of the author's names, and those that begin with its name, are its to give.
        """
        # A copy: what is set aside adds its record to the same change.
        for quad in list(change.added):
            if quad.predicate != _OBJECT_ID or not self._is_own(quad.subject):
                continue
            is_own = str(getattr(quad.object, "value", "")).startswith(f"{self._access.agent}/")
            for other in self._store.quads_for_pattern(None, _OBJECT_ID, quad.object, None):
                if other.subject == quad.subject:
                    continue
                if self._is_strangers(other) or (is_own and self._author_gives_way(other)):
                    reason = f"{self._who()} states {_words(triple_key(quad))}"
                    self._set_aside(change, other, reason)

    def identities(self, change: Overlay) -> Iterator[TripleKey]:
        """Yield stored identities of the author's names that a change uses."""
        find, inferred = self._store.quads_for_pattern, self._graphs.inferred
        if len(change.added) > MAX_SET_ASIDE:
            return  # a load: it costs more to look than its names are worth
        if next(iter(find(None, _SAME_AS, None, inferred)), None) is None:
            return
        terms = (
            term
            for quad in change.added
            if self._graphs.is_input(quad.graph_name)
            for term in (quad.subject, quad.object)
        )
        for term in islice(dict.fromkeys(filter(self._is_own, terms)), _MAX_NAMES):
            assert isinstance(term, NamedNode)
            for quad in find(term, _SAME_AS, None, inferred):
                if quad.object != term:
                    yield triple_key(quad)

    def give_way_to_name(self, change: Overlay, support: Support, name: TripleKey) -> None:
        """Withdraw what makes a name of the author one with another, before it is used."""
        reason = f"it makes {name[0]} one with {name[2]}, and {self._who()} names the first"
        for quad in list(self._in_the_way(support)):
            self._set_aside(change, quad, reason)

    def refused(self, error: InconsistentError, clashes: Iterable[Any]) -> Exception:
        """Return the refusal of what contradicts an owner's statement, or the error as it is."""
        # Whoever may change the ontology is told of the clash itself.
        if self._access.may_state_axioms:
            return error
        for clash in clashes:
            statements = support_of(clash).statements
            for triple in filter(self._is_new, statements):
                author = self._stated_by_owner(triple, statements)
                if author is not None:
                    owner, stated = author
                    return ForbiddenError(
                        f"{self._access.role} {self._access.agent} may not state "
                        f"{_words(triple)}: {owner}, who minted the name, states "
                        f"{_words(stated)}, and both cannot hold; nothing was stored",
                        **{**error.details, "charged_to": []},
                        statement=_words(triple),
                        owner=owner,
                        stated=_words(stated),
                    )
        return error

    def remark(self) -> str | None:
        """Return what became of others' statements; ``None`` if nothing did."""
        if not self.moved:
            return None
        first = self.moved[0]
        return (
            f"{len(self.moved)} statements of others stood in the way and were set aside, e.g. "
            f"{_words(triple_key(first))} of {self._graphs.owner(first.graph_name)}"
        )

    def notice(self) -> str | None:
        """Return that statements of the author are in quarantine; ``None`` if there are none."""
        here, home = self._graphs.quarantine, self._access.home()
        named = home if isinstance(home, NamedNode) else None
        count = sum(1 for _ in self._store.quads_for_pattern(None, RESTS_IN, named, here))
        if not count:
            return None
        return (
            f"{count} earlier statements of {self._access.agent} are in quarantine, where they "
            f"have no effect; {here} holds them with the reasons"
        )

    def _own_statement(self, support: Support, change: Overlay | None = None) -> TripleKey | None:
        """Return the author's statement about its own name in a support, if it reaches no other."""
        new = [triple for triple in support.statements if self._is_new(triple)]
        if support.unproven and change is not None:
            terms = set(support.unproven)
            new += [triple_key(q) for q in change.added if q.subject in terms or q.object in terms]
        # A statement that reaches into others' names has no precedence: it is theirs to contradict.
        if any(self._is_of_others(term) for triple in new for term in (triple[0], triple[2])):
            return None
        own = (t for t in new if self._is_own(t[0]) or self._is_own(t[2]))
        return next(own, None)

    def _is_new(self, triple: TripleKey) -> bool:
        held = self._store.quads_for_pattern(*triple, None)
        return not any(self._graphs.is_input(quad.graph_name) for quad in held)

    def _is_own(self, term: Term) -> bool:
        name = minted_by(term, self._graphs)
        # Names without an owner, such as those of imported data, have nobody who goes first.
        return name is not None and (self._access.may_state_axioms or name == self._access.agent)

    def _is_of_others(self, term: Term) -> bool:
        return minted_by(term, self._graphs) is not None and not self._is_own(term)

    def _of_strangers(self, triple: TripleKey) -> Iterator[Quad]:
        return filter(self._is_strangers, self._store.quads_for_pattern(*triple, None))

    def _is_strangers(self, quad: Quad) -> bool:
        """Tell whether somebody without the right states something of a name of the author."""
        author, names = self._graphs.owner(quad.graph_name), (quad.subject, quad.object)
        return self._author_gives_way(quad) and any(
            self._is_own(n) and minted_by(n, self._graphs) != author for n in names
        )

    def _author_gives_way(self, quad: Quad) -> bool:
        """Tell whether a statement is of somebody else without the right."""
        author = self._graphs.owner(quad.graph_name)
        if author is None or author == self._access.agent:
            return False
        return not self._has_schema(author)

    def _stated_by_owner(
        self, triple: TripleKey, support: Sequence[TripleKey]
    ) -> tuple[str, TripleKey] | None:
        """Return who minted a name in a triple, and what that one has stated of it."""
        for term in (triple[0], triple[2]):
            owner = minted_by(term, self._graphs)
            if owner is None or owner == self._access.agent:
                continue
            for other in support:
                held = self._store.quads_for_pattern(*other, None)
                if term in (other[0], other[2]) and any(
                    self._graphs.owner(quad.graph_name) == owner for quad in held
                ):
                    return owner, other
        return None

    def _set_aside(self, change: Overlay, quad: Quad, reason: str) -> None:
        if quad in change.removed or len(self.moved) >= MAX_SET_ASIDE:
            return
        change.remove(quad)
        self.moved.append(quad)
        if len(self.moved) > MAX_RECORDED:
            return
        for line in record(self._graphs, quad, reason, self._seq, records_in(change) + 1):
            change.add(line)

    def _who(self) -> str:
        return self._access.agent or f"an {self._access.role}"


def _words(triple: TripleKey) -> str:
    return " ".join(map(str, triple))
