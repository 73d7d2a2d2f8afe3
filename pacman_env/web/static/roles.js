// Roles of players: who plays what, and what a player can do now.

import { $, button, make, notice, renderReleased, showMap, touch, write, writeOrHide } from "./dom.js";
import { updateControls } from "./page.js";

// What a player can do now.
function task({ state: now, harmless_s: harmless = [], away_s: away = [] }, role) {
  const ghost = Number(role.at(-1));
  const left = role === "robot" ? Math.max(0, ...harmless.filter((_, k) => !away[k])) : harmless[ghost];
  if (left > 0 && role === "robot") return `catch the blue ghosts, ${Math.ceil(left)} s left`;
  if (left > 0) return away[ghost] > 0 ? `caught, back in ${Math.ceil(left)} s` : `frightened for ${Math.ceil(left)} s`;
  const click = role !== "robot" ? `${touch.matches ? "tap" : "click"} a place, or the robot to follow it`
    : touch.matches ? "tap a pellet" : "use the arrow keys or click a pellet";
  if (now !== "menu") return click;
  return $("start").disabled ? `wait for the start, then ${click}` : `press Start, then ${click}`;
}

export class Roles {
  constructor(state, game, steering) {
    Object.assign(this, { state, game, steering });
    state.on("people hello scene connection", () => this.#showRoles());
    state.on("frame placing story role", () => this.#showMode());
  }

  async #chooseRole(role) {
    this.steering.stop();
    const answer = await this.game.request({ do: "role", role });
    if (answer?.data?.words) notice(`The role is ${answer.data.words}.`);
  }

  #showRoles() {
    const { people, hello, me, role } = this.state;
    const players = people.roles ?? {};
    const mine = Object.keys(players).find((one) => players[one] && players[one] === me) ?? "none";
    if (mine !== role) {
      this.steering.stop();
      this.state.role = mine;
      if (mine !== "none") showMap();
      this.state.emit("role", mine);
    }
    renderReleased($("roles"), () => this.#showPlayers());
    $("play-robot").hidden = mine !== "robot";
    $("play-ghost").hidden = !mine.startsWith("ghost");
    if (mine.startsWith("ghost")) write($("play-ghost-title"), `You are ${hello.roles[mine].name}`);
    this.#showMode();
  }

  #showPlayers() {
    const { hello, me, scene, source, role: mine, people: { roles: players } } = this.state;
    const ghosts = source === "ros" ? [] : scene?.ghosts ?? []; // a robot's game has no players of ghosts
    const rows = hello ? [{ role: "robot", ...hello.roles.robot }, ...ghosts] : [];
    const active = document.activeElement?.dataset?.role;
    $("roles").replaceChildren(...rows.map(({ role, name, colour }) => {
      const player = players[role];
      const taken = player && player !== me;
      const act = role === mine ? "Leave" : "Play";
      return make("li", {}, make("span", { class: colour ? "dot" : "dot robot", colour }),
        make("span", { class: "player", text: `${name}: ${taken ? player : player ? "you" : "free"}` }),
        button(role === mine ? "Leave" : taken ? "Taken" : `Play ${name}`, {
          class: role === mine ? "small" : "small primary", "aria-label": `${act} ${name}`, disabled: taken,
          data: taken ? { role } : { role, needs: "operator" },
          onclick: () => this.#chooseRole(role === mine ? "none" : role),
        }));
    }));
    if (active) $("roles").querySelector(`[data-role="${active}"]`)?.focus();
    updateControls();
  }

  #showMode() {
    const { frame, hello, me, people, role, story, scene } = this.state;
    const plays = role !== "none" && !story && ["menu", "starting", "running"].includes(frame?.state);
    const player = role === "robot" ? "the robot" : hello?.roles[role]?.name;
    writeOrHide($("mode"), this.state.placing || (plays ? `You are ${player}: ${task(frame, role)}` : ""));
    const driver = people.roles?.robot;
    const score = frame?.baseline && driver && !story ? `Pellets: ${driver === me ? "you" : driver} ${frame.collected}, `
      + `${scene?.policy ?? "policy"} ${frame.baseline_collected}` : "";
    writeOrHide($("duel"), score);
  }
}
