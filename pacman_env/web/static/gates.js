// What may not be used now is disabled, and says why. `data-needs` names what an element needs, `data-only` the source.

import { $, write } from "./dom.js";
import { obstacle, on, state } from "./state.js";

let queued = false;

export function refresh() {
  if (queued) return;
  queued = true;
  queueMicrotask(() => {
    queued = false;
    for (const element of document.querySelectorAll("[data-needs]")) {
      const why = obstacle(element.dataset.needs.split(" "));
      if (element.disabled !== Boolean(why)) element.disabled = Boolean(why);
      if (why) element.title = why;
      else if (element.dataset.title !== element.title) element.title = element.dataset.title ?? "";
    }
    for (const element of document.querySelectorAll("[data-only]")) element.hidden = Boolean(state.hello) && (state.hello.source ?? "simulator") !== element.dataset.only;
    const why = state.connected ? obstacle(["control"]) : "";
    write($("reason"), why);
    $("reason").hidden = !why;
  });
}

export function setUpGates() {
  let game = "";
  on("hello people connection", refresh);
  on("frame", (frame) => {
    if (frame.state !== game) refresh();
    game = frame.state;
  });
  refresh();
}
