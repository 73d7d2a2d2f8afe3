// The settings of the configuration: by name, with unit and range, and a search.

import { $, button, make, option, write } from "./dom.js";
import { updateControls } from "./state.js";

let settings = []; // as the server describes them
const rows = new Map(); // by name: {setting, row, input, undo}; made when the list is opened
let changed = new Map(); // values other than the default, by name

export function showSettings(described) {
  settings = described;
  rows.clear();
  $("settings-list").replaceChildren();
  $("settings").hidden = !settings.length;
  buildRows();
  showCount();
}

export function setChanged(values) {
  changed = new Map(Object.entries(values ?? {}));
  for (const name of rows.keys()) fillRow(name);
  showCount();
}

export const hasSettings = () => settings.length > 0;
export const changedSettings = () => Object.fromEntries(changed);
export const settingsAreValid = () => [...rows.values()].every(({ input }) => input.checkValidity());

export function readSetting(name, text) {
  const type = settings.find((setting) => setting.name === name)?.type;
  if (type === "number" || type === "integer") return Number(text);
  return type === "bool" ? text.toLowerCase() === "true" : text;
}

function makeInput({ type, low, high, options }, shared) {
  if (type === "bool") return make("input", { type: "checkbox", ...shared });
  if (type === "choice") return make("select", shared, ...options.map((value) => option(value)));
  if (type === "text") return make("input", { type: "text", maxLength: 200, ...shared });
  return make("input", { type: "number", step: type === "integer" ? "1" : "any", min: low, max: high, ...shared });
}

function makeRow(setting, k) {
  const { name, unit, low, high, words } = setting;
  const id = `setting-${k}`;
  const change = () => {
    readInput(setting, input);
    fillRow(name);
    showCount();
  };
  const input = makeInput(setting, { id, data: { needs: "control" }, "aria-describedby": `${id}-words`, onchange: change });
  const undo = button("Undo", { "aria-label": `Undo ${name}`, onclick: () => {
    changed.delete(name);
    fillRow(name);
    showCount();
  } });
  const limits = low === null ? (high === null ? "" : `up to ${high}`) : high === null ? `from ${low}` : `${low} to ${high}`;
  const text = [words, limits, `default ${setting.value}`].filter(Boolean).join(" · ");
  const row = make("div", { class: "setting" }, make("label", { htmlFor: id, text: unit ? `${name}, ${unit}` : name }),
    make("span", { class: "control" }, input, undo), make("p", { id: `${id}-words`, text }));
  rows.set(name, { setting, row, input, undo });
  fillRow(name);
  return row;
}

function readInput({ name, type, value }, input) {
  if (!input.reportValidity() || (input.type === "number" && input.value === "")) return;
  const now = type === "bool" ? input.checked : input.type === "number" ? Number(input.value) : input.value;
  if (now === value) changed.delete(name);
  else changed.set(name, now);
}

function fillRow(name) {
  const { setting, row, input, undo } = rows.get(name);
  const value = changed.get(name) ?? setting.value;
  if (setting.type === "bool") input.checked = Boolean(value);
  else input.value = String(value ?? "");
  row.classList.toggle("changed", changed.has(name));
  undo.hidden = !changed.has(name);
}

function showCount() {
  write($("settings-count"), changed.size ? `${changed.size} changed` : String(settings.length));
}

function buildRows() {
  if (rows.size || !$("settings").open) return;
  $("settings-list").replaceChildren(...settings.map(makeRow));
  search();
  updateControls();
}

function search() {
  const terms = $("settings-search").value.toLowerCase().split(/\s+/);
  for (const [name, { row, setting }] of rows) {
    row.hidden = !terms.every((term) => `${name} ${setting.words}`.toLowerCase().includes(term));
  }
}

$("settings-search").oninput = search;
$("settings").ontoggle = buildRows;
