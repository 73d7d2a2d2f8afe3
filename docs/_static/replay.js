// The player of the page "Replay": two recorded rounds on one time line. The modules of the page of `pacman-env web`
// draw the rounds and explain the choices; tools/replay.py writes both scripts that it reads.

const MARK_COLOUR = "#e0407f";
const systemIsDark = matchMedia("(prefers-color-scheme: dark)");
const { markup, modules, style } = window.replay_page;
const { GameMap, setUpMapControls } = modules.map;
const { Player } = modules.player;
const { PageState } = modules.state;
const { WhyTable } = modules.why;
const { clock, make, setIcons, still, write } = modules.dom;
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

// One of the rounds: its outcome, its map, and why the robot drives where it drives.
class Round {
  constructor({ entry, scene, frames, whys }, hello) {
    const [policy] = entry.policies;
    this.root = shadowRoot("round");
    Object.assign(this, { entry, whys, ticks: Object.keys(whys).map(Number) });
    const [map, panel] = [document.createElement("div"), copyOf("panel-why")];
    map.id = map.className = "map";
    map.append(...copyOf("map").children);
    this.root.append(map, panel, copyOf("reason"));
    setIcons(this.root);
    const find = (id) => this.root.getElementById(id);
    const shown = { ...scene, ghosts: scene.ghosts.map((ghost) => ({ ...ghost, ...hello.roles[ghost.role] })) };
    this.story = { entry, frames, scene: shown, index: 0, trail: frames.map(({ true: pose }) => pose) };
    this.state = Object.assign(new PageState(), { hello, scene: shown, story: this.story });
    this.map = new GameMap(this.root, this.state);
    setUpMapControls(this.map);
    new WhyTable(this.root, this.state);
    map.append(this.figures = make("p", { class: "card now" }));
    map.before(make("div", { class: "outcome", data: { won: entry.result === "complete" } }, make("strong", { text: policy }),
      map.querySelector(".map-buttons"), make("span", { class: "result", text: outcome(entry, hello) })));
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
  }

  // Moves to a tick; after a jump the map shows what both policies choose at this tick.
  show(tick, jump) {
    const { state } = this;
    const { frames, trail } = this.story;
    const index = (this.story.index = Math.min(tick, frames.length - 1));
    const decided = this.ticks.findLast((one) => one <= tick);
    if (decided !== this.decided) state.emit("why", (state.why = this.whys[decided]));
    this.decided = decided;
    const [goal, other] = this.entry.policies.map((policy) => state.why.chosen[policy]);
    const chooses = jump && decided === tick && goal !== frames[index].goal;
    const frame = chooses ? { ...frames[index], goal, plan: [] } : frames[index];
    const ringed = jump && decided === tick && other !== goal ? other : -1;
    if (ringed !== this.ringed) state.candidate = this.ringed = ringed;
    this.map.showFrame(frame, { jump, path: trail.slice(0, index + 1) });
    write(this.figures, `${clock(frame.time_s)}, ${frame.collected} of ${frame.spawned} pellets`);
  }
}

function outcome({ result, catcher, collected, spawned, time_s: time }, { results, roles }) {
  const by = catcher === null ? "" : ` by ${roles[`ghost-${catcher}`].name}`;
  return `${results[result]}${by} after ${clock(time)}${collected < spawned ? `, ${collected} of ${spawned} pellets` : ""}`;
}

// The player of all rounds, in a shadow root.
function playerOf(rounds, root) {
  const bar = root.appendChild(copyOf("story-bar"));
  const find = (id) => root.getElementById(`story-${id}`);
  const frames = rounds.map(({ story }) => story.frames);
  const end_s = Math.max(...frames.map((all) => all.at(-1).time_s));
  const tick_s = frames[0][1].time_s - frames[0][0].time_s;
  const marks = [...new Set(rounds.flatMap(({ entry }) => entry.parts))].sort((a, b) => a - b);
  const names = rounds.map(({ entry }) => entry.policies[0]);
  const legend = "Marks: the policies differ";
  bar.hidden = false;
  bar.ariaLabel = "Player";
  for (const name of ["share", "save", "again", "close"]) find(name).remove();
  bar.querySelector(".legend").remove();
  setIcons(bar);
  find("range").ariaLabel = "Time";
  find("title").replaceWith(make("span", { id: "story-title", role: "status" }));
  for (const [id, key] of [["previous", "P"], ["next", "N"]]) {
    find(id).title = find(id).ariaLabel = `${id[0].toUpperCase()}${id.slice(1)} decision in which the policies differ (${key})`;
  }
  const player = new Player(root, {
    wraps: true,
    show(tick, jumps) {
      for (const round of rounds) round.show(tick, jumps);
      write(find("title"), legend);
      return `${clock(tick * tick_s)} of ${clock(end_s)}`;
    },
    jumped(tick) {
      const where = names.filter((_, k) => rounds[k].entry.parts.includes(tick));
      const words = where.length > 1 ? "both rounds" : where[0];
      write(find("title"), `Difference ${marks.indexOf(tick) + 1} of ${marks.length}: ${words}`);
    },
  });
  player.open({
    ticks: Math.max(...frames.map(({ length }) => length)), tick_s, marks,
    lanes: rounds.map(({ entry }, k) => [entry.parts, MARK_COLOUR, 9, k > 0]),
  });
  return player;
}

async function start(place) {
  const { hello, rounds: recorded } = await unpack(window.replay_rounds);
  const rounds = recorded.map((one) => new Round(one, hello));
  const bar = shadowRoot("player");
  const player = playerOf(rounds, bar);
  const hosts = [...rounds.map(({ root }) => root), bar].map(({ host }) => host);
  const adoptTheme = () => {
    const { theme = "auto" } = document.body.dataset;
    const dark = theme === "auto" ? systemIsDark.matches : theme === "dark";
    for (const { dataset } of hosts) dataset.theme = dark ? "dark" : "light";
    for (const { map } of rounds) map.repaint();
  };
  adoptTheme();
  place.replaceChildren(...hosts);
  place.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey || event.altKey)) player.press(event);
  });
  new MutationObserver(adoptTheme).observe(document.body, { attributeFilter: ["data-theme"] });
  systemIsDark.addEventListener("change", adoptTheme);
  await Promise.all(rounds.map(({ map, state }) => map.showScene(state.scene)));
  player.seek(0);
  if (!still.matches) player.play();
}

const place = document.querySelector(".replay");
start(place).catch((error) => {
  place.append(`The replay needs a browser from 2023 or newer (${error.message}).`);
});
