// Frames: docs/web_protocol.md, "frame".

// Whether two messages show the same; the numbers of the frames may differ.
const NUMBER = /"number":\d+/;
export const sameFrame = (a, b) => a !== null && a.replace(NUMBER, "") === b.replace(NUMBER, "");

// The robot's pose, as well as it is known.
export const robotPose = (frame) => frame?.true ?? frame?.believed ?? null;
