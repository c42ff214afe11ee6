"""Trials of push grasps as a service, so that workers on many machines share an analysis.

One call is one shard: some perturbed parts, on which all grasps are tried (Kehoe 2014, 3.6).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from rtask.errors import ServiceError
from rtask.services.service import Service, method, startup
from rtask.wire.message import Message
from rtask.wire.types import Array, ArrayOf, Bytes, Carried, Flag, Json, Number, Unit, Whole

if TYPE_CHECKING:
    from grasp.push.trials import Trials

__all__ = ["NAME", "PushTrials", "codes_of", "counts_of", "request_of"]

NAME = "rtask/PushTrials"
_MAX_TRIALS = 100_000
_MAX_EVALUATIONS = 50_000_000


def _rows(columns: int, form: str, most: int) -> Any:
    kind = Carried("string", "Sequence[Sequence[float]]", None)
    return Annotated[NDArray[np.float64], ArrayOf(columns, "", most, form), kind]


class Shard(Message):
    """Trials of grasps on one part, all lengths in radii of the part."""

    ring: _rows(2, "[x, y]", 2000)  # type: ignore[valid-type]
    """outline, with the centroid as origin"""
    com: Array
    """centre of mass, x and y"""
    rows: _rows(5, "five numbers", 200_000)  # type: ignore[valid-type]
    """grasps"""
    width: Number
    """of the jaw"""
    diameter: Number
    """of the part"""
    vertex_std: Array
    """standard deviation of a vertex: one number, or one for each vertex"""
    com_std: Number
    """standard deviation of the centre of mass"""
    pose_std: Array
    """standard deviations of the lateral position and of the rotation in rad"""
    com_follows: Flag
    """whether the centre of mass is the centroid of each perturbed part"""
    correlation: Number | None = None
    """length over which vertices deviate alike; default: each deviates on its own"""
    test: Json
    """parameters of the test of a grasp"""
    key: Annotated[Whole, Ge(0)]
    """number from which the perturbations follow"""


class PushTrials(Service):
    """Trials of push grasps on perturbed parts, one shard at a time."""

    name = NAME
    version = "1.3.0"
    extra = "perception"
    timeout_s = 300.0

    @startup
    def compile(self) -> None:
        """Compile the kernels; they are kept on disk."""
        from grasp.push import warm_up

        warm_up()

    @method(output="codes")
    def run(
        self,
        shard: Shard,
        first: Annotated[Whole, Ge(0)],
        count: Annotated[Whole, Ge(1), Le(_MAX_TRIALS)],
    ) -> Bytes:
        """Result of every grasp on every perturbed part, one byte each, compressed by zlib.

        Parameters
        ----------
        shard
            Part, grasps and test.
        first
            Number of the first perturbation.
        count
            How many perturbations.
        """
        return zlib.compress(_judged(shard, count, lambda trials: trials(first, count)), 1)

    @method(output="counts")
    def count(
        self,
        shard: Shard,
        first: Annotated[Whole, Ge(0)],
        count: Annotated[Whole, Ge(1), Le(_MAX_TRIALS)],
    ) -> Bytes:
        """Counts of each result, grasp by grasp: four bytes each, compressed by zlib.

        The results are in ascending order of their numbers.

        Parameters
        ----------
        shard
            Part, grasps and test.
        first
            Number of the first perturbation.
        count
            How many perturbations.
        """
        from grasp.push.trials import Counting

        counts = _judged(shard, count, lambda trials: Counting(trials)(first, count).astype("<u4"))
        return zlib.compress(counts, 1)

    @method(output="codes")
    def pose(
        self,
        shard: Shard,
        position_std: Array,
        rotation_std: Annotated[Array, Unit("rad")],
        samples: Annotated[Whole, Ge(1), Le(_MAX_TRIALS)],
        first: Annotated[Whole, Ge(0)],
        count: Annotated[Whole, Ge(1), Le(_MAX_TRIALS)],
    ) -> Bytes:
        """Result of one grasp on the part in many poses, one byte each, compressed by zlib.

        The trials are numbered through a grid of uncertainties, ``samples`` for each pair of a
        position and a rotation (Kehoe 2014, 3.8).

        Parameters
        ----------
        shard
            Part, one grasp, and a test by simulation.
        position_std
            Deviations of the lateral position, in radii of the part.
        rotation_std
            Deviations of the rotation about the centre of mass.
        samples
            Trials for each pair.
        first
            Number of the first trial.
        count
            How many trials.
        """
        from grasp.push.pose import PoseTrials

        total = len(position_std) * len(rotation_std) * samples
        if len(shard.rows) != 1 or first + count > total:
            raise ServiceError(
                f"expected one grasp and trials below {total}, got {len(shard.rows)} and "
                f"{first + count}"
            )
        try:
            codes = PoseTrials(_trials(shard), position_std, rotation_std, samples)(first, count)
        except (ValueError, TypeError) as error:
            raise ServiceError(str(error)) from error
        return zlib.compress(codes.tobytes(), 1)


def request_of(trials: Trials) -> dict[str, Any]:
    """Return the trials of an analysis as a request carries them."""
    from dataclasses import asdict

    given = trials.tolerance
    return {
        "ring": trials.ring.tolist(),
        "com": trials.com.tolist(),
        "rows": trials.rows.tolist(),
        "width": trials.width,
        "diameter": trials.diameter,
        "vertex_std": np.atleast_1d(given.vertex_std).tolist(),
        "com_std": given.com_std,
        "pose_std": list(given.pose_std),
        "com_follows": given.com_follows,
        **({} if given.correlation is None else {"correlation": given.correlation}),
        "test": asdict(trials.test),
        "key": int(trials.key),
    }


def _judged(shard: Shard, count: int, judge: Callable[[Trials], NDArray[Any]]) -> bytes:
    """Return what a function of the trials finds.

    Raises
    ------
    ServiceError
        They make no sense, or are too many.
    """
    if count * len(shard.rows) > _MAX_EVALUATIONS:
        raise ServiceError(f"{count} trials of {len(shard.rows)} grasps are too many for a call")
    try:
        return judge(_trials(shard)).tobytes()
    except (ValueError, TypeError) as error:
        raise ServiceError(str(error)) from error


def codes_of(packed: bytes, grasps: int) -> NDArray[np.int8]:
    """Return the results (grasps, count) that an answer holds."""
    return np.frombuffer(zlib.decompress(packed), np.int8).reshape(grasps, -1)


def counts_of(packed: bytes, grasps: int) -> NDArray[np.int64]:
    """Return the counts (grasps, results) that an answer holds."""
    counts = np.frombuffer(zlib.decompress(packed), "<u4").reshape(grasps, -1)
    return counts.astype(np.int64)


def _trials(shard: Shard) -> Trials:
    from grasp.push.perturb import Tolerance
    from grasp.push.trials import PushTest, Trials

    for name, two in (("com", shard.com), ("pose_std", shard.pose_std)):
        if len(two) != 2:
            raise ValueError(f"{name}: expected two numbers, got {len(two)}")
    lateral, rotation = shard.pose_std.tolist()
    std = shard.vertex_std
    tolerance = Tolerance(
        float(std[0]) if len(std) == 1 else std, shard.com_std, (lateral, rotation),
        shard.com_follows, shard.correlation,
    )  # fmt: skip
    return Trials(
        shard.ring, shard.com, shard.rows, shard.width, shard.diameter, tolerance,
        PushTest(**shard.test), shard.key,
    )  # fmt: skip
