"""An edit that changes statements of several agents, each in the graph of its author.

People who curate the graph move what robots wrote. Every statement stays in the graph of its
author; the commit records who moved it, and the inverse commit undoes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from rtask.engine.memory.causes import restate
from rtask.engine.triples import Triples
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import GraphName, NamedNode, Quad, Subject, Triple, object_term

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["NOTE", "VERDICT", "Edit"]

_OF_OUTCOMES = (RT.success, RT.hasReason, RT.hasFeedback)
NOTE = "objects: "
"""Prefix of the notes of commits that can be undone."""
VERDICT = "a person's verdict"
"""Note of a commit with a verdict, which can be undone, too."""


class Edit:
    """Statements to withdraw and to assert.

    Parameters
    ----------
    kb
        The knowledge base; graphs that commits maintain are left unchanged. It must not change
        before the edit is committed, as patterns are looked up once: on disk every look-up counts.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._rights = kb.access()
        self.removed: dict[Quad, None] = {}
        self.added: dict[Quad, None] = {}
        self._matched: dict[tuple[NamedNode | None, ...], list[Quad]] = {}
        self._may_write: dict[GraphName, bool] = {}
        self._stored: dict[Subject, list[Quad]] = {}
        self._writes = kb.store.writes

    def match(self, *pattern: NamedNode | None) -> list[Quad]:
        """Return the changeable statements that match a pattern; the list is not to be changed."""
        quads = self._matched.get(pattern)
        if quads is None:
            subject, *rest = pattern
            if isinstance(subject, NamedNode) and not rest:
                quads = self._changeable(self._about(subject))
            elif (subject,) in self._matched:
                quads = [quad for quad in self._matched[(subject,)] if _fits(quad, *rest)]
            else:
                quads = self._changeable(self._kb.match(*pattern))
            self._matched[pattern] = quads
        return quads

    def _about(self, subject: NamedNode) -> list[Quad]:
        """Return all that is stored about a subject, and keep it for the commit."""
        store = self._kb.store
        before = store.writes
        quads = list(store.quads_for_pattern(subject, None, None))
        if not before == self._writes == store.writes:
            # Notes that waited were stored, or others wrote: what was read before may have changed.
            self._stored.clear()
            self._writes = store.writes
        if before == self._writes:
            self._stored[subject] = quads
        return [quad for quad in quads if isinstance(quad.graph_name, NamedNode)]

    def _changeable(self, quads: Iterable[Quad]) -> list[Quad]:
        # Graphs that nobody may write, such as the reasoner's, follow from the others.
        return [quad for quad in quads if self._is_changeable(quad.graph_name)]

    def _is_changeable(self, graph: GraphName) -> bool:
        may_write = self._may_write.get(graph)
        if may_write is None:
            may_write = self._may_write[graph] = self._rights.may_write(graph)
        return may_write

    def after(self, *pattern: NamedNode | None) -> list[Quad]:
        """Return the changeable statements that will match a pattern after the edit."""
        pattern_of_three = (*pattern, *(None,) * (3 - len(pattern)))
        added = [
            quad
            for quad in self.added
            if all(
                want is None or want == part
                for want, part in zip(pattern_of_three, tuple(quad)[:3], strict=True)
            )
        ]
        stay = (q for q in self.match(*pattern) if q not in self.removed)
        return list(dict.fromkeys([*stay, *added]))

    def remove(self, quads: Iterable[Quad]) -> None:
        """Withdraw statements."""
        self.removed.update(dict.fromkeys(quads))

    def replace(self, old: Quad, new: Quad) -> None:
        """Replace one statement by another."""
        if old != new:
            self.removed[old] = None
            self.added[new] = None

    def state(self, triples: Triples, graph: NamedNode) -> None:
        """Assert triples in a graph."""
        for subject, predicate, value in triples:
            self.added[Quad(subject, predicate, object_term(value), graph)] = None

    def rename(self, old: NamedNode, new: NamedNode, keep: Callable[[Quad], bool]) -> None:
        """Move the statements about one individual to another.

        Parameters
        ----------
        keep
            Whether a statement is moved or withdrawn; the same goes for the annotations on it.
        """
        for quad in self.match(old):
            if quad in self.removed:
                continue
            if keep(quad):
                moved = Quad(new, quad.predicate, quad.object, quad.graph_name)
                self.replace(quad, moved)
            else:
                self.remove([quad])
        for quad in self.match(None, None, old):
            if quad not in self.removed:
                self.replace(quad, Quad(quad.subject, quad.predicate, new, quad.graph_name))
        for quad in self.match(None, RDF.reifies, None):
            reified = quad.object
            if quad in self.removed or not isinstance(reified, Triple):
                continue
            if old in (reified.subject, reified.object):
                self._rename_reified(quad, reified, old, new, keep)

    def _rename_reified(
        self,
        quad: Quad,
        reified: Triple,
        old: NamedNode,
        new: NamedNode,
        keep: Callable[[Quad], bool],
    ) -> None:
        stated = Quad(reified.subject, reified.predicate, reified.object, quad.graph_name)
        if reified.subject == old and not keep(stated):
            assert isinstance(quad.subject, NamedNode)
            self.remove(self.match(quad.subject))
            return
        subject = new if reified.subject == old else reified.subject
        value = new if reified.object == old else reified.object
        triple = Triple(subject, reified.predicate, value)
        self.replace(quad, Quad(quad.subject, quad.predicate, triple, quad.graph_name))

    def forget_bytes(self, node: NamedNode) -> list[NamedNode]:
        """Withdraw the descriptions of blobs that only this node uses; return their IRIs."""
        freed = []
        for link in self.match(node, RT.hasBlob):
            blob = link.object
            if not isinstance(blob, NamedNode):
                continue
            others = {q.subject for q in self._kb.match(None, RT.hasBlob, blob)}
            # Nodes that go in this very edit hold nothing any more.
            others -= {q.subject for q in self.removed if q.predicate == RT.hasBlob}
            if others <= {node}:
                self.remove(self.match(blob))
                freed.append(blob)
        return freed

    def commit(self, context: Context, note: str, author: Access) -> Commit:
        """Store the edit as one commit in the name of a person; the caller holds the write lock."""
        self._restate_causes(context)
        # An edit changes graphs of several agents, which their own right would not allow; whoever
        # calls has checked the person's.
        access = Access(author.agent, "admin")
        with context.kb.transaction(access=access, note=NOTE + note) as tx:
            # The commit has to know of each statement whether another graph says the same.
            gone = {quad.subject for quad in self.removed}
            tx.learn((self._stored[node] for node in gone if node in self._stored), self._writes)
            # What is both withdrawn and asserted stays untouched, and out of the history.
            tx.remove_quads(self.removed.keys() - self.added.keys(), as_read=True)
            tx.add_quads(quad for quad in self.added if quad not in self.removed)
        context.views.sync()
        return tx.commit

    def _restate_causes(self, context: Context) -> None:
        """Restate the hidden causes of the objects whose attempts the edit changes."""
        graph = context.kb.graphs.causes
        for changes in (self.removed, self.added):
            for quad in [q for q in changes if q.graph_name == graph]:
                # Causes follow from the attempts, and are restated as a whole below.
                del changes[quad]
        will_be = _WillBe(self)
        for object_iri in sorted(self._tried_objects(will_be), key=str):
            gone, added = restate(context, will_be.match, object_iri)
            self.removed.update(dict.fromkeys(gone))
            self.added.update(dict.fromkeys(added))

    def _tried_objects(self, will_be: _WillBe) -> set[NamedNode]:
        """Return the objects whose grasps, attempts, outcomes or verdicts the edit changes."""

        def both(*pattern: Any) -> list[Quad]:
            return [*self.match(*pattern), *will_be.match(*pattern)]

        changed: dict[object, list[Quad]] = {}
        for quad in (*self.removed, *self.added):
            changed.setdefault(quad.predicate, []).append(quad)
        outcomes = {q.subject for p in _OF_OUTCOMES for q in changed.get(p, ())}
        attempts = {q.subject for q in changed.get(RT.hasOutcome, ())}
        attempts |= {q.subject for node in outcomes for q in both(None, RT.hasOutcome, node)}
        grasps = {q.object for q in changed.get(RT.executesGrasp, ())}
        grasps |= {q.object for node in attempts for q in both(node, RT.executesGrasp)}
        poses = {q.subject for p in (RT.x, RT.theta) for q in changed.get(p, ())}
        grasps |= {q.subject for node in poses for q in both(None, RT.graspPose, node)}
        changed_grasps = {q.subject for p in (RT.hasGrasp, RT.extentX) for q in changed.get(p, ())}
        changed_grasps |= {q.subject for node in grasps for q in both(None, RT.hasGrasp, node)}
        return {node for node in changed_grasps if isinstance(node, NamedNode)}


def _fits(quad: Quad, predicate: NamedNode | None = None, value: NamedNode | None = None) -> bool:
    return predicate in (None, quad.predicate) and value in (None, quad.object)


class _WillBe:
    """Statements after an edit, by subject and by object."""

    def __init__(self, edit: Edit) -> None:
        self._edit = edit
        self._of: dict[object, list[Quad]] = {}
        self._to: dict[object, list[Quad]] = {}
        for quad in edit.added:
            self._of.setdefault(quad.subject, []).append(quad)
            self._to.setdefault(quad.object, []).append(quad)

    def match(
        self, subject: Any, predicate: NamedNode | None = None, value: Any = None
    ) -> list[Quad]:
        """Return the changeable statements about a subject or with a value."""
        renamed = self._to.get(value, ()) if subject is None else self._of.get(subject, ())
        stay = [
            q for q in self._edit.match(subject, predicate, value) if q not in self._edit.removed
        ]
        fits = (
            q for q in renamed
            if predicate in (None, q.predicate) and value in (None, q.object)
        )  # fmt: skip
        return list(dict.fromkeys([*stay, *fits]))
