// What the next round is: a form, a map of one's own, Clyde's speed and place.

import { $, css, fill, make, throttled, write } from "./dom.js";
import { refresh } from "./gates.js";
import { notice, told } from "./notices.js";
import { Settings } from "./settings.js";
import { on, state, tell } from "./state.js";

const MOST_UPLOAD = 5.5e6;

export class Setup {
  #edited = new Set(); // fields that the person has changed since the last scene

  constructor(connection, token) {
    this.connection = connection;
    this.token = token;
    this.settings = new Settings();
    const form = $("setup");
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.send(true);
    });
    $("setup-only").addEventListener("click", () => this.send(false));
    form.addEventListener("change", ({ target }) => {
      this.#edited.add(target.id);
      if (target.id === "setup-map") this.#showLevel();
    });
    $("setup-seed").addEventListener("input", () => this.#edited.add("setup-seed"));
    $("setup-dice").addEventListener("click", () => {
      $("setup-seed").value = String(crypto.getRandomValues(new Uint32Array(1))[0]);
      this.#edited.add("setup-seed");
    });
    $("setup-ghost-add").addEventListener("click", () => this.#ghosts([...this.ghosts, this.ghosts.at(-1)], true));
    $("upload-send").addEventListener("click", () => this.#upload());
    this.#setUpClyde();
    on("hello", ({ choices }) => this.#choices(choices ?? {}));
    on("scene", (scene) => this.#scene(scene));
  }

  get ghosts() {
    return [...$("setup-ghosts").querySelectorAll("select")].map((select) => select.value);
  }

  #choices(choices) {
    for (const [field, values] of [["map", choices.maps], ["preset", choices.presets], ["policy", choices.policies], ["second", choices.policies]]) {
      fill($(`setup-${field}`), values ?? [], undefined, { generated: "a generated house" });
      $(`setup-${field}`).closest("label").hidden = !values?.length;
    }
    this.behaviours = choices.behaviours ?? [];
    $("setup-ghosts-field").hidden = !this.behaviours.length;
    $("setup").hidden = !choices.policies?.length && !choices.maps?.length && !choices.settings?.length;
    this.settings.show(choices.settings ?? []);
    this.#showLevel();
  }

  #scene(scene) {
    if (scene.preparing) return;
    for (const field of ["map", "preset", "policy", "second"]) {
      if (this.#edited.has(`setup-${field}`)) continue;
      const value = field === "map" ? scene.map?.name : scene[field];
      const select = $(`setup-${field}`);
      if (value && ![...select.options].some((option) => option.value === value)) select.append(make("option", { value, text: value }));
      if (value) select.value = value;
    }
    if (!this.#edited.has("setup-level") && scene.level !== null) $("setup-level").value = String(scene.level ?? 0);
    if (!this.#edited.has("setup-seed")) {
      $("setup-seed").value = "";
      $("setup-seed").placeholder = "random";
    }
    if (!this.#edited.has("setup-ghosts") && scene.ghosts.length) this.#ghosts(scene.ghosts.map(({ behaviour }) => behaviour));
    if (!$("setup").contains(document.activeElement)) this.settings.values = scene.settings;
    this.#showLevel();
    const facts = [["Map", scene.level === null || scene.level === undefined ? scene.map?.name : `${scene.map?.name}, level ${scene.level}`], ["Policy", scene.policy],
      ["Compared with", scene.second], ["Seed", scene.seed], ["Ghosts", scene.ghosts.map(({ name, behaviour }) => `${name} ${behaviour}`).join(", ")], ["Preset", scene.preset]];
    $("facts").replaceChildren(...facts.filter(([, value]) => value !== null && value !== undefined && value !== "")
      .flatMap(([name, value]) => [make("dt", { text: name }), make("dd", { text: String(value) })]));
    fill($("place-who"), scene.ghosts.map((_, k) => String(k)), undefined, Object.fromEntries(scene.ghosts.map(({ name }, k) => [k, name])));
    write($("place"), scene.ghosts.length > 1 ? "Place a ghost" : "Place Clyde");
  }

  #showLevel() {
    $("setup-level").closest("label").hidden = $("setup-map").value !== "generated";
  }

  #ghosts(behaviours, edited = false) {
    if (edited) this.#edited.add("setup-ghosts");
    const list = $("setup-ghosts");
    if (!edited && this.ghosts.join() === behaviours.join()) return;
    list.replaceChildren(...behaviours.slice(0, 4).map((behaviour, k) => {
      const { name, colour } = state.hello.roles[`ghost-${k}`];
      const dot = make("span", { class: "dot" });
      dot.style.background = css(colour);
      const select = make("select", { "aria-label": `What ${name} does`, data: { needs: "control" }, onchange: () => this.#edited.add("setup-ghosts") },
        ...[...new Set([...this.behaviours, behaviour])].map((value) => make("option", { value, text: value })));
      select.value = behaviour;
      const remove = make("button", { type: "button", class: "small", text: "Remove", "aria-label": `Remove ${name}`, data: { needs: "control" },
        hidden: behaviours.length === 1, onclick: () => this.#ghosts(this.ghosts.filter((_, other) => other !== k), true) });
      return make("div", { class: "ghost-row" }, dot, make("span", { class: "ghost-name", text: name }), select, remove);
    }));
    $("setup-ghost-add").hidden = behaviours.length >= 4;
    refresh();
  }

  // What the form asks for, as a message; null: a field is wrong.
  get message() {
    if (!$("setup").reportValidity() || !this.settings.valid) return null;
    const message = { do: "setup" };
    for (const field of ["map", "preset", "policy", "second"]) {
      const select = $(`setup-${field}`);
      if (select.value && !select.closest("label").hidden) message[field] = select.value;
    }
    if (message.map === "generated" && $("setup-level").value !== "") message.level = Number($("setup-level").value);
    if (this.ghosts.length && this.behaviours.length) message.ghosts = this.ghosts;
    if ($("setup-seed").value !== "") message.seed = Number($("setup-seed").value);
    if (this.settings.facts?.length) message.settings = this.settings.values;
    return message;
  }

  async send(start) {
    const { message } = this;
    if (!message) return;
    const waiting = notice("Preparing the round.", { key: "setup", stays: true });
    const answer = await this.connection.ask(message, 120000);
    waiting?.();
    if (!told(answer)) return;
    this.#edited.clear();
    if (state.scene) this.#scene(state.scene);
    if (start) told(await this.connection.ask({ do: "start" }));
  }

  async #upload() {
    const words = $("upload-words");
    const say = (text) => {
      words.hidden = false;
      write(words, text);
    };
    const files = [...$("upload-files").files];
    const yaml = files.find(({ name }) => /\.ya?ml$/i.test(name));
    const image = files.find(({ name }) => /\.(pgm|png)$/i.test(name));
    if (!yaml || !image) {
      say("Choose two files: the YAML and its image (PGM or PNG).");
      return;
    }
    if (image.size > MOST_UPLOAD) {
      say(`The image is ${(image.size / 1e6).toFixed(1)} MB large: at most ${MOST_UPLOAD / 1e6} MB.`);
      return;
    }
    say("Checking.");
    try {
      const bytes = new Uint8Array(await image.arrayBuffer());
      let binary = "";
      for (let k = 0; k < bytes.length; k += 32768) binary += String.fromCharCode(...bytes.subarray(k, k + 32768));
      const headers = { "Content-Type": "application/json", ...(this.token ? { Authorization: `Bearer ${this.token}` } : {}) };
      const name = $("upload-name").value.trim() || yaml.name.replace(/\.ya?ml$/i, "");
      const response = await fetch("/map", { method: "POST", headers, body: JSON.stringify({ name, yaml: await yaml.text(), image: btoa(binary) }) });
      const answer = await response.json();
      say(answer.words || (answer.ok ? "Added." : "Refused."));
      if (!answer.ok) return;
      const select = $("setup-map");
      if (![...select.options].some(({ value }) => value === answer.map)) select.append(make("option", { value: answer.map, text: answer.map }));
      select.value = answer.map;
      this.#edited.add("setup-map");
      this.#showLevel();
      notice(`The map ${answer.map} is chosen. Press "Apply and start".`);
    } catch {
      say("The map could not be uploaded: no answer from the server.");
    }
  }

  #setUpClyde() {
    const slider = $("clyde-speed");
    let touched = -Infinity;
    const show = () => write($("clyde-speed-value"), `${Number(slider.value).toFixed(2)} m/s`);
    const send = throttled(async (mps) => told(await this.connection.ask({ do: "clyde_speed", mps })), 250);
    slider.addEventListener("input", () => {
      touched = performance.now();
      show();
      send(Number(slider.value));
    });
    on("scene", ({ clyde_speed_mps: mps }) => {
      if (mps === undefined || performance.now() - touched < 1500) return;
      slider.value = String(mps);
      show();
    });
    const placing = (placing_) => {
      state.placing = placing_;
      $("place").setAttribute("aria-pressed", String(placing_));
      $("place-words").hidden = !placing_;
      $("place-who-label").hidden = !placing_ || (state.scene?.ghosts.length ?? 0) < 2;
      $("top").classList.toggle("placing", placing_);
      tell("placing");
    };
    $("place").addEventListener("click", () => placing(!state.placing));
    on("frame", (frame) => {
      if (state.placing && frame.state !== "menu") placing(false);
    });
    this.placeAt = async ([x, y]) => {
      const ghost = Number($("place-who").value || 0);
      if (told(await this.connection.ask({ do: "place_clyde", x, y, ghost }))) placing(false);
    };
  }
}
