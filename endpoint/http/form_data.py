"""Bodies of multipart/form-data (RFC 7578): forms, and files as curl sends them."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from email.parser import BytesParser
from email.policy import HTTP
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from endpoint.http.messages import RefusedError, Request

__all__ = ["FORM_DATA_TYPE", "FormPart", "array_from_npy", "form_parts"]

FORM_DATA_TYPE = "multipart/form-data"


@dataclass(frozen=True)
class FormPart:
    """One part of a form.

    Parameters
    ----------
    name
        Of the field.
    filename
        As sent; empty for what is no file.
    media_type
        Its Content-Type; empty where it has none of its own.
    data
        The bytes.
    """

    name: str
    filename: str
    media_type: str
    data: bytes


def form_parts(request: Request) -> list[FormPart]:
    """Return the parts of a body.

    Raises
    ------
    RefusedError
        400: there are none.
    """
    head = f"Content-Type: {request.header('content-type')}\r\n\r\n".encode()
    message = BytesParser(policy=HTTP).parsebytes(head + request.body)
    if not message.is_multipart():
        raise RefusedError(400, "usage", "the multipart body has no parts; is the boundary right?")
    parts = []
    for piece in message.iter_parts():
        data = piece.get_payload(decode=True)
        if not isinstance(data, bytes):
            raise RefusedError(400, "usage", "a part of the body is multipart itself")
        name = piece.get_param("name", "", "content-disposition")
        media_type = piece.get_content_type() if piece.get("Content-Type") else ""
        parts.append(FormPart(str(name), piece.get_filename() or "", media_type, data))
    return parts


def array_from_npy(data: bytes) -> NDArray[Any] | None:
    """Return the numbers of a ``.npy`` file; none if it does not hold as many as it says.

    numpy's own reader first makes room for what the header announces, and may run pickles.

    Examples
    --------
    >>> file = io.BytesIO()
    >>> np.save(file, np.eye(2))
    >>> array_from_npy(file.getvalue())
    array([[1., 0.],
           [0., 1.]])
    >>> array_from_npy(file.getvalue()[:-1]) is None
    True
    """
    file = io.BytesIO(data)
    try:
        read = _HEADERS[npy.read_magic(file)]
        shape, is_fortran, dtype = read(file)
        rest = data[file.tell() :]
        if dtype.kind not in "fiub" or math.prod(shape) * dtype.itemsize != len(rest):
            return None
        return np.frombuffer(rest, dtype).reshape(shape, order="F" if is_fortran else "C")
    except Exception:  # noqa: BLE001 - numpy evaluates the header, which may be any expression
        return None


_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
