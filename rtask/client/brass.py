"""The names of Brass for programs, besides those for services (Kehoe 2014, 5.7)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import IO, Any

from rtask.client.datasets import DatasetClient
from rtask.client.remote import RemoteClient
from rtask.services import brass
from rtask.services.brass import *  # noqa: F403 - it is the same library

__all__ = [*brass.__all__, "connect", "connect_to_dataset"]

SERVER = "http://127.0.0.1:8765"


def connect(address: str, data_mapping: Mapping[str, str] | None = None) -> Any:
    """Return a proxy of a service of the server in RTASK_SERVER.

    Parameters
    ----------
    address
        ``brass://<namespace>/<name>``, perhaps with a version.
    data_mapping
        Names of datasets by the names of the data resources.
    """
    name = address.removeprefix("brass://")
    server = os.environ.get("RTASK_SERVER", SERVER)
    client = RemoteClient(server, os.environ.get("RTASK_TOKEN"))
    return client.service(name, data_mapping)


class _Dataset:
    """A dataset of a server, to be written to."""

    def __init__(self, name: str) -> None:
        self._name = name
        server = os.environ.get("RTASK_SERVER", SERVER)
        self._client = DatasetClient(server, os.environ.get("RTASK_TOKEN"))

    def put(self, path: str, file: bytes | IO[Any]) -> None:
        """Write a file to the head; one that was opened as text is sent as the bytes it holds."""
        data = file if isinstance(file, bytes) else getattr(file, "buffer", file).read()
        self._client.put(self._name, path, data)

    def get(self, path: str) -> bytes:
        """Return the bytes of a file."""
        return self._client.get(self._name, path)


def connect_to_dataset(name: str) -> _Dataset:
    """Return a dataset of the server in RTASK_SERVER."""
    return _Dataset(name)
