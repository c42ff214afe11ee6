"""Records of each request: a log line, metrics and, where it matters, the audit trail."""

from __future__ import annotations

import hashlib
import time

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
        seconds = time.perf_counter() - started
        query, how = "", ""
        if plan.form and plan.form != "UPDATE" and response.status < 400:
            query, how = plan.form, "ok" if whole else "broken-off"
        self._metrics.request(
            request.raw_path, request.method, response.status, seconds, query, how
        )
        if self._writer is None:
            return
        line = (
            f'{{"time": "{timestamp(time.time())}", "level": "info", "id": "{request.id}", '
            f'"method": {as_json(request.method)}, "path": {as_json(redacted(request.raw_path))}, '
            f'"status": {response.status}, "ms": {seconds * 1e3:.2f}, '
            f'"in": {len(request.body)}, "out": {sent}, {_sender(request, caller)}'
        )
        if plan.form:
            digest = hashlib.sha256(plan.text.encode()).hexdigest()[:16]
            line += f', "form": "{plan.form}", "seq": {self._kb.seq}, "text_sha256": "{digest}"'
            if seconds >= SLOW_S or self._config.log_queries:
                line += f', "text": {as_json(redacted(plan.text[:_MAX_TEXT]))}'
        if not whole:
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


def _sender(request: Request, caller: Caller | None) -> str:
    """Return the members of a log line that say who asked; the caller may be unknown."""
    members = f'"client": {as_json(request.client)}'
    if caller is not None:
        members += f', "role": "{caller.access.role}"'
        if caller.access.agent:
            members += f', "agent": {as_json(caller.access.agent)}'
        if caller.token:
            members += f', "token": "{caller.token.id}"'
    return members
