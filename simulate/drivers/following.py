"""Base of every driver: motions that are checked before, bounded meanwhile and measured after.

A motion may be sent in pieces that end at rest. The next piece leaves this program only when the
arm has been measured at the end of the last one, so that a link that is lost, or a program that is
killed, ends the motion with the piece that the robot has: no controller needs a watchdog for it.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np

from simulate.drivers.contract import ARRIVED_RAD, check_arrival, check_at_goal, check_motion_start
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["FollowingArm"]

_NO_WAY_RAD = 1e-6

log = logging.getLogger(__name__)


class FollowingArm(ABC):
    """Keeps the contract of drivers around what one of them sends.

    Parameters
    ----------
    joints
        In the order of the trajectories.
    link
        To what, for people: it may be lost.
    keep_ready
        With what people can stop the arm.
    say
        Receives what people have to know before a motion; logged by default.
    """

    arrived_rad = ARRIVED_RAD
    """How far a joint may be from its goal."""

    def __init__(
        self,
        joints: tuple[str, ...],
        link: str,
        keep_ready: str,
        say: Callable[[str], object] = log.warning,
    ) -> None:
        self._joints, self._say = joints, say
        self._if_lost, self._keep_ready = f"if {link} is lost", keep_ready

    @abstractmethod
    def measured(self) -> Floats:
        """Return the joints (dof,), rad, of the arm at rest, from fresh states."""

    @abstractmethod
    def carry_out(self, way: Trajectory) -> Callable[[Floats], None] | None:
        """Send a motion, and wait until the robot says that it succeeded.

        Returns
        -------
        A further check of the joints (dof,), rad, that are measured afterwards; None = there is
        none.

        Raises
        ------
        RobotError, RemoteUnavailableError
            It ended otherwise, or nobody knows.
        """

    @abstractmethod
    def stop(self) -> None:
        """End this program's own motion, if the robot still has one; raises nothing."""

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory as one motion; see :meth:`follow_pieces`."""
        self.follow_pieces([way])

    def follow_pieces(self, pieces: Sequence[Trajectory]) -> None:
        """Have the arm follow trajectories, each from the end of the one before, and wait.

        How long the arm may go on without this program is said before the motion: it is the longest
        piece. Pieces that lead nowhere are not sent. On every error the arm is stopped.

        Raises
        ------
        RobotError
            They start away from the measured pose, the robot ended one otherwise than by success,
            the measured joints are not at its end, or did not move as planned.
        RemoteUnavailableError
            One did not end in its time and 5 s, or the robot cannot be heard.
        """
        start = self.measured()
        check_motion_start(pieces[0], self._joints, start)
        pieces = [piece for piece in pieces if _leads_somewhere(piece)]
        if not pieces:
            return
        self._say(self._risk(pieces))
        now = start
        for piece in pieces:
            now = self._follow_piece(piece, now)
        if len(pieces) > 1:
            check_arrival(pieces[-1], self._joints, now, start, self.arrived_rad)

    def _follow_piece(self, piece: Trajectory, before: Floats) -> Floats:
        """Follow one piece; return the joints (dof,), rad, measured at its end."""
        try:
            check = self.carry_out(piece)
            measured = self.measured()
            # A way shorter than the tolerance ends where it began, as far as that tells: there,
            # half of it has to be gone.
            if np.abs(piece.positions[-1] - before).max() > self.arrived_rad:
                check_at_goal(piece, self._joints, measured, self.arrived_rad)
            else:
                check_arrival(piece, self._joints, measured, before, self.arrived_rad)
            if check is not None:
                check(measured)
        # Ctrl-C as well: whoever presses it wants the arm to stop.
        except BaseException:
            self.stop()
            raise
        return measured

    def _risk(self, pieces: Sequence[Trajectory]) -> str:
        longest = max(piece.duration for piece in pieces)
        if len(pieces) > 1:
            return (
                f"{self._if_lost}, the arm stops within {longest:.1f} s: "
                f"it gets its way in {len(pieces)} pieces that end at rest"
            )
        return (
            f"{self._if_lost}, the arm may go on for up to {longest:.1f} s: keep {self._keep_ready}"
        )


def _leads_somewhere(way: Trajectory) -> bool:
    return bool(np.abs(way.positions - way.positions[0]).max() > _NO_WAY_RAD)
