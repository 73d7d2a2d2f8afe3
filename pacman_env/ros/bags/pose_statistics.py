"""Statistics of a robot's motion and received poses, the same for recorded and simulated games."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.game.decisions import HOLD, LastDecision
from pacman_env.game.ends import RUNNING
from pacman_env.levels.assets import MapAssets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.sim.batch import GameBatch
from pacman_env.world.navigation.localization import Pose, compose, relative

DRIVING_MPS = 0.05  # a slower robot stands
STANDING_S = 5.0  # longer intervals between poses do not count: AMCL is silent while the robot stands
MOST_S = 300.0  # longest simulated game
_PERIOD_S = 0.1  # period of the lidar, the shortest time between poses
_UNSEEN = math.inf, math.inf, -math.inf
#: Compared quantities with their units.
QUANTITIES = {
    "speed": "driving speed, m/s",
    "interval": "time between poses, s",
    "distance": "distance between poses, m",
    "jump": "jump against odometry, m",
    "turn": "turn against odometry, rad",
    "clyde": "Clyde's speed as seen, m/s",
}


@dataclass
class PoseStatistics:
    """Samples of the poses and speeds of one or several games in order; times in s."""

    samples: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in QUANTITIES})
    pose: Pose | None = None  # last received pose
    odometry: Pose | None = None  # current odometry, in its own frame
    counts: bool = True  # False: received values make no samples
    _pose_s: float = 0.0
    _pose_odometry: Pose | None = None  # odometry when the last pose was received
    _clyde: tuple[float, float, float] = _UNSEEN  # Clyde's x and y, and the time of its last move

    def drive(self, odometry: Pose, speed_mps: float) -> None:
        self.odometry = odometry
        if speed_mps > DRIVING_MPS:
            self._sample("speed", speed_mps)

    def localize(self, at_s: float, pose: Pose) -> None:
        if self.pose is not None and 0 < at_s - self._pose_s < STANDING_S:
            self._sample("interval", at_s - self._pose_s)
            self._sample("distance", math.dist(pose[:2], self.pose[:2]))
            if self._pose_odometry is not None and self.odometry is not None:
                expected = compose(self.pose, relative(self._pose_odometry, self.odometry))
                jump = relative(expected, pose)
                self._sample("jump", math.hypot(*jump[:2]))
                self._sample("turn", abs(jump[2]))
        self.pose, self._pose_s, self._pose_odometry = pose, at_s, self.odometry

    def see_clyde(self, at_s: float, x: float, y: float) -> None:
        moved_m, passed_s = math.dist((x, y), self._clyde[:2]), at_s - self._clyde[2]
        if moved_m > 0 and 0 < passed_s < 1.0:
            self._sample("clyde", moved_m / passed_s)
        if moved_m != 0:
            self._clyde = x, y, at_s

    def _sample(self, name: str, value: float) -> None:
        if self.counts:
            self.samples[name].append(value)

    def quantiles(self) -> dict[str, list[float] | None]:
        """Return the 10 %, 50 % and 90 % quantiles of each quantity, None for a quantity without samples."""
        return {
            name: [float(q) for q in np.quantile(values, (0.1, 0.5, 0.9))] if values else None
            for name, values in self.samples.items()
        }


def simulated_statistics(assets: MapAssets, config: Config, policy: Policy, rounds: int = 4) -> PoseStatistics:
    """Simulate rounds with the seeds 0 to ``rounds`` - 1, sampled at the highest rate of received poses."""
    samples = PoseStatistics().samples
    finer = config.with_fields(**{"execution.tick_s": _PERIOD_S, "execution.check_period_s": _PERIOD_S})
    decide_every = round(config.execution.tick_s / _PERIOD_S)
    batch, last = GameBatch(assets, finer, 1), LastDecision(config)
    for seed in range(rounds):
        batch.reset(np.zeros(1, dtype=np.int64), np.array([seed], dtype=np.uint64))
        policy.reset(np.ones(1, dtype=np.bool_), config)
        statistics = PoseStatistics(samples)  # a game does not continue the poses of the previous one
        last.clear()
        game, last_update = batch.games[0], -1
        choice: NDArray[np.int64] = np.array([batch.hold])
        for tick in range(round(MOST_S / _PERIOD_S)):
            if tick % decide_every == 0 and last.due(moment := batch.moment(0)):
                choice = policy.select(situation_of(batch))
                last.decide(HOLD if choice[0] == batch.hold else int(choice[0]), moment)
            batch.step(choice)
            if game["end"] != RUNNING:
                break
            at_s = float(game["step"]) * config.physics_step_s
            statistics.drive(game[["x", "y", "heading"]].item(), float(game["left"] + game["right"]) / 2)
            if game["amcl_step"] != last_update:
                last_update = game["amcl_step"]
                statistics.localize(at_s, game[["amcl_x", "amcl_y", "amcl_heading"]].item())
            statistics.see_clyde(at_s, *batch.obstacles[0, 0, :2].tolist())
    return PoseStatistics(samples)
