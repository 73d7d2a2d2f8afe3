// Why this pellet: the terms of each candidate, for two policies side by side.

import { $, make, write } from "./dom.js";
import { on, shownScene, state, tell } from "./state.js";

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
  #facts = null;

  constructor(connection) {
    this.connection = connection;
    on("why", () => this.show());
    on("candidate", () => this.#light());
    $("why-full").addEventListener("change", () => this.show(true));
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
    return { columns, same };
  }

  show(again = false) {
    const { why } = state;
    if ($("panel-why").hidden) return;
    const key = JSON.stringify(why);
    if (key === this.#shown && !again) return;
    this.#shown = key;
    const table = $("why-table");
    $("why-scroll").hidden = !why?.rows?.length;
    if (!why?.rows?.length) {
      table.replaceChildren();
      this.#facts = null;
      this.#one();
      $("why-words").replaceChildren(why ? "Nothing could be chosen at this moment." : "Start a round: each decision is shown here.");
      write($("why-same"), "");
      return;
    }
    const { policies, rows, chosen } = why;
    const scene = shownScene();
    const { kinds } = state.hello;
    const first = scene?.first_refuge ?? 0;
    const name = (candidate) => {
      const row = rows.find((one) => one.candidate === candidate);
      if (!row) return candidate < 0 ? "nothing" : `candidate ${candidate}`;
      return row.kind === "hold" ? kinds.hold : `${kinds[row.kind] ?? words(row.kind)} ${(row.kind === "refuge" ? candidate - first : candidate) + 1}`;
    };
    const parted = policies.length > 1 && chosen[policies[0]] !== chosen[policies[1]];
    $("why-words").replaceChildren(
      parted ? make("span", { class: "parted", text: "The policies disagree. " }) : "",
      `At ${why.time_s.toFixed(1)} s. ` + policies.map((policy) => `${policy}: ${name(chosen[policy])}.`).join(" "),
    );
    const full = $("why-full").checked;
    const about = Object.fromEntries(policies.map((policy) => [policy, this.#terms(rows, policy)]));
    const columns = Object.fromEntries(policies.map((policy) => [policy, full ? [...about[policy].columns, "rank"] : [this.#main(about[policy].columns), "rank"]]));
    const order = (policy) => [...rows].sort((a, b) => this.#rank(b, policy) - this.#rank(a, policy));
    const ranks = Object.fromEntries(policies.map((policy) => [policy, new Map(order(policy).map(({ candidate }, k) => [candidate, k + 1]))]));
    const head = make("thead", {},
      make("tr", {}, make("td", {}), ...policies.map((policy, k) => make("th", { scope: "colgroup", colSpan: columns[policy].length, class: k ? "second" : "", text: policy }))),
      make("tr", {}, make("th", { scope: "col", text: "Candidate" }), ...policies.flatMap((policy, g) => columns[policy].map((column, k) => make("th", { scope: "col", class: g && !k ? "second" : "", text: words(column) })))));
    const body = make("tbody", {}, ...order(policies[0]).map((row) => {
      const { candidate, terms, kind } = row;
      const point = (on_) => () => tell("candidate", (state.candidate = on_ && kind !== "hold" ? candidate : -1));
      const by = policies.filter((policy) => chosen[policy] === candidate);
      const apart = policies.length > 1 && Math.abs(ranks[policies[0]].get(candidate) - ranks[policies[1]].get(candidate)) > 2;
      return make("tr", { class: parted && by.length ? "parts" : "", data: { candidate }, onmouseenter: point(true), onmouseleave: point(false) },
        make("th", { scope: "row" }, make("button", { type: "button", text: (by.length ? "★ " : "") + name(candidate), title: by.length ? `chosen by ${by.join(" and ")}` : "Show on the map",
          onfocus: point(true), onblur: point(false), onclick: () => this.#go(candidate, kind) })),
        ...policies.flatMap((policy, g) => columns[policy].map((column, k) => {
          const said = column === "rank" ? (Number.isFinite(this.#rank(row, policy)) ? String(ranks[policy].get(candidate)) : "–") : value(terms[policy]?.[column]);
          const names = [g && !k ? "second" : "", chosen[policy] === candidate ? "chosen" : "", column === "rank" && apart && said !== "–" ? "apart" : "", said === "–" ? "none" : ""];
          return make("td", { class: names.filter(Boolean).join(" "), text: said });
        })));
    }));
    this.#facts = { rows, policies, name, goal: chosen[policies[0]] };
    const active = document.activeElement?.closest?.("#why-table tr")?.dataset.candidate;
    table.replaceChildren(make("caption", { class: "hidden", text: "Candidates and their terms, the best of the first policy first" }), head, body);
    if (active !== undefined) table.querySelector(`tr[data-candidate="${active}"] button`)?.focus();
    const same = policies.filter((policy) => about[policy].same.length).map((policy) => `${policy}: ${about[policy].same.join(", ")}`);
    write($("why-same"), same.length ? `Equal for all candidates. ${same.join(". ")}.` : "");
    this.#light();
  }

  // All terms of one candidate, the policies beside each other.
  #one() {
    const { rows, policies, name, goal } = this.#facts ?? {};
    const row = rows?.find(({ candidate }) => candidate === state.candidate) ?? rows?.find(({ candidate }) => candidate === goal);
    $("why-one").hidden = !row;
    if (!row) return;
    $("why-one").replaceChildren(make("strong", { text: name(row.candidate) }), make("div", { class: "pair" }, ...policies.map((policy) => make("div", {}, make("span", { class: "quiet", text: policy }),
      make("dl", { class: "facts" }, ...Object.entries(row.terms[policy] ?? {}).flatMap(([term, said]) => [make("dt", { text: words(term) }), make("dd", { text: value(said) })]))))));
  }

  #main(columns) {
    return columns.find((name) => name === "score") ?? columns.find((name) => name === "total") ?? columns[0] ?? "score";
  }

  // The higher the better; a policy that gives costs has "total".
  #rank({ terms }, policy) {
    const mine = terms[policy] ?? {};
    if (typeof mine.score === "number") return mine.score;
    return typeof mine.total === "number" ? -mine.total : -Infinity;
  }

  async #go(candidate, kind) {
    if (state.role === "robot" && !state.story) await this.connection.ask({ do: "goal", candidate: kind === "hold" ? -1 : candidate });
  }

  #light() {
    if ($("panel-why").hidden) return;
    this.#one();
    for (const row of $("why-table").querySelectorAll("tr[data-candidate]")) row.classList.toggle("lit", Number(row.dataset.candidate) === state.candidate);
  }
}
