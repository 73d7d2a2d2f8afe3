// The light ring as it is, and buttons for every event, light and sound.

import { $, css, make, write } from "./dom.js";
import { told } from "./notices.js";
import { on } from "./state.js";

const DOTS = { yellow: "#ffb400", red: "#f00", blue: "#00f", pink: "#ff3cb4", orange: "#ff5000", white: "#fff", clyde: "#ff5000", blinky: "#f00", pinky: "#ff3cb4", inky: "#00f" };
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
    write($("ring-words"), ring ? "The colours are the frames of the robot's ring." : "The ring shows the robot's own state.");
  });
  on("hello", ({ words, feedback, melodies }) => {
    for (const what of ["event", "light", "sound"]) {
      $(`show-${what}`).replaceChildren(...(words?.[what] ?? []).map((word) => {
        const dot = DOTS[word] ?? DOTS[word.split(" ")[0]];
        const mark = what === "light" && dot ? make("span", { class: "dot" }) : null;
        if (mark) mark.style.background = dot;
        const asks = what === "event" ? feedback?.[word] : null;
        const title = asks ? ["light", "sound", "motion"].map((kind) => `${kind}: ${asks[kind] ?? "none"}`).join(", ") : what === "sound" ? `${melodies?.[word]?.length ?? 0} notes` : "";
        return make("button", { type: "button", data: { needs: "control", word, what, title }, onclick: async () => told(await connection.ask({ do: "event", word, what })) }, mark, word);
      }));
    }
  });
  $("arm").addEventListener("change", async ({ target }) => {
    if (!told(await connection.ask({ do: "arm", on: target.checked }))) target.checked = !target.checked;
  });
  on("connection", () => {
    $("arm").checked = false;
  });
}
