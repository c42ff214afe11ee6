"""Addresses for operators of a running server: metrics, queries, audit trail and backups.

They require a token of role ``admin``, except for local callers while no token is required.
"""

from __future__ import annotations

import datetime as dt
import json
import secrets
import shutil
import time
from typing import Any

from endpoint.access.auth import Caller
from endpoint.context import ServerContext
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.monitoring.metrics import CONTENT_TYPE
from endpoint.routes.addresses import QUERIES
from endpoint.served import embedded
from rtask.errors import UnsupportedError
from rtask.kb.maintenance.backup import discard_unfinished

_HISTORY = 200
_COUNT_EVERY_S = 60.0


class AdminRoutes:
    """The addresses ``/metrics``, ``/queries``, ``/api/history`` and ``/backup``.

    Parameters
    ----------
    context
        The parts of the server.
    """

    def __init__(self, context: ServerContext) -> None:
        self._context = context
        self._count, self._count_again = 0, 0.0

    def plan_metrics(self) -> Plan:
        """Plan the metrics."""
        return Plan(self._metrics)

    def plan_history(self) -> Plan:
        """Plan the last events of the audit trail."""
        return Plan(lambda: _json({"events": self._context.audit.recent(_HISTORY)}))

    def plan_backup(self, caller: Caller) -> Plan:
        """Plan a copy of the knowledge base into a folder that the server chooses.

        Raises
        ------
        UnsupportedError
            The data are in memory.
        """
        context = self._context
        if context.kb.folder is None:
            raise UnsupportedError("this server keeps its data in memory; use GET /store instead")

        def run() -> Response:
            target = context.config.backups_of(context.kb.folder) / backup_name()
            discard_unfinished(target.parent)
            record = embedded(context.kb, "a backup").backup(target)
            context.audit.event("backup", folder=str(target), by=caller.name, seq=record["seq"])
            members = {**record, "folder": str(target)}
            return json_response(members, 201)

        return Plan(run)

    def _metrics(self) -> Response:
        context = self._context
        folder = context.kb.folder
        gauges: dict[str, float] = {
            "rtask_store_seq": context.kb.seq,
            "rtask_quads": self._quads(),
            "rtask_queries_running": len(context.queries),
            "rtask_ready": not context.health.draining,
        }
        if folder is not None:
            journal = folder / "journal"
            sizes = [file.stat().st_size for file in journal.glob("*") if file.is_file()]
            gauges["rtask_journal_bytes"] = sum(sizes)
            gauges["rtask_disk_free_bytes"] = shutil.disk_usage(folder).free
        gauges.update({name: measure() for name, measure in context.gauges.items()})
        return Response(200, context.metrics.text(gauges), CONTENT_TYPE)

    def _quads(self) -> int:
        """Count the statements, at most once a minute: a store on disk reads all of them."""
        now = time.monotonic()
        if now >= self._count_again:
            self._count, self._count_again = len(self._context.kb.store), now + _COUNT_EVERY_S
        return self._count

    def plan_queries(self, request: Request, caller: Caller, address: str) -> Plan:
        """List or stop running queries: the caller's own or, for an admin, anybody's.

        Raises
        ------
        RefusedError
            404.
        """
        queries = self._context.queries.visible_to(caller)
        if request.method != "DELETE":
            return Plan.ready(_json({"queries": [query.facts() for query in queries]}))
        name = address.removeprefix(f"{QUERIES}/")
        matching = [query for query in queries if query.id == name]
        if not matching:
            raise RefusedError(404, "not-found", f"you have no running query {name}")

        def stop() -> Response:
            for query in matching:
                query.stop()
            self._context.metrics.count("rtask_query_aborted_total", reason="stopped")
            return Response(204)

        return Plan(stop)


def backup_name() -> str:
    """Return a unique name that sorts by time."""
    now = dt.datetime.now(dt.UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"{now}-{secrets.token_hex(3)}"


def _json(members: dict[str, Any]) -> Response:
    return Response(200, json.dumps(members, ensure_ascii=False, default=str).encode(), JSON_TYPE)
