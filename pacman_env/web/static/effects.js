// Lights, sounds and events: the light ring, the melodies, and a button for each.

import { request } from "./connection.js";
import { $, css, make, setIcon, write } from "./dom.js";
import { state } from "./page.js";

const LEDS = 6;
const VOLUME = 0.07;
const FADE_S = 0.012;

export const leds = () => Array.from({ length: LEDS }, (_, k) => (
  make("i", { style: `transform: rotate(${-60 * k}deg) translateY(-155%)` })));
const rings = [$("ring"), $("ring-large")];
for (const ring of rings) ring.append(...leds());
let shownRing = "";
state.on("frame", ({ ring }) => {
  if (JSON.stringify(ring) === shownRing) return;
  shownRing = JSON.stringify(ring);
  const colours = Array.from({ length: LEDS }, (_, k) => (ring?.[k]?.some(Boolean) ? css(ring[k]) : ""));
  for (const { children } of rings) {
    colours.forEach((background, k) => Object.assign(children[k].style, {
      background, boxShadow: background ? `0 0 10px ${background}` : "none",
    }));
  }
  const lit = colours.some(Boolean);
  if (lit) state.count.lit++;
  $("ring").setAttribute("aria-label", `Light ring: ${lit ? "on" : "off"}`);
  write($("ring-words"), ring ? "The colours of the robot's light ring." : "The ring shows the robot's own status.");
});

// Buttons for what the server names; `describe` returns the title or the colour of one.
function showButtons(what, named, describe) {
  $(`show-${what}`).replaceChildren(...Object.entries(named ?? {}).map(([word, value]) => {
    const { title = "", colour } = describe(value);
    const data = { needs: "control", word, what, title };
    const onclick = () => request({ do: "event", word, what });
    const dot = colour && make("span", { class: "dot", colour });
    return make("button", { type: "button", data, title, onclick }, dot, word);
  }));
}
state.on("hello", ({ events, lights, sounds }) => {
  showButtons("event", events, ({ light, sound, motion }) => ({
    title: `light: ${light ?? "none"}, sound: ${sound ?? "none"}, motion: ${motion ?? "none"}`,
  }));
  showButtons("light", lights, (colour) => ({ colour }));
  showButtons("sound", sounds, (notes) => ({ title: `${notes.length} notes` }));
});
$("arm").onchange = async ({ target }) => {
  if (!await request({ do: "arm", on: target.checked })) target.checked = !target.checked;
};
state.on("connection", () => ($("arm").checked = false));

// Sounds are synthesised from the robot's notes; silent until the user switches them on.
let audio = null;
const notes = new Set(); // playing or to be played

export const sounds = { get on() { return audio?.state === "running"; } };

function showSound() {
  $("sound").setAttribute("aria-pressed", String(sounds.on));
  setIcon($("sound"), sounds.on ? "sound" : "mute");
  write($("sound-words"), sounds.on ? "Sound is on. The robot's own melodies."
    : "Sound is off. Switch it on with the loudspeaker button at the top.");
}

export async function switchSound(on) {
  audio ??= Object.assign(new AudioContext(), { onstatechange: showSound });
  silence();
  await (on ? audio.resume() : audio.suspend());
  showSound();
}
$("sound").onclick = () => switchSound(!sounds.on);

function silence() {
  for (const note of notes) note.stop();
  notes.clear();
}

function play(word) {
  const melody = state.hello?.sounds?.[word];
  if (!sounds.on || !melody) return;
  silence();
  let start = audio.currentTime + 0.02;
  for (const [frequency, seconds] of melody) {
    const [risen, end] = [start + FADE_S, start + seconds];
    const note = new OscillatorNode(audio, { type: "square", frequency });
    const envelope = new GainNode(audio, { gain: 0 });
    envelope.gain.setValueAtTime(0, start);
    envelope.gain.linearRampToValueAtTime(VOLUME, risen);
    envelope.gain.setValueAtTime(VOLUME, Math.max(risen, start + 0.8 * seconds));
    envelope.gain.linearRampToValueAtTime(0, end);
    note.connect(envelope).connect(audio.destination);
    note.start(start);
    note.stop(end);
    note.onended = () => notes.delete(note);
    notes.add(note);
    start = end;
    state.count.notes++;
  }
}
state.on("news", (items) => items.forEach(({ sound }) => sound && play(sound)));
showSound();
