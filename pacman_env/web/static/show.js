// The light ring as it is, and buttons for every event, light and sound.

import { $, css, make, write } from "./dom.js";
import { told } from "./notices.js";
import { on } from "./state.js";

const DARK = "rgb(51, 58, 75)";

export function setUpShow(connection, count) {
  const rings = [$("ring"), $("ring-large")];
  for (const ring of rings) ring.append(...Array.from({ length: 6 }, () => document.createElement("i")));
  let before = "";
  on("frame", ({ ring }) => {
    const key = JSON.stringify(ring);
    if (key === before) return;
    before = key;
    const lit = ring?.some((led) => led.some(Boolean));
    if (lit) count.lit++;
    for (const element of rings) {
      [...element.children].forEach((led, k) => {
        const colour = ring?.[k];
        const on_ = colour?.some(Boolean);
        led.style.background = on_ ? css(colour) : DARK;
        led.style.boxShadow = on_ ? `0 0 10px ${css(colour)}` : "none";
      });
      element.dataset.ring = key;
    }
    $("ring").setAttribute("aria-label", `Light ring: ${lit ? "on" : "off"}`);
    write($("ring-words"), ring ? "The colours of the robot's light ring." : "The ring shows the robot's own status.");
  });
  on("hello", ({ events, lights, sounds }) => {
    const fillWith = (what, words, describe) => $(`show-${what}`).replaceChildren(...Object.entries(words ?? {}).map(([word, facts]) => {
      const { title = "", colour = null } = describe(facts);
      const mark = colour ? make("span", { class: "dot" }) : null;
      if (mark) mark.style.background = css(colour);
      return make("button", { type: "button", data: { needs: "control", word, what, title }, onclick: async () => told(await connection.ask({ do: "event", word, what })) }, mark, word);
    }));
    fillWith("event", events, ({ light, sound, motion }) => ({ title: `light: ${light ?? "none"}, sound: ${sound ?? "none"}, motion: ${motion ?? "none"}` }));
    fillWith("light", lights, (colour) => ({ colour }));
    fillWith("sound", sounds, (notes) => ({ title: `${notes.length} notes` }));
  });
  $("arm").addEventListener("change", async ({ target }) => {
    if (!told(await connection.ask({ do: "arm", on: target.checked }))) target.checked = !target.checked;
  });
  on("connection", () => {
    $("arm").checked = false;
  });
}
