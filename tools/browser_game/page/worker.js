// The worker of the page without a server: carries messages, files and time to the game.

import { Match } from "./match.js";

const FRAME_MS = 50;

async function read(path) {
  const response = await fetch(new URL(path, import.meta.url));
  if (!response.ok) throw new Error(`${response.status} ${response.statusText}`);
  return response.arrayBuffer();
}

const pause = () => new Promise((resolve) => { setTimeout(resolve); });
const match = new Match();
onmessage = ({ data }) => match.receive(data);
setInterval(() => match.advance(), FRAME_MS);
const host = { read, pause, now: () => performance.now(), post: (text) => postMessage(text) };
match.begin(host).catch((error) => setTimeout(() => { throw error; })); // which the page is told
