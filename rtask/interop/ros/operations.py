"""Answers the operations of the engine to messages of ROS; knows neither rospy nor rclpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from rtask.errors import RtaskError
from rtask.interop.ros.convert import Converter, Make, Pack, fill
from rtask.interop.ros.schema import REFUSED, Schema

__all__ = ["Caller", "Heard", "OperationHandler", "best_grasp", "refusal", "service_names"]

Heard = Callable[[str, Mapping[str, Any]], None]
"""Takes an operation and its answer."""
_MAX_WORDS = 500


class Caller(Protocol):
    """The part of a client of the server that a node uses."""

    @property
    def waiting(self) -> int:
        """Number of calls that wait in the outbox."""

    def call(
        self, operation: str, /, timeout_s: float | None = None, **args: Any
    ) -> dict[str, Any]:
        """Carry out an operation of the engine."""

    def deliver(self) -> int:
        """Send what waits in the outbox."""


def service_names(schema: Schema) -> list[str]:
    """Return the relative names of the services of all operations."""
    return [f"rtask/{name}" for name in schema.services]


def refusal(error: Exception) -> str:
    """Return an error as a service tells it: its first line, at most 500 characters."""
    return (str(error).strip() or repr(error)).partition("\n")[0][:_MAX_WORDS]


class OperationHandler:
    """Carries out the operations that messages ask for.

    Parameters
    ----------
    client
        Of the server; each call ends within its time limit.
    make
        Makes empty messages.
    heard
        Called with the operation and the answer after each call that was answered.
    pack
        Packs the clouds of requests; see :class:`Converter`.
    """

    def __init__(
        self, schema: Schema, client: Caller, make: Make, heard: Heard, pack: Pack | None = None
    ) -> None:
        self._client, self._heard = client, heard
        self._converter = Converter(schema, make, pack)

    def answer(self, operation: str, message: Any, response: Any) -> Any:
        """Fill in the response to a request and return it.

        Raises
        ------
        RtaskError
            The request is wrong, or the server refused it or cannot be reached.
        """
        request = self._converter.request(operation, message)
        data = self._client.call(operation, **request)
        filled = self._converter.answer(operation, data, response)
        self._heard(operation, data)
        return filled

    def answer_or_refuse(self, operation: str, message: Any, make: Callable[[], Any]) -> Any:
        """Return the response to a request; what was refused has the reason in ``refused``.

        Services of ROS 2 have no exceptions.
        """
        try:
            return self.answer(operation, message, make())
        except RtaskError as error:
            refused = make()
            setattr(refused, REFUSED, refusal(error))
            return refused


def best_grasp(operation: str, answer: Mapping[str, Any], make: Make) -> Any:
    """Return the best grasp of an answer of ``recognise_for_grasp`` as a message, or None."""
    if operation != "recognise_for_grasp" or not answer.get("grasps"):
        return None
    return fill(make("moveit_msgs/Grasp"), answer["grasps"][0], make)
