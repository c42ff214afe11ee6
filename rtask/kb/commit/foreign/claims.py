"""Contested keys: things of several contributors that have the same value of a key.

A serial number tells which robot a thing is, but anybody can state it of a thing of its own, and
nobody here can know who is right. So both statements stand, and the reasoner makes nothing of it
(`reasoner.fixpoint.ownership`); whoever states such a value is told, and `rtask doctor` lists them
until an operator withdraws one or states that the two are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.minters import Minters
from rtask.rdf.terms import RDF_TYPE, Subject, Term

__all__ = ["MAX_CLAIMS", "MAX_SHARERS", "ContestedKey", "Keys", "contested_keys"]

_OWL, _RDF = ontology.PREFIXES["owl"], ontology.PREFIXES["rdf"]
_SAME_AS = NamedNode(_OWL + "sameAs")
_KEYS = f"""
SELECT ?p ?list ?kind {{
    {{ GRAPH ?g {{ ?p a <{_OWL}InverseFunctionalProperty> }} }}
    UNION
    {{ GRAPH ?g {{ ?kind <{_OWL}hasKey> ?list . ?list <{_RDF}rest>*/<{_RDF}first> ?p }} }}
}}"""
_MAX_LENGTH = 100
MAX_CLAIMS = 20
"""Statements of a commit of which it is looked whether others have the same value of a key."""
MAX_SHARERS = 20
"""Statements of one value that are looked at: a robot could give thousands of its things one."""


@dataclass(frozen=True)
class ContestedKey:
    """Two things of different contributors with the same values of a key.

    Parameters
    ----------
    first, second
        The things.
    statement
        One of the first that the second has as well.
    owners
        Who minted their names; ``None`` for names of nobody.
    """

    first: Subject
    second: Subject
    statement: Quad
    owners: tuple[str | None, str | None]

    def __str__(self) -> str:
        who = " and ".join(owner or "nobody in particular" for owner in self.owners)
        return (
            f"{self.first} and {self.second}, names of {who}, both have {self.statement.predicate} "
            f"{self.statement.object}, a key"
        )


class Keys:
    """The keys of a graph: lists of properties whose values together belong to one thing.

    Parameters
    ----------
    of
        For each list its class; ``None`` for an inverse functional property, a key of all.
    """

    def __init__(self, of: Iterable[tuple[tuple[NamedNode, ...], Term | None]] = ()) -> None:
        self.of = list(of)
        self._of_property: dict[NamedNode, list[tuple[tuple[NamedNode, ...], Term | None]]] = {}
        for key in self.of:
            for name in key[0]:
                self._of_property.setdefault(name, []).append(key)

    @classmethod
    def read(cls, store: GraphStore) -> Keys:
        """Return the keys that a store holds."""
        names: dict[Term | None, dict[NamedNode, None]] = {}
        kinds: dict[Term | None, Term | None] = {}
        unique: dict[NamedNode, None] = {}
        for row in store.query(_KEYS):
            name, cell = row["p"], row["list"]
            if not isinstance(name, NamedNode):
                continue
            if cell is None:
                unique[name] = None
            else:
                names.setdefault(cell, {})[name] = None
                kinds[cell] = row["kind"]
        keys: dict[tuple[tuple[NamedNode, ...], Term | None], None] = {}
        keys.update(dict.fromkeys(((name,), None) for name in unique))
        keys.update(dict.fromkeys((tuple(names[cell]), kinds[cell]) for cell in names))
        return cls(keys)

    def remark(self, added: Iterable[Quad], store: GraphStore, graphs: Graphs) -> str | None:
        """Return what the author of a commit is told of keys that others claim as well."""
        concerned = (quad for quad in added if quad.predicate in self._of_property)
        claim = next(self.contested(islice(concerned, MAX_CLAIMS), store, graphs), None)
        if claim is None:
            return None
        return (
            f"{claim}; both stand, and are not taken for one thing. An operator sees them in rtask "
            "doctor, and can withdraw one or state that they are the same"
        )

    def contested(
        self, quads: Iterable[Quad], store: GraphStore, graphs: Graphs
    ) -> Iterator[ContestedKey]:
        """Yield what statements in the store, or about to be, give of keys that others have.

        Of the statements of one value it looks at some only.
        """
        owner = Minters(graphs.base)
        concerned = (quad for quad in quads if quad.predicate in self._of_property)
        # In batches: a store elsewhere answers one request for many values.
        while some := list(islice(concerned, MAX_CLAIMS)):
            held = store.with_values([(q.predicate, q.object) for q in some], MAX_SHARERS)
            for number, other in held:
                quad = some[number]
                mine, theirs = _owner(quad.subject, owner), _owner(other.subject, owner)
                # What was inferred is nobody's claim.
                if theirs != mine and graphs.is_input(other.graph_name):
                    pair = (quad.subject, other.subject)
                    keys = self._of_property[quad.predicate]
                    if any(_have_same(pair, key, store) for key in keys):
                        yield ContestedKey(*pair, quad, (mine, theirs))


def contested_keys(store: GraphStore, graphs: Graphs, limit: int = 1_000) -> list[ContestedKey]:
    """Return all contested keys, each pair of things once."""
    keys = Keys.read(store)
    claims: dict[frozenset[Subject], ContestedKey] = {}
    for properties, _ in keys.of:
        # The first property is enough to find the pairs; the others are compared then.
        stated = store.quads_for_pattern(None, properties[0], None, None)
        own = (quad for quad in stated if graphs.is_input(quad.graph_name))
        for claim in keys.contested(own, store, graphs):
            claims.setdefault(frozenset((claim.first, claim.second)), claim)
            if len(claims) == limit:
                return [*claims.values()]
    return [*claims.values()]


def _owner(term: Subject, owner: Minters) -> str | None:
    return owner(term.value) if isinstance(term, NamedNode) else None


def _have_same(
    pair: tuple[Subject, Subject],
    key: tuple[tuple[NamedNode, ...], Term | None],
    store: GraphStore,
) -> bool:
    """Tell whether two things that are not known to be one agree in the values of a key."""
    (first, second), (properties, kind) = pair, key

    def holds(subject: Subject, predicate: NamedNode, value: Term) -> bool:
        return any(True for _ in store.quads_for_pattern(subject, predicate, value, None))

    if kind is not None and not all(holds(thing, RDF_TYPE, kind) for thing in pair):
        return False
    # Said to be one already: nothing to decide. Either direction, since reasoning may be off.
    if holds(first, _SAME_AS, second) or holds(second, _SAME_AS, first):
        return False
    return all(
        any(
            holds(second, name, quad.object)
            for quad in islice(store.quads_for_pattern(first, name, None, None), _MAX_LENGTH)
        )
        for name in properties
    )
