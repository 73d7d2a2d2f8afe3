// The websocket: kept open, opened again when it is lost, answers matched to what was asked.

const WAITS_MS = [250, 500, 1000, 2000, 4000, 5000];
const SILENT_MS = 5000;
const FRAME = '{"kind":"frame"'; // its first field

export class Connection {
  #socket = null;
  #asked = new Map();
  #id = 0;
  #tries = 0;
  #heard = 0;
  #timer = 0;

  constructor(url, { opened, lost, text, frame }) {
    this.url = url;
    this.hooks = { opened, lost, text, frame };
    this.farewell = "";
    setInterval(() => this.#watch(), 1000);
    addEventListener("online", () => this.#soon(0));
    this.#open();
  }

  get open() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  say(message) {
    if (!this.open) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  // Settles always: {ok, words, data}.
  ask(message, patience_ms = 8000) {
    const id = ++this.#id;
    if (!this.say({ ...message, id })) return Promise.resolve({ ok: false, words: "There is no connection.", data: null });
    return new Promise((resolve) => {
      const timer = setTimeout(() => this.#settle(id, { ok: false, words: "No answer yet.", data: null, late: true }), patience_ms);
      this.#asked.set(id, { resolve, timer });
    });
  }

  #settle(id, answer) {
    const asked = this.#asked.get(id);
    if (!asked) return;
    clearTimeout(asked.timer);
    this.#asked.delete(id);
    asked.resolve(answer);
  }

  #open() {
    clearTimeout(this.#timer);
    if (this.#socket && this.#socket.readyState <= WebSocket.OPEN) return;
    const socket = new WebSocket(this.url());
    this.#socket = socket;
    this.#heard = performance.now();
    socket.onopen = () => {
      this.#heard = performance.now();
      this.farewell = "";
      this.hooks.opened();
    };
    socket.onmessage = ({ data }) => {
      this.#heard = performance.now();
      this.#tries = 0;
      if (data.startsWith(FRAME)) {
        this.hooks.frame(data);
        return;
      }
      const message = JSON.parse(data);
      if (message.kind === "answer") this.#settle(message.id, message);
      else if (message.kind === "bye") this.farewell = message.words;
      else this.hooks.text(message);
    };
    socket.onclose = ({ reason }) => {
      if (this.#socket !== socket) return;
      for (const id of [...this.#asked.keys()]) this.#settle(id, { ok: false, words: "The connection was lost.", data: null });
      this.hooks.lost(this.farewell || reason);
      this.#soon(WAITS_MS[Math.min(this.#tries++, WAITS_MS.length - 1)]);
    };
  }

  #soon(wait_ms) {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#open(), wait_ms);
  }

  // A connection that says nothing is tried with a ping, then given up.
  #watch() {
    const silent = performance.now() - this.#heard;
    if (this.open && silent > SILENT_MS / 2) this.say({ do: "ping", id: ++this.#id });
    if (silent > SILENT_MS && this.#socket && this.#socket.readyState <= WebSocket.OPEN && !document.hidden) {
      const socket = this.#socket;
      socket.close();
      socket.onclose({ reason: "" });
      socket.onmessage = null;
      socket.onclose = null;
    }
  }
}
