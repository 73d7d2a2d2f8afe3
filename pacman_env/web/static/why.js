// Why this goal: the terms of each candidate, for two policies side by side.

import { facts, make, renderReleased, write, writeOrHide } from "./dom.js";

const MISSING = "–";
const RANK_LIMIT = 2; // a larger difference of the policies' ranks is marked

const ordinal = (n) => `${n}${["th", "st", "nd", "rd"][n % 100 > 10 && n % 100 < 14 ? 0 : n % 10] ?? "th"}`;
const merit = ({ terms }, policy) => terms[policy]?.score ?? -Infinity; // the higher the better

// What the table shows of one policy: its terms, the one that decides or all that differ, and each candidate's rank.
function summarise(rows, policy, all) {
  const names = [...new Set(rows.flatMap(({ terms }) => Object.keys(terms[policy] ?? {})))];
  const differ = names.filter((name) => new Set(rows.map(({ terms }) => terms[policy]?.[name])).size > 1);
  const order = [...rows].sort((a, b) => merit(b, policy) - merit(a, policy));
  const ranks = new Map(order.map(({ candidate }, k) => [candidate, k + 1]));
  return { policy, columns: [...(all ? differ : ["score"]), "rank"], order, ranks };
}

export class WhyTable {
  #pointAt = (candidate) => this.state.emit("candidate", (this.state.candidate = candidate));
  #find = (id) => this.root.getElementById(id);
  // A term in words: its plain name, its unit, and how much of the unit 1 is.
  #termOf = (name) => this.state.hello.terms[name] ?? [name.replaceAll("_", " "), "", 1];
  #labelOf = (name) => this.#termOf(name).slice(0, 2).filter(Boolean).join(", ");

  // `root` is the document or shadow root with the panel.
  constructor(root, state) {
    Object.assign(this, { root, state });
    state.on("why tab", () => renderReleased(this.#find("why-table"), () => this.#show()));
    state.on("candidate", () => this.#showCandidate());
    this.#find("why-full").onchange = () => this.#show();
  }

  #format(name, term) {
    if (term === null || term === undefined) return MISSING;
    if (typeof term === "boolean") return term ? "yes" : "no";
    if (typeof term !== "number") return term;
    const [, unit, factor] = this.#termOf(name);
    const value = term * factor;
    return value.toFixed(unit === "%" || Math.abs(value) >= 100 || (Number.isInteger(term) && factor === 1) ? 0 : 2);
  }

  #nameOf(candidate) {
    const row = this.state.why.rows.find((one) => one.candidate === candidate);
    if (!row) return candidate < 0 ? "nothing" : `candidate ${candidate}`;
    if (row.kind === "hold") return "Hold";
    const name = this.state.shownScene?.names?.[candidate] ?? `candidate ${candidate}`;
    return name[0].toUpperCase() + name.slice(1);
  }

  // Who comes first, in words.
  #race(later) {
    if (!Number.isFinite(later)) return "";
    const ghosts = this.state.shownScene?.ghosts ?? [];
    const who = ghosts.length === 1 ? ghosts[0].name : "the nearest ghost";
    const seconds = Math.round(Math.abs(later));
    if (!seconds) return `; ${who} can be there at the same time`;
    return later > 0 ? `; ${who} needs ${seconds} s longer` : `; ${who} can be there ${seconds} s earlier`;
  }

