// Why the robot stands: the alert, and its two answers; the robot's pose by two clicks on the map.

import { request } from "./connection.js";
import { $, make, showMap } from "./dom.js";
import { state } from "./page.js";

let shown = ""; // of the alert

function setPosing(posing) {
  state.posing = posing;
  state.stands = null;
  if (posing) showMap();
  $("set-pose").setAttribute("aria-pressed", String(Boolean(posing)));
  state.emit("placing");
}
$("set-pose").onclick = () => setPosing(state.posing ? "" : "Click where the robot stands");
$("continue").onclick = async () => await request({ do: "continue" }) && setPosing("");

export async function poseRobot([x, y]) {
  if (!state.stands) {
    setPosing("Click a place that it faces");
    state.stands = [x, y];
    return;
  }
  const [left, top] = state.stands;
  const heading = Math.atan2(y - top, x - left);
  if (await request({ do: "set_pose", x: left, y: top, heading })) setPosing("");
}

state.on("scene", ({ alerts = [] }) => {
  const asks = alerts.some((one) => one.asks);
  const words = alerts.map(({ words: what, remedy, asks: answered }) =>
    `${what[0].toUpperCase()}${what.slice(1)}${answered ? ". Where is the robot?" : `: ${remedy}.`}`);
  if (words.join("\n") !== shown) $("alert-words").replaceChildren(...words.map((text) => make("p", { text })));
  shown = words.join("\n");
  $("alert").hidden = !alerts.length;
  $("alert-answers").hidden = !asks;
  if (!asks && state.posing) setPosing("");
});
