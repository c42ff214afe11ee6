"""A branch compared with its trunk: what it changes, and what stands against merging it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.errors import InconsistentError, RtaskError
from rtask.kb.branches.record import BranchRecord
from rtask.kb.commit.validation import Violation
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.naming import Names
from rtask.kb.store.overlay import NetChange
from rtask.rdf.terms import RDF_TYPE, Subject, Term, stored

__all__ = ["Comparison", "Conflict", "conflicts_of", "refusal_of"]

_FUNCTIONAL = NamedNode(ontology.PREFIXES["owl"] + "FunctionalProperty")
_PLACEMENT_OF = NamedNode(ontology.NS + "placementOf")
_END = NamedNode(ontology.PREFIXES["time"] + "hasEnd")
MAX_CONFLICTS = 100
_MORE = f"there are more than these {MAX_CONFLICTS}: settle them, and compare again"
"""Conflicts that are named; with so many, somebody looks at the branch first."""


@dataclass(frozen=True)
class Conflict:
    """Something that stands against merging a branch.

    Parameters
    ----------
    kind
        ``value``: both gave another value of a functional property; ``place``: both put a thing
        somewhere, and neither ended the other's interval; ``withdrawn``: the branch states
        something of what the trunk has withdrawn; ``contradiction``: together they contradict each
        other or the ontology; ``refused``: the commit would be refused for another reason;
        ``more``: there are further ones, which were not looked for.
    message
        What it is, for people.
    subject
        What it is about, where that is one thing.
    branch, trunk
        Statements of either, in N-Quads.
    """

    kind: str
    message: str
    subject: str = ""
    branch: tuple[str, ...] = ()
    trunk: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "kind": self.kind,
            "message": self.message,
            "subject": self.subject,
            "branch": list(self.branch),
            "trunk": list(self.trunk),
        }


@dataclass(frozen=True)
class Comparison:
    """What a branch changes, and what stands against merging it.

    Parameters
    ----------
    record
        The branch.
    added, removed
        Statements that merging would assert and withdraw.
    derived, withdrawn
        Numbers of statements that the reasoner would add to and remove from the trunk; none if
        the commit would be refused.
    commits
        Number of commits of the branch.
    trunk_commits
        Number of commits of the trunk since the branch was made.
    conflicts
        What stands against it, at most 100.
    violations
        Of the shapes that look at what would change, whether or not commits are held to them.
    """

    record: BranchRecord
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]
    derived: int | None
    withdrawn: int | None
    commits: int
    trunk_commits: int
    conflicts: tuple[Conflict, ...]
    violations: tuple[Violation, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values; statements as N-Quads."""
        return self.record.to_dict() | {
            "added": [f"{quad} ." for quad in self.added],
            "removed": [f"{quad} ." for quad in self.removed],
            "derived": self.derived,
            "withdrawn": self.withdrawn,
            "commits": self.commits,
            "trunk_commits": self.trunk_commits,
            "conflicts": [conflict.to_dict() for conflict in self.conflicts],
            "violations": [str(violation) for violation in self.violations],
        }


def conflicts_of(
    trunk: GraphStore, own: NetChange, others: NetChange, names: Names
) -> list[Conflict]:
    """Return the conflicts that can be told from the statements.

    Of more than :data:`MAX_CONFLICTS`, the last entry is of kind ``more``, and says that further
    ones were not looked for.

    Parameters
    ----------
    trunk
        Quads of the trunk now.
    own, others
        What the branch, and the trunk since, have changed.
    """
    conflicts: list[Conflict] = []
    for conflict in (
        *_values(trunk, own, others, names),
        *_places(trunk, own, others, names),
        *_withdrawn(trunk, own, others, names),
    ):
        if len(conflicts) == MAX_CONFLICTS:
            conflicts.append(Conflict("more", _MORE))
            break
        conflicts.append(conflict)
    return conflicts


