"""One attempt with everything that belongs to it: statements, pictures and other binary data."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from rtask.errors import UnsupportedError, UsageError
from rtask.rdf.namespaces import PREFIXES, PROV, RDF, RT, local_name
from rtask.rdf.terms import BlankNode, NamedNode, Quad, iri, moment

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Episode", "Picture", "blobs_of", "episodes_of", "statements_of"]

_BLOB = "urn:sha256:"


@dataclass(frozen=True)
class Picture:
    """A picture of an attempt.

    Parameters
    ----------
    node
        IRI of the picture.
    phase
        Of the attempt, such as ``lift``; empty if it has no name.
    blob
        IRI of its bytes.
    """

    node: str
    phase: str
    blob: str


@dataclass(frozen=True)
class Episode:
    """An attempt, as the graph states it.

    Parameters
    ----------
    attempt, robot, task, thing
        IRIs; ``task`` and ``thing`` are None where none is stated.
    robot_name, thing_name, reason
        Names; empty where none is stated.
    started, ended
        Times; ``started`` is None where it is not stated.
    held, placed
        What the robot judged; None = not judged.
    evidence
        Remarks on which the judgement rests.
    pictures
        Pictures of the attempt, in the order of their names.
    motion
        IRI of the bytes of a :class:`~rtask.interop.episodes.motion.Motion`; empty if the joints
        were not recorded.
    """

    attempt: str
    robot: str
    robot_name: str
    ended: dt.datetime
    task: str | None = None
    thing: str | None = None
    thing_name: str = ""
    started: dt.datetime | None = None
    held: bool | None = None
    placed: bool | None = None
    reason: str = ""
    evidence: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = field(default=())
    motion: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the episode as JSON data."""
        fields = asdict(self)
        for key in ("started", "ended"):
            fields[key] = fields[key].isoformat() if fields[key] else None
        return fields


_EPISODES = """
SELECT ?attempt ?robot ?robotName ?ended ?started ?task ?thing ?thingName ?held ?placed ?reason {{
  ?attempt a rt:GraspAttempt ; rt:performedBy ?robot ; prov:endedAtTime ?ended .
  OPTIONAL {{ ?attempt prov:startedAtTime ?started }}
  OPTIONAL {{ ?robot rt:name ?robotName }}
  OPTIONAL {{ ?task rt:through ?attempt
    OPTIONAL {{ ?task rt:handles ?thing OPTIONAL {{ ?thing rt:name ?thingName }} }} }}
  OPTIONAL {{ ?attempt rt:hasOutcome ?outcome
    OPTIONAL {{ ?outcome rt:success ?held }} OPTIONAL {{ ?outcome rt:placed ?placed }}
    OPTIONAL {{ ?outcome rt:hasReason ?reason }} }}
  {narrow}
}} ORDER BY ?ended ?attempt"""

_EVIDENCE = """
SELECT DISTINCT ?attempt ?comment {
  ?attempt a rt:GraspAttempt ; rt:hasOutcome/rt:hasFeedback/rt:comment ?comment
} ORDER BY ?attempt ?comment"""

_PICTURES = """
SELECT DISTINCT ?attempt ?node ?phase ?blob {
  ?attempt a rt:GraspAttempt . ?node prov:wasGeneratedBy ?attempt ; rt:hasBlob ?blob .
  FILTER NOT EXISTS { ?node a rt:JointTrajectory }
  OPTIONAL { ?node rt:name ?phase }
} ORDER BY ?node"""

_MOTIONS = """
SELECT DISTINCT ?attempt ?blob {
  ?attempt a rt:GraspAttempt . ?node prov:wasGeneratedBy ?attempt ; a rt:JointTrajectory ;
    rt:hasBlob ?blob
} ORDER BY ?attempt ?blob"""


def episodes_of(
    kb: GraphCore,
    *,
    robot: str | None = None,
    since: dt.datetime | None = None,
    query: str | None = None,
) -> list[Episode]:
    """Return the episodes of a graph in the order of their ends.

    Parameters
    ----------
    kb
        The graph.
    robot
        Name or IRI of the robot; None = all.
    since
        Only those that ended at this time or later, with a time zone; None = all.
    query
        SPARQL SELECT of attempts: its variable ``?attempt``, else its first; None = all. The usual
        prefixes need no declaration.

    Raises
    ------
    UsageError
        ``since`` has no time zone, or ``query`` is no SELECT of attempts.
    QuerySyntaxError
        ``query`` cannot be read.
    """
    if since is not None and since.tzinfo is None:
        raise UsageError(f"{since.isoformat()} has no time zone; write, say, {since.isoformat()}Z")
    narrow = ""
    if since is not None:
        narrow = f'FILTER(?ended >= "{since.isoformat()}"^^xsd:dateTime)'
    among = None if query is None else _selected(kb, query)
    pictures: dict[str, list[Picture]] = {}
    for row in _rows(kb, _PICTURES):
        picture = Picture(str(row["node"]), str(row["phase"] or ""), str(row["blob"]))
        pictures.setdefault(str(row["attempt"]), []).append(picture)
    evidence: dict[str, list[str]] = {}
    for row in _rows(kb, _EVIDENCE):
        evidence.setdefault(str(row["attempt"]), []).append(str(row["comment"]))
    motions = {str(row["attempt"]): str(row["blob"]) for row in _rows(kb, _MOTIONS)}
    episodes: dict[str, Episode] = {}
    for row in _rows(kb, _EPISODES.format(narrow=narrow)):
        attempt = str(row["attempt"])
        if robot is not None and robot not in (str(row["robot"]), str(row["robotName"])):
            continue
        if among is not None and attempt not in among:
            continue
        episodes.setdefault(
            attempt,
            replace(
                _episode(row, tuple(evidence.get(attempt, ()))),
                pictures=tuple(pictures.get(attempt, ())),
                motion=motions.get(attempt, ""),
            ),
        )
    return list(episodes.values())


