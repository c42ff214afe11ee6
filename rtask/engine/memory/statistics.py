"""Success counts of grasps, kept by each robot and summed over all robots.

Each robot counts its own attempts in its own graph, with one ``rt:GraspStatistics`` for each grasp,
type of gripper and robot. The attempts themselves are authoritative; the counts can be rebuilt from
them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rtask.engine.memory.calibration import Scored, calibrate, own_outcomes
from rtask.engine.memory.causes import Causes, restate
from rtask.engine.names import tail
from rtask.engine.policy import JUDGED, UNJUDGED
from rtask.engine.triples import Triples
from rtask.rdf.namespaces import PREFIXES, PROV, RDF, RT, reason
from rtask.rdf.terms import NamedNode, object_term, python_value
from rtask.wire.message import Answer

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.commit import Commit
    from rtask.kb.commit.transaction import Transaction
    from rtask.world import WorldEdit

__all__ = [
    "GraspStatistics",
    "Pending",
    "count",
    "judged",
    "judged_counts",
    "lower_95",
    "over_all_robots",
    "rebuild",
    "statistics_of",
    "summary",
    "totalled",
]


class GraspStatistics(Answer):
    """Attempts and successes of a grasp, over all robots."""

    attempts: int
    successes: int
    mean: float
    lower_95: float


def lower_95(successes: int, attempts: int) -> float:
    """Return the one-sided lower 95 % Clopper-Pearson bound on the probability of success.

    >>> round(lower_95(12, 14), 3), lower_95(0, 5)
    (0.615, 0.0)
    """
    if not 0 <= successes <= attempts:
        raise ValueError(f"expected 0 <= successes <= attempts, got {successes} of {attempts}")
    if successes == 0:
        return 0.0
    from scipy.special import betaincinv

    return float(betaincinv(successes, attempts - successes + 1, 0.05))


def summary(successes: int, attempts: int) -> GraspStatistics:
    """Return the statistics of a grasp from its counts."""
    return GraspStatistics(
        attempts=attempts,
        successes=successes,
        mean=successes / attempts if attempts else 0.0,
        lower_95=lower_95(successes, attempts),
    )


def statistics_of(context: Context, grasp: NamedNode, robot: NamedNode) -> NamedNode:
    """Return the IRI of one robot's count of a grasp."""
    return context.names.named("statistics", f"{tail(grasp)}-{tail(robot)}")


@dataclass
class Pending:
    """Counts of a pending commit, so that its triples need not be read again.

    Parameters
    ----------
    totals
        (successes, attempts) by the IRI of a robot's count.
    judged
        Judged attempts by grasp and (held, in coarse physics).
    scored
        Judged attempts with a score by hand and kind of score.
    causes
        Attempts and verdicts that change hidden causes; None if there are none.
    world
        Things that the commit sees and moves; None if there are none.
    """

    totals: dict[NamedNode, tuple[int, int]] = field(default_factory=dict)
    judged: dict[NamedNode, Counter[tuple[bool, bool]]] = field(default_factory=dict)
    scored: dict[tuple[NamedNode, str], list[Scored]] = field(default_factory=dict)
    causes: Causes | None = None
    world: WorldEdit | None = None


def count(
    context: Context, triples: Triples, grasp: NamedNode, gripper_type: str, robot: NamedNode,
    graph: NamedNode, attempts: int, successes: int, pending: Pending,
) -> list[tuple[NamedNode, NamedNode, Any]]:  # fmt: skip
    """Add a robot's new count of a grasp.

    Parameters
    ----------
    graph
        Graph of the robot's counts.
    attempts, successes
        Changes of the counts; negative if a person withdrew a verdict.
    pending
        Counts of this commit so far, which are updated.

    Returns
    -------
    Statements of the old count, to be withdrawn.
    """
    node = statistics_of(context, grasp, robot)
    counted = (RT.attempts, RT.successes, RT.meanSuccess, RT.lower95)
    old = [
        (node, quad.predicate, quad.object)
        for quad in context.kb.match(node, graph=graph)
        if quad.predicate in counted
    ]
    # Counted before in this commit: the store does not have it yet.
    if node in pending.totals:
        triples.discard(node, counted)
        held, total = pending.totals[node]
    else:
        numbers = {p: float(str(python_value(object_term(v)))) for _, p, v in old}
        held, total = int(numbers.get(RT.successes, 0)), int(numbers.get(RT.attempts, 0))
    # A verdict takes counts away; where a count was edited by hand, what remains stays a possible
    # one.
    total = max(total + attempts, 0)
    held = min(max(held + successes, 0), total)
    pending.totals[node] = held, total
    state(triples, node, grasp, gripper_type, robot, held, total)
    return old


def state(
    triples: Triples, node: NamedNode, grasp: NamedNode, gripper_type: str, robot: NamedNode,
    successes: int, attempts: int,
) -> None:  # fmt: skip
    """Add one count."""
    triples.node(
        node,
        [RT.GraspStatistics],
        {
            RT.statisticsOf: grasp,
            RT.gripperType: gripper_type,
            PROV.wasAttributedTo: robot,
            RT.attempts: attempts,
            RT.successes: successes,
            RT.meanSuccess: successes / attempts if attempts else 0.0,
            RT.lower95: lower_95(successes, attempts),
        },
    )


