// The colours of the map, dark and light; the page's other colours are in style/base.css.

import { stored } from "./dom.js";

const DARK = {
  page: "#0d1018", floor: [27, 34, 51], wall: [98, 122, 220], pellet: "#ffd54a", eaten: "#3b465f", refuge: "#4fd1b5",
  home: "#9fb0d0", robot: "#ffcc1f", rim: "#10141f", believed: "#d59bff", plan: "#7fa9ff", trail: "#ffcc1f",
  score: "#4fd1b5", lidar: "#ff7a9c", ink: "#eef1f8", halo: "#0d1018", baseline: "#c9d3e8", goal: "#ffffff",
  ghost: "#e6ebf7", points: "#7ff0ff",
};
const LIGHT = {
  page: "#dfe3ec", floor: [255, 255, 253], wall: [45, 52, 73], pellet: "#f0b400", eaten: "#d3d8e2", refuge: "#0b8a72",
  home: "#5b6782", robot: "#ffc400", rim: "#2a2100", believed: "#8a2fc9", plan: "#1f5fe0", trail: "#c98f00",
  score: "#0b8a72", lidar: "#d81e5b", ink: "#171c2b", halo: "#ffffff", baseline: "#7c879e", goal: "#171c2b",
  ghost: "#2a2100", points: "#0b5c8a",
};
const systemIsLight = matchMedia("(prefers-color-scheme: light)");
const KEY = "pacman_env.theme";

// The data of the element with the theme: of a document, or of the host of a shadow root.
const dataOf = (root) => (root.host ?? root.documentElement).dataset;
const isLight = ({ theme = systemIsLight.matches ? "light" : "dark" }) => theme === "light";
export const palette = (root = document) => (isLight(dataOf(root)) ? LIGHT : DARK);

export function setUpTheme(button, changed) {
  const page = dataOf(document);
  const chosen = stored("localStorage", KEY);
  if (chosen === "light" || chosen === "dark") page.theme = chosen;
  button.onclick = () => {
    page.theme = isLight(page) ? "dark" : "light";
    stored("localStorage", KEY, page.theme);
    changed();
  };
  systemIsLight.onchange = changed;
}
