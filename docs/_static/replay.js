// The player of the page "Replay": two recorded rounds on one time line. The modules of the page of `pacman-env web`
// draw the rounds and explain the choices; tools/replay.py writes both scripts that it reads.

const SPEEDS = [2, 4, 8, 16]; // times real time; the second one at first
const LONGEST_STEP_MS = 250; // between two pictures; after a longer break the rounds go on from where they were
const THUMB_PX = 16; // of the time line
const systemIsDark = matchMedia("(prefers-color-scheme: dark)");
const { open, markup, style } = window.replay_page;
const webPage = new DOMParser().parseFromString(markup, "text/html");

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
}

// An empty shadow root in the style of the web page, with its icons.
function shadowRoot(name) {
  const host = document.createElement("div");
  host.className = `replay-${name}`;
  const root = host.attachShadow({ mode: "open" });
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(style);
  root.adoptedStyleSheets = [sheet];
  root.append(webPage.querySelector("body > svg").cloneNode(true));
  return root;
}

const copyOf = (id) => webPage.getElementById(id).cloneNode(true);

// What the modules of the web page use of `document`: they find only the elements of one shadow root.
const documentOf = (root) => ({
  body: root.host,
  documentElement: root.host,
  get hidden() { return document.hidden; },
  get activeElement() { return root.activeElement; },
  getElementById: (id) => root.getElementById(id),
  querySelectorAll: (selector) => root.querySelectorAll(selector),
  createElement: (tag) => document.createElement(tag),
  addEventListener: (...listener) => document.addEventListener(...listener),
});

// One of the rounds: its outcome, its map, and why the robot drives where it drives.
class Round {
  constructor({ entry, scene, frames, whys }, hello) {
    const [policy] = entry.policies;
    this.root = shadowRoot("round panel-open"); // the map has no row of buttons
    Object.assign(this, { entry, whys, ticks: Object.keys(whys).map(Number) });
    const [map, panel] = [document.createElement("div"), copyOf("panel-why")];
    map.id = map.className = "map";
    map.append(...copyOf("map").children);
    this.root.append(map, panel, copyOf("reason"));
    const find = (id) => this.root.getElementById(id);
    Object.assign(this, open(documentOf(this.root)));
    const { make } = this.dom;
    map.append(this.figures = make("p", { class: "card now" }));
    map.before(make("div", { class: "outcome", data: { won: entry.result === "complete" } }, make("strong", { text: policy }),
      map.querySelector(".map-buttons"), make("span", { class: "result", text: outcome(entry, hello, this.dom.clock) })));
    find("top").setAttribute("aria-label", `Map of the round of ${policy}`);
    panel.hidden = false;
    for (const name of ["role", "aria-labelledby", "tabindex"]) panel.removeAttribute(name);
    panel.querySelector("h2").textContent = `Why this goal (${policy})`;
    panel.firstElementChild.append(make("details", {}, make("summary", { text: "All candidates and their terms" }),
      find("why-one"), panel.querySelector(".switch"), find("why-scroll")));
    // Fingers and the wheel scroll the documentation; with Ctrl the wheel zooms.
    map.addEventListener("wheel", (event) => event.ctrlKey || event.stopPropagation(), true);
    map.addEventListener("pointerdown", (event) => event.pointerType === "touch"
      && event.target.matches("canvas") && event.stopPropagation(), true);
    const shown = { ...scene, ghosts: scene.ghosts.map((ghost) => ({ ...ghost, ...hello.roles[ghost.role] })) };
    const story = { entry, frames, scene: shown, index: 0, trail: frames.map(({ true: pose }) => pose) };
    Object.assign(this.state.state, { hello, scene: shown, story });
  }

  // Moves to a tick; after a jump the map shows what both policies choose at this tick.
  show(tick, jump) {
    const { state, emit } = this.state;
    const { frames, trail } = state.story;
    const index = (state.story.index = Math.min(tick, frames.length - 1));
    const decided = this.ticks.findLast((one) => one <= tick);
    if (decided !== this.decided) emit("why", (state.why = this.whys[decided]));
    this.decided = decided;
    const [goal, other] = this.entry.policies.map((policy) => state.why.chosen[policy]);
    const chooses = jump && decided === tick && goal !== frames[index].goal;
    const frame = chooses ? { ...frames[index], goal, plan: [] } : frames[index];
    const ringed = jump && decided === tick && other !== goal ? other : -1;
    if (ringed !== this.ringed) state.candidate = this.ringed = ringed;
    this.map.showFrame(frame, { jump, path: trail.slice(0, index + 1) });
    this.dom.write(this.figures, `${this.dom.clock(frame.time_s)}, ${frame.collected} of ${frame.spawned} pellets`);
  }
}

function outcome({ result, catcher, collected, spawned, time_s: time }, { results, roles }, clock) {
  const by = catcher === null ? "" : ` by ${roles[`ghost-${catcher}`].name}`;
  return `${results[result]}${by} after ${clock(time)}${collected < spawned ? `, ${collected} of ${spawned} pellets` : ""}`;
}

