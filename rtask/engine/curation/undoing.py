"""Undo a commit: a correction or a verdict with what hangs on it, any other by its inverse."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose
from rtask.engine.curation.edit import NOTE, VERDICT, Edit
from rtask.engine.curation.merging import withdraw_models
from rtask.engine.memory.confidence import believe
from rtask.engine.memory.statistics import judged_counts, rebuild
from rtask.engine.perception.growth import regrown, state_model
from rtask.engine.triples import Triples
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError
from rtask.rdf.namespaces import PREFIXES, RDF, RT, SOSA, values
from rtask.rdf.terms import NamedNode, Quad, Value, python_value

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.feed.history import HistoryEntry

__all__ = ["undo"]

_REPORTS = (RT.executesGrasp, RT.hasOutcome, RT.success, RT.hasFeedback)
"""What counts, maps and hidden causes follow from."""
_NUMBERS = (RT.x, RT.y, RT.z, RT.qx, RT.qy, RT.qz, RT.qw)


def undo(context: Context, commit: str, author: Access) -> Commit:
    """Undo one commit.

    A correction of objects, a withdrawal of a contributor and a verdict are undone with what hangs
    on them: statements made since then stay, and statements withdrawn since then stay withdrawn;
    counts and beliefs that robots have restated since then are stated again from all present
    reports. Any other commit is undone by its inverse, see `GraphCore.revert`.

    Raises
    ------
    UnknownTermError
        No such commit, or one too old for a store in memory.
    ForbiddenError
        It is another person's verdict, the author may not write what it changed, or its bytes were
        deleted.
    ConflictError
        It is already undone, or a later change conflicts.
    """
    with context.writing:
        entry = _entry(context, commit)
        if entry.note != VERDICT and not (entry.note or "").startswith(NOTE):
            return _revert(context, entry, author)
        if entry.note == VERDICT:
            _refuse_judged_since(context, entry, author)
        edit = _inverse(context, entry)
        if not edit.removed and all(quad in context.kb.store for quad in edit.added):
            raise ConflictError(f"commit: {commit} is already undone")
        _refuse_gone(context, edit, commit)
        _refuse_moved_on(context, edit, entry.seq)
        _refuse_reported_since(context, edit)
        _move_later_attempts(context, edit)
        restated = _leave_out_restated(edit)
        triples = Triples()
        for object_iri in sorted(_grown_since(edit), key=str):
            withdraw_models(edit, object_iri)
            _leave_out_models(edit, object_iri)
            model = regrown(context.kb, _posed_after(edit, object_iri))
            if model is not None:
                state_model(context, triples, object_iri, model)
        edit.state(triples, context.home_graph(author))
        done = edit.commit(context, f"take back {commit}", author)
        if restated:
            _restate(context, restated, author)
        return done


def _entry(context: Context, commit: str) -> HistoryEntry:
    """Return the commit with this id."""
    number = commit.removeprefix("c-")
    if not number.isdecimal():
        raise UnknownTermError(f"commit: {commit!r} is not a commit; expected a form like c-00012")
    seq = int(number)
    entries = [e for e in context.kb.history(since=seq - 1, upto=seq) if e.seq == seq]
    if not entries:
        raise UnknownTermError(f"commit: there is no commit {commit}")
    return entries[0]


def _revert(context: Context, entry: HistoryEntry, author: Access) -> Commit:
    """Undo a commit that the engine did not make as a correction, with the author's own rights."""
    done = context.kb.revert(entry.seq, access=author)
    if any(quad.predicate in _REPORTS for quad in (*entry.added, *entry.removed)):
        rebuild(context)
    context.views.sync()
    return done


def _refuse_judged_since(context: Context, entry: HistoryEntry, author: Access) -> None:
    """Refuse to undo another person's verdict, or one that later verdicts counted with."""
    if author.role == "teacher" and author.agent != entry.agent:
        raise ForbiddenError(f"commit: it is the verdict of {entry.agent}, who may undo it")
    for given in entry.added:
        if given.predicate != RT.hasFeedback or not isinstance(given.subject, NamedNode):
            continue
        since = context.kb.history(given.subject, RT.hasFeedback, since=entry.seq)
        later = [commit for commit in since if commit.added and _stands(context, commit.added)]
        if later:
            raise ConflictError(
                f"commit: c-{later[-1].seq:05d} judged the same attempt since; undo that first",
                commit=f"c-{later[-1].seq:05d}",
            )


