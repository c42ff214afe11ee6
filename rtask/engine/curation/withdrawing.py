"""Withdraw a contributor: all that a robot or a person told, and all that followed from it.

What others build on stays: objects that they have handled, grasps that they have tried, and what
these need. Attempts, outcomes, verdicts, places and planned grasps of the contributor go, and with
them what was computed from them: counts, maps from scores to chances, beliefs and hidden causes,
which are restated from what the others told. What rules inferred goes with the commit.

Only a period can be withdrawn, such as the day on which a robot's camera was loose: then what the
contributor told before and after counts as what others told does. The server's clock decides what
belongs to it, by the commits, and not the times that robots give.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.engine.curation.edit import Edit
from rtask.engine.curation.merging import withdraw_models
from rtask.engine.curation.period import stored_in
from rtask.engine.curation.splitting import forget_view
from rtask.engine.memory.calibration import Scored, calibrate, own_outcomes, score_of
from rtask.engine.memory.confidence import believe, stored_confidences
from rtask.engine.memory.statistics import state, statistics_of
from rtask.engine.memory.verdicts import Judged, judged_attempts, label_of
from rtask.engine.names import tail
from rtask.engine.perception.growth import regrown, state_model
from rtask.engine.perception.observation import viewpoint
from rtask.engine.triples import Triples
from rtask.errors import UnknownTermError, nearest
from rtask.kb.store.collector import collector_paused
from rtask.rdf.namespaces import PREFIXES, PROV, RDF, RT
from rtask.rdf.terms import GraphName, NamedNode, Quad, Subject, Triple, literal

if TYPE_CHECKING:
    import datetime as dt

    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.store.overlay import NetChange

__all__ = ["Withdrawal", "withdraw"]

_REPORT_KINDS = (
    "task", "attempt", "outcome", "feedback", "statistics", "calibration", "pose-estimate",
    "placement", "refusal", "learner",
)  # fmt: skip


@dataclass(frozen=True)
class Withdrawal:
    """A contributor's statements that went.

    Parameters
    ----------
    attempts, verdicts
        Numbers of attempts, and of verdicts on attempts of others.
    objects, kept
        Objects that the contributor had added: those that went with it, and those that stay because
        others build on them.
    grasps
        Grasps whose belief is restated.
    """

    commit: Commit
    attempts: int
    verdicts: int
    objects: int
    kept: int
    grasps: int


def withdraw(
    context: Context,
    name: str,
    author: Access,
    since: dt.datetime | None = None,
    until: dt.datetime | None = None,
) -> Withdrawal:
    """Withdraw all that a robot or person told, in one commit, which can be undone.

    A robot stays registered, and the tokens of both stay valid.

    Parameters
    ----------
    since, until
        Only what was stored from the first of them on and before the second.

    Raises
    ------
    UnknownTermError
        Nobody of this name has told anything, or nothing then.
    GoneError
        The journal no longer reaches back to ``since``.
    """
    with context.writing, collector_paused():
        period = None if since is None and until is None else stored_in(context, since, until)
        contributor = _Contributor(context, name, period)
        attempts = contributor.nodes("attempt")
        verdicts = contributor.verdicts()
        doubtful = contributor.grasps_of(attempts) | {judged.grasp for judged, _ in verdicts}
        before = judged_attempts(context, doubtful)
        contributor.forget_reports(verdicts)
        survivors = contributor.kept()
        objects = contributor.added_objects()
        contributor.forget_rest(survivors)
        after = _without(before, attempts, verdicts)
        edit, triples = contributor.edit, Triples()
        left = [g for g in doubtful if edit.after(None, RT.hasGrasp, g)]
        contributor.restore_replaced()
        contributor.recount(before, after)
        contributor.restate_votes(after, verdicts)
        contributor.rebelieve(triples, doubtful, after, author)
        contributor.regrow(triples)
        edit.state(triples, context.home_graph(author))
        commit = edit.commit(context, f"withdraw {name}", author)
    return Withdrawal(
        commit,
        len(attempts),
        len(verdicts),
        len(objects - survivors),
        len(objects & survivors),
        len(left),
    )


class _Contributor:
    """The statements of one contributor, and the edit that withdraws them.

    Parameters
    ----------
    period
        What was stored in the period that is withdrawn; None if everything is.
    """

    def __init__(self, context: Context, name: str, period: NetChange | None) -> None:
        graphs = context.kb.graphs
        self.context, self.edit = context, Edit(context.kb)
        self._rights = context.kb.access()
        self.graph = graphs.agent(name)
        self.robot, self.person = graphs.agent_iri(name), graphs.agent_iri(name, "teacher")
        self._period = period
        self.about: dict[NamedNode, list[Quad]] = {}
        for quad in context.kb.match(graph=self.graph):
            if isinstance(quad.subject, NamedNode) and self._is_meant(quad):
                self.about.setdefault(quad.subject, []).append(quad)
        judged = context.kb.match(None, PROV.wasAttributedTo, self.person)
        judged = [*filter(self._is_meant, judged)]
        if not self.about and not judged:
            owners = {graphs.owner(q.graph_name) for q in context.kb.match(None, RDF.type, None)}
            hint = nearest(name, sorted(owner for owner in owners if owner))
            then = " then" if period else ""
            raise UnknownTermError(f"contributor: {name!r} has told nothing{then}{hint}")

    def _is_meant(self, quad: Quad) -> bool:
        return self._period is None or quad in self._period.added

    def _goes(self, quad: Quad) -> bool:
        """Whether a statement is one of the contributor's that are withdrawn if nobody needs it."""
        return quad.graph_name == self.graph and self._is_meant(quad)

    def nodes(self, kind: str) -> set[NamedNode]:
        """Return the contributor's own nodes of one kind, not those that it only wrote about.

        Nor what belongs to one of them, such as the pictures of an attempt.
        """
        start = f"{self.context.kb.base}{kind}/"
        return {
            node
            for node in self.about
            if node.value.startswith(start) and "/" not in node.value[len(start) :]
            if self._made(node)
        }

    def _made(self, node: NamedNode) -> bool:
        return any(quad.predicate == RDF.type for quad in self.about[node])

    def grasps_of(self, attempts: Iterable[NamedNode]) -> set[NamedNode]:
        """Return the grasps that were tried."""
        return {
            quad.object
            for attempt in attempts
            for quad in self.about[attempt]
            if quad.predicate == RT.executesGrasp and isinstance(quad.object, NamedNode)
        }

    def added_objects(self) -> set[NamedNode]:
        """Return the objects that the contributor has added."""
        return {
            node
            for node, quads in self.about.items()
            if any(quad.predicate == RT.objectId for quad in quads)
        }

    def verdicts(self) -> list[tuple[Judged, NamedNode]]:
        """Return the verdicts of the contributor on attempts of others, with their nodes."""
        rows = self.context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?feedback ?outcome ?grasp WHERE {{
  ?feedback prov:wasAttributedTo {self.person} ; a rt:HumanFeedback .
  ?outcome rt:hasFeedback ?feedback . ?attempt rt:hasOutcome ?outcome ; rt:executesGrasp ?grasp
}} ORDER BY ?feedback""")
        grasps = {row["grasp"] for row in rows}
        outcomes = {
            judged.outcome: judged
            for judged in judged_attempts(
                self.context, [grasp for grasp in grasps if isinstance(grasp, NamedNode)]
            )
        }
        mine, verdicts = self.nodes("outcome"), []
        for row in rows:
            outcome, feedback = row["outcome"], row["feedback"]
            assert isinstance(outcome, NamedNode)
            assert isinstance(feedback, NamedNode)
            if not any(map(self._is_meant, self.context.kb.match(feedback, RDF.type))):
                continue
            if outcome in outcomes and outcome not in mine:
                verdicts.append((outcomes[outcome], feedback))
        return verdicts

    def is_report(self, node: NamedNode) -> bool:
        """Whether a node of the contributor is testimony, which goes whoever refers to it."""
        base = self.context.kb.base
        if not self._made(node):
            return False
        if node.value.startswith(tuple(f"{base}{kind}/" for kind in _REPORT_KINDS)):
            return True
        return any(quad.predicate == RT.beliefAlpha for quad in self.about[node])

    def forget_reports(self, verdicts: Iterable[tuple[Judged, NamedNode]]) -> None:
        """Withdraw testimony, and what others said about it."""
        edit = self.edit
        reports = [node for node in self.about if self.is_report(node)]
        outcomes = self.nodes("outcome")
        for outcome in outcomes:
            for link in edit.match(outcome, RT.hasFeedback):
                if isinstance(link.object, NamedNode):
                    reports.append(link.object)
        reports += [node for _, node in verdicts]
        for node in reports:
            edit.remove(edit.match(node))
            edit.forget_bytes(node)
            edit.remove(edit.match(None, None, node))

    def kept(self) -> set[NamedNode]:
        """Return the nodes that stay: those that others build on, and what these need.

        Also the robot's description of itself.
        """
        edit, gone = self.edit, self.edit.removed
        survivors: set[NamedNode] = set()
        todo = deque(node for node in self.about if self._is_own(node) or self._is_used(node))
        while todo:
            node = todo.popleft()
            if node in survivors or node not in self.about:
                continue
            survivors.add(node)
            for predicate in (RT.hasGrasp, RT.hasView):
                todo += [
                    quad.subject for quad in edit.match(None, predicate, node)
                    if isinstance(quad.subject, NamedNode)
                ]  # fmt: skip
            for quad in self.about[node]:
                value = quad.object
                if quad in gone or not isinstance(value, NamedNode):
                    continue
                if quad.predicate != RT.hasGrasp and not self._is_replaceable(value):
                    todo.append(value)
        return survivors

    def _is_own(self, node: NamedNode) -> bool:
        return node in (self.robot, self.person) or node.value.startswith(f"{self.robot.value}/")

    def _is_used(self, node: NamedNode) -> bool:
        """Whether a statement of somebody else that stays is about a node.

        A view is not used by those who recognised something by it: what they recognised is. Nor is
        a grasp by a belief in it, which was computed from what robots told, whoever stated it.
        """
        edit = self.edit
        if self._is_replaceable(node):
            return False
        return any(
            not self._goes(quad)
            and quad.graph_name != self.context.kb.graphs.causes
            and quad not in edit.removed
            and not self._is_ontology(quad.graph_name)
            and not self._is_belief(quad)
            for quad in (*edit.match(node), *edit.match(None, None, node))
        )

    def _is_belief(self, quad: Quad) -> bool:
        """Whether a statement links a grasp to a belief in it."""
        value = quad.object
        return (
            quad.predicate == RT.hasEvaluation
            and isinstance(value, NamedNode)
            and bool(self.edit.match(value, RT.beliefAlpha))
        )

    def _is_ontology(self, graph: GraphName) -> bool:
        is_ontology = self._rights.is_ontology
        return is_ontology is not None and is_ontology(graph)

    def _shown(self, node: NamedNode) -> list[NamedNode]:
        """Return the objects that a view shows."""
        return [
            quad.subject
            for quad in self.edit.match(None, None, node)
            if quad.predicate == RT.hasView and isinstance(quad.subject, NamedNode)
        ]

    def _is_replaceable(self, node: NamedNode) -> bool:
        """Whether a node is a view of something of which others have views as well."""
        views = (
            view
            for object_iri in self._shown(node)
            for view in self.edit.match(object_iri, RT.hasView)
        )
        return any(not self._goes(view) for view in views)

    def forget_rest(self, survivors: set[NamedNode]) -> None:
        """Withdraw all that does not stay."""
        edit = self.edit
        for node, quads in self.about.items():
            if node not in survivors:
                if self._shown(node):
                    forget_view(edit, node)
                elif not self._is_note_on(node, survivors):
                    edit.forget_bytes(node)
                    edit.remove(quads)
                continue
            for quad in quads:
                is_left_behind = quad.object in self.about and quad.object not in survivors
                # That it reaches a table is known from what it took from there.
                if is_left_behind or quad.predicate == RT.reaches:
                    edit.remove([quad])

    def _is_note_on(self, node: NamedNode, survivors: set[NamedNode]) -> bool:
        """Whether a node annotates a statement that stays."""
        reified = [quad.object for quad in self.about[node] if quad.predicate == RDF.reifies]
        return any(isinstance(value, Triple) and value.subject in survivors for value in reified)

    def restore_replaced(self) -> None:
        """Give what the contributor had described before the period the values that it had then."""
        if self._period is None:
            return
        edit = self.edit
        replaced: dict[tuple[Subject, NamedNode], list[Quad]] = {}
        for quad in self._period.removed:
            if quad.graph_name == self.graph:
                replaced.setdefault((quad.subject, quad.predicate), []).append(quad)
        for node, quads in self.about.items():
            if self._made(node) or node.value.startswith(self._counters):
                continue
            values = [q for q in quads if not isinstance(q.object, NamedNode)]
            edit.remove(values)
            for quad in values:
                edit.added.update(dict.fromkeys(replaced.get((node, quad.predicate), ())))

    @property
    def _counters(self) -> tuple[str, str]:
        """Beginnings of the IRIs of what is restated and not replaced."""
        base = self.context.kb.base
        return f"{base}statistics/", f"{base}calibration/"

    def recount(self, before: Iterable[Judged], after: Sequence[Judged]) -> None:
        """Recount grasps where the contributor's verdicts, or attempts of the period, counted."""
        was = {judged.attempt: label_of(judged) for judged in before}
        left = {judged.attempt for judged in after}
        changed = [judged for judged in after if was[judged.attempt] != label_of(judged)]
        gone = [judged for judged in before if judged.attempt not in left]
        totals: dict[tuple[NamedNode, NamedNode], Counter[bool]] = {}
        for judged in after:
            label = label_of(judged)
            if label is not None:
                totals.setdefault((judged.grasp, judged.robot), Counter())[label] += 1
        edit, context = self.edit, self.context
        recounted = {(o.grasp, o.robot, o.gripper_type) for o in (*changed, *gone)}
        for grasp, robot, gripper_type in recounted:
            node, triples = statistics_of(context, grasp, robot), Triples()
            edit.remove(edit.match(node))
            counts = totals.get((grasp, robot), Counter())
            if counts:
                state(
                    triples, node, grasp, gripper_type, robot, counts[True], counts.total(),
                )  # fmt: skip
            edit.state(triples, context.kb.graphs.agent(tail(robot)))
        self._recalibrate([*changed, *(gone if self._period else ())], left)

    def _recalibrate(self, changed: Iterable[Judged], left: set[NamedNode]) -> None:
        """Restate the maps of hands whose attempts are judged otherwise now, or are gone."""
        context = self.context
        by_score: dict[tuple[NamedNode, str], tuple[StoredGripper, list[tuple[Judged, float]]]] = {}
        for judged_attempt in changed:
            score = score_of(context, judged_attempt.attempt)
            hands = {quad.object for quad in context.kb.match(judged_attempt.attempt, RT.activates)}
            gripper = next((g for g in context.grippers.all() if g.iri in hands), None)
            if score is not None and gripper is not None:
                by_score.setdefault((gripper.iri, score[0]), (gripper, []))[1].append(
                    (judged_attempt, score[1])
                )
        for (_, kind), (gripper, judged) in by_score.items():
            more = [
                Scored(judged_attempt.attempt.value, kind, score, label)
                for judged_attempt, score in judged
                if (label := label_of(judged_attempt)) is not None
                if judged_attempt.attempt in left
            ]
            out = {judged_attempt.attempt.value for judged_attempt, _ in judged}
            out -= {scored.attempt for scored in more}
            if not more and all(o.attempt in out for o in own_outcomes(context, gripper.iri)):
                continue  # the map went with the reports
            graph, triples = context.kb.graphs.agent(tail(gripper.robot)), Triples()
            for old in calibrate(context, triples, gripper, kind, more, graph, without=out):
                subject, predicate, value = old
                self.edit.remove(
                    q for q in self.edit.match(subject, predicate) if q.object == value
                )
            self.edit.state(triples, graph)

    def restate_votes(
        self, after: Iterable[Judged], verdicts: Iterable[tuple[Judged, NamedNode]]
    ) -> None:
        """Restate how many people had spoken when others did, on what the contributor judged."""
        touched = {judged.outcome for judged, _ in verdicts}
        for judged in after:
            if judged.outcome not in touched:
                continue
            for k, verdict in enumerate(judged.verdicts):
                votes = replace(judged, verdicts=judged.verdicts[: k + 1]).votes
                for predicate, number in zip((RT.heldVotes, RT.lostVotes), votes, strict=True):
                    for quad in self.edit.match(verdict.node, predicate):
                        new = Quad(quad.subject, predicate, literal(number), quad.graph_name)
                        self.edit.replace(quad, new)

    def rebelieve(
        self, triples: Triples, grasps: Iterable[NamedNode], after: Iterable[Judged], author: Access
    ) -> None:
        """Replace the beliefs about grasps by what the others told."""
        context, edit = self.context, self.edit
        counts: dict[NamedNode, Counter[tuple[bool, bool]]] = {}
        for judged in after:
            label = label_of(judged)
            if label is not None:
                counts.setdefault(judged.grasp, Counter())[label, judged.is_fast] += 1
        home, who = context.home_graph(author), context.agent_iri(author)
        stored = stored_confidences(context, sorted(grasp.value for grasp in counts))
        for grasp in sorted(grasps, key=str):
            for link in edit.match(grasp, RT.hasEvaluation):
                value = link.object
                quads = edit.match(value) if isinstance(value, NamedNode) else []
                if any(quad.predicate == RT.beliefAlpha for quad in quads):
                    edit.remove([link, *quads])
            if grasp in counts:
                believe(context, triples, grasp, counts[grasp], who, home, stored=stored)

    def regrow(self, triples: Triples) -> None:
        """Build the models of objects that lost views from those that they have left."""
        edit, kb = self.edit, self.context.kb
        lost = {
            quad.subject
            for quad in edit.removed
            if quad.predicate == RT.hasView and isinstance(quad.subject, NamedNode)
        }
        for object_iri in sorted(lost, key=str):
            if not edit.after(object_iri, RT.objectId):
                continue
            withdraw_models(edit, object_iri)
            views = sorted({quad.object for quad in edit.after(object_iri, RT.hasView)}, key=str)
            posed = [
                (view.value, pose)
                for view in views
                if isinstance(view, NamedNode) and (pose := viewpoint(kb, view)) is not None
            ]
            model = regrown(kb, posed)
            if model is not None:
                state_model(self.context, triples, object_iri, model)


def _without(
    before: Iterable[Judged],
    attempts: set[NamedNode],
    verdicts: Iterable[tuple[Judged, NamedNode]],
) -> list[Judged]:
    """Return attempts without those of the contributor, and without its verdicts."""
    gone = {node for _, node in verdicts}
    return [
        replace(
            judged,
            verdicts=tuple(verdict for verdict in judged.verdicts if verdict.node not in gone),
        )
        for judged in before
        if judged.attempt not in attempts
    ]
