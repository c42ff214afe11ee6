"""A node of ROS 2 on DDS: publishers, subscriptions and services, without ROS 2."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any

from rtask.errors import RemoteUnavailableError, RtaskError, UsageError
from rtask.interop.ros.dds.calling import ServiceClient, read_header, with_header
from rtask.interop.ros.dds.library import check_single_library
from rtask.interop.ros.dds.structs import Structs
from rtask.interop.ros.dds.types import RosTypes

__all__ = ["CallerWatch", "DdsNode", "Publisher", "is_of_cyclone"]

log = logging.getLogger(__name__)

Take = Callable[[Any, Any], None]
"""Takes a reader and a sample of it."""

_GRAPH_TOPIC = "ros_discovery_info"
_LATCHED = 100
"""Writers of one latched topic that a reader hears at once; as tf2 keeps of /tf_static."""
_GRAPH_TYPE = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_GRAPH_TEXTS = {
    "rmw_dds_common/msg/Gid": "uint8[16] data\n",
    "rmw_dds_common/msg/NodeEntitiesInfo": "string<=256 node_namespace\nstring<=256 node_name\n"
    "Gid[] reader_gid_seq\nGid[] writer_gid_seq\n",
    _GRAPH_TYPE: "Gid gid\nNodeEntitiesInfo[] node_entities_info_seq\n",
}
_CYCLONE = b"\x01\x10"
"""Vendor id of Eclipse Cyclone DDS, with which the guid of each of its participants begins."""
_POLL_S, _CALLERS_POLLS = 0.1, 10
_SERVICE_THREADS = 8
_REFUSED = (
    "%s: requests of a caller are refused, because services work only with Cyclone as the peer's "
    "RMW; set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp there, or call the operation by rosbridge"
)


class DdsNode:
    """A node as ROS 2 with rmw_cyclonedds would see it.

    Which network and which peers are used is set as for that: by ``CYCLONEDDS_URI``.

    Parameters
    ----------
    name
        Of the node.
    types
        Definitions of all messages that it will exchange.
    namespace
        Before relative names, ``/nao1``.
    domain
        ROS_DOMAIN_ID.

    Raises
    ------
    RemoteUnavailableError
        DDS could not be started.
    UsageError
        Another Cyclone DDS was loaded into this process before.
    """

    def __init__(self, name: str, types: RosTypes, namespace: str = "/", domain: int = 0) -> None:
        from cyclonedds.core import DDSException, Policy, Qos, WaitSet
        from cyclonedds.domain import DomainParticipant

        check_single_library()
        self.types, self._structs = types, Structs(types)
        self._name, self._namespace = name, "/" + namespace.strip("/")
        for type_, text in _GRAPH_TEXTS.items():
            types.add_message(type_, text)
        try:
            self._participant = DomainParticipant(domain, qos=Qos(Policy.Userdata(b"enclave=/;")))
            self._waiting = WaitSet(self._participant)
        except DDSException as error:
            raise RemoteUnavailableError(
                f"DDS does not start in domain {domain}: {error}; does CYCLONEDDS_URI name an "
                "interface of this machine?"
            ) from error
        self._readers: list[tuple[Any, Any, Take]] = []
        self._writers: list[Any] = []
        self._callers = CallerWatch()
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._pool = ThreadPoolExecutor(_SERVICE_THREADS, "rtask-dds")
        self._graph = Publisher(self, *self._writer(_GRAPH_TOPIC, _GRAPH_TYPE, is_latched=True))
        self._thread = threading.Thread(target=self._run, daemon=True, name="rtask-dds-reader")
        self._thread.start()

    def __enter__(self) -> DdsNode:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def full_name(self) -> str:
        """Name with its namespace."""
        return f"{self._namespace.rstrip('/')}/{self._name}"

    @property
    def guid(self) -> bytes:
        """Id of the participant, 16 bytes."""
        return bytes(self._participant.guid.bytes)

    def close(self) -> None:
        """Leave the graph of ROS 2, when the services that are being answered are done."""
        self._ended.set()
        self._thread.join()
        self._pool.shutdown(cancel_futures=True)
        self._readers.clear()
        self._writers.clear()
        del self._graph, self._waiting, self._participant

    def publisher(self, topic: str, type_: str, *, is_latched: bool = False) -> Publisher:
        """Announce a publisher: reliable, and with ``is_latched`` transient local.

        Parameters
        ----------
        type_
            ``std_msgs/msg/String``.
        """
        made = Publisher(self, *self._writer(f"rt{self._full(topic)}", type_, is_latched))
        self._announce(writer=made.writer)
        return made

    def subscribe(
        self, topic: str, type_: str, hear: Callable[[bytes], None], *, is_latched: bool = False
    ) -> None:
        """Subscribe to a topic; CDR arrives in a thread of the node.

        Best effort, keeping the last five, which matches every publisher; with ``is_latched``
        reliable and transient local, which matches latched ones.
        """
        sample = self._structs.of_topic(type_)
        qos = self._qos(type_, is_latched, is_sensor=not is_latched, is_read=True)
        self._reader(f"rt{self._full(topic)}", sample, qos, lambda _, heard: hear(heard.cdr))

    def watch_nodes(self, hear: Callable[[set[str]], None]) -> None:
        """Call a function with the full names of the nodes that a participant announces."""

        def take(_: Any, sample: Any) -> None:
            info = self.types.decode(sample.cdr, _GRAPH_TYPE)
            nodes = info.node_entities_info_seq
            hear({f"{n.node_namespace.rstrip('/')}/{n.node_name}" for n in nodes})

        sample = self._structs.of_topic(_GRAPH_TYPE)
        qos = self._qos(_GRAPH_TYPE, is_latched=True, is_read=True)
        self._reader(_GRAPH_TOPIC, sample, qos, take)

    def serve(self, service: str, type_: str, handle: Callable[[Any], Any]) -> None:
        """Offer a service to clients whose RMW is Cyclone's.

        Parameters
        ----------
        type_
            ``rtask_msgs/srv/WhereIs``.
        handle
            Takes a request and returns the response; called in several threads.
        """
        name, qos = self._full(service), self._qos(type_)
        response = self._structs.of_service(type_, "Response")
        writer = self._service_writer(f"rr{name}Reply", response, qos)

        def answer(cdr: bytes) -> None:
            try:
                guid, sequence, rest = read_header(cdr)
                made = handle(self.types.decode(rest, f"{type_}_Request"))
                reply = self.types.encode(made, f"{type_}_Response")
            except RtaskError as error:
                log.warning("%s: a request that cannot be answered: %s", name, error)
                return
            except Exception:  # one request must not end the others
                log.exception("%s: the request could not be answered", name)
                return
            writer.write(response.from_cdr(with_header(reply, guid, sequence)))

        def take(reader: Any, sample: Any) -> None:
            if is_of_cyclone(reader, sample, name):
                self._pool.submit(answer, sample.cdr)

        request = self._structs.of_service(type_, "Request")
        self._callers.add(self._reader(f"rq{name}Request", request, qos, take), name)

    def client(self, service: str, type_: str) -> ServiceClient:
        """Return a client of a service, of a server whose RMW is Cyclone's."""
        name, qos = self._full(service), self._qos(type_)
        request = self._structs.of_service(type_, "Request")
        writer = self._service_writer(f"rq{name}Request", request, qos)

        def send(cdr: bytes) -> None:
            writer.write(request.from_cdr(cdr))

        def servers() -> int:
            publications = len(reader.get_matched_publications())
            return min(publications, len(writer.get_matched_subscriptions()))

        made = ServiceClient(self.types, type_, send, servers)
        response = self._structs.of_service(type_, "Response")
        reader = self._reader(
            f"rr{name}Reply", response, qos, lambda _, heard: made.take(heard.cdr)
        )
        return made

    def _service_writer(self, topic: str, sample: Any, qos: Any) -> Any:
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        writer = DataWriter(self._participant, Topic(self._participant, topic, sample), qos=qos)
        self._announce(writer=writer)
        return writer

    def _writer(self, topic: str, type_: str, is_latched: bool) -> tuple[Any, Any, str]:
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        sample = self._structs.of_topic(type_)
        made = DataWriter(
            self._participant, Topic(self._participant, topic, sample),
            qos=self._qos(type_, is_latched),
        )  # fmt: skip
        return made, sample, type_

    def _reader(self, topic: str, sample: Any, qos: Any, take: Take) -> Any:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        reader = DataReader(self._participant, Topic(self._participant, topic, sample), qos=qos)
        every = SampleState.Any | ViewState.Any | InstanceState.Any
        condition = ReadCondition(reader, every)
        with self._lock:
            self._readers.append((reader, condition, take))
        self._waiting.attach(condition)
        self._announce()
        return reader

    def _announce(self, writer: Any = None) -> None:
        """Tell ROS 2 which endpoints are this node's."""
        if writer is not None:
            self._writers.append(writer)
        make = self.types.make
        info, node = make(_GRAPH_TYPE), make("rmw_dds_common/msg/NodeEntitiesInfo")
        node.node_namespace, node.node_name = self._namespace, self._name
        info.gid = self._gid(self.guid)
        with self._lock:
            readers = [made for made, _, _ in self._readers]
        node.reader_gid_seq = [self._gid(bytes(made.guid.bytes)) for made in readers]
        node.writer_gid_seq = [self._gid(bytes(made.guid.bytes)) for made in self._writers]
        info.node_entities_info_seq = [node]
        self._graph.publish(info)

    def _gid(self, guid: bytes) -> Any:
        made = self.types.make("rmw_dds_common/msg/Gid")
        made.data = guid
        return made

    def _qos(
        self, type_: str, is_latched: bool = False, is_sensor: bool = False, is_read: bool = False
    ) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.util import duration

        reliable = Policy.Reliability.Reliable(duration(seconds=10))
        # Many write to one latched topic, such as /tf_static, each its last message: a reader that
        # keeps one alone loses those that come before it has taken the first, and for good.
        depth = _LATCHED if is_latched and is_read else 1 if is_latched else 5 if is_sensor else 10
        return Qos(
            Policy.Reliability.BestEffort if is_sensor else reliable,
            Policy.History.KeepLast(depth),
            Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile,
            Policy.Userdata(f"typehash={self.types.hash(type_)};".encode()),
        )

    def _full(self, name: str) -> str:
        """Return the full name of a topic or service."""
        full = name if name.startswith("/") else f"{self._namespace.rstrip('/')}/{name}"
        if not all(part.isidentifier() for part in full[1:].split("/")):
            raise UsageError(f"{name!r} is no name in ROS 2")
        return full

    def _run(self) -> None:
        from cyclonedds.util import duration

        polls = 0
        while not self._ended.is_set():
            self._waiting.wait(duration(seconds=_POLL_S))
            polls += 1
            if polls % _CALLERS_POLLS == 0:
                self._callers.look()
            for reader, take, sample in self._taken():
                try:
                    take(reader, sample)
                except Exception:  # one message must not end the thread that takes all
                    log.exception("a message could not be handled")

    def _taken(self) -> Iterator[tuple[Any, Take, Any]]:
        """Yield what arrived; what only tells of the end of a writer has no data."""
        from cyclonedds.internal import InvalidSample

        with self._lock:
            readers = list(self._readers)
        for reader, _, take in readers:
            for sample in reader.take(100):
                if not isinstance(sample, InvalidSample):
                    yield reader, take, sample


