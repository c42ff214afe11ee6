"""Operations of the SPARQL 1.1 Protocol on the knowledge base (2.1.4 to 2.2.4)."""

from __future__ import annotations

import datetime as dt
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

from endpoint.access.auth import Caller
from endpoint.http.compression import wants_gzip
from endpoint.http.conditional import Versions, is_current
from endpoint.http.messages import (
    JSON_TYPE,
    RefusedError,
    Request,
    Response,
    json_response,
    remark_header,
)
from endpoint.http.outbound_http import Outgoing
from endpoint.http.plan import Plan, RunningQuery
from endpoint.served import ServedGraph, embedded
from endpoint.settings import Config, Limits
from endpoint.sparql import federation, negotiation
from endpoint.sparql.answer_cache import AnswerCache
from endpoint.sparql.answers import GRACE_S, Answers, Question
from endpoint.sparql.branches import BranchStates, open_named
from endpoint.sparql.description import MAX_NAMED_GRAPHS, describe
from endpoint.sparql.limits import checked_form
from endpoint.sparql.lookups import Lookups
from endpoint.sparql.past_states import PastStates, parse_as_of
from endpoint.sparql.request import QueryRequest, UpdateRequest, absolute_iri
from endpoint.sparql.update_trial import try_where
from rtask.errors import (
    ClosedError,
    ForbiddenError,
    QuerySyntaxError,
    QueryTimeout,
    RtaskError,
    VersionConflictError,
)
from rtask.kb.commit.budget import OF_OPERATORS
from rtask.kb.commit.commit import Commit
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.sparql.query_cost import is_lookup, is_quick
from rtask.sparql.service import without_services
from rtask.sparql.slow_shapes import SlowShapes
from rtask.sparql.tokens import shape

_CACHED_TEXT = 16_384
_LIST_GRAPHS = f"SELECT ?g WHERE {{ GRAPH ?g {{}} }} ORDER BY ?g LIMIT {MAX_NAMED_GRAPHS + 1}"


@lru_cache(maxsize=512)
def _remembered_form(masked: str, limits: Limits) -> str:
    return checked_form(masked, limits)


def _form(text: str, limits: Limits) -> str:
    """Return the form of a query; short texts that differ in their IRIs only are read once."""
    if len(text) > min(_CACHED_TEXT, limits.query_bytes):
        return checked_form(text, limits)
    masked = shape(text)
    try:
        return _remembered_form(masked, limits)
    except RtaskError:
        return checked_form(text, limits)  # for the position in the text as sent


@dataclass(frozen=True)
class Asked:
    """The parts that answer queries: readers, look-ups, caches, earlier states; slow queries."""

    answers: Answers
    lookups: Lookups
    cache: AnswerCache
    versions: Versions
    past: PastStates
    branches: BranchStates
    slow: SlowShapes


def plan_query(
    query: QueryRequest, request: Request, caller: Caller, config: Config, asked: Asked
) -> Plan:
    """Plan a query: check limits, format, dataset and whether the client has the answer already.

    Raises
    ------
    RefusedError
        The query is too complex, or no format is acceptable.
    QuerySyntaxError
        The text is not a query.
    """
    is_elsewhere = bool(query.as_of or query.branch)
    if query.as_of and query.branch:
        raise RefusedError(400, "usage", "`as_of` and `branch` in one query")
    lookup = is_lookup(query.text) and not is_elsewhere
    form = "SELECT" if lookup else _form(query.text, config.limits)
    if not form:
        raise QuerySyntaxError(
            "this is not a query: expected SELECT, ASK, CONSTRUCT or DESCRIBE; "
            "send updates as `update=` or application/sparql-update"
        )
    offers = negotiation.SOLUTION_TYPES if form in ("SELECT", "ASK") else negotiation.GRAPH_TYPES
    media_type = negotiation.choose(request.header("accept"), offers)
    content_type = negotiation.content_type(media_type)
    etag = ""
    if not is_elsewhere:
        etag = asked.versions.of_query(
            query.text,
            query.default_graphs,
            query.named_graphs,
            query.inferred,
            query.base,
            media_type,
        )
    headers: tuple[tuple[str, str], ...] = (("ETag", etag),) if etag else ()
    timeout_s = config.effective_timeout(query.timeout_s, caller.access.role)
    if query.timeout_s is not None and query.timeout_s > timeout_s:
        headers = (*headers, ("RTASK-Timeout", f"{timeout_s:g}"))
    if is_current(request, etag):
        return Plan.ready(Response(304, headers=headers))
    if request.method == "HEAD":
        return Plan.ready(Response(200, b"", content_type, headers))
    running = RunningQuery(request.id, caller.key, caller.name, query.text, timeout_s)
    deadline = running.started + timeout_s
    question = Question(query, media_type, wants_gzip(request), headers, running, deadline)
    if is_elsewhere:
        other = _Query(question, lookup, None, timeout_s, config, asked)
        other.require_local("as_of" if query.as_of else "branch")
        run = other.run_in_branch
        if query.as_of:
            run = partial(other.run_past, parse_as_of(query.as_of))
        return Plan(run, timeout_s + GRACE_S, "query", form, query.text, running)
    keep = None
    if query.timeout_s is None:  # a limit may be answered with a header that depends on the role
        keep = asked.cache.keeper(request, caller.access, form, query.text, etag)
    planned = _Query(question, lookup, keep, timeout_s, config, asked)
    if lookup and asked.lookups.in_memory and (response := planned.look_up()) is not None:
        return Plan(lambda: response, None, "loop", form, query.text, query=planned)
    is_point = lookup or (is_quick(query.text) and query.text not in asked.slow)
    return Plan(
        planned.run_point if is_point else planned.run,
        timeout_s + GRACE_S,
        "point" if is_point else "query",
        form,
        query.text,
        running,
        planned,
    )


