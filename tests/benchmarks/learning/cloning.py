"""A small policy that clones recorded movements, and what it has to beat (numpy alone)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

__all__ = ["Controller", "Demonstration", "mean_of", "nearest_of", "read_set", "train"]

Floats = NDArray[np.float64]
Controller = Callable[[int, Floats], Floats]
"""From the number of a row and the measured joints (n,) to the commanded ones (n,)."""

_OPEN = 0.5
"""Opening of a commanded hand below which it is to close."""
_HIDDEN, _STEPS, _BATCH, _RATE = 128, 6000, 512, 1e-3
_NOISE, _NOISE_HAND = 0.03, 0.1
"""Of the joints in training, as a share of the way that is left, and of the opening, 0..1."""
_NEAR, _ALIKE_RAD, _RIDGE = 2.0, 0.4, 1e-3
"""Of poses, in standard deviations, and of ways to reach one: how far an episode counts.

Chosen on fifty other episodes, each left out in turn."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode, until the hand has closed.

    Parameters
    ----------
    states, actions : (n, joints) float, rad
        The last joint is the opening of the hand, 0..1.
    pose : (7,) float
        Of the object: m, and a quaternion.
    """

    states: Floats
    actions: Floats
    pose: Floats


def read_set(folder: Path, closing_rows: int) -> list[Demonstration]:
    """Read a data set of LeRobot by its own description, without the code that wrote it.

    Parameters
    ----------
    folder
        With ``meta/info.json``.
    closing_rows
        Rows that belong to the closing of the hand.
    """
    info = json.loads((folder / "meta/info.json").read_text("utf-8"))
    path = str(info["data_path"]).format(chunk_index=0, file_index=0)
    table = pq.read_table(folder / path)
    states, actions, poses = (
        np.array(table[name].to_pylist(), np.float64)
        for name in ("observation.state", "action", "observation.environment_state")
    )
    episodes = np.asarray(table["episode_index"])
    made = []
    for number in np.unique(episodes):
        rows = np.flatnonzero(episodes == number)
        closes = int(np.argmax(actions[rows, -1] < _OPEN))
        rows = rows[: closes + closing_rows]
        made.append(Demonstration(states[rows], actions[rows], poses[rows[0]]))
    return made


def seen(pose: Floats) -> Floats:
    """Return a pose (7,) as numbers (4,) without a jump: the place, and the yaw of a box."""
    yaw = 2.0 * np.arctan2(pose[5], pose[6])
    return np.array([pose[0], pose[1], np.cos(2 * yaw), np.sin(2 * yaw)])


def nearest_of(shown: list[Demonstration], pose: Floats) -> Controller:
    """Replay the episode whose object lay most alike."""
    scale = np.std([seen(one.pose) for one in shown], axis=0)
    apart = [np.linalg.norm((seen(one.pose) - seen(pose)) / scale) for one in shown]
    return _replayed(shown[int(np.argmin(apart))].actions)


def mean_of(shown: list[Demonstration]) -> Controller:
    """Replay the mean of all episodes, each stretched to one length."""
    count = round(float(np.mean([len(one.actions) for one in shown])))
    stretched = [
        [np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(one.actions)), column)
         for column in one.actions.T]
        for one in shown
    ]  # fmt: skip
    return _replayed(np.mean(stretched, axis=0).T)


def _replayed(actions: Floats) -> Controller:
    return lambda row, measured: actions[min(row, len(actions) - 1)]


def posture_for(shown: list[Demonstration], pose: Floats) -> Floats:
    """Return the joints (n - 1,) rad in which the hand is to close on an object.

    A linear fit to the final postures around the nearest episode. Arms reach one pose in several
    ways, whose mean reaches nothing: episodes count by how alike they deviate from a fit to all.
    """
    places = np.array([seen(one.pose) for one in shown])
    ends = np.array([one.states[-1, :-1] for one in shown])
    here = (seen(pose) - places.mean(0)) / places.std(0)
    places = (places - places.mean(0)) / places.std(0)
    apart = np.linalg.norm(places - here, axis=1)
    nearest = int(np.argmin(apart))
    curved = np.hstack([places, places**2, places[:, :1] * places[:, 1:2]])
    beside = ends - _fitted_at(curved, ends, np.ones(len(ends)), curved)
    unlike = np.linalg.norm(beside - beside[nearest], axis=1)
    weights = np.exp(-0.5 * (apart / _NEAR) ** 2 - 0.5 * (unlike / _ALIKE_RAD) ** 2)
    change = _fitted_at(places, ends - ends[nearest], weights, here[None])
    return np.asarray(ends[nearest] + change[0])


def _fitted_at(places: Floats, values: Floats, weights: Floats, there: Floats) -> Floats:
    """Fit values linearly by places and return them elsewhere."""
    known = np.hstack([np.ones((len(places), 1)), places])
    weighted = known.T * weights
    slopes = np.linalg.solve(weighted @ known + _RIDGE * np.eye(len(weighted)), weighted @ values)
    return np.asarray(np.hstack([np.ones((len(there), 1)), there]) @ slopes)


def train(shown: list[Demonstration], seed: int) -> Callable[[Floats], Controller]:
    """Return a policy: of the pose of an object, what to command in each state.

    It knows the posture to close in (:func:`posture_for`), and how to come there and close: two
    hidden layers give the change from the measured joints to the commanded ones, by least squares.

    Parameters
    ----------
    shown
        The episodes.
    seed
        Of the weights and the order of the rows.
    """
    rng = np.random.default_rng(seed)
    states = np.concatenate([one.states for one in shown])
    ahead = np.concatenate([one.states[-1, :-1] - one.states[:, :-1] for one in shown])
    changes = np.concatenate([one.actions for one in shown]) - states
    inputs = np.hstack([states, ahead])
    middle, spread, unit = inputs.mean(0), inputs.std(0) + 1e-6, changes.std(0) + 1e-6
    arm = states.shape[1] - 1
    sizes = (inputs.shape[1], _HIDDEN, _HIDDEN, states.shape[1])
    layers = [(rng.normal(0, 1 / np.sqrt(n), (n, m)), np.zeros(m)) for n, m in pairwise(sizes)]

    def batches() -> Iterator[tuple[Floats, Floats]]:
        for _ in range(_STEPS):
            rows = rng.integers(len(inputs), size=_BATCH)
            # Beside the path, by less where it ends: there a hand that is beside it misses.
            size = _NOISE * np.abs(ahead[rows]).max(axis=1, keepdims=True)
            moved = rng.normal(0, 1, (_BATCH, arm + 1))
            moved *= np.hstack([np.repeat(size, arm, axis=1), np.full((_BATCH, 1), _NOISE_HAND)])
            given, wanted = inputs[rows].copy(), changes[rows] - moved
            given[:, : arm + 1] += moved
            given[:, arm + 1 :] -= moved[:, :arm]
            yield (given - middle) / spread, wanted / unit

    weights = _fitted(layers, batches())

    def policy(pose: Floats) -> Controller:
        posture = posture_for(shown, pose)

        def command(row: int, measured: Floats) -> Floats:
            given = np.concatenate([measured, posture - measured[:-1]])
            change = _passes(weights, ((given - middle) / spread)[None])[-1][0]
            return np.asarray(measured + change * unit)

        return command

    return policy


_Layers = list[tuple[Floats, Floats]]


def _passes(layers: _Layers, given: Floats) -> list[Floats]:
    """Return what goes in, and what comes out of each layer."""
    values = [given]
    for number, (weight, offset) in enumerate(layers, start=1):
        out = values[-1] @ weight + offset
        values.append(np.tanh(out) if number < len(layers) else out)
    return values


def _fitted(layers: _Layers, batches: Iterator[tuple[Floats, Floats]]) -> _Layers:
    """Fit by Adam (Kingma and Ba 2015) with a rate that falls to nothing."""
    flat = [array for layer in layers for array in layer]
    first, second = ([np.zeros_like(array) for array in flat] for _ in range(2))
    for step, (given, wanted) in enumerate(batches, start=1):
        layers = list(zip(flat[::2], flat[1::2], strict=True))
        values = _passes(layers, given)
        slope = (values[-1] - wanted) / len(given)
        slopes: list[Floats] = []
        for number in reversed(range(len(layers))):
            slopes = [values[number].T @ slope, slope.sum(0), *slopes]
            slope = (slope @ layers[number][0].T) * (1 - values[number] ** 2)
        rate = _RATE * (1 - step / (_STEPS + 1))
        for k, gradient in enumerate(slopes):
            first[k] = 0.9 * first[k] + 0.1 * gradient
            second[k] = 0.999 * second[k] + 0.001 * gradient**2
            mean, size = first[k] / (1 - 0.9**step), second[k] / (1 - 0.999**step)
            flat[k] = flat[k] - rate * mean / (np.sqrt(size) + 1e-8)
    return list(zip(flat[::2], flat[1::2], strict=True))