def _values(
    trunk: GraphStore, own: NetChange, others: NetChange, names: Names
) -> Iterator[Conflict]:
    """Yield the functional properties of a subject to which both gave another value."""
    theirs: dict[tuple[Subject, NamedNode], list[Quad]] = {}
    for quad in others.added:
        theirs.setdefault((quad.subject, quad.predicate), []).append(quad)
    is_functional: dict[NamedNode, bool] = {}
    for quad in own.added:
        rivals = theirs.get((quad.subject, quad.predicate), ())
        # The same value from both is agreement, and what the branch withdrew is no rival.
        rivals = [r for r in rivals if r.object != quad.object and r not in own.removed]
        if not rivals:
            continue
        predicate = quad.predicate
        if predicate not in is_functional:
            # Asked once a property: a branch may change thousands of values.
            is_functional[predicate] = _is_there(trunk, own, predicate, _FUNCTIONAL)
        if is_functional[predicate]:
            values = " and ".join(dict.fromkeys(names(rival.object) for rival in rivals))
            yield Conflict(
                "value",
                f"{names(predicate)} of {names(quad.subject)} is {names(quad.object)} in the "
                f"branch and {values} in the trunk, and it has one value",
                _text(quad.subject),
                _lines([quad]),
                _lines(rivals),
            )


def _is_there(store: GraphStore, own: NetChange, subject: NamedNode, cls: NamedNode) -> bool:
    if next(iter(store.quads_for_pattern(subject, RDF_TYPE, cls, None)), None) is not None:
        return True
    return any(q.subject == subject and q.object == cls for q in own.added)


def _places(
    trunk: GraphStore, own: NetChange, others: NetChange, names: Names
) -> Iterator[Conflict]:
    """Yield the things that both put somewhere, in intervals without an end."""
    ended = {quad.subject for quad in own.added if quad.predicate == _END}
    theirs: dict[Term, list[Quad]] = {}
    for quad in others.added:
        if quad.predicate != _PLACEMENT_OF or quad.subject in ended:
            continue
        if next(iter(trunk.quads_for_pattern(quad.subject, _END, None, None)), None) is None:
            theirs.setdefault(quad.object, []).append(quad)
    for quad in own.added:
        if quad.predicate != _PLACEMENT_OF or quad.subject in ended:
            continue
        rivals = [q for q in theirs.get(quad.object, ()) if q.subject != quad.subject]
        if rivals:
            yield Conflict(
                "place",
                f"{names(quad.object)} has a place in the branch and another in the trunk, and "
                "neither has ended",
                _text(quad.object),
                _lines([quad]),
                _lines(rivals),
            )


def _withdrawn(
    trunk: GraphStore, own: NetChange, others: NetChange, names: Names
) -> Iterator[Conflict]:
    """Yield what the trunk has withdrawn, all its types, and the branch states something of."""
    gone: dict[Term, list[Quad]] = {}
    for quad in others.removed:
        if quad.predicate == RDF_TYPE and _has_no_type(trunk, quad.subject):
            gone.setdefault(quad.subject, []).append(quad)
    if not gone:
        return
    built: dict[Term, list[Quad]] = {}
    # What the branch types itself it brings along, whatever the trunk did.
    typed = {quad.subject for quad in own.added if quad.predicate == RDF_TYPE}
    for quad in own.added:
        for node in (quad.subject, quad.object):
            if node in gone and node not in typed:
                built.setdefault(node, []).append(quad)
    for node, quads in built.items():
        yield Conflict(
            "withdrawn",
            f"the trunk has withdrawn {names(node)}, and {len(quads)} of the branch's "
            "statements name it",
            _text(node),
            _lines(quads),
            _lines(gone[node]),
        )


def _has_no_type(trunk: GraphStore, node: Subject) -> bool:
    return next(iter(trunk.quads_for_pattern(node, RDF_TYPE, None, None)), None) is None


def refusal_of(error: RtaskError) -> list[Conflict]:
    """Return why the trunk would refuse the commit of a branch, each cause by itself."""
    if not isinstance(error, InconsistentError):
        return [Conflict("refused", str(error))]
    causes = error.details.get("causes") or error.details.get("contradictions") or []
    return [
        Conflict(
            "contradiction",
            str(cause["message"]),
            branch=tuple(" ".join(triple) + " ." for triple in cause.get("statements", ())),
            trunk=tuple(" ".join(triple) + " ." for triple in cause.get("known", ())),
        )
        for cause in causes
    ] or [Conflict("contradiction", str(error))]


def _lines(quads: Iterable[Quad]) -> tuple[str, ...]:
    return tuple(f"{quad} ." for quad in quads)


def _text(term: Term) -> str:
    return term.value if isinstance(term, NamedNode) else str(stored(term))
