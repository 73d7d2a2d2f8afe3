// Run the game: Start, Pause, Reset, speed, STOP; what its state is; who has control.

import { $, clock, make, setIcon, throttled, write } from "./dom.js";
import { notice, told, unnotice } from "./notices.js";
import { inControl, me, on, shown, state } from "./state.js";

const STOP_PATIENCE_MS = 900;
const STOP_TRIES = 3;

export function setUpControls(connection) {
  const ask = async (message) => told(await connection.ask(message));

  $("start").addEventListener("click", () => ask({ do: "start" }));
  $("reset").addEventListener("click", () => ask({ do: "reset" }));
  $("pause").addEventListener("click", () => ask({ do: "pause", on: !state.frame?.paused }));

  const slider = $("speed");
  let touched = 0;
  const send = throttled((times) => ask({ do: "speed", times }), 150);
  slider.addEventListener("input", () => {
    touched = performance.now();
    write($("speed-value"), `×${slider.value}`);
    send(Number(slider.value));
  });

  setUpStop(connection, ask);
  setUpLease(connection);

  on("frame story", () => {
    const frame = shown();
    if (!frame) return;
    const live = state.frame ?? frame;
    const label = $("state");
    const word = state.story ? "Recording" : frame.stopped ? "Stopped" : frame.paused && frame.state === "running" ? "Paused" : state.hello.states[frame.state];
    write(label, word);
    label.dataset.state = state.story ? "story" : frame.stopped ? "stopped" : frame.state;
    write($("score"), state.story ? "–" : String(frame.score));
    write($("pellets"), frame.spawned ? `${frame.collected}/${frame.spawned}` : "–");
    write($("time"), clock(frame.time_s));
    write($("round"), String(frame.round));
    const pause = $("pause");
    if (pause.getAttribute("aria-pressed") !== String(live.paused)) {
      pause.setAttribute("aria-pressed", String(live.paused));
      write(pause.lastElementChild, live.paused ? "Resume" : "Pause");
      pause.setAttribute("aria-label", live.paused ? "Resume" : "Pause");
      setIcon(pause.firstElementChild, live.paused ? "play" : "pause");
    }
    if (performance.now() - touched > 1000 && Number(slider.value) !== Math.round(live.speed)) {
      slider.value = String(Math.round(live.speed));
      write($("speed-value"), `×${slider.value}`);
    }
    write($("hint"), live.stopped ? "Stopped: press Release to continue." : live.state === "menu" && !state.story
      ? (state.role === "robot" ? "Press Start: you are the robot." : "Press Start: the robot collects the pellets.") : "");
  });
  on("scene", () => {
    if (state.scene?.preparing) write($("state"), "Preparing");
    if (state.scene?.notice) write($("hint"), state.scene.notice);
  });
}

function setUpStop(connection, ask) {
  let owed = false; // a STOP that nobody has confirmed
  const stop = async () => {
    owed = true;
    for (let k = 0; k < STOP_TRIES && owed; k++) {
      if (!connection.open) break;
      const answer = await connection.ask({ do: "stop" }, STOP_PATIENCE_MS);
      if (answer.ok) {
        owed = false;
        unnotice("stop");
        notice("Stopped. The robot stands until it is released.", { key: "stopped" });
        return;
      }
    }
    if (!owed) return;
    $("lost").classList.add("loud");
    if (!connection.open) {
      write($("lost"), "STOP was NOT delivered: no connection. Use the robot's own buttons. STOP is sent as soon as the connection is back.");
      $("lost").hidden = false;
    }
    notice("STOP was NOT confirmed. Use the robot's own buttons.", { bad: true, stays: true, key: "stop" });
  };
  $("stop").addEventListener("click", stop);
  addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) stop();
  });
  $("release").addEventListener("click", async () => {
    if (await ask({ do: "release" })) unnotice("stopped");
  });
  on("connection", () => {
    if (state.connected && owed) stop();
  });
  on("frame", ({ stopped }) => {
    $("release").hidden = !stopped;
    if (stopped && owed) {
      owed = false;
      unnotice("stop");
    }
  });
}

function setUpLease(connection) {
  const say = async (what) => {
    if (told(await connection.ask({ do: "control", what })) && what === "ask") notice("You have asked for control.");
  };
  $("lease-take").addEventListener("click", () => say("take"));
  $("lease-ask").addEventListener("click", () => say("ask"));
  $("lease-give").addEventListener("click", () => say("give"));
  let before = null;
  let asked = "";
  on("hello people connection", () => {
    const { operator, asking, viewers } = state.people;
    const may = state.hello?.access === "operator" && state.connected;
    const words = !state.hello ? "" : operator === null ? (may ? "Nobody has control" : "View only") : operator === me() ? "You have control" : `${operator} has control`;
    write($("lease-words"), words);
    $("lease-words").classList.toggle("important", operator !== null && operator !== me());
    $("lease-take").hidden = !may || operator !== null;
    $("lease-ask").hidden = !may || operator === null || operator === me() || asking.includes(me());
    $("lease-give").hidden = !may || !inControl();
    write($("viewers"), String(viewers));
    const wants = inControl() ? asking.filter((name) => name !== me()) : [];
    if (wants.length && wants.join() !== asked) {
      notice(`${wants.join(", ")} asks for control.`, { stays: true, key: "asking", buttons: [["Hand over", () => say("give")], ["Keep", () => {}]] });
    } else if (!wants.length) unnotice("asking");
    asked = wants.join();
    if (before !== null && operator === me() && before !== me()) notice("You have control.");
    before = operator;
    const others = Object.entries(state.people.roles).filter(([, who]) => who);
    write($("people-words"), [
      `${viewers} ${viewers === 1 ? "viewer" : "viewers"}. You are ${me() ?? "not connected"}.`,
      operator ? `${operator === me() ? "You have" : `${operator} has`} control.` : "Nobody has control.",
      asking.length ? `${asking.join(", ")} asks for it.` : "", others.length ? `Roles: ${others.map(([role, who]) => `${state.hello.roles[role].name} ${who}`).join(", ")}.` : "",
    ].filter(Boolean).join(" "));
  });
}

// The result of a round, seen and spoken: as soon as the game says so, and when its recording is there.
export function setUpResult() {
  let before = "";
  on("frame", ({ state: now, collected, spawned, time_s }) => {
    if (now === before) return;
    if (now === "complete") showResult({ result: "complete", collected, spawned, time_s });
    if (now === "dying") showResult({ result: "caught", collected, spawned, time_s });
    if (now === "running") $("result").hidden = true;
    before = now;
  });
  on("story", () => {
    if (state.story) $("result").hidden = true;
  });
}

let hide = 0;
export function showResult({ result, collected, spawned, time_s }) {
  const box = $("result");
  const [title, words] = [state.hello.results[result] ?? result, `${collected} of ${spawned} pellets in ${clock(time_s)}`];
  if (box.textContent !== title + words) box.replaceChildren(make("strong", { text: title }), words);
  box.hidden = Boolean(state.story);
  clearTimeout(hide);
  hide = setTimeout(() => {
    box.hidden = true;
  }, 10000);
}
