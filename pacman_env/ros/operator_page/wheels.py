"""Velocities by hand and the operator's stop: a thread of its own, so that no other work can delay a stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

PERIOD_S = 0.05  # while stopped, as often as Nav2 publishes the opposite
DEAD_MAN_S = 0.5  # after the last velocity by hand the robot stands
_ENDS = 5  # zero velocities at the end of a drive: one may be lost


class Wheels:
    """Publishes velocities while a person drives by hand, zero while the robot is stopped, and nothing else.

    ``publish`` is called with v (m/s) and omega (rad/s), from any thread; without ``own_thread`` the caller calls
    ``beat`` every ``PERIOD_S``.
    """

    def __init__(
        self,
        publish: Callable[[float, float], None],
        monotonic: Callable[[], float] = time.monotonic,
        own_thread: bool = True,
    ) -> None:
        self._publish, self._monotonic = publish, monotonic
        self._change = threading.Condition()
        self._stopped = False
        self._driven: tuple[float, float, float] | None = None  # v, omega, since when
        self._zeros = 0  # to be published yet
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="wheels", daemon=True) if own_thread else None
        if self._thread is not None:
            self._thread.start()

    @property
    def driven(self) -> bool:
        return self._driven is not None

    def stop(self) -> None:
        """Zero velocity now, and again and again until ``release``; a drive has ended."""
        with self._change:
            self._stopped, self._driven = True, None
            self._publish(0.0, 0.0)
            self._change.notify()

    def release(self) -> None:
        with self._change:
            self._stopped = False

    def drive(self, v: float, omega: float) -> bool:
        """That velocity, for half a second at most; False: the robot is stopped."""
        with self._change:
            if self._stopped or self._closed:
                return False
            self._driven = v, omega, self._monotonic()
            self._publish(v, omega)
            self._change.notify()
        return True

    def end_drive(self) -> None:
        with self._change:
            if self._driven is not None:
                self._end_drive()
                self._change.notify()

    def close(self) -> None:
        """Publish no more; what was driven by hand stands."""
        with self._change:
            if self._driven is not None:
                self._publish(0.0, 0.0)
            self._driven, self._closed = None, True
            self._change.notify()
        if self._thread is not None:
            self._thread.join()

    def beat(self) -> None:
        """Publish what is due after a period."""
        with self._change:
            if self._due and not self._closed:
                self._publish_due()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closed or self._due)
                if self._closed:
                    return
                self._publish_due()
            time.sleep(PERIOD_S)

    @property
    def _due(self) -> bool:
        return self._stopped or self._driven is not None or self._zeros > 0

    def _publish_due(self) -> None:
        if self._stopped:
            self._zeros = 0
            self._publish(0.0, 0.0)
        elif self._driven is not None:
            v, omega, since_s = self._driven
            if self._monotonic() - since_s >= DEAD_MAN_S:
                self._end_drive()
            else:
                self._publish(v, omega)
        else:
            self._zeros -= 1
            self._publish(0.0, 0.0)

    def _end_drive(self) -> None:
        self._driven, self._zeros = None, _ENDS
        self._publish(0.0, 0.0)
