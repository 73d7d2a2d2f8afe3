// The websocket, reopened when it is lost, or a worker that runs the game in this browser; and requests over HTTP.

import { notice, stored } from "./dom.js";

const RETRY_MS = [250, 500, 1000, 2000, 4000, 5000];
const SILENT_MS = 5000;
export const SLOW_MS = 180000; // within which the server prepares or plays a round
const FRAME = '{"kind":"frame"'; // its first field

const GAME = document.documentElement.dataset.game; // script of the worker, on a page without a server

export const token = new URLSearchParams(location.search).get("token");

let again = stored("sessionStorage", "again"); // restores name and role after a break or a reload

export function remember(key) {
  again = key ?? again;
  stored("sessionStorage", "again", again);
}

// The address of a path of the server, relative to the page's own: a proxy may serve it below another path.
export function address(path) {
  const url = new URL(path, location.href);
  if (token) url.searchParams.set("token", token);
  return url;
}

// The frames of a finished round.
export async function fetchFrames(number) {
  if (GAME) return (await ask({ do: "story", story: number }, SLOW_MS)).data;
  const response = await fetch(address(`story/${number}.json`));
  if (!response.ok) throw new Error(await response.text());
  return response.json();
}

const pending = new Map(); // of requests without an answer: what settles them, by id
let socket = null;
let hooks = null;
let lastId = 0;
let retries = 0;
let received = 0; // time of the last message
let pinged = 0; // time of the first ping since then; 0: none
let retryTimer = 0;
let endReason = "";

export const silence_ms = () => performance.now() - received; // since the last message
export const isOpen = () => socket?.readyState === WebSocket.OPEN;

export function connect(listeners) {
  hooks = listeners;
  open();
  if (GAME) return;
  setInterval(checkSilence, 1000);
  addEventListener("online", () => reconnect(0));
}

export function send(message) {
  if (isOpen()) socket.send(JSON.stringify(message));
}

const failed = (words, late = false) => ({ ok: false, words, data: null, late });

// Always resolves, with {ok, words, data}; without a server the first requests wait until the game has been loaded.
export function ask(message, timeout_ms = GAME ? SLOW_MS : 8000) {
  const id = ++lastId;
  if (!isOpen()) return Promise.resolve(failed("There is no connection."));
  send({ ...message, id });
  setTimeout(() => settle(id, failed("No answer yet.", true)), timeout_ms);
  return new Promise((resolve) => pending.set(id, resolve));
}

// The answer, or null after a notice of the reason.
export async function request(message, timeout_ms) {
  const answer = await ask(message, timeout_ms);
  if (answer.ok) return answer;
  notice(answer.words || "The request was refused.", { bad: !answer.late });
  return null;
}

function settle(id, answer) {
  pending.get(id)?.(answer);
  pending.delete(id);
}

// A worker with what this module uses of a websocket; the texts are the same.
function startWorker() {
  const worker = new Worker(GAME, { type: "module" });
  const onerror = ({ message = "a file is missing" }) => {
    worker.readyState = WebSocket.CLOSED;
    worker.onclose({ reason: message });
  };
  return Object.assign(worker, { onerror, readyState: WebSocket.OPEN, send: worker.postMessage });
}

function open() {
  if (socket && socket.readyState <= WebSocket.OPEN) return;
  const url = address("ws");
  url.protocol = url.protocol.replace("http", "ws"); // browsers before 2024 refuse a relative address
  if (again) url.searchParams.set("again", again);
  const opened = GAME ? startWorker() : new WebSocket(url.href);
  socket = opened;
  noteMessage();
  opened.onmessage = ({ data }) => socket === opened && receive(data);
  opened.onclose = ({ reason }) => socket === opened && closed(reason);
}

function noteMessage() {
  received = performance.now();
  pinged = 0;
}

function receive(data) {
  noteMessage();
  retries = 0;
  endReason = "";
  if (data.startsWith(FRAME)) {
    hooks.frame(data);
    return;
  }
  const message = JSON.parse(data);
  if (message.kind === "answer") settle(message.id, message);
  else if (message.kind === "bye") endReason = message.words;
  else hooks.message(message);
}

function closed(reason) {
  for (const id of pending.keys()) settle(id, failed("The connection was lost."));
  hooks.lost(endReason || reason);
  if (!GAME) reconnect(RETRY_MS[Math.min(retries++, RETRY_MS.length - 1)]);
}

function reconnect(wait_ms) {
  clearTimeout(retryTimer);
  retryTimer = setTimeout(open, wait_ms);
}

// A silent connection is tried with pings, and closed if none is answered: a page that was busy has received nothing.
function checkSilence() {
  const now = performance.now();
  if (now - received > SILENT_MS / 2) {
    pinged ||= now;
    send({ do: "ping", id: ++lastId });
  }
  const lost = pinged && now - pinged > SILENT_MS / 2;
  if (lost && socket && socket.readyState <= WebSocket.OPEN && !document.hidden) {
    const silent = socket;
    socket = null;
    silent.close();
    closed("");
  }
}