class _Query:
    """The steps of one query, as :mod:`endpoint.lanes` takes them.

    Its reader is killed at the deadline.
    """

    __slots__ = ("_asked", "_config", "_keep", "_lookup", "_question", "_timeout_s")

    def __init__(
        self,
        question: Question,
        lookup: bool,
        keep: Callable[[Response], None] | None,
        timeout_s: float,
        config: Config,
        asked: Asked,
    ) -> None:
        self._question = question
        self._lookup = lookup
        self._keep = keep
        self._timeout_s = timeout_s
        self._config = config
        self._asked = asked

    def run(self) -> Response:
        """Answer among the long queries."""
        return self._guarded(lambda: self._open(point=False))

    def run_point(self) -> Response:
        """Answer among the quick queries."""
        return self._guarded(lambda: self._open(point=True))

    def require_local(self, field: str) -> None:
        """Refuse SERVICE in a query of another state, which another server does not have."""
        if federation.mentions(self._question.query.text, "SERVICE"):
            raise RefusedError(400, "usage", f"`{field}` and SERVICE in one query")

    def run_in_branch(self) -> Response:
        """Answer from a branch."""
        name = self._question.query.branch
        return self._guarded(lambda: self._asked.branches.open(self._question, name))

    def run_past(self, at: int | dt.datetime | str) -> Response:
        """Answer from an earlier state."""
        return self._guarded(lambda: self._asked.past.open(self._question, at))

    def _open(self, point: bool) -> Response:
        return self._asked.answers.open(_federated(self._question, self._config), point=point)

    def encode(self) -> bytes | None:
        """Return the query as it is sent to a reader; none if a thread is to do the work."""
        if _calls_out(self._question.query.text, self._config):
            return None
        return self._asked.answers.encode(self._question)

    def whole(self, answer: Answer) -> Response:
        """Return the response for a whole answer from a reader."""
        return self._asked.answers.whole(self._question, answer)

    def resume(self, stream: ReaderStream) -> Response:
        """Answer from what a reader has begun to send."""
        return self._guarded(lambda: self._asked.answers.resume(self._question, stream))

    def look_up(self) -> Response | None:
        """Answer from the store in this process, if the query only asks about one thing."""
        query = self._question.query
        if not self._lookup or not query.inferred or query.default_graphs or query.named_graphs:
            return None
        return self._asked.lookups.try_now(self._question)

    def keep(self, response: Response) -> None:
        """Take the response, before it is sent, for the answer cache."""
        if self._keep is not None:
            self._keep(response)

    def _guarded(self, work: Callable[[], Response]) -> Response:
        try:
            return work()
        except QueryTimeout:
            raise timed_out(self._timeout_s, self._config) from None
        except ClosedError:
            if not self._question.running.stopped:
                raise
            raise RefusedError(503, "query-stopped", "the query was stopped") from None


def _calls_out(text: str, config: Config) -> bool:
    return bool(config.allow_service) and federation.mentions(text, "SERVICE")


def _federated(question: Question, config: Config) -> Question:
    """Query other servers first if that is allowed; otherwise the store refuses SERVICE."""
    query = question.query
    if not _calls_out(query.text, config):
        return question
    outgoing = Outgoing("SERVICE", config.allow_service)
    text = federation.answer_services(query.text, outgoing, question.deadline, query.base)
    return replace(question, query=replace(query, text=text))


def timed_out(seconds: float, config: Config) -> RefusedError:
    """Return the error for work that exceeded its time limit."""
    return RefusedError(
        504,
        "query-timeout",
        f"no answer within {seconds:g} s; request more with `timeout=<seconds>`, "
        f"at most {config.max_timeout_s:g}, or for fewer rows with LIMIT",
        limit=seconds,
    )


