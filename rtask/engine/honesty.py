"""Honesty of robots: their agreement with others about the same grasps.

Robots that try one grasp of one object with the same kind of hand draw from one chance that it
holds. How a robot turns what happened into what it reports is one of a few manners: truthfully, the
other way round, always the same, or at random (a confusion matrix as of Dawid and Skene 1979, with
few values, because a robot has few reports). The others' reports, weighed by how truthful they are
believed to be, give a Beta distribution over the chance; a robot's own reports on the grasp are
Beta-Binomial under each manner. Beliefs about all robots are computed in turn until they settle.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.engine.policy import UNJUDGED
from rtask.rdf.namespaces import PREFIXES, RT, reason

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore

__all__ = ["MANNERS", "Honesty", "HonestyCatalogue", "Reports", "judge_honesty"]

MANNERS: Mapping[str, tuple[float, float]] = {
    "truthful": (0.97, 0.03),
    "the other way round": (0.03, 0.97),
    "always held": (0.97, 0.97),
    "never held": (0.03, 0.03),
    "at random": (0.5, 0.5),
}
"""Manners of reporting: the chances of the report "held" where the grasp held, and where not."""

_CONTRADICTS, _LEAST = 0.02, 8
_LATEST = 5_000
"""Attempts that are looked at, so that no decision waits long for it."""

_STALE_SHARE = 0.05
"""Beliefs are renewed when outcomes have changed by more than this share of those known."""

_OTHERS_WEIGHT = 0.5
"""Weight of one report of another robot. Below 1, because robots that differ in pose and wear do
not draw from exactly one chance."""

_PRIOR = np.array([0.9, 0.025, 0.025, 0.025, 0.025])
_PSEUDO = 0.5
_NODES = 33
_ROUNDS = 50


@dataclass(frozen=True)
class Reports:
    """Reports of one robot on one grasp.

    Parameters
    ----------
    held, count
        Attempts reported as held, and all; 0 <= held <= count.
    """

    robot: str
    grasp: str
    held: int
    count: int


@dataclass(frozen=True)
class Honesty:
    """Belief about how one robot reports.

    Parameters
    ----------
    attempts, comparable
        Reports, and those on grasps that others have tried as well.
    agreeing
        Comparable reports that say what most of the others say of the grasp; ties count half.
    truthful
        Probability that it reports truthfully.
    manner
        The most probable manner, one of :data:`MANNERS`.
    weight
        Part, 0..1, for which one of its reports counts with others; 1 for a robot that nothing
        speaks against.
    """

    robot: str
    attempts: int
    comparable: int
    agreeing: float
    truthful: float
    manner: str
    weight: float

    @property
    def contradicts(self) -> bool:
        """Whether it is almost surely not truthful; choices of others leave its reports out."""
        return self.truthful < _CONTRADICTS and self.comparable >= _LEAST


def judge_honesty(reports: Sequence[Reports]) -> dict[str, Honesty]:
    """Return the belief about each robot, from how its reports fit those of the others.

    Examples
    --------
    >>> said = [Reports(f"r{k}", f"g{i}", 4 * (i % 2), 4) for k in range(4) for i in range(6)]
    >>> said += [Reports("liar", f"g{i}", 4 - 4 * (i % 2), 4) for i in range(6)]
    >>> found = judge_honesty(said)
    >>> found["liar"].manner, found["r0"].manner
    ('the other way round', 'truthful')
    """
    if not reports:
        return {}
    reports_table = _ReportTable.of(reports)
    belief = np.tile(_PRIOR, (len(reports_table.names), 1))
    for _ in range(_ROUNDS):
        now = _beliefs(reports_table, belief)
        settled = bool(np.abs(now - belief).max() < 1e-4)
        # Half a step, so that two robots that contradict each other do not swap for ever.
        belief = now if settled else (belief + now) / 2
        if settled:
            break
    manners = list(MANNERS)
    comparable, agreeing = _agreement(reports_table)
    attempts = reports_table.by_robot(reports_table.count)
    return {
        name: Honesty(
            name, int(attempts[i]), int(comparable[i]), float(agreeing[i]), float(belief[i, 0]),
            manners[int(np.argmax(belief[i]))], _weight(belief[i]),
        )
        for i, name in enumerate(reports_table.names)
    }  # fmt: skip


def _weight(belief: NDArray[np.float64]) -> float:
    """Return how much a report says about a grasp, relative to one of a robot not yet compared.

    That is by how much "held" is more probable where the grasp holds than where it does not
    (Youden's J), over the manners of a robot. A report that speaks for the opposite counts nothing:
    whoever lies may stop lying.
    """
    tells = np.array([true - false for true, false in MANNERS.values()])
    # Rounded, so that a belief that has not moved gives exactly 1.
    return round(float(np.clip(belief @ tells / (_PRIOR @ tells), 0.0, 1.0)), 3)


@dataclass(frozen=True)
class _ReportTable:
    """Reports as arrays, one entry for each pair of a robot and a grasp that it has tried.

    Parameters
    ----------
    names
        Of the robots.
    robot, grasp
        (n,) int, numbers of the robots and grasps.
    held, count
        (n,) float, attempts reported as held, and all.
    """

    names: list[str]
    robot: NDArray[np.intp]
    grasp: NDArray[np.intp]
    held: NDArray[np.float64]
    count: NDArray[np.float64]

    @classmethod
    def of(cls, reports: Sequence[Reports]) -> _ReportTable:
        """Add up the reports of each pair."""
        names, robot = np.unique([report.robot for report in reports], return_inverse=True)
        grasps, grasp = np.unique([report.grasp for report in reports], return_inverse=True)
        pairs, pair = np.unique(robot * len(grasps) + grasp, return_inverse=True)
        held = _sums(pair, np.array([report.held for report in reports], dtype=np.float64))
        count = _sums(pair, np.array([report.count for report in reports], dtype=np.float64))
        of_robot, of_grasp = np.divmod(pairs, len(grasps))
        return cls([str(name) for name in names], of_robot, of_grasp, held, count)

    def by_robot(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums (r,) over the grasps of each robot."""
        return _sums(self.robot, values)

    def of_others(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return for each pair the sum over the other robots that tried the grasp, (n,)."""
        return _sums(self.grasp, values)[self.grasp] - values


def _sums(group: NDArray[np.intp], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of the values of each group."""
    sums: NDArray[np.float64] = np.bincount(group, values)  # type: ignore[assignment]  # of floats
    return sums


def _beliefs(reports: _ReportTable, belief: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (r, m) probabilities of manners, given the reports and the (r, m) beliefs."""
    trust = belief[reports.robot, 0] * _OTHERS_WEIGHT
    lost = reports.count - reports.held
    a = _PSEUDO + reports.of_others(trust * reports.held)
    b = _PSEUDO + reports.of_others(trust * lost)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    p, weights = (nodes + 1) / 2, weights / 2
    log_density = (a - 1)[:, None] * np.log(p) + (b - 1)[:, None] * np.log1p(-p) + np.log(weights)
    log_density -= _log_sum(log_density)[:, None]
    scores = np.tile(np.log(_PRIOR), (len(reports.names), 1))
    # A robot that is always lucky, or never, where nobody else has been is not to be doubted.
    comparable = reports.of_others(reports.count) > 0
    for m, (true, false) in enumerate(MANNERS.values()):
        chance = p * true + (1 - p) * false
        log_likelihood = reports.held[:, None] * np.log(chance) + lost[:, None] * np.log1p(-chance)
        scores[:, m] += reports.by_robot(_log_sum(log_density + log_likelihood) * comparable)
    scores -= scores.max(axis=1, keepdims=True)
    posterior: NDArray[np.float64] = np.exp(scores)
    posterior /= posterior.sum(axis=1, keepdims=True)
    return posterior


def _log_sum(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithms of the sums of rows, which thousands of attempts would make zero."""
    most = logs.max(axis=1)
    sums: NDArray[np.float64] = most + np.log(np.exp(logs - most[:, None]).sum(axis=1))
    return sums


def _agreement(reports: _ReportTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how many reports of each robot are comparable, and how many agree with most others."""
    others, of_others = reports.of_others(reports.held), reports.of_others(reports.count)
    is_comparable = of_others > 0
    most = np.sign(2 * others - of_others)
    held, lost = reports.held, reports.count - reports.held
    agree = np.where(most > 0, held, np.where(most < 0, lost, reports.count / 2))
    return reports.by_robot(reports.count * is_comparable), reports.by_robot(agree * is_comparable)


class HonestyCatalogue:
    """Beliefs about the robots of a graph, renewed as outcomes are added.

    Parameters
    ----------
    kb
        The knowledge base.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._cached: dict[str, Honesty] | None = None
        self._total = self._changed = 0

    def forget_if_changed(self, change: Change) -> None:
        """Take note of a commit with outcomes."""
        outcomes_changed = sum(
            quad.predicate == RT.hasOutcome for quad in (*change.added, *change.removed)
        )
        if outcomes_changed:
            with self._lock:
                self._changed += outcomes_changed

    def now(self) -> dict[str, Honesty]:
        """Return the beliefs by IRI of the robot, from the latest 5,000 attempts."""
        with self._lock:
            if self._cached is None or self._changed:
                self._renew()
            assert self._cached is not None
            return self._cached

    def doubts(self, asking: str | None = None) -> dict[str, float]:
        """Return the weights below 1 by IRI of the robot, sorted; 0 for those that contradict.

        Parameters
        ----------
        asking
            IRI of the robot that asks; its own word always counts in full.
        """
        with self._lock:
            if self._cached is None or self._changed > _STALE_SHARE * self._total:
                self._renew()
            assert self._cached is not None
            judgements = self._cached.values()
        weights = {
            honesty.robot: 0.0 if honesty.contradicts else honesty.weight for honesty in judgements
        }
        return {who: weights[who] for who in sorted(weights) if weights[who] < 1 and who != asking}

    def _renew(self) -> None:
        reports = _reports(self._kb)
        self._total, self._changed = sum(report.count for report in reports), 0
        self._cached = judge_honesty(reports)


def _reports(kb: GraphCore) -> list[Reports]:
    """Return what each robot reported of each grasp in the latest attempts.

    Hands of another type try other grasps.
    """
    unjudged = ", ".join(str(reason(code)) for code in UNJUDGED)
    rows = kb.select(f"""{PREFIXES}
SELECT ?robot ?grasp ?held (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{
  {{ SELECT ?attempt ?outcome WHERE {{
    ?attempt rt:hasOutcome ?outcome ; prov:endedAtTime ?ended
  }} ORDER BY DESC(?ended) DESC(?attempt) LIMIT {_LATEST} }}
  ?attempt rt:executesGrasp ?grasp ; rt:performedBy ?robot .
  ?outcome rt:hasReason ?reason ; rt:success ?held FILTER(?reason NOT IN ({unjudged}))
}} GROUP BY ?robot ?grasp ?held ORDER BY ?robot ?grasp""")
    counts: dict[tuple[str, str], Counter[bool]] = {}
    for row in rows:
        key = str(row.value("robot")), str(row.value("grasp"))
        counts.setdefault(key, Counter())[bool(row.value("held"))] += int(str(row.value("n")))
    return [Reports(*key, count[True], count.total()) for key, count in counts.items()]
