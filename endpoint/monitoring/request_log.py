"""Records of each request: a log line, metrics and, where it matters, the audit trail."""

from __future__ import annotations

import hashlib
import time
from typing import NamedTuple

from endpoint.access.auth import Caller
from endpoint.http.messages import Request, Response
from endpoint.http.plan import Plan
from endpoint.monitoring.audit import Audit
from endpoint.monitoring.log import LineWriter, as_json, redacted, timestamp
from endpoint.monitoring.metrics import Metrics
from endpoint.served import ServedGraph
from endpoint.settings import Config
from rtask.kb.commit.commit import Change

SLOW_S = 1.0
_MAX_TEXT = 10_000


class Sender(NamedTuple):
    """Part of a log line known before the answer; equal for many requests of a client.

    Attributes
    ----------
    method, path
        Labels of metrics.
    asked, who
        Members of the log line, as JSON.
    """

    method: str
    path: str
    asked: str
    who: str

    @classmethod
    def of(cls, request: Request, caller: Caller | None) -> Sender:
        """Return what is said of a request, whose caller may be unknown."""
        path = redacted(request.raw_path)
        asked = f'"method": {as_json(request.method)}, "path": {as_json(path)}'
        who = f'"client": {as_json(request.client)}'
        if caller is not None:
            who += f', "role": "{caller.access.role}"'
            if caller.access.agent:
                who += f', "agent": {as_json(caller.access.agent)}'
            if caller.token:
                who += f', "token": "{caller.token.id}"'
        return cls(request.method, request.raw_path, asked, who)


class Outcome(NamedTuple):
    """End of a request: status, sizes, completeness.

    Attributes
    ----------
    id
        Request id.
    received, sent
        Bytes of the bodies.
    whole
        Whether the client received the whole answer.
    """

    id: str
    status: int
    received: int
    sent: int
    whole: bool = True


class RequestLog:
    """Records requests, refusals and commits.

    Parameters
    ----------
    metrics, audit
        Where they are counted and kept.
    config
        Says whether the texts of queries are logged.
    kb
        Source of the number of the last commit.
    writer
        Receives log lines; none to write no log.
    """

    def __init__(
        self,
        metrics: Metrics,
        audit: Audit,
        config: Config,
        kb: ServedGraph,
        writer: LineWriter | None,
    ) -> None:
        self._metrics = metrics
        self._audit = audit
        self._config = config
        self._kb = kb
        self._writer = writer

    def request(
        self,
        request: Request,
        plan: Plan,
        caller: Caller | None,
        response: Response,
        sent: int,
        started: float,
        whole: bool = True,
    ) -> None:
        """Record a request that has ended.

        Parameters
        ----------
        sent
            Bytes of the body that were sent.
        started
            When it began, on the clock of :func:`time.perf_counter`.
        whole
            Whether the client received the whole answer.
        """
        self.answered(
            Sender.of(request, caller),
            Outcome(request.id, response.status, len(request.body), sent, whole),
            plan.form,
            plan.text,
            started,
        )

    def answered(
        self, sender: Sender, outcome: Outcome, form: str, text: str, started: float
    ) -> None:
        """Record a request that has ended, given by its parts; see :meth:`request`.

        Parameters
        ----------
        form, text
            Of SPARQL requests; else empty.
        """
        seconds = time.perf_counter() - started
        query, how = "", ""
        if form and form != "UPDATE" and outcome.status < 400:
            query, how = form, "ok" if outcome.whole else "broken-off"
        self._metrics.request(sender.path, sender.method, outcome.status, seconds, query, how)
        if self._writer is None:
            return
        line = (
            f'{{"time": "{timestamp(time.time())}", "level": "info", "id": "{outcome.id}", '
            f'{sender.asked}, "status": {outcome.status}, "ms": {seconds * 1e3:.2f}, '
            f'"in": {outcome.received}, "out": {outcome.sent}, {sender.who}'
        )
        if form:
            digest = hashlib.sha256(text.encode()).hexdigest()[:16]
            line += f', "form": "{form}", "seq": {self._kb.seq}, "text_sha256": "{digest}"'
            if seconds >= SLOW_S or self._config.log_queries:
                line += f', "text": {as_json(redacted(text[:_MAX_TEXT]))}'
        if not outcome.whole:
            line += ', "broken_off": true'
        self._writer.put(line + "}")

    def denied(self, request: Request, caller: Caller | None, status: int, detail: str) -> None:
        """Record a request that was refused for lack of rights."""
        self._metrics.count("rtask_denied_total", status=str(status))
        self._audit.denied(
            status,
            detail,
            request=request.id,
            method=request.method,
            path=request.raw_path[:500],
            client=request.client,
            agent=caller.access.agent if caller else None,
            token=caller.token.id if caller and caller.token else None,
        )

    def commit(self, change: Change) -> None:
        """Record a commit."""
        self._metrics.count("rtask_commits_total")
        commit = change.commit
        for kind in ("added", "removed", "derived"):
            self._metrics.count("rtask_commit_quads_total", getattr(commit, kind), kind=kind)
        self._audit.commit(change)
