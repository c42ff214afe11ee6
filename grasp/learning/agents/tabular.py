"""Base of the learners that keep a table of state-action values."""

from __future__ import annotations

import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["Settings", "TabularAgent", "allowed_actions", "load_arrays", "save_arrays"]

_FORMAT = 2
_DRAWN = 256


@dataclass(frozen=True)
class Settings:
    """Parameters of the learners with a table.

    Parameters
    ----------
    gamma
        Discount a step.
    epsilon
        Share of random actions.
    alpha
        Learning rate.
    initial
        Value of everything before it was tried.
    """

    gamma: float = 0.99
    epsilon: float = 0.1
    alpha: float = 0.3
    initial: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gamma", "epsilon", "alpha"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 to 1")


class TabularAgent(ABC):
    """A table of values, epsilon-greedy actions, one random generator.

    Parameters
    ----------
    bins
        Numbers the states.
    actions
        How many there are.
    settings
        Parameters.
    seed
        Of the random generator.
    """

    def __init__(
        self, bins: Bins, actions: int, settings: Settings | None = None, seed: int = 0
    ) -> None:
        if actions < 1:
            raise ValueError(f"an agent needs an action, got {actions}")
        self.bins = bins
        self.actions = actions
        self.settings = settings or Settings()
        self.rng = np.random.default_rng(seed)
        self.values = np.full((bins.count, actions), self.settings.initial)
        self._epsilon, self._alpha = self.settings.epsilon, self.settings.alpha
        self._gamma = self.settings.gamma
        self._chances: list[float] = []
        self._acted: tuple[NDArray[Any] | None, int] = None, 0
        self._planned: tuple[int, int] | None = None

    @property
    def values(self) -> NDArray[np.float64]:
        """Value of every state (by its number) and action."""
        return self._values

    @values.setter
    def values(self, values: NDArray[np.float64]) -> None:
        self._values = values
        # Views of the rows, which take longer to make than to read.
        self._rows = list(values)

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return the action planned for this state, else an epsilon-greedy one.

        Parameters
        ----------
        state : (d,)
            Where the agent is.
        info
            ``action_mask`` (actions,) of bool leaves out what is impossible.
        """
        cell, mask = self.bins.number(state), allowed_actions(info) if info else None
        self._acted = state, cell
        planned, self._planned = self._planned, None
        if planned is not None and planned[0] == cell and (mask is None or mask[planned[1]]):
            return planned[1]
        return self.choose(cell, mask)

    def plan(self, cell: int) -> int:
        """Choose the action for a numbered state now; :meth:`act` returns it there."""
        action = self.choose(cell)
        self._planned = cell, action
        return action

    def choose(self, cell: int, mask: NDArray[np.bool_] | None = None) -> int:
        """Return the action for a numbered state, epsilon-greedy."""
        # As _chance() does, without a call.
        if (self._chances.pop() if self._chances else self._chance()) < self._epsilon:
            if mask is None:
                return int(self._chance() * self.actions)
            return self._any_of(np.flatnonzero(mask).tolist())
        return self.best(cell, mask)

    def best(self, cell: int, mask: NDArray[np.bool_] | None = None) -> int:
        """Return the action of the highest value; ties at random."""
        # On so short a row, a list takes a tenth of the time of an array.
        values: list[float] = self._rows[cell].tolist()
        if mask is not None:
            values = np.where(mask, values, -np.inf).tolist()
        highest = max(values)
        first = values.index(highest)
        if highest not in values[first + 1 :]:
            return first
        return self._any_of([action for action, value in enumerate(values) if value == highest])

    def _any_of(self, actions: list[int]) -> int:
        return actions[int(self._chance() * len(actions))] if len(actions) > 1 else actions[0]

    def _chance(self) -> float:
        """Return a number from [0, 1); drawn many at a time, which is five times as fast."""
        if not self._chances:
            self._chances = self.rng.random(_DRAWN).tolist()
        return self._chances.pop()

    def _cell_before(self, transition: Transition) -> int:
        """Return the number of the state in which the last action was taken."""
        (state, cell), self._acted = self._acted, (None, 0)
        return cell if state is transition.state else self.bins.number(transition.state)

    @abstractmethod
    def observe(self, transition: Transition) -> None:
        """Learn from one step."""

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from steps that somebody else took, before the first episode."""
        for transition in transitions:
            self.observe(transition)

    def parameters(self) -> dict[str, Any]:
        """Return what the learner was made with; a file resumes only in one made alike."""
        return asdict(self.settings)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        planned = [] if self._planned is None else [self._planned]
        return {
            "values": self.values,
            "planned": np.array(planned, dtype=np.int64).reshape(-1, 2),
            "chances": np.array(self._chances),
        }

    def take(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        self.values = np.array(arrays["values"])
        planned = [(int(cell), int(action)) for cell, action in arrays["planned"]]
        self._planned = planned[0] if planned else None
        # Earlier releases drew them one by one.
        self._chances = arrays["chances"].tolist() if "chances" in arrays else []

    def save(self, path: Path) -> None:
        """Write everything that is needed to go on exactly here."""
        save_arrays(path, type(self).__name__, self.rng, self.parameters(), self.arrays())

    def load(self, path: Path) -> None:
        """Go on where :meth:`save` stopped.

        Raises
        ------
        ValueError
            Another learner's file, one of another version, or of other states, actions or
            parameters. The learner is left as it was.
        """
        self.take(
            load_arrays(
                path, type(self).__name__, self.rng, self.parameters(), values=self.values.shape
            )
        )


def allowed_actions(info: Mapping[str, Any] | None) -> NDArray[np.bool_] | None:
    """Return the mask (actions,) of what is possible, or ``None`` if everything is.

    Raises
    ------
    ValueError
        The mask allows nothing.
    """
    mask = None if info is None else info.get("action_mask")
    if mask is None:
        return None
    allowed = np.asarray(mask, dtype=bool)
    if not allowed.any():
        raise ValueError("the action mask allows nothing")
    return allowed


def save_arrays(
    path: Path,
    kind: str,
    rng: np.random.Generator,
    parameters: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> None:
    """Write a learner as one npz file, by a rename, so that none is ever half written.

    Parameters
    ----------
    path
        Replaced if it exists.
    kind
        Of learner.
    rng
        Its state is written, too.
    parameters
        What the learner was made with; JSON.
    arrays
        What it learned.
    """
    header = {
        "format": _FORMAT,
        "kind": kind,
        "parameters": dict(parameters),
        "random": rng.bit_generator.state,
    }
    draft = path.with_name(path.name + ".part")
    with draft.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=np.array(json.dumps(header)), **arrays)
    draft.replace(path)


def load_arrays(
    path: Path,
    kind: str,
    rng: np.random.Generator,
    parameters: Mapping[str, Any],
    **shapes: tuple[int, ...],
) -> dict[str, NDArray[Any]]:
    """Read what :func:`save_arrays` wrote, and set the random generator.

    Parameters
    ----------
    path, kind, rng, parameters
        As for :func:`save_arrays`; kind and parameters must be those of the file.
    **shapes
        That arrays of these names must have.

    Raises
    ------
    ValueError
        No learner's file, another learner's, of another version, parameters or shapes; says what
        to do. The generator is left as it was.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays.pop("header")))
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a saved learner: {error}") from error
    version = header.get("format")
    if version != _FORMAT:
        has_number = isinstance(version, int)
        remedy = (
            "use the release of RTASK that wrote it"
            if has_number and version > _FORMAT
            else "relearn from the outcomes, or go on with the release that wrote it"
        )
        raise ValueError(f"{path} is of version {version}, this release reads {_FORMAT}: {remedy}")
    if header.get("kind") != kind:
        raise ValueError(f"{path} holds a {header.get('kind')}, expected a {kind}: make that one")
    saved, mine = header["parameters"], json.loads(json.dumps(dict(parameters)))
    other = sorted(k for k in {*saved, *mine} if saved.get(k) != mine.get(k))
    if other:
        there, here = ({k: p.get(k) for k in other} for p in (saved, mine))
        raise ValueError(f"{path} was learned with {there}, not {here}: make the learner with that")
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(
                f"{path} knows {arrays[name].shape} states and actions, this agent {shape}: "
                "make it with the same bins"
            )
    rng.bit_generator.state = header["random"]
    return arrays
