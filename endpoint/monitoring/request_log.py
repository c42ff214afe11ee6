"""Records of each request: a log line, metrics and, where it matters, the audit trail."""

from __future__ import annotations

import hashlib
import time

from endpoint.access.auth import Caller
from endpoint.http.messages import Request, Response
from endpoint.http.plan import Plan
from endpoint.monitoring.audit import Audit
from endpoint.monitoring.log import LineWriter, redacted, timestamp
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
        self._metrics.request(request.raw_path, request.method, response.status, seconds)
        if plan.form not in ("", "UPDATE") and response.status < 400:
            outcome = "ok" if whole else "broken-off"
            self._metrics.count("rtask_query_total", form=plan.form, outcome=outcome)
        if self._writer is None:
            return
        line: dict[str, object] = {
            "time": timestamp(time.time()),
            "level": "info",
            "id": request.id,
            "method": request.method,
            "path": redacted(request.raw_path),
            "status": response.status,
            "ms": round(seconds * 1e3, 2),
            "in": len(request.body),
            "out": sent,
            "client": request.client,
        }
        if caller is not None:
            line["role"] = caller.access.role
            if caller.access.agent:
                line["agent"] = caller.access.agent
            if caller.token:
                line["token"] = caller.token.id
        if plan.form:
            line["form"], line["seq"] = plan.form, self._kb.seq
            line["text_sha256"] = hashlib.sha256(plan.text.encode()).hexdigest()[:16]
            if seconds >= SLOW_S or self._config.log_queries:
                line["text"] = redacted(plan.text[:_MAX_TEXT])
        if not whole:
            line["broken_off"] = True
        self._writer.put(line)

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
