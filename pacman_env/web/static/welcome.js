// The card of the demo: play at once, or watch.

import { $, focusMap, stored } from "./dom.js";
import { switchSound } from "./effects.js";

const PLAY_SPEED = 3; // times real time
const KEY = "pacman_env.sound"; // in the browser's store: whether the player wants sound

export class Welcome {
  constructor(state, game, demo) {
    Object.assign(this, { state, game });
    $("play").onclick = () => this.#play("robot");
    $("play-clyde").onclick = () => this.#play("ghost-0");
    $("watch").onclick = () => game.request({ do: "start" });
    $("welcome-close").onclick = () => {
      demo.close();
      focusMap();
    };
    $("play-sound").checked = stored("localStorage", KEY) !== "no";
    $("play-sound").onchange = ({ target }) => stored("localStorage", KEY, target.checked ? "yes" : "no");
    state.on("demo", (invites) => ($("welcome").hidden = !invites));
  }

  // Takes a role and starts a game that can be won, in one click.
  async #play(role) {
    const { game, state } = this;
    if ($("play-sound").checked) switchSound(true);
    if (!await game.request({ do: "role", role })) return;
    if (!await game.request({ do: "setup", ...state.hello.choices.play[role.split("-")[0]] }, game.SLOW_MS)) return;
    if (await game.request({ do: "speed", times: PLAY_SPEED })) await game.request({ do: "start" });
  }
}