def plan_update(
    kb: ServedGraph, update: UpdateRequest, request: Request, caller: Caller, config: Config
) -> Plan:
    """Plan an update; the knowledge base checks rights on the exact change.

    Raises
    ------
    RefusedError
        Too complex.
    ForbiddenError
        The update calls another server, or its agent is not the caller.
    """
    caller = _in_the_name_of(caller, update.agent)
    if checked_form(update.text, config.limits, update=True):
        raise QuerySyntaxError("this is a query; send it as `query=` or application/sparql-query")
    wants_json = JSON_TYPE in request.header("accept").lower()
    if not config.allow_service:
        # The WHERE part of an update would call out just as a query would.
        without_services(update.text)

    def run() -> Response:
        attribution = caller.note(request)
        note = f"{update.note} ({attribution})" if update.note else attribution
        target = _written_branch(kb, update.branch, caller) if update.branch else kb
        commit = _commit(target, update, caller, note, config)
        remark = commit.remark if commit else None
        if not wants_json:
            return Response(204, headers=remark_header(remark))
        # Another server does not say what it changed.
        counts = {
            "seq": commit.seq if commit else target.seq,
            "added": commit and commit.added,
            "removed": commit and commit.removed,
            "derived": commit and commit.derived,
            **({"remark": remark} if remark else {}),
        }
        return json_response(counts)

    return Plan(run, form="UPDATE", text=update.text)


def _written_branch(kb: ServedGraph, name: str, caller: Caller) -> ServedGraph:
    """Return the graph of a branch that a caller may write."""
    branch = open_named(kb, name)
    branch.record.require_may_write(caller.access)
    return branch.graph


def _in_the_name_of(caller: Caller, agent: str) -> Caller:
    """Return the caller as the author of a change; who has a name writes in no other."""
    own = caller.access.agent
    if not agent or agent == own:
        return caller
    if own:
        raise ForbiddenError(f"the token belongs to {own!r}: it cannot write for {agent!r}")
    return replace(caller, access=replace(caller.access, agent=agent))


def _commit(
    kb: ServedGraph, update: UpdateRequest, caller: Caller, note: str, config: Config
) -> Commit | None:
    """Carry out an update, including its requests to other servers if those are allowed."""
    text = update.text
    deadline = time.monotonic() + config.timeout_s
    if config.allow_service and federation.mentions(text, "SERVICE"):
        outgoing = Outgoing("SERVICE", config.allow_service)
        text = federation.answer_services(text, outgoing, deadline, update.base)
    limit_s = config.max_timeout_s if caller.access.role == "admin" else config.write_timeout_s
    version = _expected(kb, update.if_version)
    reasoning = OF_OPERATORS if caller.access.role == "admin" else None

    def run(text: str) -> Commit | None:
        text = without_services(text)
        if not kb.readers.evaluate_updates:
            try_where(kb, update, text, limit_s)
        return kb.update(
            text,
            note=note,
            using=update.using,
            named=update.using_named,
            access=caller.access,
            base=update.base,
            if_version=version,
            limits=UpdateLimits(limit_s, reasoning=reasoning),
        )

    if config.allow_load and federation.mentions(text, "LOAD"):
        outgoing = Outgoing("LOAD", config.allow_load)
        own = embedded(kb, "LOAD")
        return federation.update_with_loads(
            own, update, text, caller, note, outgoing, deadline, run
        )
    return run(text)


def _expected(kb: ServedGraph, text: str) -> int | None:
    """Return the number of the last commit on which a change depends, if it depends on one.

    Raises
    ------
    RefusedError
        The text is no version.
    VersionConflictError
        The version is from before a backup was restored.
    """
    if not text:
        return None
    epoch, _, number = text.partition(":")
    if not number.isdecimal() or len(number) > 17:
        raise RefusedError(400, "usage", "`if-version` is EPOCH:NUMBER, as in RTASK-Version")
    if epoch != kb.epoch:
        raise VersionConflictError(f"versions were renumbered with epoch {kb.epoch}")
    return int(number)


def plan_description(kb: ServedGraph, request: Request, config: Config, *, updates: bool) -> Plan:
    """Plan the service description."""
    media_type = negotiation.choose(request.header("accept"), negotiation.GRAPH_TYPES)
    address = absolute_iri(request.url, "the address of this service")

    def run() -> Response:
        names = [str(row.value("g")) for row in kb.select(_LIST_GRAPHS)]
        base = "" if kb.plain else kb.base
        return describe(
            address, media_type, plain=config.plain, updates=updates, graphs=names, base=base
        )

    return Plan(run, config.timeout_s)