  // A candidate in a sentence: which, how far, and whether a ghost is faster.
  #sentenceOf(candidate) {
    const row = this.state.why.rows.find((one) => one.candidate === candidate);
    if (!row) return "";
    if (row.kind === "hold") return `${this.#nameOf(candidate)}: the robot waits where it is.`;
    const { robot_m: distance, ghost_later_s: later } = row;
    if (!Number.isFinite(distance)) return "";
    const rivals = this.state.why.rows.filter(({ kind, robot_m: other }) => kind === row.kind && other < distance);
    const rank = rivals.length ? `${ordinal(rivals.length + 1)} nearest` : "nearest";
    return `${this.#nameOf(candidate)}: ${rank}, ${distance.toFixed(1)} m${this.#race(later)}.`;
  }

  #tableHead(summaries) {
    const head = (scope, text, second, colSpan) => make("th", { scope, text, colSpan, class: second ? "second" : "" });
    return make("thead", {},
      make("tr", {}, make("td"), ...summaries.map(({ policy, columns }, k) =>
        head("colgroup", policy, k > 0, columns.length))),
      make("tr", {}, head("col", "Candidate", false), ...summaries.flatMap(({ columns }, policy) =>
        columns.map((name, k) => head("col", this.#labelOf(name), policy > 0 && k === 0)))));
  }

  #tableRow(row, summaries, disagree) {
    const { candidate, terms, kind } = row;
    const by = summaries.map(({ policy }) => policy).filter((policy) => this.state.why.chosen[policy] === candidate);
    const [first, second = first] = summaries.map(({ ranks }) => ranks.get(candidate));
    const place = kind === "hold" ? -1 : candidate;
    const [point, leave] = [() => this.#pointAt(place), () => this.#pointAt(-1)];
    const onclick = () => this.state.emit("choose", place);
    const cells = summaries.flatMap(({ policy, columns, ranks }, k) => columns.map((column) => {
      const rank = Number.isFinite(merit(row, policy)) ? ranks.get(candidate) : null;
      const text = this.#format(column, column === "rank" ? rank : terms[policy]?.[column]);
      const classes = {
        second: k && column === columns[0], chosen: by.includes(policy), none: text === MISSING,
        differs: column === "rank" && rank && Math.abs(first - second) > RANK_LIMIT,
      };
      return make("td", { class: Object.keys(classes).filter((name) => classes[name]).join(" "), text });
    }));
    return make("tr", {
      class: disagree && by.length ? "disagree" : "", data: { candidate }, onmouseenter: point, onmouseleave: leave,
    }, make("th", { scope: "row" }, make("button", {
      type: "button", text: (by.length ? "★ " : "") + this.#nameOf(candidate), onfocus: point, onblur: leave, onclick,
      title: by.length ? `chosen by ${by.join(" and ")}` : "Show on the map",
    })), ...cells);
  }

  #show() {
    if (this.#find("panel-why").hidden) return;
    const { why } = this.state;
    const hint = why ? "Nothing could be chosen at this moment." : "Start a round: each decision is shown here.";
    this.#find("why-scroll").hidden = !why?.rows?.length;
    if (why?.rows?.length) this.#showTable(why);
    else for (const [id, text] of [["table", ""], ["words", hint]]) write(this.#find(`why-${id}`), text);
    writeOrHide(this.#find("why-sentence"), why?.rows?.length ? this.#sentenceOf(why.chosen[why.policies[0]]) : "");
    this.#showCandidate();
  }

  #showTable({ policies, rows, chosen, goal, time_s: time }) {
    const disagree = policies.length > 1 && chosen[policies[0]] !== chosen[policies[1]];
    const player = this.state.story?.entry.player === "person" ? ` The player: ${this.#nameOf(goal)}.` : "";
    this.#find("why-words").replaceChildren(
      disagree ? make("span", { class: "disagreement", text: "The policies disagree. " }) : "",
      `At ${time.toFixed(1)} s. ` + policies.map((policy) => `${policy}: ${this.#nameOf(chosen[policy])}.`).join(" ") + player,
    );
    const summaries = policies.map((policy) => summarise(rows, policy, this.#find("why-full").checked));
    const active = this.root.activeElement?.closest?.("#why-table tr")?.dataset.candidate;
    this.#find("why-table").replaceChildren(
      make("caption", { class: "hidden", text: "Candidates and their terms, the best of the first policy first" }),
      this.#tableHead(summaries),
      make("tbody", {}, ...summaries[0].order.map((row) => this.#tableRow(row, summaries, disagree))),
    );
    if (active !== undefined) this.#find("why-table").querySelector(`tr[data-candidate="${active}"] button`)?.focus();
  }

  // All terms of the candidate pointed at, or else of the first policy's choice.
  #showCandidate() {
    if (this.#find("panel-why").hidden) return;
    const { policies, rows, chosen } = this.state.why?.rows?.length ? this.state.why : { rows: [] };
    const row = rows.find(({ candidate }) => candidate === this.state.candidate)
      ?? rows.find(({ candidate }) => candidate === chosen[policies[0]]);
    this.#find("why-one").hidden = !row;
    if (!row) return;
    const terms = (policy) => Object.entries(row.terms[policy] ?? {})
      .map(([name, term]) => [this.#labelOf(name), this.#format(name, term)]);
    const columns = policies.map((policy) => make("div", {}, make("span", { class: "quiet", text: policy }),
      make("dl", { class: "facts" }, ...facts(terms(policy)))));
    const name = make("strong", { text: this.#nameOf(row.candidate) });
    this.#find("why-one").replaceChildren(name, make("div", { class: "pair" }, ...columns));
    for (const line of this.#find("why-table").querySelectorAll("tr[data-candidate]")) {
      line.classList.toggle("lit", Number(line.dataset.candidate) === this.state.candidate);
    }
  }
}
