"""Code that calls a method of a service, in the languages that robots are programmed in."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

__all__ = ["snippets"]

MAX_FILE_BYTES = 3_000
"""Of a file that stands whole in the code."""


def snippets(
    site: str,
    service: str,
    ros_service: str,
    ros_type: str,
    method: str,
    args: Mapping[str, Any],
    data: Mapping[str, str],
) -> list[tuple[str, str]]:
    """Return the name of each language and the code in it.

    Parameters
    ----------
    site
        Address of the server.
    service
        Name and version of the service.
    args
        The request.
    data
        Datasets by data resource.

    Examples
    --------
    >>> code = snippets("http://h:1", "a/B@1.0.0", "/services/a/B/go", "a/BGo", "go", {"x": 1}, {})
    >>> dict(code)["Python"].splitlines()[-1]
    'print(service.go(x=1))'
    """
    sent = _sendable(args)
    body = {**sent, **({"$data": dict(data)} if data else {})}
    text = json.dumps(body, ensure_ascii=False)
    address = f"{site}/services/{service}/{method}"
    named = ", ".join(f"{name}={value!r}" for name, value in sent.items())
    data_argument = f", data={dict(data)!r}" if data else ""
    host = urlsplit(site)
    return [
        ("curl", f"curl -s {shlex.quote(address)} -H 'Content-Type: application/json' \\\n"
                 f"  -d {shlex.quote(text)}"),
        ("Python", "import rtask\n\n"
                   f'service = rtask.connect("{site}").service("{service}"{data_argument})\n'
                   f"print(service.{method}({named}))"),
        ("roslibpy", "import roslibpy\n\n"
                     f'ros = roslibpy.Ros("{host.hostname}", {host.port or 80})\n'
                     "ros.run()\n"
                     f'service = roslibpy.Service(ros, "{ros_service}", "{ros_type}")\n'
                     f"print(service.call(roslibpy.ServiceRequest({body!r})))\n"
                     "ros.close()"),
        ("JavaScript", f'const answer = await fetch("{address}", {{\n'
                       '  method: "POST",\n'
                       '  headers: { "Content-Type": "application/json" },\n'
                       f"  body: JSON.stringify({text}),\n"
                       "});\nconsole.log(await answer.json());"),
    ]  # fmt: skip


def _sendable(value: Any) -> Any:
    """Return a value as JSON carries it; a large file as words that tell what to put there.

    Examples
    --------
    >>> _sendable({"views": [{"cloud": b"ply"}], "scan": bytes(10_000)})
    {'views': [{'cloud': 'cGx5'}], 'scan': 'base64 of a file of 10000 bytes'}
    """
    if isinstance(value, Mapping):
        return {name: _sendable(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_sendable(item) for item in value]
    if not isinstance(value, bytes):
        return value
    if len(value) > MAX_FILE_BYTES:
        return f"base64 of a file of {len(value)} bytes"
    return base64.b64encode(value).decode()
