// The player of the page "Replay": two recorded rounds on one time line. The modules of the page of `pacman-env web`
// draw the rounds and explain the choices; tools/replay.py writes both scripts that it reads.

const SPEEDS = [2, 4, 8, 16]; // times real time
const START_SPEED = 4;
const LONGEST_STEP_MS = 250; // between two pictures; after a longer break the rounds go on from where they were
const UNUSED = ["end", "ring", "countdown", "guide", "stick", "story-bar", "key"]; // parts of the map
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
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
    this.entry = entry;
    this.whys = whys;
    this.ticks = Object.keys(whys).map(Number);
    const [map, panel] = [document.createElement("div"), copyOf("panel-why")];
    map.id = map.className = "map";
    map.append(...copyOf("map").children);
    this.root.append(map, panel, copyOf("reason"));
    for (const id of UNUSED) this.#find(id).remove();
    Object.assign(this, open(documentOf(this.root)));
    const { make } = this.dom;
    this.figures = make("p", { class: "card now" });
    map.append(this.figures);
    map.before(make("div", { class: "outcome", data: { won: entry.result === "complete" } }, make("strong", { text: policy }),
      map.querySelector(".map-buttons"), make("span", { class: "result", text: outcome(entry, hello, this.dom.clock) })));
    this.#find("top").setAttribute("aria-label", `Map of the round of ${policy}`);
    panel.hidden = false;
    for (const name of ["role", "aria-labelledby", "tabindex"]) panel.removeAttribute(name);
    panel.querySelector("h2").textContent = `Why this goal (${policy})`;
    const terms = make("details", {}, make("summary", { text: "All candidates and their terms" }));
    terms.append(this.#find("why-one"), panel.querySelector(".switch"), this.#find("why-scroll"));
    panel.firstElementChild.append(terms);
    this.#leaveScrolling(map);
    const ghosts = scene.ghosts.map((ghost) => ({ ...ghost, ...hello.roles[ghost.role] }));
    Object.assign(this.state.state, { hello, scene: { ...scene, ghosts } });
    this.state.state.story = { entry, frames, scene: this.state.state.scene, index: 0, trail: frames.map(({ true: pose }) => pose) };
  }

  #find(id) {
    return this.root.getElementById(id);
  }

  // Fingers and the wheel scroll the documentation; with Ctrl the wheel zooms.
  #leaveScrolling(map) {
    map.addEventListener("wheel", (event) => event.ctrlKey || event.stopPropagation(), { capture: true });
    map.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch" && event.target.matches("canvas")) event.stopPropagation();
    }, { capture: true });
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

// How a round ends, in words.
function outcome({ result, catcher, collected, spawned, time_s: time }, { results, roles }, clock) {
  const by = catcher === null ? "" : ` by ${roles[`ghost-${catcher}`].name}`;
  return `${results[result]}${by} after ${clock(time)}${collected < spawned ? `, ${collected} of ${spawned} pellets` : ""}`;
}

// The controls of all rounds.
class Player {
  #at = 0; // ticks since the start, with a fraction while playing
  #speed = START_SPEED;
  #request = 0; // of the next picture, 0: paused
  #since = 0;

  constructor(rounds, root) {
    this.rounds = rounds;
    this.root = root;
    this.dom = rounds[0].dom;
    const frames = rounds.map(({ state }) => state.state.story.frames);
    this.last = Math.max(...frames.map(({ length }) => length)) - 1;
    this.tick_s = frames[0][1].time_s - frames[0][0].time_s;
    this.end_s = Math.max(...frames.map((all) => all.at(-1).time_s));
    this.differing = [...new Set(rounds.flatMap(({ entry }) => entry.parts))].sort((a, b) => a - b);
    this.#build();
  }