def _stands(context: Context, quads: Iterable[Quad]) -> bool:
    return any(quad in context.kb.store for quad in quads)


def _inverse(context: Context, entry: HistoryEntry) -> Edit:
    """Return the inverse of a commit, as far as its statements still stand."""
    edit, rights, causes = Edit(context.kb), context.kb.access(), context.kb.graphs.causes

    def ours(quad: Quad) -> bool:
        # Causes are restated from the attempts that the edit leaves.
        return rights.may_write(quad.graph_name) and quad.graph_name != causes

    edit.remove(quad for quad in entry.added if ours(quad) and quad in context.kb.store)
    edit.added.update(dict.fromkeys(filter(ours, entry.removed)))
    return edit


def _refuse_gone(context: Context, edit: Edit, commit: str) -> None:
    """Refuse to restore features whose blobs were deleted."""
    blobs = {q.object for q in edit.added if q.predicate == RT.hasBlob}
    gone = [b for b in blobs if isinstance(b, NamedNode) and not context.kb.blobs.has(b)]
    if gone:
        raise ForbiddenError(f"commit: the bytes of {len(gone)} features were deleted")


def _refuse_moved_on(context: Context, edit: Edit, seq: int) -> None:
    """Refuse when views or grasps have moved on, or names or classes have changed since."""
    kinds = context.classes.all().keys() - {RT.ManipulableObject.value}

    def says(quad: Quad) -> bool:
        if quad.predicate == RT.name:
            return True
        value = quad.object
        return quad.predicate == RDF.type and isinstance(value, NamedNode) and value.value in kinds

    for quad in edit.added:
        subject, value = quad.subject, quad.object
        assert isinstance(subject, NamedNode)
        if quad.predicate in (RT.hasView, RT.hasGrasp) and isinstance(value, NamedNode):
            owners = {q.subject for q in edit.after(None, quad.predicate, value)}
            if owners != {subject} or not edit.after(value) or not edit.after(subject, RT.objectId):
                raise _in_the_way(context, value, seq)
        elif says(quad) and not subject.value.startswith(f"{context.kb.base}statement/"):
            since = {q for q in edit.after(subject, quad.predicate) if says(q)} - edit.added.keys()
            if since:
                raise _in_the_way(context, subject, seq)


def _in_the_way(context: Context, object_iri: NamedNode, seq: int) -> ConflictError:
    """Return the error that names the latest conflicting commit."""
    history = context.kb.history
    since = [
        entry
        for entry in (*history(object_iri, since=seq), *history(value=object_iri, since=seq))
        if (entry.note or "").startswith(NOTE)
    ]
    last = max(since, key=lambda entry: entry.seq, default=None)
    if last is None:
        return ConflictError(f"commit: {object_iri.value} was changed since then")
    what = (last.note or "").removeprefix(NOTE)
    return ConflictError(
        f"commit: c-{last.seq:05d} ({what}) changed the same things since; take that back first",
        commit=f"c-{last.seq:05d}",
    )


def _refuse_reported_since(context: Context, edit: Edit) -> None:
    """Refuse to remove an object that robots have reported on since it was created."""
    for quad in edit.removed:
        object_iri = quad.subject
        if quad.predicate != RT.objectId or not isinstance(object_iri, NamedNode):
            continue
        if edit.after(object_iri, RT.objectId):
            continue
        reported = [
            *edit.after(object_iri, RT.hasView), *edit.after(object_iri, RT.hasGrasp),
            *edit.after(None, RT.handles, object_iri),
            *edit.after(None, SOSA.hasFeatureOfInterest, object_iri),
        ]  # fmt: skip
        if reported:
            raise ConflictError(
                f"commit: robots have reported on {object_iri.value} since; merge the two instead"
            )


