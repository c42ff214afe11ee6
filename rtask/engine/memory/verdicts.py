"""Attempts with people's verdicts, and the resulting label for learning."""

from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rtask.engine.policy import UNJUDGED
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, local_name, values
from rtask.rdf.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.sparql.results import Row

__all__ = ["Judged", "Verdict", "find_attempt", "judged_attempts", "label_of"]

_RECENT = 500


@dataclass(frozen=True)
class Verdict:
    """A person's verdict on an outcome.

    Parameters
    ----------
    by
        Name of the person.
    reason
        Code of the reason for the outcome in the person's opinion; empty if none was given.
    node
        IRI; None for one that is about to be stored.
    """

    by: str
    held: bool
    time: dt.datetime
    reason: str = ""
    comment: str = ""
    node: NamedNode | None = None


@dataclass(frozen=True)
class Judged:
    """An attempt with its verdicts.

    Parameters
    ----------
    decided
        Outcome reported by the robot.
    reason
        Code of the reason that the robot reported.
    is_fast
        Whether it was simulated with the coarse physics preset.
    verdicts
        Verdicts of people, oldest first.
    """

    attempt: NamedNode
    outcome: NamedNode
    grasp: NamedNode
    robot: NamedNode
    gripper_type: str
    decided: bool
    reason: str
    is_fast: bool
    verdicts: tuple[Verdict, ...] = ()

    @property
    def votes(self) -> tuple[int, int]:
        """Numbers of people whose latest verdict is that the grasp held, and that it did not."""
        latest = {verdict.by: verdict.held for verdict in self.verdicts}
        held = sum(latest.values())
        return held, len(latest) - held


def label_of(judged: Judged) -> bool | None:
    """Return the label for learning: success, failure, or None for neither.

    A disputed outcome is not counted. Nor is a failure that says nothing about the grasp, unless
    people judge that the grasp did hold.
    """
    held, lost = judged.votes
    if held == lost and judged.verdicts:
        return None
    label = held > lost if judged.verdicts else judged.decided
    return None if label == judged.decided and judged.reason in UNJUDGED else label


def find_attempt(
    context: Context, *, task_id: str | None, grasp: str | None, object_iri: str | None
) -> Judged:
    """Return the latest attempt of a task, grasp or object, with all verdicts on it.

    Raises
    ------
    UsageError
        The request names neither a task nor an object nor a grasp.
    UnknownTermError
        No attempt matches; the error suggests the nearest known name.
    """
    patterns = []
    if task_id:
        patterns.append(f"?attempt rt:requestId {literal(task_id)} .")
    if grasp:
        patterns.append(f"?attempt rt:executesGrasp {iri(grasp)} .")
    if object_iri:
        patterns.append(f"?task rt:through ?attempt ; rt:handles {iri(object_iri)} .")
    if not patterns:
        raise UsageError("task_id is missing; alternatively give object or grasp", field="task_id")
    attempts = _read(
        context,
        f"""{{ SELECT ?attempt WHERE {{ {" ".join(patterns)}
     ?attempt rt:executesGrasp ?any ; rt:hasOutcome ?result ; prov:endedAtTime ?ended
     }} ORDER BY DESC(?ended) DESC(?attempt) LIMIT 1 }}""",
    )
    if not attempts:
        raise UnknownTermError(
            _nothing_fits(context, task_id=task_id, grasp=grasp, object=object_iri)
        )
    return attempts[0]


def judged_attempts(context: Context, grasps: Collection[NamedNode]) -> list[Judged]:
    """Return all attempts of grasps, with all verdicts on them, ordered by IRI."""
    if not grasps:
        return []
    return _read(context, f"VALUES ?grasp {{ {values(sorted(grasp.value for grasp in grasps))} }}")


def _read(context: Context, which: str) -> list[Judged]:
    """Return the attempts that a pattern selects."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?attempt ?outcome ?grasp ?robot ?gripper ?decided ?code ?fast
  ?by ?held ?why ?said ?time ?feedback
WHERE {{
  {which}
  ?attempt rt:executesGrasp ?grasp ; rt:hasOutcome ?outcome ; rt:performedBy ?robot ;
    rt:activates/rt:gripperType ?gripper .
  ?outcome rt:success ?decided ; rt:hasReason ?code
  BIND(EXISTS {{ ?outcome rt:hasFeedback/rt:preset "fast" }} AS ?fast)
  OPTIONAL {{ ?outcome rt:hasFeedback ?feedback .
    ?feedback a rt:HumanFeedback ; rt:verdict ?held ; rt:atTime ?time ;
      prov:wasAttributedTo/rt:name ?by
    OPTIONAL {{ ?feedback rt:saidReason ?why }} OPTIONAL {{ ?feedback rt:comment ?said }} }}
}} ORDER BY ?attempt ?time ?feedback""")
    grouped: dict[str, list[Row]] = {}
    for row in rows:
        grouped.setdefault(str(row.value("attempt")), []).append(row)
    return [_judged(mine) for mine in grouped.values()]


def _judged(rows: Sequence[Row]) -> Judged:
    """Return one attempt from its rows, one for each verdict."""
    attempts: list[dict[str, Any]] = [row.to_dict() for row in rows]
    verdicts = {
        (str(row["time"]), str(row["by"])): Verdict(
            str(row["by"]), bool(row["held"]), _time(row["time"]), _code(row["why"]),
            str(row["said"] or ""), iri(str(row["feedback"])),
        )
        for row in attempts
        if row["by"] is not None
    }  # fmt: skip
    first = attempts[0]
    return Judged(
        iri(str(first["attempt"])),
        iri(str(first["outcome"])),
        iri(str(first["grasp"])),
        iri(str(first["robot"])),
        str(first["gripper"]),
        bool(first["decided"]),
        _code(first["code"]),
        bool(first["fast"]),
        tuple(verdicts.values()),
    )


def _code(name: Any) -> str:
    return "" if name is None else local_name(str(name)).removeprefix("reason_")


def _time(value: Any) -> dt.datetime:
    time = value if isinstance(value, dt.datetime) else dt.datetime.fromisoformat(str(value))
    return time if time.tzinfo else time.replace(tzinfo=dt.UTC)


def _nothing_fits(context: Context, **named: str | None) -> str:
    """Return why no attempt matches, with the nearest name among the latest attempts."""
    given = {name: value for name, value in named.items() if value}
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?task_id ?grasp ?object WHERE {{
  ?attempt rt:hasOutcome ?outcome ; rt:requestId ?task_id ; rt:executesGrasp ?grasp ;
    prov:endedAtTime ?ended . ?task rt:through ?attempt ; rt:handles ?object
}} ORDER BY DESC(?ended) LIMIT {_RECENT}""")
    hints = []
    for name, value in given.items():
        values_stored = sorted({str(row.value(name)) for row in rows})
        if value not in values_stored:
            near = difflib.get_close_matches(value, values_stored, n=1, cutoff=0.8)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            hints.append(f"unknown {name} {value!r}{hint}")
    reason = "; ".join(hints) or f"no attempt fits {' and '.join(given)} together"
    return f"{reason}: nothing to judge"
