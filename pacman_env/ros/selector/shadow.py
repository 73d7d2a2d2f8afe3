"""Log what a goal selector would do while another one drives, and send nothing to Nav2."""

from collections.abc import Callable
from typing import Any

from pacman_env.game.execution import ABORTED, CANCELED
from pacman_env.ros.message_conversion import Pose, Position


class Shadow:
    """Navigation that succeeds at once, like a Nav2 that accepts every goal and ends the earlier one."""

    ready = True
    last_status = last_error = 0

    def __init__(
        self,
        node: Any,
        accepted: Callable[[int], None],
        rejected: Callable[[int], None],
        finished: Callable[[int, int, Position | None], None],
    ) -> None:
        self._log, self._accepted, self._finished = node.get_logger().info, accepted, finished
        self._running: int | None = None

    def clear(self) -> bool:
        return True

    def send(self, number: int, pose: Pose) -> None:
        before, self._running = self._running, number
        if before is not None:
            self._finished(before, ABORTED, None)
        self._accepted(number)

    def cancel(self, number: int) -> None:
        self._log(f"shadow: cancel goal {number}")
        self._running = None
        self._finished(number, CANCELED, None)

    def forbid(self, forbidden: bool) -> None: ...

    def stop_wheels(self) -> None: ...

    def end_without_results(self) -> None: ...

    def finish(self) -> tuple[Any, ...]:
        return ()
