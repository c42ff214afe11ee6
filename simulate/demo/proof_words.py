"""What a proof shows: the attempts side by side, what the robot relied on, and each point."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from ontology import PREFIXES
from rtask.engine.words import reason_words
from simulate.demo.products import by_product
from simulate.demo.report_attempts import GRASP_WORDS

__all__ = [
    "attempts_of",
    "clock",
    "find_evidence",
    "first_grasp",
    "proof_points",
    "proof_rows",
    "reliance",
]

Runs = Mapping[str, Mapping[str, Any]]
"""What robots did, each with its ``encounters``, by the title of the run."""

_EVIDENCE = """
SELECT ?attempt ?robot ?time ?grasp ?held (SAMPLE(?sha) AS ?picture) {
  <%s> rt:hasGrasp ?grasp . ?attempt rt:executesGrasp ?grasp ; rt:performedBy/rt:name ?robot ;
    prov:endedAtTime ?time ; rt:hasOutcome/rt:judgedSuccess ?held .
  FILTER(?robot != "%s")
  OPTIONAL { ?image prov:wasGeneratedBy ?attempt ; a rt:ColorImage ; rt:name ?phase ;
    rt:hasBlob/rt:sha256 ?sha . FILTER(?phase = IF(?held, "held", "closed")) }
} GROUP BY ?attempt ?robot ?time ?grasp ?held ORDER BY ?time"""


class _Graph(Protocol):
    def query(self, sparql: str, /) -> Any: ...


def attempts_of(run: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the physical attempts of a run, in order."""
    return [
        attempt
        for met in by_product(run["encounters"])
        for attempt in met["attempts"]
        if attempt["physical"]
    ]


def first_grasp(run: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the first physical attempt of a run; None if there was none."""
    return next(iter(attempts_of(run)), None)


def _succeeded(attempt: Mapping[str, Any] | None) -> bool:
    """Return whether an attempt held, and was not lost on the way."""
    return bool(attempt and attempt["held"] and attempt["place_reason"] != "slip_transport")


def _outcome_words(attempt: Mapping[str, Any]) -> str:
    grasp = GRASP_WORDS.get(attempt["source"], f"grasp from {attempt['source']}")
    if _succeeded(attempt):
        return f"held; {grasp}"
    why = attempt["place_reason"] if attempt["held"] else attempt["reason"]
    return f"failed, {reason_words(why) or why}; {grasp}"


def proof_rows(runs: Runs, titles: Sequence[str]) -> list[tuple[str, ...]]:
    """Return a row for each attempt, the runs side by side."""
    columns = [
        [_outcome_words(attempt) for attempt in attempts_of(runs[title])] for title in titles
    ]
    return [
        (str(k + 1), *(words[k] if k < len(words) else "" for words in columns))
        for k in range(max(map(len, columns), default=0))
    ]


def find_evidence(
    graph: _Graph, thing: str, robot: str, attempt: Mapping[str, Any] | None
) -> list[dict[str, Any]]:
    """Return the attempts of others at an object that its graph holds, in order of time.

    Parameters
    ----------
    graph
        Answers SPARQL.
    thing
        IRI of the object; empty = it was not recognised, and there is no evidence.
    robot
        Name of the robot that relied on them.
    attempt
        Its first attempt.

    Returns
    -------
    list of dict
        ``same_grasp`` tells whether the robot repeated that very grasp; ``picture`` is the SHA-256
        of the picture of the moment, empty without one.
    """
    if not thing or attempt is None:
        return []
    prefixes = "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in PREFIXES.items())
    return [
        {
            "attempt": str(row["attempt"]),
            "robot": str(row["robot"]),
            "time": str(row["time"]),
            "held": str(row["held"]).lower() == "true",
            "same_grasp": str(row["grasp"]) == attempt["grasp"],
            "picture": str(row["picture"] or ""),
        }
        for row in graph.query(prefixes + _EVIDENCE % (thing, robot))
    ]


def clock(stamp: str) -> str:
    """Return the time of day of a stamp of ISO 8601 in UTC, to the second.

    >>> clock("2026-03-01T11:14:56.248878Z")
    '11:14:56 UTC'
    """
    return f"{dt.datetime.fromisoformat(stamp).astimezone(dt.UTC):%H:%M:%S} UTC"


def reliance(attempt: Mapping[str, Any] | None, evidence: Sequence[Mapping[str, Any]]) -> str:
    """Return on what the robot with the graph relied, in words."""
    if attempt is None or not evidence:
        return "The robot with the graph names no attempt of another: it relied on none."
    lines = ["The robot with the graph relied on"]
    for row in evidence:
        what = "held" if row["held"] else "failed"
        same = ", the grasp that it repeated" if row["same_grasp"] else ""
        lines.append(f"  {row['robot']}, {clock(row['time'])}: {what}{same}: {row['attempt']}")
        if row.get("picture_url"):
            lines.append(f"    picture {row['picture_url']}")
    if attempt.get("alone"):
        lines.append(f"  in its own words: {attempt['alone']}")
    return "\n".join(lines)


def proof_points(
    runs: Runs, titles: Sequence[str], evidence: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Return what was to be shown, point by point, and whether it was.

    Parameters
    ----------
    titles
        Of the runs alone, with the graph, with a shuffled one, with the teacher withdrawn and with
        the withdrawal undone.
    """
    alone, shared, shuffled, withdrawn, undone = (first_grasp(runs[title]) for title in titles)
    same = ""
    if alone and withdrawn and not _succeeded(withdrawn):
        is_same = (alone["source"], alone["reason"]) == (withdrawn["source"], withdrawn["reason"])
        same = ", as the one alone" if is_same else ", in another way than the one alone"
    named = [row for row in evidence if row["held"]]
    return [
        _point("alone, the first attempt failed", alone is not None and not _succeeded(alone)),
        _point(
            "with lessons of another product, the first attempt failed",
            shuffled is not None and not _succeeded(shuffled),
        ),
        _point("with the graph, it held at once with a remembered grasp", _from_memory(shared)),
        _point(
            "it names the attempt that it relied on, and its picture",
            any(row["picture"] for row in named),
        ),
        _point(
            f"with its teacher withdrawn, the first attempt failed again{same}",
            withdrawn is not None and not _succeeded(withdrawn),
        ),
        _point("with the withdrawal undone, it held at once again", _from_memory(undone)),
    ]


def _from_memory(attempt: Mapping[str, Any] | None) -> bool:
    return attempt is not None and _succeeded(attempt) and attempt["source"] == "memory"


def _point(text: str, shown: bool) -> dict[str, Any]:
    return {"text": text, "shown": shown}
