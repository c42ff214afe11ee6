"""Types of ROS 2 as the DDS library takes them, and their samples as raw CDR.

The library's own coding in Python takes 131 ms of processor time for a cloud of 2 MB; here CDR
passes as it is.
"""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype

from rtask.interop.ros.dds.types import RosTypes, dds_name

__all__ = ["ENCAPSULATION", "Structs"]

ENCAPSULATION = 4
"""Bytes of the CDR's own header: representation and options."""
_HEADER = "rtask_request_header"


class Structs:
    """Classes of samples, each with the one attribute ``cdr``.

    Parameters
    ----------
    types
        Definitions of messages.
    """

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._nested: dict[str, Any] = {}

    def of_topic(self, type_: str) -> Any:
        """Return the class of the samples of a topic, ``std_msgs/msg/String``."""
        return self._raw(dds_name(type_), self._fields(type_))

    def of_service(self, type_: str, half: str) -> Any:
        """Return the class of a service's requests or replies.

        Parameters
        ----------
        type_
            ``rtask_msgs/srv/WhereIs``.
        half
            ``Request`` or ``Response``.
        """
        from cyclonedds.idl import types as idl

        # rmw_cyclonedds puts a client's guid and a sequence number before the fields.
        header = {f"{_HEADER}_guid": idl.uint64, f"{_HEADER}_sequence": idl.int64}
        name = f"{type_}_{half}"
        return self._raw(dds_name(name), {**header, **self._fields(name)})

    def _fields(self, type_: str) -> dict[str, Any]:
        return {name: self._idl(description) for name, description in self._types.fields(type_)}

    def _idl(self, description: Any) -> Any:
        from cyclonedds.idl import make_idl_struct
        from cyclonedds.idl import types as idl

        kind, what = description
        if kind == Nodetype.BASE:
            base, limit = what
            if base == "string":
                return idl.bounded_str[limit] if limit else str
            return {"bool": bool, "char": idl.uint8}.get(base) or getattr(idl, base)
        if kind == Nodetype.NAME:
            if what not in self._nested:
                name = dds_name(what)
                self._nested[what] = make_idl_struct(
                    name.rpartition("::")[2], name, self._fields(what)
                )
            return self._nested[what]
        inner = self._idl(what[0])
        if kind == Nodetype.ARRAY:
            return idl.array[inner, what[1]]
        return idl.sequence[inner, what[1]] if what[1] else idl.sequence[inner]

    @staticmethod
    def _raw(name: str, fields: dict[str, Any]) -> Any:
        from cyclonedds.idl import make_idl_struct

        made: Any = make_idl_struct(name.rpartition("::")[2], name, fields)

        def serialize(sample: Any, *unused: Any, **options: Any) -> bytes:
            return _padded(sample.cdr)

        def deserialize(cls: Any, data: bytes, *unused: Any, **options: Any) -> Any:
            sample = cls.__new__(cls)
            sample.cdr = bytes(data)
            return sample

        def from_cdr(cls: Any, data: bytes) -> Any:
            sample = cls.__new__(cls)
            sample.cdr = data
            return sample

        # On the class itself: the library refuses a subclass.
        made.serialize, made.deserialize = serialize, classmethod(deserialize)
        made.from_cdr = classmethod(from_cdr)
        return made


def _padded(cdr: bytes) -> bytes:
    """Return CDR filled up to four bytes; the options tell by how many (RTPS 2.5, 10.2.1)."""
    fill = -len(cdr) % 4
    return cdr[:3] + bytes([fill]) + cdr[ENCAPSULATION:] + bytes(fill)
