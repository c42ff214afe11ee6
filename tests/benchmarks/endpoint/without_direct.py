"""``rtask`` whose server answers every request by the application, none in the protocol itself."""

from __future__ import annotations

from typing import Any

import endpoint.server
from endpoint.http.server_protocol import GuardedProtocol
from rtask.cli import main


def guarded(*args: Any, asgi: object, queries: object, **options: Any) -> GuardedProtocol:
    """Make a protocol that answers nothing by itself."""
    return GuardedProtocol(*args, **options)


if __name__ == "__main__":
    endpoint.server.DirectProtocol = guarded  # type: ignore[misc,assignment]
    main()
