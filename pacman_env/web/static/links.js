// Links and files of rounds: the setup, and what people ordered, behind the # of the page's address.

import { $, make, notice, question } from "./dom.js";
import { showResult } from "./end.js";

const FORMAT = "pacman_env round";

const fieldsOf = (hash) => Object.fromEntries(new URLSearchParams(hash.replace(/^#/, "")));
const pack = (value) => btoa(JSON.stringify(value)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
const unpack = (text) => JSON.parse(atob(text.replaceAll("-", "+").replaceAll("_", "/")));

// A setting of a link: a number, true, false, or a text.
const valueOf = (text) => (text && Number.isFinite(Number(text)) ? Number(text)
  : { true: true, false: false }[text.toLowerCase()] ?? text);

export class Links {
  opening = false; // whether a link's round is being prepared or opened
  #followed = false; // the link by which the page was opened

  constructor(state, game, stories) {
    Object.assign(this, { state, game, stories });
    $("story-share").onclick = () => this.#copy(`${this.#linkOf(state.story.entry)}&tick=${state.story.index}`);
    $("story-save").onclick = () => this.#save(state.story.entry);
    $("story-again").onclick = () => this.#play(state.story.entry, state.story.index);
    $("share").onclick = () => this.#copy(state.scene?.link);
    state.on("share", (entry) => this.#copy(this.#linkOf(entry)));
    state.on("play", (entry) => this.#play(entry));
    state.on("scene", ({ preparing }) => {
      if (!preparing && !this.#followed) setTimeout(() => this.#follow(), 300);
      this.#followed ||= !preparing;
    });
    $("story-file").onchange = ({ target }) => this.#load(target);
    addEventListener("hashchange", () => this.#follow());
  }

  // The part of an address behind the # that repeats a round: with orders of people if there were any.
  #linkOf({ link, moves, hash }) {
    const { version } = this.state.hello;
    return moves?.orders || moves?.placed ? `${link}&hash=${hash}&version=${version}&moves=${pack(moves)}` : link;
  }

  // Copies the address of a round without the token.
  async #copy(link) {
    const hint = this.game.token ? " It contains no token: other users need their own." : "";
    history.replaceState(null, "", `#${link}`);
    try {
      await navigator.clipboard.writeText(`${location.origin}${location.pathname}#${link}`);
      notice(`Link copied.${hint}`);
    } catch {
      notice(`The link is in the address bar.${hint}`);
    }
  }

  #save(entry) {
    const { story, result, collected, spawned, time_s, map, seed, configuration, hash } = entry;
    const round = {
      format: FORMAT, version: this.state.hello.version, map, hash, configuration, seed, result, collected, spawned,
      time_s, link: this.#linkOf(entry),
    };
    const url = URL.createObjectURL(new Blob([JSON.stringify(round, null, 1)], { type: "application/json" }));
    make("a", { href: url, download: `round-${story}.json` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1000);
  }

  async #load(input) {
    const [file] = input.files;
    const round = await file.text().then(JSON.parse).catch(() => null);
    if (round?.format !== FORMAT || typeof round.link !== "string") {
      notice(`${file.name} is no round that this page has saved.`, { bad: true });
    } else await this.#follow(`${round.link}&tick=0`);
    input.value = "";
  }

  // The setup of a link; null if it is no round.
  #setupOf(link) {
    const fields = fieldsOf(link);
    const { seed, level, tick, clyde, ghosts, map, preset, policy, second, moves } = fields;
    if (seed === undefined) return null;
    const set = Object.entries(fields).filter(([field]) => field.startsWith("set."))
      .map(([field, value]) => [field.slice(4), valueOf(value)]);
    return {
      do: "setup", finish: (tick ?? moves) !== undefined, seed: Number(seed), level: level && Number(level), map, preset,
      policy, second, clyde_mps: clyde && Number(clyde), ghosts: ghosts?.split(","), settings: Object.fromEntries(set),
      moves: moves && unpack(moves),
    };
  }

  // Prepares the round of a link; if it names a tick or contains orders, plays the round to its end and opens it.
  async #follow(link = location.hash) {
    let message = null;
    try {
      message = this.#setupOf(link);
    } catch {
      notice("The link is damaged: copy it again.", { bad: true });
    }
    if (!message) return;
    const { frame, people } = this.state;
    const busy = (frame && frame.state !== "menu") || Object.values(people.roles).some(Boolean);
    if (busy && !(await question("This link opens another round and ends the current one. Continue?"))) return;
    const hide = notice("Preparing the linked round.", { stays: true, key: "setup" });
    this.opening = true;
    const answer = await this.game.request(message, this.game.SLOW_MS);
    hide();
    if (answer?.data?.story) await this.#open(answer.data.story, fieldsOf(link));
    else if (answer) notice("The linked round is ready: press Start.");
    this.opening = false;
  }

  async #open(story, { tick, moves, version, hash }) {
    await this.stories.open(story, Number(tick) || 0);
    const { entry } = this.state.story ?? {};
    if (!entry || moves === undefined) return;
    if (hash !== entry.hash) notice(`The map ${entry.map} is another one here: the round differs.`, { bad: true });
    else if (version !== this.state.hello.version) notice(`Recorded with version ${version}: the round may differ.`);
    showResult(entry, true);
    if (tick === undefined) this.stories.player.play();
  }

  // Lets the person of this page play the robot in the round of an entry: from its start, or from a moment on.
  async #play(entry, until) {
    await this.stories.close();
    if (!await this.game.request({ do: "role", role: "robot" })) return;
    const moves = until === undefined ? undefined : entry.moves;
    const setup = { ...this.#setupOf(entry.link), moves, until, finish: false };
    if (await this.game.request(setup, this.game.SLOW_MS)) await this.game.request({ do: "start" });
  }
}
