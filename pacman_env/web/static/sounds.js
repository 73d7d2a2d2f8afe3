// The sounds, synthesised from the real lists of notes; silent until the person switches them on.

import { $, setIcon, write } from "./dom.js";
import { on, state } from "./state.js";

const VOLUME = 0.07;
const FADE_S = 0.012;

export class Sounds {
  #context = null;
  #out = null;
  #playing = [];

  constructor(count) {
    this.count = count;
    $("sound").addEventListener("click", () => this.switch(!this.on));
    on("news", (items) => {
      for (const item of items) if (item.sound) this.play(item.sound);
    });
    this.#show();
  }

  get on() {
    return this.#context?.state === "running" && this.wanted;
  }

  get sounding() {
    return this.#playing.length > 0;
  }

  async switch(wanted) {
    this.wanted = wanted;
    if (wanted && !this.#context) {
      this.#context = new AudioContext();
      this.#out = new GainNode(this.#context, { gain: VOLUME });
      this.#out.connect(this.#context.destination);
      this.#context.onstatechange = () => this.#show();
    }
    if (wanted) await this.#context.resume();
    else {
      this.#hush();
      await this.#context?.suspend();
    }
    this.#show();
  }

  #show() {
    $("sound").setAttribute("aria-pressed", String(Boolean(this.on)));
    setIcon($("sound").firstElementChild, this.on ? "sound" : "mute");
    write($("sound-words"), this.on ? "Sound is on. The robot's own melodies." : "Sound is off: switch it on at the top.");
  }

  #hush() {
    for (const note of this.#playing) note.stop();
    this.#playing = [];
  }

  play(word) {
    const melody = state.hello?.sounds?.[word];
    if (!this.on || !melody) return;
    this.#hush();
    let at = this.#context.currentTime + 0.02;
    for (const [hertz, seconds] of melody) {
      const gain = new GainNode(this.#context, { gain: 0 });
      gain.gain.setValueAtTime(0, at);
      gain.gain.linearRampToValueAtTime(1, at + FADE_S);
      gain.gain.setValueAtTime(1, Math.max(at + FADE_S, at + 0.8 * seconds));
      gain.gain.linearRampToValueAtTime(0, at + seconds);
      const note = new OscillatorNode(this.#context, { type: "square", frequency: hertz });
      note.connect(gain).connect(this.#out);
      note.start(at);
      note.stop(at + seconds);
      note.onended = () => {
        this.#playing = this.#playing.filter((one) => one !== note);
      };
      this.#playing.push(note);
      at += seconds;
      this.count.notes++;
    }
  }
}
