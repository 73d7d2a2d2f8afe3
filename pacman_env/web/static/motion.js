// Between two messages everything moves evenly from where it is shown to where it is said to be.

import { robotPose } from "./frame.js";

const FARTHEST_M = 2.5; // farther than this it has been put there

const turn = (from, to, share) => from + share * Math.atan2(Math.sin(to - from), Math.cos(to - from));

function between(from, to, share) {
  if (!from || !to || Math.hypot(to[0] - from[0], to[1] - from[1]) > FARTHEST_M) return to;
  const moved = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
  if (to.length > 2) moved.push(turn(from[2], to[2], share));
  return moved;
}

export class Motion {
  constructor() {
    this.from = null;
    this.to = null;
    this.since = 0;
    this.wait = 60; // ms between messages, smoothed
  }

  take(frame, now, steady = false) {
    const jump = !this.to || frame.revision !== this.to.revision || frame.time_s < this.to.time_s;
    this.from = jump || steady ? null : this.at(now);
    this.wait += 0.2 * (Math.min(250, Math.max(20, now - this.since)) - this.wait);
    this.since = now;
    this.to = frame;
    this.still = this.from === null || this.#stands();
  }

  #stands() {
    const near = (a, b) => a && b && a.every((value, k) => Math.abs(value - b[k]) < 1e-4);
    const { from, to } = this;
    const pairs = [[from.true, to.true], [from.believed, to.believed], [from.baseline, to.baseline], ...to.ghosts.map((ghost, k) => [from.ghosts[k], ghost])];
    return pairs.every(([a, b]) => (!a && !b) || near(a, b));
  }

  moving(now) {
    return !this.still && now - this.since < this.wait;
  }

  at(now) {
    const { from, to } = this;
    const share = from && !this.still ? Math.min(1, (now - this.since) / this.wait) : 1;
    if (!to) return null;
    const poses = {
      true: share < 1 ? between(from.true, to.true, share) : to.true,
      believed: share < 1 ? between(from.believed, to.believed, share) : to.believed,
      baseline: share < 1 ? between(from.baseline, to.baseline, share) : to.baseline,
      ghosts: to.ghosts.map((ghost, k) => (share < 1 ? between(from.ghosts[k], ghost, share) : ghost)),
    };
    poses.robot = robotPose(poses);
    return poses;
  }
}
