// The settings of the configuration: by name, with unit and range, and a search.

import { $, button, make, option, write } from "./dom.js";

let rows = []; // {setting, row, input, undo, value (the preset's)}

export function showSettings(settings) {
  rows = settings.map(makeRow);
  $("settings-list").replaceChildren(...rows.map(({ row }) => row));
  $("settings").hidden = !rows.length;
  showPreset({}, {});
}

// Shows the values of a preset, and the values that differ from it: by default the changes of the user.
export function showPreset(values, changed = changedSettings()) {
  for (const one of rows) {
    const { name, value } = one.setting;
    one.value = values[name] ?? value;
    writeInput(one.input, changed[name] ?? one.value);
  }
  showChanged();
}

export const hasSettings = () => rows.length > 0;
const isChanged = ({ value, input }) => readInput(input) !== value;
export const changedSettings = () =>
  Object.fromEntries(rows.filter(isChanged).map(({ setting, input }) => [setting.name, readInput(input)]));

function makeInput({ type, low, high, options }, shared) {
  if (type === "bool") return make("input", { type: "checkbox", ...shared });
  if (type === "choice") return make("select", shared, ...options.map((value) => option(value)));
  if (type === "text") return make("input", { type: "text", maxLength: 200, ...shared });
  const step = type === "integer" ? "1" : "any";
  return make("input", { type: "number", required: true, step, min: low, max: high, ...shared });
}

// The property of an input with its value.
const valueKey = ({ type }) => ({ checkbox: "checked", number: "valueAsNumber" }[type] ?? "value");
const readInput = (input) => input[valueKey(input)];
const writeInput = (input, value) => (input[valueKey(input)] = value);

function makeRow(setting, k) {
  const { name, unit, low, high, words } = setting;
  const [id, help] = [`setting-${k}`, `setting-${k}-help`];
  const input = makeInput(setting, { id, data: { needs: "control" }, "aria-describedby": help, onchange: () => {
    input.reportValidity();
    showChanged();
  } });
  const undo = button("Undo", { "aria-label": `Undo ${name}`, onclick: () => {
    writeInput(input, one.value);
    showChanged();
  } });
  const from = low === null ? "" : `from ${low}`;
  const limits = high === null ? from : `${from || "up"} to ${high}`;
  const about = make("p", { id: help, text: [words, limits].filter(Boolean).join(" · ") }, make("span"));
  const row = make("div", { class: "setting" }, make("label", { htmlFor: id, text: unit ? `${name}, ${unit}` : name }),
    make("span", { class: "control" }, input, undo), about);
  const one = { setting, row, input, undo };
  return one;
}

function showChanged() {
  for (const one of rows) {
    one.row.classList.toggle("changed", isChanged(one));
    one.undo.hidden = !isChanged(one);
    write(one.row.querySelector("p span"), ` · in this preset ${one.value}`);
  }
  const changed = rows.filter(isChanged).length;
  write($("settings-count"), changed ? `${changed} changed` : String(rows.length));
}

// Here Escape clears the search, then leaves it; on the robot it is STOP, too.
$("settings-search").onkeydown = (event) => {
  if (event.key !== "Escape") return;
  event.preventDefault();
  if (!event.target.value) event.target.blur();
  event.target.value = "";
  event.target.dispatchEvent(new Event("input"));
};
$("settings-search").oninput = ({ target }) => {
  const terms = target.value.toLowerCase().split(/\s+/);
  for (const { row, setting } of rows) {
    row.hidden = !terms.every((term) => `${setting.name} ${setting.words}`.toLowerCase().includes(term));
  }
};
