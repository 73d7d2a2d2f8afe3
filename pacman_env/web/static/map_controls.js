// The controls of the map: gestures, buttons and the list of layers.

import { make } from "./dom.js";
import { LAYERS } from "./map.js";
import { setUpGestures } from "./view.js";

export function setUpMapControls(map) {
  const { element, layers, root, state, view } = map;
  const find = (id) => root.getElementById(id);
  const [top, list] = [find("top"), find("layers-list")];
  const openLayers = (open) => {
    list.hidden = !open;
    find("layers").setAttribute("aria-expanded", String(open));
  };

  setUpGestures(top, view, {
    changed: () => map.redraw(),
    panned: () => map.follow(false),
    tapped: (at) => {
      map.hideCross();
      state.emit("tap", { world: view.toWorld(...at), candidate: map.candidateAt(at) });
    },
    hovered: (at) => {
      const ghost = state.role.startsWith("ghost"); // which goes anywhere
      const candidate = at && !ghost ? map.candidateAt(at) : -1;
      top.classList.toggle("pointing", ghost || (candidate >= 0 && state.role === "robot"));
      if (candidate !== state.candidate) state.emit("candidate", (state.candidate = candidate));
    },
  });
  state.on("placing", () => top.classList.toggle("placing", Boolean(state.placing)));
  element.addEventListener("pointerdown", ({ target }) => target === top && openLayers(false));
  find("zoom-in").onclick = () => map.zoom(1.4);
  find("zoom-out").onclick = () => map.zoom(1 / 1.4);
  find("fit").onclick = () => map.fit();
  find("follow").onclick = () => map.follow(!view.following);
  find("layers").onclick = () => openLayers(list.hidden);
  list.append(...Object.entries(LAYERS).map(([name, text]) => make("label", { class: "switch" }, make("input", {
    type: "checkbox", checked: layers[name], id: `layer-${name}`,
    onchange: ({ target }) => {
      layers[name] = target.checked;
      state.emit("layers");
      map.redraw(false);
    },
  }), make("span", { text }))));
}
