"""Joints of a robot during an attempt, measured and commanded, as one binary object."""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """

    joints: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    commands: NDArray[np.float64]

    @classmethod
    def of_rows(
        cls, joints: list[str], times: Any, positions: Any, commands: Any, where: str
    ) -> Motion:
        """Return the motion of numbers in one row each, sample by sample.

        Parameters
        ----------
        joints
            Names, all different.
        times : (n,) float, s
        positions, commands : (n * joints,) float
        where
            The field, for errors.

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
        return cls(tuple(joints), moments, rows[0], rows[1])

    def to_bytes(self) -> bytes:
        """Return the motion as compressed JSON, the same bytes for the same numbers."""
        fields = {
            "format": _FORMAT,
            "joints": list(self.joints),
            "times": np.round(self.times, _DECIMALS).tolist(),
            "positions": np.round(self.positions, _DECIMALS).ravel().tolist(),
            "commands": np.round(self.commands, _DECIMALS).ravel().tolist(),
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
            return cls.of_rows(list(fields["joints"]), times, positions, commands, "motion")
        except (OSError, EOFError, ValueError, KeyError, TypeError, UsageError) as error:
            raise DataError(f"no motion of an attempt: {error}") from error

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

        return Motion(self.joints, times, at(self.positions), at(self.commands))
