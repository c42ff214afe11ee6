"""TEXPLORE in real time (RTMBA, Hester, Quinlan and Stone 2012): acting never waits for learning.

Three threads share one agent. The calling thread acts at a fixed rate, a second one trains a copy
of the model and swaps it in, a third one plans all the time. Rollouts and the building of trees run
without the interpreter's lock.
"""

from __future__ import annotations

import copy
import logging
import threading
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents.texplore.agent import Texplore, TexploreSettings
from grasp.learning.agents.texplore.model import Prediction
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["RealTimeTexplore"]

_log = logging.getLogger(__name__)
_BATCH = 5


class RealTimeTexplore:
    """Acts ``rate_hz`` times a second; learns and plans meanwhile. Close it, or use ``with``.

    What it does depends on how fast the machine is; :class:`Texplore` is the same learner with
    the same life for the same seed.

    Parameters
    ----------
    bins, actions, settings, seed
        As of :class:`Texplore`; ``settings.rollouts`` is not used.
    rate_hz
        Decisions a second.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        settings: TexploreSettings | None = None,
        seed: int = 0,
        *,
        rate_hz: float = 25.0,
    ) -> None:
        if not rate_hz > 0:
            raise ValueError(f"{rate_hz} decisions a second is no rate")
        self.period_s = 1 / rate_hz
        self._agent = Texplore(bins, actions, settings, seed)
        self._statistics = threading.Lock()
        self._arrived = threading.Condition()
        self._experience: list[Transition] = []
        self._training = False
        self._state: NDArray[np.float64] | None = None
        self._planning = threading.Event()
        self._stopped = threading.Event()
        self._due = 0.0
        self._failure: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._guard, args=(work,), name=name, daemon=True)
            for name, work in (("texplore-model", self._learn), ("texplore-planner", self._plan))
        ]
        for thread in self._threads:
            thread.start()

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return the best action known when the time is up.

        Raises
        ------
        RuntimeError
            Learning or planning failed, or the agent is closed.
        """
        self._check()
        self._plan_from(state)
        now = time.monotonic()
        if self._due <= now - self.period_s:
            self._due = now + self.period_s
        time.sleep(max(self._due - time.monotonic(), 0.0))
        self._due += self.period_s
        return self._agent.best(np.asarray(state, dtype=np.float64), info)

    def observe(self, transition: Transition) -> None:
        """Hand over one step; planning goes on from where it led."""
        self._check()
        with self._arrived:
            self._experience.append(transition)
            self._arrived.notify_all()
        if not (transition.terminated or transition.truncated):
            self._plan_from(transition.next_state)

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Hand over steps that somebody else took."""
        for transition in transitions:
            self.observe(transition)

    @property
    def is_learning(self) -> bool:
        """Whether something handed over is not in the model yet."""
        with self._arrived:
            return bool(self._experience or self._training)

    def wait_until_learned(self, timeout_s: float) -> bool:
        """Wait until everything handed over is in the model; return whether it is."""
        with self._arrived:
            return self._arrived.wait_for(
                lambda: not (self._experience or self._training) or self._failure is not None,
                timeout_s,
            )

    def save(self, path: Path) -> None:
        """Write what is known now, as :meth:`Texplore.save`; what is being learned is missing."""
        with self._statistics:
            self._agent.save(path)

    def load(self, path: Path) -> None:
        """Go on with what :meth:`save` or :class:`Texplore` wrote.

        Raises
        ------
        ValueError
            As of :meth:`Texplore.load`.
        RuntimeError
            Experience is being learned just now.
        """
        with self._arrived, self._statistics:
            if self._experience or self._training:
                raise RuntimeError("experience is being learned; load before the first step")
            self._agent.load(path)

    def close(self) -> None:
        """End both threads; nothing survives this."""
        self._stopped.set()
        self._planning.set()
        with self._arrived:
            self._arrived.notify_all()
        for thread in self._threads:
            thread.join()

    def __enter__(self) -> RealTimeTexplore:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _guard(self, work: Any) -> None:
        try:
            work()
        except BaseException as error:  # noqa: BLE001 - it is raised where the caller acts next
            _log.exception("TEXPLORE stopped")
            with self._arrived:
                self._failure = error
                self._arrived.notify_all()

    def _check(self) -> None:
        if self._failure is not None:
            raise RuntimeError(f"the learner stopped: {self._failure}") from self._failure
        if self._stopped.is_set():
            raise RuntimeError("the learner is closed")

    def _plan_from(self, state: NDArray[Any]) -> None:
        self._state = np.array(state, dtype=np.float64)
        self._planning.set()

    def _learn(self) -> None:
        agent = self._agent
        while not self._stopped.is_set():
            with self._arrived:
                self._arrived.wait_for(lambda: self._experience or self._stopped.is_set())
                taken, self._experience = self._experience, []
                self._training = True
            model = copy.deepcopy(agent.model)
            changed = False
            for transition in taken:
                if self._stopped.is_set():
                    return
                changed |= model.learn(transition)
            if changed:
                sizes = (agent.bins.count, agent.actions, len(agent.bins.low))
                with self._statistics:
                    agent.model, agent.predictions = model, Prediction(*sizes)
                    agent.planner.model_changed()
            else:
                agent.model = model
            with self._arrived:
                self._training = False
                self._arrived.notify_all()

    def _plan(self) -> None:
        agent = self._agent
        while not self._stopped.is_set():
            self._planning.wait()
            state = self._state
            if state is None or self._stopped.is_set():
                continue
            with self._statistics:
                agent.planner.rollouts(state, _BATCH, agent.predictions, agent.predict)
