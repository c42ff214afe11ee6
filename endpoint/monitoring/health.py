"""Health checks: is the server alive, and is it ready to serve requests?"""

from __future__ import annotations

import shutil
from typing import Any

from endpoint.http.following import Following
from endpoint.http.messages import RefusedError, Response, json_response
from endpoint.http.plan import Plan
from endpoint.routes.addresses import HEALTH
from endpoint.served import ServedGraph
from rtask import __version__
from rtask.knowledge_base import KnowledgeBase

_MIN_FREE_BYTES = 1 << 30
_TIMEOUT_S = 5.0
MAX_BEHIND_S = 10.0
MAX_WRITER_WAIT_S = 2.0


class Health:
    """Answers the health checks of supervisors and load balancers.

    A server is live while its event loop answers; a process that is not live should be restarted.
    It is ready while it can serve requests; one that is not ready should be sent none for now, but
    needs no restart.

    Parameters
    ----------
    kb
        The knowledge base.
    following
        The connection to the server that this one follows, if any.

    Attributes
    ----------
    draining
        Whether the server is shutting down.
    """

    def __init__(self, kb: ServedGraph, following: Following | None = None) -> None:
        self._kb = kb
        self._following = following
        self.draining = False

    def plan(self, check: str) -> Plan:
        """Plan the answer to the check ``live`` or ``ready``.

        Raises
        ------
        RefusedError
            404: there is no such check.
        """
        if check == "live":
            return Plan.ready(_answer({"live": True}, True))
        if check != "ready":
            checks = f"{HEALTH}, {HEALTH}/live and {HEALTH}/ready"
            raise RefusedError(404, "not-found", f"the health checks are {checks}")
        return Plan(self._ready, _TIMEOUT_S)

    def _ready(self) -> Response:
        failing = self._failing()
        members = {
            "live": True,
            "ready": not failing,
            "failing": failing,
            "version": __version__,
            "epoch": self._kb.epoch,
            "seq": self._kb.seq,
        }
        return _answer(members, not failing)

    def _failing(self) -> list[str]:
        failing = []
        if self.draining:
            failing.append("draining")
        if self._kb.query("ASK {}") is not True:
            failing.append("store")
        if self._following is not None and self._following.seconds_behind > MAX_BEHIND_S:
            failing.append("behind")
        if isinstance(self._kb, KnowledgeBase) and self._kb.write_queue()[1] > MAX_WRITER_WAIT_S:
            failing.append("writers")
        folder = self._kb.folder
        if folder is not None and shutil.disk_usage(folder).free < _MIN_FREE_BYTES:
            failing.append("disk")
        return failing


def _answer(members: dict[str, Any], ok: bool) -> Response:
    return json_response(members, 200 if ok else 503)
