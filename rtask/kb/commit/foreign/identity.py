"""Identity of others' individuals: a caller's data may not make one of them the same as another.

A key (`owl:hasKey`), a functional or inverse functional property and a rule each make two names one
individual without a word of identity in what is stated. So this looks at what follows from a
change, not at how it is stated.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice

from pyoxigraph import BlankNode, NamedNode, Quad

import ontology
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.commit.foreign.claims import Keys
from rtask.kb.commit.foreign.supports import Support, leaves_of
from rtask.kb.commit.inference import Staged
from rtask.kb.commit.schema_right import SchemaRight, namespaces
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import InGraph
from rtask.rdf.terms import Term, TripleKey

__all__ = [
    "MAX_MERGES",
    "merge_refused",
    "merge_remark",
    "merges_of_others",
    "new_merges",
    "remark",
    "supports_of",
]

_SAME_AS = NamedNode(ontology.PREFIXES["owl"] + "sameAs")
MAX_MERGES = 100
"""Pairs for which the statement behind them is looked for."""


def merges_of_others(
    derived: InGraph, access: Access, graphs: Graphs, store: GraphStore
) -> Iterator[TripleKey]:
    """Yield the derived identities that concern a term which others than the caller use.

    Parameters
    ----------
    derived
        What newly follows.
    store
        Says who uses a term.
    """
    right = SchemaRight(access, graphs, store, ())
    for triple in derived.having(_SAME_AS):
        if triple[0] != triple[2] and (
            right.is_used_by_others(triple[0]) or right.is_used_by_others(triple[2])
        ):
            yield triple


def new_merges(
    change: Overlay, derived: InGraph, access: Access, graphs: Graphs
) -> list[TripleKey]:
    """Return identities of others' individuals that follow from a change and may not."""
    if access.may_state_axioms:
        return []
    return [*islice(merges_of_others(derived, access, graphs, change.store), MAX_MERGES)]


def supports_of(merges: Sequence[TripleKey], staged: Staged | None) -> list[Support]:
    """Return the asserted statements from which identities follow, as far as they are found."""
    proofs = [] if staged is None else [staged.prove(triple) for triple in merges]
    return [leaves_of(proof) for proof in proofs if proof is not None]


def merge_refused(
    merges: Collection[TripleKey],
    added: Collection[Quad],
    store: GraphStore,
    access: Access,
    graphs: Graphs,
) -> ForbiddenError:
    """Return the error for identities that a caller's statements may not lead to."""
    first, other, quad, has = _behind(merges, added, store, graphs.is_input)
    statement = "this" if quad is None else f"{quad.subject} {quad.predicate} {quad.object}"
    own = namespaces(access, graphs)[0] if access.agent else ""
    return ForbiddenError(
        f"{access.role} {access.agent} may not state {statement}: {has}it would follow that "
        f"{first} and {other} are the same, and others use them; that needs the right schema. Of "
        f"its own terms ({own}...) that nobody else uses it may state what it likes",
        statement=None if quad is None else statement,
        same=[str(first).strip("<>"), str(other).strip("<>")],
        right="schema",
    )


def remark(
    change: Overlay, derived: InGraph, keys: Keys, store: GraphStore, graphs: Graphs
) -> str | None:
    """Return what the author of a stored change is told of things that are, or are not, one.

    Where others claim a key as well nothing follows; where the author may make two things one, a
    slip of the pen joins all that is known of them, and nothing else would show it.
    """
    contested = keys.remark(change.added, store, graphs)
    if contested is not None or any(quad.predicate == _SAME_AS for quad in change.added):
        return contested  # whoever states an identity knows of it
    return merge_remark(derived, store, graphs, change.added)


def merge_remark(
    derived: InGraph, store: GraphStore, graphs: Graphs, added: Collection[Quad] | None = None
) -> str | None:
    """Return what an author is told of things that are one from now on; ``None`` if none are.

    Parameters
    ----------
    derived
        What newly follows.
    added
        The statements from which it follows; by default they are looked up.
    """
    merges = [triple for triple in derived.having(_SAME_AS) if triple[0] != triple[2]]
    if not merges:
        return None
    if added is None:
        subject = merges[0][0]
        held = store.quads_for_pattern(subject, None, None, None)
        added = [quad for quad in held if graphs.is_input(quad.graph_name)]
    first, other, quad, has = _behind(merges, added, store, graphs.is_input)
    why = f", as both have {quad.predicate} {quad.object}" if quad is not None and has else ""
    more = len({frozenset((a, b)) for a, _, b in merges}) - 1
    return (
        f"{first} and {other} are one thing from now on{why}: what is stated of one holds for both."
        + (f" So are {more} more pairs." if more else "")
        + " If they are two, withdraw what makes them one"
    )


def _behind(
    merges: Collection[TripleKey],
    added: Collection[Quad],
    store: GraphStore,
    is_input: Callable[..., bool],
) -> tuple[Term, Term, Quad | None, str]:
    """Return two terms that become one, and what is stated of them that the other has as well."""
    other_of: dict[Term, NamedNode | BlankNode] = {}
    for a, _, b in merges:
        if isinstance(a, NamedNode | BlankNode) and isinstance(b, NamedNode | BlankNode):
            other_of.setdefault(a, b)
            other_of.setdefault(b, a)
    named: Quad | None = None
    for quad in added:
        other = other_of.get(quad.subject)
        if other is not None:
            named = named or quad
            has = store.quads_for_pattern(other, quad.predicate, quad.object, None)
            here = any(is_input(match.graph_name) for match in has)
            if here and _tells_apart(quad):
                return quad.subject, other, quad, f"{other} has that as well, and "
        elif quad.object in other_of:
            return quad.object, other_of[quad.object], quad, ""
    merge = next(iter(merges))
    return merge[0], merge[2], named, ""


def _tells_apart(quad: Quad) -> bool:
    """Tell whether a value may be that of a key; a class is shared by many."""
    return quad.predicate.value != ontology.PREFIXES["rdf"] + "type"
