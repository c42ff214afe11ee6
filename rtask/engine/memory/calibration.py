"""A robot's own maps from scores to chances, grown from its outcomes in the graph.

Each hand has one map for each kind of score, in its robot's own graph. With every judged outcome it
is computed again from all outcomes of that hand, so that it can be rebuilt from them exactly.
Evaluations keep the raw score; beliefs about new grasps begin with the mapped one.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grasp.learning.calibration import ScoreMap, fit_map
from rtask.engine.grippers import StoredGripper
from rtask.engine.names import slug, tail
from rtask.engine.policy import JUDGED
from rtask.engine.triples import Triples
from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import NamedNode, Value, literal, object_term, python_value

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = [
    "PLANAR", "SPATIAL", "Scored", "calibrate", "own_outcomes", "score_maps", "score_of",
]  # fmt: skip

PLANAR, SPATIAL = "planar outline", "pose perturbation"
"""Kinds of scores: of grasps from above, by outline; of grasps in space, by perturbed poses."""


_NUMBERS = (
    RT.calibrationOffset, RT.calibrationSlope, RT.offsetVariance, RT.slopeVariance,
    RT.offsetSlopeCovariance, RT.outcomeCount,
)  # fmt: skip
_CHANGING = (*_NUMBERS, PROV.generatedAtTime)


@dataclass(frozen=True)
class Scored:
    """A judged attempt at a grasp with a score.

    Parameters
    ----------
    attempt
        IRI; empty for one that is about to be stored.
    kind
        Of the score, as ``rt:qualityKind`` names it.
    score
        Raw, 0..1, as the graph keeps it.
    """

    attempt: str
    kind: str
    score: float
    held: bool


def own_outcomes(context: Context, hand: NamedNode) -> list[Scored]:
    """Return the judged attempts of a hand whose grasps had a score."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?attempt ?kind ?score ?held WHERE {{
  ?attempt rt:activates {hand} ; rt:analyticQuality ?score ; rt:qualityKind ?kind .
  {JUDGED} }}""")
    return [
        Scored(
            str(row.value("attempt")), str(row.value("kind")), float(str(row.value("score"))),
            bool(row.value("held")),
        )
        for row in rows
    ]  # fmt: skip


def calibrate(
    context: Context,
    triples: Triples,
    gripper: StoredGripper,
    kind: str,
    more: Sequence[Scored],
    graph: NamedNode,
    without: Collection[str] = (),
) -> list[tuple[NamedNode, NamedNode, Value]]:
    """Restate a hand's map from all its outcomes; return the old statements, which go.

    Parameters
    ----------
    kind
        Of the score.
    more
        Outcomes of this commit; they replace stored ones of the same attempt.
    graph
        The robot's own.
    without
        IRIs of attempts that nothing judges any more.
    """
    changed = {score.attempt for score in more if score.attempt}.union(without)
    stored = [score for score in own_outcomes(context, gripper.iri) if score.attempt not in changed]
    scores = [score for score in (*stored, *more) if score.kind == kind]
    node = _node(context, gripper, kind)
    old: list[tuple[NamedNode, NamedNode, Value]] = [
        (node, quad.predicate, quad.object)
        for quad in context.kb.match(node, graph=graph)
        if quad.predicate in _CHANGING
    ]
    triples.discard(node, _CHANGING)
    fitted = fit_map((score.score, score.held) for score in scores)
    triples.node(
        node,
        [RT.ScoreCalibration],
        {
            RT.calibratesHand: gripper.iri,
            RT.calibratedScore: kind,
            RT.outcomeCount: fitted.outcomes,
            PROV.generatedAtTime: dt.datetime.now(dt.UTC),
            PROV.wasAttributedTo: gripper.robot,
            # As literals: not rounded, so that a rebuilt map is the stored one.
            **{
                name: literal(value)
                for name, value in zip(_NUMBERS, _numbers(fitted), strict=False)
            },
        },
    )
    return old


def score_maps(context: Context, gripper: StoredGripper) -> Mapping[str, ScoreMap]:
    """Return a hand's stored maps by kind of score; a kind without one is believed as it is."""
    graph = context.kb.graphs.agent(tail(gripper.robot))
    maps: dict[str, ScoreMap] = {}
    for kind in (PLANAR, SPATIAL):
        numbers = {
            quad.predicate: float(str(python_value(object_term(quad.object))))
            for quad in context.kb.match(_node(context, gripper, kind), graph=graph)
            if quad.predicate in _NUMBERS
        }
        if len(numbers) == len(_NUMBERS):
            a, b, aa, bb, ab, n = (numbers[name] for name in _NUMBERS)
            maps[kind] = ScoreMap(a, b, (aa, bb), ab, int(n))
    return maps


def score_of(context: Context, attempt: NamedNode) -> tuple[str, float] | None:
    """Return the kind and the value of the score of an attempt's grasp, if it had one."""
    scores = {
        quad.predicate: str(python_value(object_term(quad.object)))
        for quad in context.kb.match(attempt)
        if quad.predicate in (RT.qualityKind, RT.analyticQuality)
    }
    if len(scores) < 2:
        return None
    return scores[RT.qualityKind], float(scores[RT.analyticQuality])


def _numbers(score_map: ScoreMap) -> tuple[float, ...]:
    return score_map.offset, score_map.slope, *score_map.variances, score_map.covariance


def _node(context: Context, gripper: StoredGripper, kind: str) -> NamedNode:
    name = f"{tail(gripper.robot)}-{tail(gripper.iri)}-{slug(kind)}"
    return context.names.named("calibration", name)
