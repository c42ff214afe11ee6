"""Confidence in a grasp: a computed prior, updated by counted outcomes.

The confidence s_G of a grasp (Kehoe 2014, 4.3) starts as the mean quality under uncertainty, or as
the generator's own score. Each judged attempt updates it to a posterior: the belief of the bandit
(:mod:`grasp.learning.bandit`) over all robots. It is stored in the same commit as the outcome, in
the graph of the robot that tried, and refers to the evaluation used as the prior, which is kept.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from grasp.learning.bandit import Arm, BetaThompson
from rtask.engine.names import slug
from rtask.engine.policy import Policy
from rtask.engine.triples import Triples
from rtask.rdf.namespaces import PREFIXES, PROV, RT, values
from rtask.rdf.terms import NamedNode, Value, iri, object_term, python_value

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = ["Belief", "Confidence", "believe", "posterior", "stored_confidences"]

_BELIEF = (
    RT.graspConfidence,
    RT.beliefAlpha,
    RT.beliefBeta,
    PROV.generatedAtTime,
    RT.policyVersion,
)


@dataclass(frozen=True)
class Belief:
    """A Beta distribution over the chance that a grasp holds."""

    alpha: float
    beta: float

    @property
    def mean(self) -> float:
        """The confidence."""
        return self.alpha / (self.alpha + self.beta)


@dataclass(frozen=True)
class Confidence:
    """Stored confidence in one grasp.

    Parameters
    ----------
    evaluation
        IRI of the evaluation that was computed before any attempt; empty if there is none.
    prior
        Confidence of that evaluation; None if there is none.
    belief
        Latest stored posterior over all robots; None before the first outcome.
    updated
        Time of the latest update, ISO 8601; empty before the first outcome.
    policy
        Version of the rules of the posterior.
    """

    evaluation: str = ""
    prior: float | None = None
    belief: Belief | None = None
    updated: str = ""
    policy: str = ""


def posterior(
    policy: Policy, quality: float | None, counts: Iterable[tuple[bool, bool, int]]
) -> Belief:
    """Combine a prior and judged attempts to a belief.

    Parameters
    ----------
    quality
        Confidence of an evaluation or else the generator's score, 0..1; None if neither is known.
    counts
        Judged attempts: held, in coarse physics, their number. They weigh as in the choice of a
        grasp; see :meth:`Policy.weight_of`.

    Examples
    --------
    >>> round(posterior(Policy(), 0.9, []).mean, 2)
    0.81
    >>> round(posterior(Policy(), 0.9, [(False, False, 3)]).mean, 2)
    0.24
    """
    weight = {True: 0.0, False: 0.0}
    for held, is_fast, number in counts:
        weight[held] += number * policy.weight_of(held, is_fast)
    arm = Arm((0.0, 0.0, 0.0), 0.0, quality, weight[True], weight[False])
    alpha, beta = BetaThompson(policy.bandit).beliefs([arm])[0]
    return Belief(float(alpha), float(beta))


def stored_confidences(context: Context, grasps: Sequence[str]) -> dict[str, Confidence]:
    """Return the stored confidences of grasps by IRI, with one query."""
    if not grasps:
        return {}
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?grasp ?evaluation ?confidence ?alpha ?beta ?time ?policy WHERE {{
  VALUES ?grasp {{ {values(grasps)} }}
  ?grasp rt:hasEvaluation ?evaluation . ?evaluation rt:graspConfidence ?confidence
  OPTIONAL {{ ?evaluation rt:beliefAlpha ?alpha ; rt:beliefBeta ?beta ; prov:generatedAtTime ?time
    OPTIONAL {{ ?evaluation rt:policyVersion ?policy }} }}
}} ORDER BY ?grasp ?time ?evaluation""")
    confidences: dict[str, Confidence] = {}
    for row in rows:
        at: dict[str, Any] = row.to_dict()
        grasp = str(row.value("grasp"))
        confidence = confidences.get(grasp, Confidence())
        if at["alpha"] is not None:
            confidence = replace(
                confidence,
                belief=Belief(float(at["alpha"]), float(at["beta"])),
                updated=_iso(row.value("time")),
                policy=str(at["policy"] or ""),
            )
        elif confidence.prior is None:
            first, prior = str(row.value("evaluation")), float(at["confidence"])
            confidence = replace(confidence, evaluation=first, prior=prior)
        confidences[grasp] = confidence
    return confidences


def believe(
    context: Context,
    triples: Triples,
    grasp: NamedNode,
    counts: Mapping[tuple[bool, bool], int],
    author: NamedNode,
    graph: NamedNode,
    quality: float | None = None,
    stored: Mapping[str, Confidence] | None = None,
) -> list[tuple[NamedNode, NamedNode, Value]]:
    """Add the new posterior of a grasp, derived from the first evaluation if there is one.

    Parameters
    ----------
    counts
        Judged attempts of all robots by (held, in coarse physics), after the current commit.
    author
        Author of the outcome or verdict that changes it.
    graph
        Graph of the author.
    quality
        Generator's score, 0..1, for a grasp that is not stored yet.
    stored
        What is stored about the grasp, of :func:`stored_confidences`; None = it is looked up.

    Returns
    -------
    The statements of this author's previous posterior, which are to be withdrawn.
    """
    if stored is None:
        stored = stored_confidences(context, [grasp.value])
    first = stored.get(grasp.value, Confidence())
    prior = _quality(context, grasp, quality) if first.prior is None else first.prior
    belief = posterior(context.policy, prior, [(*how, n) for how, n in counts.items()])
    home = context.kb.graphs.owner(graph) or "shared"
    node = iri(f"{grasp.value}/evaluation/{slug(home)}")
    triples.discard(node, _BELIEF)
    old: list[tuple[NamedNode, NamedNode, Value]] = []
    for quad in context.kb.match(node, graph=graph):
        if quad.predicate in _BELIEF:
            old.append((node, quad.predicate, quad.object))
    triples.add(grasp, RT.hasEvaluation, node)
    triples.node(
        node,
        [RT.GraspEvaluation],
        {
            RT.graspConfidence: belief.mean,
            RT.beliefAlpha: belief.alpha,
            RT.beliefBeta: belief.beta,
            # Not rt:atTime, which rules use to find the newest.
            PROV.generatedAtTime: dt.datetime.now(dt.UTC),
            RT.policyVersion: context.policy.version,
            PROV.wasDerivedFrom: iri(first.evaluation) if first.evaluation else None,
            PROV.wasAttributedTo: author,
        },
    )
    return old


def _iso(time: Any) -> str:
    return time.isoformat() if isinstance(time, dt.datetime) else str(time)


def _quality(context: Context, grasp: NamedNode, stated: float | None) -> float | None:
    """Return the generator's score of a grasp that is stored or about to be."""
    if stated is not None:
        return min(max(stated, 0.0), 1.0)
    for quad in context.kb.match(grasp, RT.graspQuality):
        return min(max(float(str(python_value(object_term(quad.object)))), 0.0), 1.0)
    return None