def is_of_cyclone(reader: Any, sample: Any, service: str) -> bool:
    """Whether a request has a header; those of another DDS would be misread.

    Nor is one taken whose writer is gone: nobody can tell any more what it is, or waits for it.
    """
    writer = reader.get_matched_publication_data(sample.sample_info.publication_handle)
    if writer is None:
        log.warning("%s: a request was left out, because its sender is gone", service)
        return False
    if writer.participant_key.bytes.startswith(_CYCLONE):
        return True
    log.warning(_REFUSED, service)
    return False


class CallerWatch:
    """Warns of callers whose RMW is not Cyclone's, once for each.

    Their requests lack the header, so that many are dropped by the library before a program sees
    them: Cyclone cannot read them as what their type says.
    """

    def __init__(self) -> None:
        self._services: list[tuple[Any, str]] = []
        self._seen: set[int] = set()

    def add(self, reader: Any, service: str) -> None:
        """Watch the reader of the requests of a service."""
        self._services.append((reader, service))

    def look(self) -> None:
        """Warn of the callers that have come since the last time."""
        for reader, service in list(self._services):
            for handle in reader.get_matched_publications():
                if handle in self._seen:
                    continue
                self._seen.add(handle)
                writer = reader.get_matched_publication_data(handle)
                if writer is not None and not writer.participant_key.bytes.startswith(_CYCLONE):
                    log.warning(_REFUSED, service)


class Publisher:
    """Publishes the messages of one topic."""

    def __init__(self, node: DdsNode, writer: Any, sample: Any, type_: str) -> None:
        self._node, self.writer, self._sample, self._type = node, writer, sample, type_

    @property
    def subscribers(self) -> int:
        """Number of subscriptions that match."""
        return len(self.writer.get_matched_subscriptions())

    def make(self) -> Any:
        """Return an empty message of the topic's type."""
        return self._node.types.make(self._type)

    def publish(self, message: Any) -> None:
        """Publish a message of :meth:`make`."""
        self.publish_cdr(self._node.types.encode(message, self._type))

    def publish_cdr(self, cdr: bytes) -> None:
        """Publish a message that is CDR already, such as a recorded cloud."""
        self.writer.write(self._sample.from_cdr(cdr))
