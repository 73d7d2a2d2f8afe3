// Why the robot stands: the alert, and its two answers; the robot's pose by two clicks on the map.

import { request } from "./connection.js";
import { $, write } from "./dom.js";
import { emit, on, state } from "./state.js";

let stands = null; // where the robot stands, once that was clicked

function setPosing(posing) {
  state.posing = posing;
  stands = null;
  $("set-pose").setAttribute("aria-pressed", String(Boolean(posing)));
  $("top").classList.toggle("placing", Boolean(posing));
  emit("placing");
}
$("set-pose").onclick = () => setPosing(state.posing ? "" : "Click where the robot stands");
$("continue").onclick = async () => await request({ do: "continue" }) && setPosing("");

export async function poseRobot([x, y]) {
  if (!stands) {
    setPosing("Click a place that it faces");
    stands = [x, y];
    return;
  }
  const heading = Math.atan2(y - stands[1], x - stands[0]);
  if (await request({ do: "set_pose", x: stands[0], y: stands[1], heading })) setPosing("");
}

on("scene", ({ alerts = [] }) => {
  const asks = alerts.some((one) => one.asks);
  const words = alerts.map(({ words: what, remedy, asks: answered }) =>
    `${what[0].toUpperCase()}${what.slice(1)}${answered ? ". Where is the robot?" : `: ${remedy}.`}`);
  write($("alert-words"), words.join(" "));
  $("alert").hidden = !alerts.length;
  $("alert-answers").hidden = !asks;
  if (!asks && state.posing) setPosing("");
});
