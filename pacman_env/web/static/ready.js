// The readiness list, each item with what to do.

import { $, make } from "./dom.js";
import { told } from "./notices.js";
import { on, state } from "./state.js";

const MARKS = { ok: "✓ Ready", warning: "! Warning", bad: "✗ Not ready" };

export function setUpReady(connection) {
  let asking = false;
  const check = async () => {
    if (asking) return;
    asking = true;
    const answer = await connection.ask({ do: "ready" }, 30000);
    asking = false;
    if (!told(answer)) return;
    $("ready").replaceChildren(...(answer.data ?? []).map(({ name, state: how, words, remedy }) => make("li", { data: { state: how } },
      make("span", { class: `mark ${how}`, text: MARKS[how] ?? how }), make("strong", { text: name }),
      make("p", {}, make("span", { text: words }), remedy ? make("strong", { text: ` What to do: ${remedy}.` }) : null))));
  };
  $("ready-check").addEventListener("click", check);
  on("tab", (name) => {
    if (name === "ready" && state.connected) check();
  });
  on("hello", ({ version, source, access, you }) => {
    const facts = [["Version", version], ["Game", source === "ros" ? "the robot" : "the simulator"], ["You", you], ["You may", access === "operator" ? "run the game" : "view, and STOP"]];
    $("about").replaceChildren(...facts.flatMap(([name, value]) => [make("dt", { text: name }), make("dd", { text: String(value ?? "–") })]));
    if (!$("panel-ready").hidden) check();
  });
}
