"""Tests of the act service with random goals (Gatto 2016, 4.3: the test interface)."""

from __future__ import annotations

import csv
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal

import numpy as np

from simulate.act.service import ActService

__all__ = ["Trial", "csv_log", "place_test", "random_goal", "reach_test", "reasons"]

_PURPOSES = {"reach": 0, "place": 1}
_BEYOND_M = 0.03
_HEIGHTS = (0.030, 0.045)


@dataclass(frozen=True)
class Trial:
    """One random goal and its outcome.

    Parameters
    ----------
    x, y, z
        Goal, m, base frame.
    theta
        Requested closing direction, rad.
    reached
        Whether the tool came within 1 cm.
    error_m
        Error of the tool; None if it did not get there.
    cpu_s
        Planning and simulation.
    """

    number: int
    x: float
    y: float
    z: float
    theta: float
    reached: bool
    reason: str
    arm: str
    error_m: float | None
    cpu_s: float


def random_goal(
    service: ActService, seed: int, number: int, action: Literal["reach", "place"]
) -> tuple[float, float, float, float]:
    """Return x, y, z (m) and theta (rad) of an imaginary object on the table.

    Drawn from the area where objects stand and 3 cm beyond it; the same seed and number give the
    same goal, whatever was drawn before.
    """
    place = service.cell.world.workplace
    rng = np.random.default_rng((seed, number, _PURPOSES[action]))
    (x0, x1), (y0, y1) = place.area_x, place.area_abs_y
    x = rng.uniform(x0 - _BEYOND_M, x1 + _BEYOND_M)
    y = rng.choice([-1.0, 1.0]) * rng.uniform(max(y0 - _BEYOND_M, 0.0), y1 + _BEYOND_M)
    z = service.cell.world.table_height + rng.uniform(*_HEIGHTS)
    return float(x), float(y), float(z), float(rng.uniform(0, np.pi))


def reach_test(
    service: ActService,
    n: int,
    seed: int = 0,
    on_trial: Callable[[Trial], None] = lambda trial: None,
) -> list[Trial]:
    """Reach for ``n`` imaginary objects at random positions."""
    return _run(service, "reach", n, seed, on_trial)


def place_test(
    service: ActService,
    n: int,
    seed: int = 0,
    on_trial: Callable[[Trial], None] = lambda trial: None,
) -> list[Trial]:
    """Carry an imaginary object to ``n`` random positions on the table."""
    return _run(service, "place", n, seed, on_trial)


def _run(
    service: ActService,
    action: Literal["reach", "place"],
    n: int,
    seed: int,
    on_trial: Callable[[Trial], None],
) -> list[Trial]:
    trials = []
    for number in range(n):
        x, y, z, theta = random_goal(service, seed, number, action)
        goal = {
            "position": {"x": x, "y": y, "z": z},
            "orientation": {"x": 0.0, "y": 0.0, "z": np.sin(theta / 2), "w": np.cos(theta / 2)},
        }
        started = time.process_time()
        answer = service.act({"action_type": action, "goal_pose": goal})
        trial = Trial(
            number, x, y, z, theta, bool(answer["success"]), answer["reason"], answer["arm"],
            answer["distance_error_m"], time.process_time() - started,
        )  # fmt: skip
        on_trial(trial)
        trials.append(trial)
    service.go_home()
    return trials


def reasons(trials: Sequence[Trial]) -> dict[str, int]:
    """Count the reason codes, the most frequent first."""
    return dict(Counter(trial.reason for trial in trials).most_common())


@contextmanager
def csv_log(path: Path | None) -> Iterator[Callable[[Trial], None]]:
    """Open a CSV file, and give what writes a trial to it at once: nothing is lost when cut.

    Parameters
    ----------
    path
        Of the file; None = trials are not written.
    """
    if path is None:
        yield lambda trial: None
        return
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Trial)])
        writer.writeheader()

        def write(trial: Trial) -> None:
            writer.writerow(asdict(trial))
            file.flush()

        yield write
