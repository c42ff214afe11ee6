"""Keys, tokens and attachments as rmw_zenoh writes them (its design text, 2024 to 2026).

Releases before 2025 wrote named fields into the attachment and do not understand this one.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from rtask.errors import UsageError

__all__ = ["Endpoint", "attachment", "dds_type", "read_attachment", "topic_key"]

_QOS = "::,7:,:,:,,"
"""Reliable, volatile, the last seven messages: the default of ROS 2."""
_GID_BYTES = 16
_ATTACHMENT = struct.Struct("<qqB16s")


def dds_type(type_: str) -> str:
    """Return the name of a type as it stands in keys.

    Examples
    --------
    >>> dds_type("std_msgs/msg/String")
    'std_msgs::msg::dds_::String_'
    """
    parts = type_.split("/")
    if len(parts) != 3 or not all(parts):
        raise UsageError(f"{type_!r} is no type of ROS 2; expected package/msg/Name")
    package, kind, name = parts
    return f"{package}::{kind}::dds_::{name}_"


def topic_key(domain: int, topic: str, type_: str, type_hash: str) -> str:
    """Return the key under which the messages of a topic are put.

    Examples
    --------
    >>> topic_key(0, "/chatter", "std_msgs/msg/String", "RIHS01_df66")
    '0/chatter/std_msgs::msg::dds_::String_/RIHS01_df66'
    """
    return f"{domain}/{_full(topic)}/{dds_type(type_)}/{type_hash}"


@dataclass(frozen=True)
class Endpoint:
    """A node, or one publisher or subscription of it, in the graph of ROS 2.

    Parameters
    ----------
    session
        Id of the Zenoh session, as hexadecimal text.
    kind
        ``NN`` node, ``MP`` publisher, ``MS`` subscription.
    number
        Unique among those of the session.
    topic, type, type_hash
        Of a publisher or subscription.
    """

    domain: int
    session: str
    number: int
    kind: str
    node: str
    topic: str = ""
    type: str = ""
    type_hash: str = ""

    @property
    def token(self) -> str:
        """Key of the liveliness token that announces it.

        Examples
        --------
        >>> Endpoint(2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, "NN", "listener").token
        '@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener'
        """
        token = f"@ros2_lv/{self.domain}/{self.session}/0/{self.number}/{self.kind}/%/%/{self.node}"
        if self.kind == "NN":
            return token
        topic = f"%{_full(self.topic).replace('/', '%')}"
        return f"{token}/{topic}/{dds_type(self.type)}/{self.type_hash}/{_QOS}"

    @property
    def gid(self) -> bytes:
        """Its id in attachments: 16 bytes that depend on the token."""
        return hashlib.blake2b(self.token.encode(), digest_size=_GID_BYTES).digest()


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Return the attachment of one message; without it ROS 2 drops the message.

    Parameters
    ----------
    sequence
        From 1, for each publisher.
    time_ns
        Since the epoch.
    """
    return _ATTACHMENT.pack(sequence, time_ns, _GID_BYTES, gid)


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Return sequence number, time (ns) and gid of an attachment.

    Raises
    ------
    UsageError
        It is of another form, such as that of an older release.
    """
    if len(data) != _ATTACHMENT.size or data[16] != _GID_BYTES:
        raise UsageError(
            f"an attachment of {len(data)} bytes; expected 33: is rmw_zenoh older than 2025?"
        )
    sequence, time_ns, _, gid = _ATTACHMENT.unpack(data)
    return int(sequence), int(time_ns), bytes(gid)


def _full(topic: str) -> str:
    """Return a topic's full name without the leading slash."""
    name = topic.strip("/")
    if not name or "//" in name or any(c in name for c in "*?#$% "):
        raise UsageError(f"{topic!r} is no name of a topic")
    return name