def _move_later_attempts(context: Context, edit: Edit) -> None:
    """Move later attempts along with the grasps that return to their objects."""
    owner = {q.object: q.subject for q in edit.added if q.predicate == RT.hasGrasp}
    grasps = [grasp for grasp in owner if isinstance(grasp, NamedNode)]
    if not grasps:
        return
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?task ?grasp WHERE {{ VALUES ?grasp {{ {values(grasps)} }}
  ?attempt rt:executesGrasp ?grasp . ?task rt:through ?attempt }}""")
    for row in rows:
        task, grasp = row["task"], row["grasp"]
        assert isinstance(task, NamedNode)
        assert isinstance(grasp, NamedNode)
        for quad in edit.match(task, RT.handles):
            if quad not in edit.removed:
                edit.replace(quad, Quad(task, RT.handles, owner[grasp], quad.graph_name))


def _grown_since(edit: Edit) -> set[NamedNode]:
    """Return the objects whose model the commit rebuilt and that has grown since."""
    before = {q.subject for q in edit.added if q.predicate == RT.hasModel}
    return {
        object_iri
        for object_iri in before
        if isinstance(object_iri, NamedNode)
        and any(q not in edit.added for q in edit.after(object_iri, RT.hasModel))
    }


def _leave_out_models(edit: Edit, object_iri: NamedNode) -> None:
    """Leave the former models of an object out of what is restored."""
    models = {q.object for q in edit.added if (q.subject, q.predicate) == (object_iri, RT.hasModel)}
    nodes = {
        f"{m.value}{part}" for m in models if isinstance(m, NamedNode) for part in ("", "/mesh")
    }
    for quad in list(edit.added):
        named = [part.value for part in (quad.subject, quad.object) if isinstance(part, NamedNode)]
        if nodes.intersection(named):
            del edit.added[quad]


def _leave_out_restated(edit: Edit) -> set[NamedNode]:
    """Leave out counts, maps and beliefs that were restated since; return their grasps."""
    computed = {
        quad.subject for quad in edit.added
        if quad.predicate in (RT.beliefAlpha, RT.attempts, RT.successes, RT.outcomeCount)
    }  # fmt: skip
    clashing = {
        quad.subject
        for quad in edit.added
        if quad.subject in computed
        and isinstance(quad.subject, NamedNode)
        and quad.predicate != RDF.type
        and any(
            now != quad and now not in edit.removed
            for now in edit.match(quad.subject, quad.predicate)
        )
    }
    grasps = set[object]()
    for node in clashing:
        # A verdict changes their values only, so the links may be in the graph instead.
        assert isinstance(node, NamedNode)
        links = [quad for quad in (*edit.added, *edit.match(node)) if quad.subject == node]
        grasps |= {q.object for q in links if q.predicate == RT.statisticsOf}
        owners = [*edit.added, *edit.match(None, RT.hasEvaluation, node)]
        grasps |= {q.subject for q in owners if (q.predicate, q.object) == (RT.hasEvaluation, node)}
    for quad in [quad for quad in edit.added if quad.subject in clashing]:
        del edit.added[quad]
    return {grasp for grasp in grasps if isinstance(grasp, NamedNode)}


def _restate(context: Context, grasps: set[NamedNode], author: Access) -> None:
    """State counts, maps and the beliefs about some grasps from all present reports."""
    rebuild(context)
    home, who, triples = context.home_graph(author), context.agent_iri(author), Triples()
    old: list[tuple[NamedNode, NamedNode, Value]] = []
    for grasp in sorted(grasps, key=str):
        old += believe(context, triples, grasp, judged_counts(context, grasp), who, home)
    with context.kb.transaction(access=author, note="state beliefs again") as tx:
        for subject, predicate, value in old:
            tx.remove(subject, predicate, value, home)
        for subject, predicate, value in triples:
            tx.add(subject, predicate, value, home)


def _posed_after(edit: Edit, object_iri: NamedNode) -> list[tuple[str, NDArray[np.float64]]]:
    """Return the views that an object will have, with their camera poses, oldest first."""
    poses = []
    for view in sorted({q.object for q in edit.after(object_iri, RT.hasView)}, key=str):
        assert isinstance(view, NamedNode)
        for link in edit.after(view, RT.viewpoint):
            assert isinstance(link.object, NamedNode)
            properties = {q.predicate: q.object for q in edit.after(link.object)}
            if all(number in properties for number in _NUMBERS):
                seven = np.array([float(str(python_value(properties[p]))) for p in _NUMBERS])
                pose = matrix_from_pose(seven[:3], seven[3:])
                poses.append((view.value, np.asarray(pose, dtype=np.float64)))
    return poses
