// Why this pellet: the terms of each candidate, for two policies side by side.

import { $, make, write } from "./dom.js";
import { on, shownScene, state, tell } from "./state.js";

const HIDDEN = new Set(["score"]); // of a policy that says more than that
const words = (name) => name.replaceAll("_", " ");

function value(term) {
  if (term === null || term === undefined) return "–";
  if (typeof term === "boolean") return term ? "yes" : "no";
  if (typeof term !== "number") return String(term);
  if (Number.isInteger(term)) return String(term);
  return Math.abs(term) >= 100 ? term.toFixed(0) : term.toFixed(2);
}

export class Why {
  #shown = "";

  constructor(connection) {
    this.connection = connection;
    on("why", () => this.show());
    on("candidate", () => this.#light());
  }

  // The terms of one policy that tell its candidates apart, and those that are the same for all.
  #terms(rows, policy) {
    const names = [...new Set(rows.flatMap(({ terms }) => Object.keys(terms[policy] ?? {})))];
    const columns = [];
    const same = [];
    for (const name of names) {
      const values = new Set(rows.map(({ terms }) => value(terms[policy]?.[name])));
      if (values.size > 1 || rows.length === 1) columns.push(name);
      else if (!values.has("–")) same.push(`${words(name)} ${[...values][0]}`);
    }
    const doubled = columns.includes("total") && columns.includes("score");
    return { columns: columns.filter((name) => !(doubled && HIDDEN.has(name))), same };
  }

  show() {
    const { why } = state;
    if ($("panel-why").hidden) return;
    const key = JSON.stringify(why);
    if (key === this.#shown) return;
    this.#shown = key;
    const table = $("why-table");
    $("why-scroll").hidden = !why?.rows?.length;
    if (!why?.rows?.length) {
      table.replaceChildren();
      $("why-words").replaceChildren(why ? "Nothing could be chosen at this moment." : "Start a round: each decision is shown here.");
      write($("why-same"), "");
      return;
    }
    const { policies, rows, chosen } = why;
    const scene = shownScene();
    const kinds = { pellet: "Pellet", refuge: "Refuge", hold: "Hold" };
    const first = scene?.first_refuge ?? 0;
    const name = (candidate) => {
      const row = rows.find((one) => one.candidate === candidate);
      if (!row) return candidate < 0 ? "nothing" : `candidate ${candidate}`;
      return row.kind === "hold" ? "Hold" : `${kinds[row.kind] ?? words(row.kind)} ${(row.kind === "refuge" ? candidate - first : candidate) + 1}`;
    };
    const parted = policies.length > 1 && chosen[policies[0]] !== chosen[policies[1]];
    $("why-words").replaceChildren(
      parted ? make("span", { class: "parted", text: "The policies part. " }) : "",
      `At ${why.time_s.toFixed(1)} s. ` + policies.map((policy) => `${policy}: ${name(chosen[policy])}.`).join(" "),
    );
    const about = Object.fromEntries(policies.map((policy) => [policy, this.#terms(rows, policy)]));
    const groups = policies.filter((policy) => about[policy].columns.length);
    const sorted = [...rows].sort((a, b) => this.#rank(b, policies[0]) - this.#rank(a, policies[0]));
    const places = Object.fromEntries(policies.map((policy) => [policy, new Map([...rows].sort((a, b) => this.#rank(b, policy) - this.#rank(a, policy)).map((row, k) => [row.candidate, k]))]));
    const head = make("thead", {},
      make("tr", {}, make("td", {}), ...groups.map((policy, k) => make("th", { scope: "colgroup", colSpan: about[policy].columns.length, class: k ? "second" : "", text: policy }))),
      make("tr", {}, make("th", { scope: "col", text: "Candidate" }), ...groups.flatMap((policy, g) => about[policy].columns.map((column, k) => make("th", { scope: "col", class: g && !k ? "second" : "", text: words(column) })))));
    const body = make("tbody", {}, ...sorted.map((row) => {
      const { candidate, terms } = row;
      const point = (on_) => () => tell("candidate", (state.candidate = on_ && row.kind !== "hold" ? candidate : -1));
      const differs = policies.length > 1 && (policies.some((policy) => chosen[policy] === candidate) ? parted : Math.abs(places[policies[0]].get(candidate) - places[policies[1]].get(candidate)) > 2);
      const marks = policies.filter((policy) => chosen[policy] === candidate);
      return make("tr", { class: differs ? "parts" : "", data: { candidate }, onmouseenter: point(true), onmouseleave: point(false) },
        make("th", { scope: "row" }, make("button", { type: "button", text: (marks.length ? "★ " : "") + name(candidate), title: marks.length ? `chosen by ${marks.join(" and ")}` : "Show on the map",
          onfocus: point(true), onblur: point(false), onclick: () => this.#go(candidate, row.kind) })),
        ...groups.flatMap((policy, g) => about[policy].columns.map((column, k) => make("td", {
          class: [g && !k ? "second" : "", chosen[policy] === candidate ? "chosen" : "", differs ? "differs" : "", value(terms[policy]?.[column]) === "–" ? "none" : ""].filter(Boolean).join(" "),
          text: value(terms[policy]?.[column]) }))));
    }));
    const active = document.activeElement?.closest?.("#why-table tr")?.dataset.candidate;
    table.replaceChildren(make("caption", { class: "hidden", text: "Candidates and their terms, the best of the first policy first" }), head, body);
    if (active !== undefined) table.querySelector(`tr[data-candidate="${active}"] button`)?.focus();
    const same = policies.filter((policy) => about[policy].same.length).map((policy) => `${policy}: ${about[policy].same.join(", ")}`);
    write($("why-same"), same.length ? `The same for all. ${same.join(". ")}.` : "");
    this.#light();
  }

  // The higher the better; a policy that gives costs has "total".
  #rank({ terms }, policy) {
    const mine = terms[policy] ?? {};
    if (typeof mine.score === "number") return mine.score;
    return typeof mine.total === "number" ? -mine.total : -Infinity;
  }

  async #go(candidate, kind) {
    if (state.seat === "robot" && !state.story) await this.connection.ask({ do: "goal", candidate: kind === "hold" ? -1 : candidate });
  }

  #light() {
    for (const row of $("why-table").querySelectorAll("tr[data-candidate]")) row.classList.toggle("lit", Number(row.dataset.candidate) === state.candidate);
  }
}
