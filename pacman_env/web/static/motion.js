// Between two messages everything moves evenly from where it is shown to where the last message has it.

import { robotPose } from "./state.js";

const FARTHEST_M = 2.5; // beyond it, something was placed and did not move
const POSES = ["true", "believed", "baseline"];

function between(from, to, share) {
  if (share >= 1 || !from || !to || Math.hypot(to[0] - from[0], to[1] - from[1]) > FARTHEST_M) return to;
  const turn = (a, b) => a + share * Math.atan2(Math.sin(b - a), Math.cos(b - a));
  const moved = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
  return to.length > 2 ? [...moved, turn(from[2], to[2])] : moved;
}

export class Motion {
  #from = null;
  #since = 0;
  #wait = 60; // ms between messages, smoothed
  to = null;

  update(frame, now, jump) {
    jump ||= !this.to || frame.revision !== this.to.revision || frame.time_s < this.to.time_s;
    this.#from = jump ? null : this.at(now);
    this.#wait += 0.2 * (Math.min(250, Math.max(20, now - this.#since)) - this.#wait);
    this.#since = now;
    this.to = frame;
  }

  moving(now) {
    return this.#from !== null && now - this.#since < this.#wait;
  }

  at(now) {
    const { to } = this;
    if (!to) return { ghosts: [] };
    const share = this.moving(now) ? (now - this.#since) / this.#wait : 1;
    const poses = Object.fromEntries(POSES.map((name) => [name, between(this.#from?.[name], to[name], share)]));
    poses.ghosts = to.ghosts.map((ghost, k) => between(this.#from?.ghosts[k], ghost, share));
    poses.robot = robotPose(poses);
    return poses;
  }
}