  #find(id) {
    return this.root.getElementById(id);
  }

  #build() {
    const { make, option, setIcon } = this.dom;
    const bar = copyOf("story-bar");
    this.root.append(bar);
    bar.hidden = false;
    bar.setAttribute("aria-label", "Player");
    for (const id of ["story-share", "story-close"]) this.#find(id).remove();
    for (const element of bar.querySelectorAll("[data-icon]")) setIcon(element, element.dataset.icon);
    const names = this.rounds.map(({ entry }) => entry.policies[0]);
    bar.querySelector(".legend").remove();
    const legend = `Marks: decisions in which the policies differ (above in the round of ${names[0]}, below of ${names[1]})`;
    this.#find("story-title").replaceWith(make("span", { id: "story-title", role: "status", text: legend }));
    const speed = make("select", { "aria-label": "Speed" }, ...SPEEDS.map((times) => option(times, `×${times}`)));
    speed.value = START_SPEED;
    speed.onchange = () => (this.#speed = Number(speed.value));
    bar.querySelector(".story-head").append(speed);
    for (const [id, step, label] of [["story-previous", -1, "Previous (P)"], ["story-next", 1, "Next (N)"]]) {
      this.#find(id).onclick = () => this.jump(step);
      this.#find(id).title = `${label} decision in which the policies differ`;
      this.#find(id).setAttribute("aria-label", this.#find(id).title);
    }
    this.#find("story-play").onclick = () => this.toggle();
    Object.assign(this.#find("story-range"), { max: this.last, ariaLabel: "Time", oninput: ({ target }) => {
      this.pause();
      this.seek(Number(target.value));
    } });
    new ResizeObserver(() => this.#drawMarks()).observe(this.#find("story-range"));
  }

  seek(at, jump = true) {
    this.#at = Math.max(0, Math.min(this.last, at));
    const tick = Math.floor(this.#at);
    for (const round of this.rounds) round.show(tick, jump);
    const text = `${this.dom.clock(tick * this.tick_s)} of ${this.dom.clock(this.end_s)}`;
    this.#find("story-range").value = tick;
    this.#find("story-range").setAttribute("aria-valuetext", text);
    this.dom.write(this.#find("story-at"), text);
  }

  // To the next or previous decision in which the policies differ, after the last one to the first one.
  jump(step) {
    this.pause();
    const [tick, all] = [Math.floor(this.#at), this.differing];
    const next = step > 0 ? all.find((one) => one > tick) ?? all[0] : all.findLast((one) => one < tick) ?? all.at(-1);
    this.seek(next);
    const names = this.rounds.filter(({ entry }) => entry.parts.includes(next)).map(({ entry }) => entry.policies[0]);
    const where = names.length > 1 ? "in both rounds" : `in the round of ${names[0]}`;
    this.dom.write(this.#find("story-title"), `The policies differ ${where} (${all.indexOf(next) + 1} of ${all.length}).`);
  }

  toggle() {
    if (this.#request) this.pause();
    else this.play();
  }

  play() {
    if (this.#at >= this.last) this.seek(0);
    this.#since = performance.now();
    this.#request = requestAnimationFrame((now) => this.#advance(now));
    this.#showPlaying();
  }

  pause() {
    cancelAnimationFrame(this.#request);
    this.#request = 0;
    this.#showPlaying();
  }

  #advance(now) {
    const [before, ms] = [Math.floor(this.#at), Math.min(LONGEST_STEP_MS, Math.max(0, now - this.#since))];
    this.#since = now;
    this.#at = Math.min(this.last, this.#at + (this.#speed * ms) / 1000 / this.tick_s);
    if (Math.floor(this.#at) > before) this.seek(this.#at, false);
    if (this.#at >= this.last) this.pause();
    else this.#request = requestAnimationFrame((later) => this.#advance(later));
  }

  #showPlaying() {
    this.#find("story-play").setAttribute("aria-label", this.#request ? "Pause" : "Play");
    this.dom.setIcon(this.#find("story-play"), this.#request ? "pause" : "play");
  }

  #drawMarks() {
    const [canvas, thumb] = [this.#find("story-marks"), 16];
    const { clientWidth: width, clientHeight: height } = this.#find("story-range");
    Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    context.fillStyle = "#e0407f";
    this.rounds.forEach(({ entry }, k) => {
      for (const tick of entry.parts) {
        context.fillRect(thumb / 2 + ((width - thumb) * tick) / this.last - 1.5, k ? height - 11 : 2, 3, 9);
      }
    });
  }

  press(event) {
    const target = event.composedPath()[0];
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && !target.matches("button, input, select, summary")) this.toggle();
    else if (event.key === "n") this.jump(1);
    else if (event.key === "p") this.jump(-1);
    else if (step && !target.matches("input, select")) {
      this.pause();
      this.seek(Math.floor(this.#at) + step);
    } else return;
    event.preventDefault();
  }
}

async function start(place) {
  const { hello, rounds: recorded } = await unpack(window.replay_rounds);
  const rounds = recorded.map((one) => new Round(one, hello));
  const player = new Player(rounds, shadowRoot("player"));
  const hosts = [...rounds, player].map(({ root }) => root.host);
  const adoptTheme = () => {
    const { theme = "auto" } = document.body.dataset;
    const dark = theme === "auto" ? systemIsDark.matches : theme === "dark";
    for (const { dataset } of hosts) dataset.theme = dark ? "dark" : "light";
    for (const { map } of rounds) map.repaint();
  };
  adoptTheme();
  place.replaceChildren(...hosts);
  place.addEventListener("keydown", (event) => player.press(event));
  new MutationObserver(adoptTheme).observe(document.body, { attributeFilter: ["data-theme"] });
  systemIsDark.addEventListener("change", adoptTheme);
  await Promise.all(rounds.map(({ map, state }) => map.showScene(state.state.scene)));
  player.seek(0);
  if (!reducedMotion.matches) player.play();
}

const place = document.querySelector(".replay");
start(place).catch((error) => {
  place.append(`The replay needs a browser from 2023 or newer (${error.message}).`);
});