def _selected(kb: GraphCore, query: str) -> set[str]:
    """Return the IRIs that a SELECT of attempts has in its rows."""
    try:
        rows = kb.select(f"{PREFIXES}\n{query}")
    except UnsupportedError as error:
        raise UsageError(f"attempts are chosen by a SELECT: {error}") from error
    if not rows.variables:  # SELECT * of a pattern without variables
        raise UsageError("attempts are chosen by a SELECT of ?attempt; this one has no variable")
    column = "attempt" if "attempt" in rows.variables else rows.variables[0]
    named = {term for row in rows if (term := row[column]) is not None}
    # Rows of something else would look like a selection in which nothing happened to fit.
    attempts = {
        term.value
        for term in named
        if isinstance(term, NamedNode) and kb.match(term, RDF.type, RT.GraspAttempt)
    }
    if named and not attempts:
        raise UsageError(
            f"attempts are chosen by a SELECT of ?attempt; the ?{column} of this one is no "
            f"attempt (rt:GraspAttempt), such as {min(map(str, named))}"
        )
    return attempts


def _rows(kb: GraphCore, query: str) -> Iterator[dict[str, Any]]:
    yield from kb.select(f"{PREFIXES}{query}").to_dicts()


def _episode(row: dict[str, Any], evidence: tuple[str, ...]) -> Episode:
    return Episode(
        attempt=str(row["attempt"]),
        robot=str(row["robot"]),
        robot_name=str(row["robotName"] or ""),
        ended=moment(row["ended"]),
        task=str(row["task"]) if row["task"] else None,
        thing=str(row["thing"]) if row["thing"] else None,
        thing_name=str(row["thingName"] or ""),
        started=moment(row["started"]) if row["started"] else None,
        held=row["held"],
        placed=row["placed"],
        reason=local_name(str(row["reason"])).removeprefix("reason_") if row["reason"] else "",
        evidence=evidence,
    )


def statements_of(kb: GraphCore, episode: Episode) -> list[Quad]:
    """Return the statements that belong to an episode, each in the graph that asserts it.

    Those about the attempt, what names it (task, pictures), and everything reached from there: the
    outcome and its evidence, the grasp, the robot, the object with its views. Other attempts and
    what only they name stay away.

    Parameters
    ----------
    kb
        The graph.
    episode
        From :func:`episodes_of`.
    """
    start = iri(episode.attempt)
    waiting: list[NamedNode | BlankNode] = [start, *_naming(kb, [start])]
    if episode.thing:
        waiting += [iri(episode.thing), *_naming(kb, [iri(episode.thing)])]
    seen: set[NamedNode | BlankNode] = set()
    statements: dict[Quad, None] = {}
    while waiting:
        node = waiting.pop()
        if node in seen or (node != start and _is_of_another(kb, node, episode)):
            continue
        seen.add(node)
        for quad in _data(kb, kb.match(node, None, None)):
            statements[quad] = None
            target = quad.object
            if isinstance(target, NamedNode | BlankNode) and quad.predicate != RDF.type:
                waiting.append(target)
    return list(statements)


def _naming(kb: GraphCore, nodes: Sequence[NamedNode]) -> list[NamedNode | BlankNode]:
    """Return what names one of some nodes: tasks, pictures, views."""
    return [
        quad.subject
        for node in nodes
        for quad in _data(kb, kb.match(None, None, node))
        if isinstance(quad.subject, NamedNode | BlankNode)
    ]


def _is_of_another(kb: GraphCore, node: NamedNode | BlankNode, episode: Episode) -> bool:
    """Tell whether a node is another attempt, or the task or a picture of one."""
    if kb.match(node, RDF.type, RT.GraspAttempt):
        return True
    attempts = [*kb.match(node, RT.through, None), *kb.match(node, PROV.wasGeneratedBy, None)]
    named = [quad.object for quad in attempts if isinstance(quad.object, NamedNode)]
    others = [reified for reified in named if kb.match(reified, RDF.type, RT.GraspAttempt)]
    return bool(others) and iri(episode.attempt) not in others


def _data(kb: GraphCore, quads: Iterable[Quad]) -> Iterator[Quad]:
    """Yield the statements that robots and people asserted: not the ontology's, not inferred."""
    for quad in quads:
        graph = quad.graph_name
        if not isinstance(graph, NamedNode) or not kb.graphs.is_input(graph):
            continue
        imported = graph.value.startswith(f"{kb.graphs.base}graph/import/")
        if imported or kb.graphs.owner(graph) is not None:
            yield quad


def blobs_of(quads: Iterable[Quad]) -> list[str]:
    """Return the IRIs of the binary data that statements name, each once."""
    named = (quad.object.value for quad in quads if isinstance(quad.object, NamedNode))
    return list(dict.fromkeys(value for value in named if value.startswith(_BLOB)))
