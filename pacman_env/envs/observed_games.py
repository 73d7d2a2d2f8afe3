"""Games with their observer; a step is one compiled call unless it needs Python."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.pipeline import Stage
from ..policies.base import Flags, Indices
from ..sim.core.batch import ALL_TICKS, GameBatch, choice_stage
from ..sim.observation.observer import Observer
from .spaces import velocities


class ObservedGames:
    """A batch with the observer of its robots; without ``copy``, two observers alternate."""

    def __init__(self, batch: GameBatch, copy: bool) -> None:
        self.batch, self.config = batch, batch.config
        self._observers = [Observer(batch) for _ in range(1 if copy else 2)]
        self._actions = np.zeros(batch.n, dtype=np.int64)
        self._by_event = self.config.decisions.when == "event"

    @property
    def observer(self) -> Observer:
        """Return the observer with the current observation."""
        return self._observers[0]

    def maps_changed(self, index: Indices) -> None:
        """Prepare the observers for the new maps of the games ``index`` (M,)."""
        for observer in self._observers:
            observer.maps_changed(index)

    def observe(self, index: Indices | None = None) -> None:
        """Observe all games, or only those in ``index`` (M,)."""
        self.observer.observe(index=index)

    def take_turns(self) -> None:
        """Switch to the other set of arrays for the next observation, if there are two."""
        self._observers.reverse()

    def play_in_one_call(self, actions: NDArray[Any]) -> None:
        """Play one decision with checked actions, (N,) or (N, 2), and observe the games, in one call of kernels."""
        batch = self.batch
        if self.config.action == "velocity":
            batch.arrays["velocities"][:] = velocities(actions, self.config)
        else:
            self._actions[:] = actions
        batch.begin_decisions()
        batch.prepare_ticks(watch=self._by_event, most=ALL_TICKS if self._by_event else 1)
        self.take_turns()
        result = self.observer.pipeline(before=self._play_stages).run(batch.n)
        if result:  # a physics space must be prepared, or a ghost's function raised
            batch.resume(result)
            self.observer.observe()
        else:
            self.observer.finish()

    def play_by_steps(
        self,
        actions: NDArray[Any],
        choose: Callable[[], NDArray[Any] | None] | None,
        ghost_choices: NDArray[Any] | None,
        plays: Flags | None,
    ) -> None:
        """Play one decision with checked actions, (N,) or (N, 2), and with Python code between ticks.

        This is needed for ghost policies and endless games. With decisions by events, ``choose`` returns the ghosts'
        choices (N, G) before each tick. Otherwise they are ``ghost_choices``, and the games in the mask ``plays`` (N,)
        are played (None: all).
        """
        if self._by_event:
            self.batch.step_until_due(*self.observer.chosen(actions), choose)
        else:
            if self.config.action == "velocity":
                actions = velocities(actions, self.config)
            elif self.observer.listed is not None:
                actions, _ = self.observer.chosen(actions)
            self.batch.step(actions, ghost_choices, plays)
        self.take_turns()
        self.observe()

    def _play_stages(self) -> list[Stage]:
        """Return the stages that play a decision; actions refer to candidates as the last observation lists them."""
        batch, last = self.batch, self._observers[-1]
        stages = [batch.tick_stage()]
        if self.config.action == "goal":
            stages.insert(0, choice_stage(batch, self._actions, last.situation.mask, last.order))
        return stages
