"""What operators ask of a running server: its numbers, its queries, who wrote what.

Open to a token of role ``admin``, and to this machine while nobody needs a token.
"""

from __future__ import annotations

import datetime as dt
import json
import secrets
import shutil
import time
from typing import TYPE_CHECKING, Any

from endpoint.access.auth import Caller, require_scope
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.monitoring.metrics import CONTENT_TYPE
from endpoint.sparql.deferred import Plan
from rtask.errors import UnsupportedError

if TYPE_CHECKING:
    from endpoint.application import Gateway

_HISTORY = 200
_COUNT_EVERY_S = 60.0


class Operators:
    """The addresses ``/metrics``, ``/queries``, ``/api/history`` and ``/backup``.

    Parameters
    ----------
    gateway
        Whose numbers.
    """

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._count, self._count_again = 0, 0.0

    def plan(self, request: Request, caller: Caller, address: str) -> Plan:
        """Prepare an answer.

        Raises
        ------
        ForbiddenError
            The caller is no operator.
        RefusedError
            404 or 405.
        """
        if address.startswith("/queries"):
            return self._queries(request, caller, address)
        if address == "/backup":
            return self._plan_backup(request, caller)
        _only(request, "GET", "HEAD")
        if caller.access.role != "anonymous" and not self._is_local(caller, address):
            require_scope(caller.access, "admin")
        if address == "/metrics":
            return Plan(self._metrics)
        return Plan(lambda: _json({"events": self._gateway.audit.recent(_HISTORY)}))

    def _plan_backup(self, request: Request, caller: Caller) -> Plan:
        """Prepare a copy of the knowledge base, in a folder that the server chooses."""
        _only(request, "POST")
        gateway = self._gateway
        gateway.auth.check_origin(request, caller)
        if caller.access.role != "anonymous":
            require_scope(caller.access, "admin")
        if gateway.kb.folder is None:
            raise UnsupportedError("this server keeps everything in memory; GET /store instead")

        def run() -> Response:
            target = gateway.config.backups_of(gateway.kb.folder) / backup_name()
            record = gateway.kb.backup(target)
            gateway.audit.event("backup", folder=str(target), by=caller.name, seq=record["seq"])
            members = {**record, "folder": str(target)}
            return Response(201, json.dumps(members).encode(), JSON_TYPE)

        return Plan(run)

    def _is_local(self, caller: Caller, address: str) -> bool:
        """Tell whether a collector on this machine reads the numbers, which hold no names."""
        return address == "/metrics" and self._gateway.config.on_loopback and caller.token is None

    def _metrics(self) -> Response:
        gateway = self._gateway
        folder = gateway.kb.folder
        gauges: dict[str, float] = {
            "rtask_store_seq": gateway.kb.seq,
            "rtask_quads": self._quads(),
            "rtask_queries_running": len(gateway.queries),
            "rtask_ready": not gateway.health.draining,
        }
        if folder is not None:
            journal = folder / "journal"
            sizes = [file.stat().st_size for file in journal.glob("*") if file.is_file()]
            gauges["rtask_journal_bytes"] = sum(sizes)
            gauges["rtask_disk_free_bytes"] = shutil.disk_usage(folder).free
        gauges.update(gateway.gauges())
        return Response(200, gateway.metrics.text(gauges), CONTENT_TYPE)

    def _quads(self) -> int:
        """Count the statements; the store on disk reads all of them, so not too often."""
        now = time.monotonic()
        if now >= self._count_again:
            self._count, self._count_again = len(self._gateway.kb.store), now + _COUNT_EVERY_S
        return self._count

    def _queries(self, request: Request, caller: Caller, address: str) -> Plan:
        """List what runs, or stop one: one's own; an admin, anybody's."""
        found = self._gateway.queries.visible_to(caller)
        if address == "/queries":
            _only(request, "GET", "HEAD")
            return Plan.ready(_json({"queries": [query.facts() for query in found]}))
        _only(request, "DELETE")
        self._gateway.auth.check_origin(request, caller)
        name = address.removeprefix("/queries/")
        wanted = [query for query in found if query.id == name]
        if not wanted:
            raise RefusedError(404, "not-found", f"no query {name} of yours runs")

        def stop() -> Response:
            for query in wanted:
                query.stop()
            self._gateway.metrics.count("rtask_query_aborted_total", reason="stopped")
            return Response(204)

        return Plan(stop)


def backup_name() -> str:
    """Return a name that sorts by time and is new."""
    now = dt.datetime.now(dt.UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"{now}-{secrets.token_hex(3)}"


def _only(request: Request, *methods: str) -> None:
    if request.method not in methods:
        allow = ", ".join(methods)
        raise RefusedError(
            405, "method-not-allowed", f"this address takes {allow}", headers=(("Allow", allow),)
        )


def _json(members: dict[str, Any]) -> Response:
    return Response(200, json.dumps(members, ensure_ascii=False, default=str).encode(), JSON_TYPE)