// The controls of all rounds. Returns how to show a tick, how to play, and what keys do.
function control(rounds, root) {
  const { clock, make, option, setIcon, write } = rounds[0].dom;
  root.append(copyOf("story-bar"));
  const find = (id) => root.getElementById(`story-${id}`);
  const [bar, range, toggle] = ["bar", "range", "play"].map(find);
  const frames = rounds.map(({ state }) => state.state.story.frames);
  const last = Math.max(...frames.map(({ length }) => length)) - 1;
  const end_s = Math.max(...frames.map((all) => all.at(-1).time_s));
  const tick_s = frames[0][1].time_s - frames[0][0].time_s;
  const differing = [...new Set(rounds.flatMap(({ entry }) => entry.parts))].sort((a, b) => a - b);
  const names = rounds.map(({ entry }) => entry.policies[0]);
  let [at, request, since] = [0, 0, 0]; // ticks, with a fraction while playing; of the next picture; time of the last one

  // Shows a tick: the next one while playing, or after a jump, which pauses.
  function seek(to, jumps = true) {
    if (jumps) run();
    at = Math.max(0, Math.min(last, to));
    const tick = Math.floor(at);
    for (const round of rounds) round.show(tick, jumps);
    range.value = tick;
    range.ariaValueText = `${clock(tick * tick_s)} of ${clock(end_s)}`;
    write(find("at"), range.ariaValueText);
    write(find("title"), "Marks: the policies differ");
  }

  // Plays, or pauses without a request for the next picture.
  function run(next = 0) {
    cancelAnimationFrame(request);
    request = next;
    since = performance.now();
    toggle.ariaLabel = request ? "Pause" : "Play";
    setIcon(toggle, toggle.ariaLabel.toLowerCase());
  }

  function play() {
    if (at >= last) seek(0);
    run(requestAnimationFrame(advance));
  }

  function advance(now) {
    const to = at + (Number(speed.value) * Math.min(LONGEST_STEP_MS, Math.max(0, now - since))) / 1000 / tick_s;
    since = now;
    if (Math.floor(to) > Math.floor(at)) seek(to, false);
    else at = to;
    if (at >= last) run();
    else request = requestAnimationFrame(advance);
  }

  // To the next or previous decision in which the policies differ, after the last one to the first one.
  function jump(step) {
    const tick = Math.floor(at);
    const next = step > 0 ? differing.find((one) => one > tick) : differing.findLast((one) => one < tick);
    seek(next ?? differing.at(step > 0 ? 0 : -1));
    const where = names.filter((_, k) => rounds[k].entry.parts.includes(at));
    const words = where.length > 1 ? "both rounds" : where[0];
    write(find("title"), `Difference ${differing.indexOf(at) + 1} of ${differing.length}: ${words}`);
  }

  function drawMarks() {
    const [canvas, { clientWidth: width, clientHeight: height }] = [find("marks"), range];
    Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    context.fillStyle = "#e0407f";
    rounds.forEach(({ entry: { parts } }, k) => parts.forEach((tick) =>
      context.fillRect(THUMB_PX / 2 + ((width - THUMB_PX) * tick) / last - 1.5, k ? height - 11 : 2, 3, 9)));
  }

  function press(event) {
    const target = event.composedPath()[0];
    const act = { n: () => jump(1), p: () => jump(-1) }[event.key]
      ?? (target.matches("button, input, select, summary") ? null : {
        " ": () => toggle.onclick(), ArrowRight: () => seek(Math.floor(at) + 1), ArrowLeft: () => seek(Math.ceil(at) - 1),
      }[event.key]);
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  }

  bar.hidden = false;
  bar.ariaLabel = "Player";
  for (const element of [find("share"), find("close"), bar.querySelector(".legend")]) element.remove();
  for (const element of bar.querySelectorAll("[data-icon]")) setIcon(element, element.dataset.icon);
  find("title").replaceWith(make("span", { id: "story-title", role: "status" }));
  const speed = make("select", { "aria-label": "Speed" }, ...SPEEDS.map((times) => option(times, `×${times}`)));
  speed.selectedIndex = 1;
  find("at").after(speed);
  for (const [id, step, key] of [["previous", -1, "P"], ["next", 1, "N"]]) {
    find(id).onclick = () => jump(step);
    find(id).title = find(id).ariaLabel = `${id[0].toUpperCase()}${id.slice(1)} decision in which the policies differ (${key})`;
  }
  toggle.onclick = () => (request ? run() : play());
  range.max = last;
  range.ariaLabel = "Time";
  range.oninput = () => seek(Number(range.value));
  new ResizeObserver(drawMarks).observe(range);
  return { seek, play, press };
}

async function start(place) {
  const { hello, rounds: recorded } = await unpack(window.replay_rounds);
  const rounds = recorded.map((one) => new Round(one, hello));
  const bar = shadowRoot("player");
  const player = control(rounds, bar);
  const hosts = [...rounds.map(({ root }) => root), bar].map(({ host }) => host);
  const adoptTheme = () => {
    const { theme = "auto" } = document.body.dataset;
    const dark = theme === "auto" ? systemIsDark.matches : theme === "dark";
    for (const { dataset } of hosts) dataset.theme = dark ? "dark" : "light";
    for (const { map } of rounds) map.repaint();
  };
  adoptTheme();
  place.replaceChildren(...hosts);
  place.addEventListener("keydown", player.press);
  new MutationObserver(adoptTheme).observe(document.body, { attributeFilter: ["data-theme"] });
  systemIsDark.addEventListener("change", adoptTheme);
  await Promise.all(rounds.map(({ map, state }) => map.showScene(state.state.scene)));
  player.seek(0);
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
}

const place = document.querySelector(".replay");
start(place).catch((error) => {
  place.append(`The replay needs a browser from 2023 or newer (${error.message}).`);
});
