// The settings of the configuration: by name, with unit and range, and a search.

import { $, make, write } from "./dom.js";
import { refresh } from "./gates.js";

export class Settings {
  #rows = new Map(); // by name: {facts, row, input, undo}
  #changed = new Map();

  constructor() {
    $("settings-search").addEventListener("input", ({ target }) => this.#search(target.value));
    $("settings").addEventListener("toggle", () => {
      if ($("settings").open) this.#build();
    });
  }

  show(facts) {
    this.facts = facts;
    this.#rows.clear();
    $("settings-list").replaceChildren();
    $("settings").hidden = !facts.length;
    if ($("settings").open) this.#build();
    this.#count();
  }

  // What was set, as the server says.
  set values(values) {
    this.#changed = new Map(Object.entries(values ?? {}));
    for (const name of this.#rows.keys()) this.#fill(name);
    this.#count();
  }

  get values() {
    return Object.fromEntries(this.#changed);
  }

  get valid() {
    return [...this.#rows.values()].every(({ input }) => input.checkValidity());
  }

  read(name, words) {
    const type = this.facts?.find((one) => one.name === name)?.type;
    if (type === "number" || type === "integer") return Number(words);
    if (type === "bool") return words.toLowerCase() === "true";
    return words;
  }

  #build() {
    if (this.#rows.size || !this.facts) return;
    const rows = this.facts.map((facts, k) => this.#row(facts, `setting-${k}`));
    $("settings-list").replaceChildren(...rows);
    this.#search($("settings-search").value);
    refresh();
  }

  #row(facts, id) {
    const { name, type, unit, low, high, options, words } = facts;
    const changed = () => this.#take(facts, input);
    const shared = { id, data: { needs: "control" }, "aria-describedby": `${id}-words`, onchange: changed };
    let input;
    if (type === "bool") input = make("input", { type: "checkbox", ...shared });
    else if (type === "choice") input = make("select", shared, ...options.map((value) => make("option", { value, text: String(value) })));
    else if (type === "number" || type === "integer") {
      input = make("input", { type: "number", step: type === "integer" ? "1" : "any", min: low ?? undefined, max: high ?? undefined, ...shared });
    } else input = make("input", { type: "text", maxLength: 200, ...shared });
    const undo = make("button", { type: "button", class: "small", text: "Undo", "aria-label": `Undo ${name}`, hidden: true, onclick: () => {
      this.#changed.delete(name);
      this.#fill(name);
      this.#count();
    } });
    const range = low !== null && high !== null ? `${low} to ${high}` : low !== null ? `from ${low}` : high !== null ? `up to ${high}` : "";
    const row = make("div", { class: "setting" }, make("label", { htmlFor: id, text: unit ? `${name}, ${unit}` : name }),
      make("span", { class: "control" }, input, undo), make("p", { id: `${id}-words`, text: [words, range, `default ${facts.value}`].filter(Boolean).join(" · ") }));
    this.#rows.set(name, { facts, row, input, undo });
    this.#fill(name);
    return row;
  }

  #take({ name, type, value }, input) {
    if (!input.checkValidity() || (input.type === "number" && input.value === "")) {
      input.reportValidity();
      return;
    }
    const now = type === "bool" ? input.checked : input.type === "number" ? Number(input.value) : input.value;
    if (now === value) this.#changed.delete(name);
    else this.#changed.set(name, now);
    this.#fill(name);
    this.#count();
  }

  #fill(name) {
    const { facts, row, input, undo } = this.#rows.get(name);
    const value = this.#changed.get(name) ?? facts.value;
    if (facts.type === "bool") input.checked = Boolean(value);
    else input.value = String(value ?? "");
    row.classList.toggle("changed", this.#changed.has(name));
    undo.hidden = !this.#changed.has(name);
  }

  #search(words) {
    const parts = words.toLowerCase().split(/\s+/).filter(Boolean);
    for (const [name, { row, facts }] of this.#rows) row.hidden = !parts.every((part) => `${name} ${facts.words}`.toLowerCase().includes(part));
  }

  #count() {
    const count = this.#changed.size;
    write($("settings-count"), count ? `${count} changed` : `${this.facts?.length ?? 0}`);
  }
}
