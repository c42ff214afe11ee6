"""A node of ROS 2 that publishes and subscribes by Zenoh, without ROS 2 (extra ``zenoh``)."""

from __future__ import annotations

import itertools
import json
import logging
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.zenoh.names import Endpoint, attachment, topic_key

__all__ = ["ROUTER", "Publisher", "ZenohNode"]

log = logging.getLogger(__name__)

ROUTER = "tcp/localhost:7447"


class ZenohNode:
    """A node as ROS 2 with rmw_zenoh would see it.

    Parameters
    ----------
    name
        Of the node.
    router
        Address of the Zenoh router, through which peers find each other.
    domain
        ROS_DOMAIN_ID.
    wait_s
        Longest wait for the router.

    Raises
    ------
    RemoteUnavailableError
        No router answers.
    """

    def __init__(
        self, name: str, router: str = ROUTER, domain: int = 0, wait_s: float = 5.0
    ) -> None:
        import zenoh
        from rosbags.typesys import Stores, get_typestore

        self.types = get_typestore(Stores.ROS2_JAZZY)
        self._name, self._domain = name, domain
        self._numbers = itertools.count()
        self._kept: list[Any] = []
        config = zenoh.Config()
        for key, value in {
            "mode": "peer",
            "connect/endpoints": [router],
            "connect/timeout_ms": round(wait_s * 1000),
            "connect/exit_on_failure": True,
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise RemoteUnavailableError(
                f"no Zenoh router answers at {router} ({error}); start one: "
                "ros2 run rmw_zenoh_cpp rmw_zenohd"
            ) from error
        self._announce(self._endpoint("NN"))

    def __enter__(self) -> ZenohNode:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph of ROS 2."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh types no more than this

    def publisher(self, topic: str, type_: str) -> Publisher:
        """Announce a publisher.

        Parameters
        ----------
        type_
            ``std_msgs/msg/String``, of the packages that ROS 2 itself brings.
        """
        endpoint = self._endpoint("MP", topic, type_)
        put = self._session.declare_publisher(self._key(endpoint))
        self._kept.append(put)
        self._announce(endpoint)
        return Publisher(endpoint, put, lambda m: self.types.serialize_cdr(m, type_).tobytes())

    def subscribe(self, topic: str, type_: str, hear: Callable[[Any], None]) -> None:
        """Subscribe to a topic; messages arrive in a thread of Zenoh.

        A message that is no CDR of its type is dropped, as ROS 2 does.
        """
        from rosbags.serde import SerdeError

        endpoint = self._endpoint("MS", topic, type_)

        def take(sample: Any) -> None:
            try:
                message = self.types.deserialize_cdr(sample.payload.to_bytes(), type_)
            except SerdeError as error:
                log.warning("%s: a message that is no %s: %s", topic, type_, error)
            else:
                hear(message)

        self._kept.append(self._session.declare_subscriber(self._key(endpoint), take))
        self._announce(endpoint)

    def _key(self, endpoint: Endpoint) -> str:
        return topic_key(endpoint.domain, endpoint.topic, endpoint.type, endpoint.type_hash)

    def _endpoint(self, kind: str, topic: str = "", type_: str = "") -> Endpoint:
        type_hash = ""
        if type_:
            if type_ not in self.types.fielddefs:
                raise UsageError(f"type {type_!r} is not known; expected one that ROS 2 brings")
            type_hash = str(self.types.hash_rihs01(type_))
        session = str(self._session.info.zid())
        number = next(self._numbers)
        return Endpoint(self._domain, session, number, kind, self._name, topic, type_, type_hash)

    def _announce(self, endpoint: Endpoint) -> None:
        self._kept.append(self._session.liveliness().declare_token(endpoint.token))


class Publisher:
    """Publishes the messages of one topic."""

    def __init__(self, endpoint: Endpoint, put: Any, as_cdr: Callable[[Any], bytes]) -> None:
        self._endpoint, self._put, self._as_cdr = endpoint, put, as_cdr
        self._sequence = itertools.count(1)
        self._lock = threading.Lock()

    def publish(self, message: Any) -> None:
        """Publish a message of :mod:`rosbags`."""
        data = self._as_cdr(message)
        with self._lock:
            about = attachment(next(self._sequence), time.time_ns(), self._endpoint.gid)
            self._put.put(data, attachment=about)
