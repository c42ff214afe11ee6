"""Joints of a robot during an attempt, measured and commanded, as one binary object."""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import pose_from_matrix
from rtask.errors import DataError, UsageError

__all__ = ["MEDIA_TYPE", "Motion"]

MEDIA_TYPE = "application/gzip"
MAX_JOINTS, MAX_SAMPLES = 64, 20_000
_FORMAT = "rtask-motion-1"
_MAX_BYTES = 64 << 20
_DECIMALS = 6


@dataclass(frozen=True, eq=False)
class Motion:
    """Joints over time.

    Parameters
    ----------
    joints
        Names; the opening of a hand, 0 (closed) to 1, counts as a joint by the hand's name.
    times : (n,) float, s
        Since the start of the attempt, rising.
    positions : (n, joints) float, rad or m
        As measured.
    commands : (n, joints) float, rad or m
        As commanded at the same moments.
    leads
        Whether each command was given after its sample, as programs record that command a robot
        row by row; otherwise it is the latest one before it.
    frame_id
        Frame of the pose, a name of tf; empty without one.
    pose : (7,) float or None
        Where the robot knew the object when the attempt began: x, y, z in m, and a quaternion.
    """

    joints: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    commands: NDArray[np.float64]
    leads: bool = False
    frame_id: str = ""
    pose: NDArray[np.float64] | None = None

    @property
    def actions(self) -> NDArray[np.float64]:
        """What was commanded from each sample on, until the next one: (n, joints) float, rad or m.

        The arm has come to where the latest command sent it. A policy that learnt those would
        command an arm to stay where it is.
        """
        if self.leads:
            return self.commands
        return np.vstack([self.commands[1:], self.commands[-1:]])

    @classmethod
    def of_rows(
        cls, joints: list[str], times: Any, positions: Any, commands: Any, where: str,
        leads: bool = False,
    ) -> Motion:  # fmt: skip
        """Return the motion of numbers in one row each, sample by sample.

        Parameters
        ----------
        joints
            Names, all different.
        times : (n,) float, s
        positions, commands : (n * joints,) float
        where
            The field, for errors.
        leads
            As of the class.

        Raises
        ------
        UsageError
            The sizes do not fit, the times do not rise, or a number is not finite.
        """
        if not 1 <= len(joints) <= MAX_JOINTS or len(set(joints)) < len(joints):
            raise UsageError(
                f"{where}.joints: expected 1 to {MAX_JOINTS} different names", field=where
            )
        moments = np.asarray(times, dtype=np.float64)
        count = len(moments)
        if not 1 <= count <= MAX_SAMPLES or not np.isfinite(moments).all():
            raise UsageError(f"{where}.times: expected 1 to {MAX_SAMPLES} numbers", field=where)
        if moments[0] < 0 or not (np.diff(moments) > 0).all():
            raise UsageError(f"{where}.times: expected rising seconds from 0 on", field=where)
        rows = []
        for name, values in (("positions", positions), ("commands", commands)):
            given = np.asarray(values, dtype=np.float64)
            if given.shape != (count * len(joints),) or not np.isfinite(given).all():
                raise UsageError(
                    f"{where}.{name}: expected {count} samples of {len(joints)} joints in one row, "
                    f"{count * len(joints)} finite numbers; got {given.size}",
                    field=where,
                )
            rows.append(given.reshape(count, len(joints)))
        return cls(tuple(joints), moments, rows[0], rows[1], leads)

    def of_object(self, frame_id: str, frame_from_object: NDArray[np.float64]) -> Motion:
        """Return the motion with where the object was when it began; pose (4, 4), m."""
        position, turn = pose_from_matrix(frame_from_object)
        return replace(self, frame_id=frame_id, pose=np.concatenate([position, turn]))

    def to_bytes(self) -> bytes:
        """Return the motion as compressed JSON, the same bytes for the same numbers."""
        fields: dict[str, Any] = {
            "format": _FORMAT,
            "joints": list(self.joints),
            "times": np.round(self.times, _DECIMALS).tolist(),
            "positions": np.round(self.positions, _DECIMALS).ravel().tolist(),
            "commands": np.round(self.commands, _DECIMALS).ravel().tolist(),
        }
        if self.leads:  # left out otherwise, so that the bytes of what is stored stay the same
            fields["leads"] = True
        if self.pose is not None:
            fields["object"] = {
                "frame_id": self.frame_id,
                "pose": np.round(self.pose, _DECIMALS).tolist(),
            }
        return gzip.compress(json.dumps(fields, separators=(",", ":")).encode(), mtime=0)

    @classmethod
    def from_bytes(cls, data: bytes) -> Motion:
        """Read what :meth:`to_bytes` returned.

        Raises
        ------
        DataError
            The bytes are something else, or too long.
        """
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
                text = file.read(_MAX_BYTES + 1)
            if len(text) > _MAX_BYTES:
                raise DataError(f"a motion is longer than {_MAX_BYTES >> 20} MiB")
            fields = json.loads(text)
            if fields["format"] != _FORMAT:
                raise DataError(f"a motion has the format {fields['format']!r}, not {_FORMAT!r}")
            times, positions, commands = (
                fields[name] for name in ("times", "positions", "commands")
            )
            leads = bool(fields.get("leads", False))
            joints = list(fields["joints"])
            motion = cls.of_rows(joints, times, positions, commands, "motion", leads)
            return motion._seen_at(fields.get("object"))
        except (OSError, EOFError, ValueError, KeyError, TypeError, UsageError) as error:
            raise DataError(f"no motion of an attempt: {error}") from error

    def _seen_at(self, seen: Any) -> Motion:
        if seen is None:
            return self
        pose = np.asarray(seen["pose"], dtype=np.float64)
        if pose.shape != (7,) or not np.isfinite(pose).all():
            raise ValueError(f"object.pose: expected 7 finite numbers, got {seen['pose']}")
        return replace(self, frame_id=str(seen["frame_id"]), pose=pose)

    def at_rate(self, rate_hz: float) -> Motion:
        """Return the motion at equal steps from its first sample, joints interpolated between.

        Parameters
        ----------
        rate_hz
            Samples per second.
        """
        count = int((self.times[-1] - self.times[0]) * rate_hz + 1e-6) + 1
        times = self.times[0] + np.arange(count) / rate_hz

        def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.stack([np.interp(times, self.times, column) for column in values.T], axis=1)

        return replace(self, times=times, positions=at(self.positions), commands=at(self.commands))
