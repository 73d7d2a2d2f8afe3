// Links of rounds: the setup behind the # of the page's address.

import { $ } from "./dom.js";
import { notice, question } from "./notices.js";

const REPLAY_TIMEOUT_MS = 180000;
const NO_LINK = "This round cannot be reproduced by a link: a person played in it, or a ghost was placed by hand.";

const fieldsOf = (hash) => Object.fromEntries(new URLSearchParams(hash.slice(1)));

export class Links {
  constructor(state, game, stories) {
    Object.assign(this, { state, game, stories });
    $("story-share").onclick = () => this.#copy(state.story.entry.link, `&tick=${state.story.index}`);
    $("share").onclick = () => this.#copy(state.scene?.link);
    addEventListener("hashchange", () => this.follow());
  }

  // Copies the address of a round without the token.
  async #copy(link, tick = "") {
    if (!link) {
      notice(NO_LINK);
      return;
    }
    const hint = this.game.token ? " It contains no token: other users need their own." : "";
    history.replaceState(null, "", `#${link}${tick}`);
    try {
      await navigator.clipboard.writeText(`${location.origin}${location.pathname}#${link}${tick}`);
      notice(`Link copied.${hint}`);
    } catch {
      notice(`The link is in the address bar.${hint}`);
    }
  }

  #settingOf(name, text) {
    const type = this.state.hello.choices?.settings?.find((setting) => setting.name === name)?.type;
    if (type === "number" || type === "integer") return Number(text);
    return type === "bool" ? text.toLowerCase() === "true" : text;
  }

  // The setup that the server wrote behind the # of a link; null if it is no round.
  #read() {
    const fields = fieldsOf(location.hash);
    const { seed, level, tick, clyde, ghosts, map, preset, policy, second } = fields;
    if (seed === undefined) return null;
    const set = Object.entries(fields).filter(([field]) => field.startsWith("set."))
      .map(([field, value]) => [field.slice(4), this.#settingOf(field.slice(4), value)]);
    return {
      do: "setup", finish: tick !== undefined, seed: Number(seed), level: level && Number(level), map, preset, policy,
      second, clyde_mps: clyde && Number(clyde), ghosts: ghosts?.split(","), settings: Object.fromEntries(set),
    };
  }

  // Prepares the round of the address; if it names a tick, plays the round to its end and opens it there.
  async follow() {
    const message = this.#read();
    if (!message) return;
    const { frame, people } = this.state;
    const busy = (frame && frame.state !== "menu") || Object.values(people.roles).some(Boolean);
    if (busy && !(await question("This link opens another round and ends the current one. Continue?"))) return;
    const hide = notice("Preparing the linked round.", { stays: true, key: "setup" });
    const answer = await this.game.request(message, REPLAY_TIMEOUT_MS);
    hide();
    if (!answer) return;
    const tick = Number(fieldsOf(location.hash).tick);
    if (answer.data?.story) await this.stories.open(answer.data.story, tick || 0);
    else notice("The linked round is ready: press Start.");
  }
}