def over_all_robots(context: Context, grasp: NamedNode) -> GraspStatistics:
    """Return the statistics of one grasp, counted from the attempts of all robots."""
    rows = judged(context, grasp=[grasp])
    held = sum(n for *_, won, n in rows if won)
    return summary(held, sum(n for *_, n in rows))


def judged_counts(context: Context, grasp: NamedNode) -> dict[tuple[bool, bool], int]:
    """Return the numbers of judged attempts of a grasp by (held, in coarse physics)."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?held ?fast (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{ VALUES ?grasp {{ {grasp} }}
  {JUDGED} BIND(EXISTS {{ ?outcome rt:hasFeedback/rt:preset "fast" }} AS ?fast)
}} GROUP BY ?held ?fast""")
    return {
        (bool(row.value("held")), bool(row.value("fast"))): int(str(row.value("n"))) for row in rows
    }


def totalled(counts: Mapping[tuple[bool, bool], int]) -> GraspStatistics:
    """Sum counts by (held, in coarse physics) to statistics.

    >>> totalled({(True, False): 2, (False, True): 1}).successes
    2
    """
    held = sum(n for (success, _), n in counts.items() if success)
    return summary(held, sum(counts.values()))


def rebuild(context: Context) -> Commit:
    """Recount every grasp from the attempts and people's verdicts in one commit."""
    with context.writing:
        totals: dict[tuple[NamedNode, NamedNode, str], list[int]] = {}
        for grasp, robot, gripper_type, won, n in judged(context):
            total = totals.setdefault((grasp, robot, gripper_type), [0, 0])
            total[0] += n if won else 0
            total[1] += n
        kb = context.kb
        with kb.transaction(note="rebuild statistics") as tx:
            # All go first: a count of what nobody tried any more would stay.
            for node in {q.subject for q in kb.match(None, RT.statisticsOf)}:
                for quad in kb.match(node):
                    if isinstance(quad.graph_name, NamedNode) and kb.access().may_write(
                        quad.graph_name
                    ):
                        tx.remove(quad.subject, quad.predicate, quad.object, quad.graph_name)
            for (grasp, robot, gripper_type), (successes, attempts) in sorted(
                totals.items(), key=str
            ):
                triples = Triples()
                node = statistics_of(context, grasp, robot)
                state(triples, node, grasp, gripper_type, robot, successes, attempts)
                graph = kb.graphs.agent(tail(robot))
                for subject, predicate, value in triples:
                    tx.add(subject, predicate, value, graph)
            _rebuild_maps(context, tx)
            _rebuild_causes(context, tx)
        return tx.commit


def _rebuild_maps(context: Context, tx: Transaction) -> None:
    """Compute each hand's maps from scores to chances again from its outcomes."""
    for gripper in context.grippers.all():
        graph = context.kb.graphs.agent(tail(gripper.robot))
        for kind in sorted({outcome.kind for outcome in own_outcomes(context, gripper.iri)}):
            triples = Triples()
            for subject, predicate, value in calibrate(context, triples, gripper, kind, (), graph):
                tx.remove(subject, predicate, value, graph)
            for subject, predicate, value in triples:
                tx.add(subject, predicate, value, graph)


def _rebuild_causes(context: Context, tx: Transaction) -> None:
    """State the hidden causes of every object again from the attempts at it."""
    kb = context.kb
    links = (*kb.match(None, RT.hasGrasp), *kb.match(None, RT.hasHiddenCause))
    exemplars = {q.subject for q in kb.match(None, RDF.type, RT.Exemplar)}
    for object_iri in sorted(
        {q.subject for q in links if isinstance(q.subject, NamedNode)} - exemplars, key=str
    ):
        gone, added = restate(context, kb.match, object_iri)
        tx.remove_quads(gone)
        tx.add_quads(added)


def judged(
    context: Context, **only: Iterable[NamedNode]
) -> list[tuple[NamedNode, NamedNode, str, bool, int]]:
    """Return (grasp, robot, gripper type, held, count) of judged attempts.

    Parameters
    ----------
    **only
        IRIs to restrict a variable to: ``grasp`` or ``attempt``.
    """
    unjudged = ", ".join(str(reason(code)) for code in UNJUDGED)
    chosen = " ".join(
        f"VALUES ?{name} {{ {' '.join(map(str, terms))} }}" for name, terms in only.items()
    )
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?grasp ?robot ?gripper ?held (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{ {chosen}
  ?attempt rt:executesGrasp ?grasp ; rt:performedBy ?robot ; rt:activates/rt:gripperType ?gripper ;
    rt:hasOutcome ?outcome . ?outcome rt:hasReason ?reason ; rt:success ?decided
  OPTIONAL {{ ?outcome rt:judgedSuccess ?verdict }}
  BIND(COALESCE(?verdict, ?decided) AS ?held)
  FILTER(?verdict != ?decided || ?reason NOT IN ({unjudged}))
  FILTER NOT EXISTS {{ ?outcome rt:disputed true }}
}} GROUP BY ?grasp ?robot ?gripper ?held""")
    judged_grasps = []
    for row in rows:
        grasp, robot = row["grasp"], row["robot"]
        if isinstance(grasp, NamedNode) and isinstance(robot, NamedNode):
            n = int(str(row.value("n")))
            judged_grasps.append(
                (grasp, robot, str(row.value("gripper")), bool(row.value("held")), n)
            )
    return judged_grasps
