"""Is the server alive, and is it ready to work?"""

from __future__ import annotations

import json
import shutil
from typing import Any

from endpoint.exchange import JSON_TYPE, RefusedError, Response
from endpoint.protocol.run import Plan
from rtask import __version__
from rtask.kb.knowledge_base import KnowledgeBase

_MIN_FREE_BYTES = 1 << 30
_TIMEOUT_S = 5.0


def health(kb: KnowledgeBase, address: str) -> Plan:
    """Prepare the answer of ``/health``, ``/health/live`` or ``/health/ready``."""
    if address == "/health/live":
        return Plan.ready(_answer({"live": True}, True))
    if address not in ("/health", "/health/ready"):
        raise RefusedError(404, "not-found", "there are /health, /health/live and /health/ready")

    def run() -> Response:
        failing = _failing(kb)
        members = {
            "live": True,
            "ready": not failing,
            "failing": failing,
            "version": __version__,
        }
        return _answer(members, not failing)

    return Plan(run, _TIMEOUT_S)


def _failing(kb: KnowledgeBase) -> list[str]:
    failing = []
    if kb.query("ASK {}") is not True:
        failing.append("store")
    if kb.folder is not None and shutil.disk_usage(kb.folder).free < _MIN_FREE_BYTES:
        failing.append("disk")
    return failing


def _answer(members: dict[str, Any], ok: bool) -> Response:
    return Response(200 if ok else 503, json.dumps(members).encode(), JSON_TYPE)
