"""Connection to a Ray cluster that is running; ``ray`` is imported here only.

None is ever started here, because a cluster listens on all interfaces.
"""

from __future__ import annotations

import importlib
import threading
from typing import Any

__all__ = ["join"]

_lock = threading.Lock()


def join(address: str | None) -> tuple[Any, bool]:
    """Connect this program to a cluster, unless it is connected already.

    Parameters
    ----------
    address
        Of the cluster, ``auto`` for the one of this machine; None = the one that this program is
        connected to.

    Returns
    -------
    ray, is_new
        The module, and whether this made the connection.

    Raises
    ------
    ValueError
        Ray is not installed, or there is no cluster.
    """
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise ValueError("executor 'ray' needs the package ray: pip install ray") from error
    with _lock:
        if ray.is_initialized():
            return ray, False
        if address is None:
            raise ValueError(
                "executor 'ray' needs the address of a running cluster: start one by `ray start "
                "--head` and name it, or auto for the one of this machine"
            )
        try:
            ray.init(address=address, logging_level="ERROR")
        except ConnectionError as error:
            raise ValueError(f"no Ray cluster at {address}: {error}") from error
    return ray, True
