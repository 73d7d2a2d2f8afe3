// A frame from its bytes: docs/web_protocol.md, "a frame".

const STATES = ["menu", "returning_home", "starting", "running", "dying", "complete"];
const PAUSED = 1, STOPPED = 2, BELIEVED = 4, TRUE = 8, SHADOW = 16, OVER = 32, RING = 64;
const HEAD = 104;

const pose = (view, at) => [view.getFloat32(at, true), view.getFloat32(at + 4, true), view.getFloat32(at + 8, true)];

export function decode(buffer) {
  const view = new DataView(buffer);
  if (view.byteLength < HEAD || view.getUint8(0) !== 1) throw new Error("no frame");
  const [ghosts, pellets] = [view.getUint8(3), view.getUint16(6, true)];
  const [scores, points, rays] = [view.getUint16(50, true), view.getUint16(52, true), view.getUint16(54, true)];
  const bits = (pellets + 7) >> 3;
  const size = HEAD + 8 * ghosts + bits + 4 * scores + 8 * points + 2 * rays;
  if (view.byteLength !== size) throw new Error(`a frame of ${view.byteLength} bytes instead of ${size}`);
  const flags = view.getUint8(2);
  let at = HEAD;
  const floats = (count) => {
    const values = Array.from({ length: count }, (_, k) => view.getFloat32(at + 4 * k, true));
    at += 4 * count;
    return values;
  };
  const pairs = (count) => {
    const flat = floats(2 * count);
    return Array.from({ length: count }, (_, k) => [flat[2 * k], flat[2 * k + 1]]);
  };
  const frame = {
    state: STATES[view.getUint8(1)] ?? "menu",
    paused: Boolean(flags & PAUSED),
    stopped: Boolean(flags & STOPPED),
    over: Boolean(flags & OVER),
    revision: view.getUint16(4, true),
    number: view.getUint32(8, true),
    time_s: view.getFloat32(12, true),
    speed: view.getFloat32(16, true),
    score: view.getUint32(20, true),
    collected: view.getUint16(24, true),
    spawned: view.getUint16(26, true),
    round: view.getUint16(28, true),
    goal: view.getInt16(30, true),
    ring: flags & RING ? Array.from({ length: 6 }, (_, k) => [0, 1, 2].map((c) => view.getUint8(32 + 3 * k + c))) : null,
    true: flags & TRUE ? pose(view, 56) : null,
    believed: flags & BELIEVED ? pose(view, 68) : null,
    velocity: [view.getFloat32(80, true), view.getFloat32(84, true)],
    shadow: flags & SHADOW ? pose(view, 88) : null,
    shadow_collected: flags & SHADOW ? view.getFloat32(100, true) : 0,
  };
  frame.ghosts = pairs(ghosts);
  const first = at;
  frame.alive = Array.from({ length: pellets }, (_, k) => Boolean((view.getUint8(first + (k >> 3)) >> (k & 7)) & 1));
  at += bits;
  frame.scores = floats(scores);
  frame.plan = pairs(points);
  frame.scan = Array.from({ length: rays }, (_, k) => view.getUint16(at + 2 * k, true) / 1000);
  return frame;
}

// The frames of a finished round, each behind its length.
export function decodeStory(buffer) {
  const view = new DataView(buffer);
  const frames = [];
  for (let at = 0; at + 4 <= view.byteLength; ) {
    const length = view.getUint32(at, true);
    frames.push(decode(buffer.slice(at + 4, at + 4 + length)));
    at += 4 + length;
  }
  return frames;
}

// Whether two messages show the same; the numbers of the frames may differ.
export function sameFrame(a, b) {
  if (!a || a.byteLength !== b.byteLength) return false;
  const [x, y] = [new Uint8Array(a), new Uint8Array(b)];
  for (let k = 0; k < x.length; k++) if (x[k] !== y[k] && (k < 8 || k > 11)) return false;
  return true;
}

// Where the robot is, as well as is known.
export const robotPose = (frame) => frame?.true ?? frame?.believed ?? null;
