// The time line of finished rounds: it shows a tick, plays, and jumps between marks.

import { option, setIcon, write } from "./dom.js";

const SPEEDS = [0.5, 1, 2, 4, 8, 16];
const LONGEST_STEP_MS = 250; // between two pictures; after a longer break the rounds go on from where they were
const THUMB_PX = 16; // of the slider
const MARK_PX = 3;

export class Player {
  #find;
  #hooks;
  #round = { ticks: 1, tick_s: 1, marks: [], lanes: [] };
  #at = 0; // ticks, with a fraction while it plays
  #request = 0; // of the next picture, 0: paused
  #since = 0; // time of the last picture

  // `root` contains the elements of the time line. `show` shows a tick, after a jump or while playing, and returns it
  // in words; `paused` is called after a pause, `jumped` with a mark, undefined if there is none in this direction.
  constructor(root, { show, paused = () => {}, jumped = () => {}, wraps = false }) {
    this.#hooks = { show, paused, jumped, wraps };
    this.#find = (name) => root.getElementById(`story-${name}`);
    const range = this.#find("range");
    range.oninput = () => {
      this.pause();
      this.seek(Number(range.value));
    };
    this.#find("play").onclick = () => this.toggle();
    this.#find("previous").onclick = () => this.jump(-1);
    this.#find("next").onclick = () => this.jump(1);
    this.#find("speed").append(...SPEEDS.map((times) => option(times, `×${times}`)));
    this.speed = 4;
    new ResizeObserver(() => this.#drawMarks()).observe(range);
  }

  set speed(times) { this.#find("speed").value = String(times); } // times real time
  get speed() { return Number(this.#find("speed").value); }
  get playing() { return this.#request !== 0; }

  // Opens rounds with this number of ticks of tick_s seconds each. `marks` are ticks in order, `lanes` the marks that
  // are drawn: [ticks, colour, size, whether they are at the lower side].
  open({ ticks, tick_s, marks, lanes }) {
    this.pause();
    this.#round = { ticks, tick_s: Math.max(0.01, tick_s), marks, lanes };
    this.#find("range").max = String(ticks - 1);
    this.#drawMarks();
  }

  seek(to, jumps = true) {
    this.#at = Math.max(0, Math.min(this.#round.ticks - 1, to));
    const tick = Math.floor(this.#at);
    const words = this.#hooks.show(tick, jumps);
    this.#find("range").value = String(tick);
    this.#find("range").setAttribute("aria-valuetext", words);
    write(this.#find("at"), words);
  }

  #setRequest(request) {
    cancelAnimationFrame(this.#request);
    this.#request = request;
    this.#since = performance.now();
    this.#find("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
    setIcon(this.#find("play"), this.playing ? "pause" : "play");
  }

  pause() {
    this.#setRequest(0);
    this.#hooks.paused();
  }

  play() {
    if (this.#at >= this.#round.ticks - 1) this.seek(0);
    this.#setRequest(requestAnimationFrame((now) => this.#advance(now)));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  #advance(now) {
    const passed_s = Math.min(LONGEST_STEP_MS, Math.max(0, now - this.#since)) / 1000;
    const to = this.#at + (this.speed * passed_s) / this.#round.tick_s;
    this.#since = now;
    if (Math.floor(to) > Math.floor(this.#at)) this.seek(to, false);
    else this.#at = to;
    if (this.#at >= this.#round.ticks - 1) this.pause();
    else this.#request = requestAnimationFrame((next) => this.#advance(next));
  }

  // To the next or previous mark.
  jump(step) {
    const tick = Math.floor(this.#at);
    const { marks } = this.#round;
    this.pause();
    let mark = step > 0 ? marks.find((one) => one > tick) : marks.filter((one) => one < tick).at(-1);
    if (this.#hooks.wraps) mark ??= marks.at(step > 0 ? 0 : -1);
    if (mark !== undefined) this.seek(mark);
    this.#hooks.jumped(mark, step);
  }

  // Does what a key means here.
  press(event) {
    const [target] = event.composedPath();
    const step = target.id === "top" ? { ArrowRight: 1, ArrowLeft: -1 }[event.key] : 0;
    if (event.key === " " && !target.matches?.("button, input, select, summary")) this.toggle();
    else if (event.key === "n") this.jump(1);
    else if (event.key === "p") this.jump(-1);
    else if (step) {
      this.pause();
      this.seek(step > 0 ? Math.floor(this.#at) + 1 : Math.ceil(this.#at) - 1);
    } else return;
    event.preventDefault();
  }

  #drawMarks() {
    const [canvas, { clientWidth: width, clientHeight: height }] = [this.#find("marks"), this.#find("range")];
    [canvas.width, canvas.height] = [width * devicePixelRatio, height * devicePixelRatio];
    const context = canvas.getContext("2d");
    context.scale(devicePixelRatio, devicePixelRatio);
    const step = (width - THUMB_PX) / Math.max(1, this.#round.ticks - 1);
    for (const [ticks, colour, size, below] of this.#round.lanes) {
      context.fillStyle = colour;
      const y = below ? height - size - MARK_PX : MARK_PX - 1;
      for (const tick of ticks) context.fillRect(THUMB_PX / 2 + step * tick - MARK_PX / 2, y, MARK_PX, size);
    }
  }
}
