// What part of the world the canvas shows, what cards leave free of it, and the gestures that change it.

const TAP_PX = 9;
const TAP_MS = 700;
const LANDSCAPE = 1.1; // width of a plan by its height
const SPANS = 0.6; // share of the map's width or height from which a card covers a whole side
const SMALL = 0.08; // share of the map's area below which a card covers nothing
const LEAST_FREE = 0.4; // share of the map's width or height that cards leave free, or else they are ignored
const portrait = matchMedia("(max-width: 820px) and (orientation: portrait)");

export class View {
  scale = 40; // pixels of the page a metre
  x = 0;
  y = 0;
  width = 1;
  height = 1;
  insets = { top: 0, right: 0, bottom: 0, left: 0 }; // pixels that something covers
  turn = 0; // rad, counter-clockwise: a quarter on a portrait screen, if the plan is wider than high
  bounds = [-5, -5, 5, 5];
  fitted = true;
  following = false;

  // The free rectangle and its middle.
  get free() {
    const { top, right, bottom, left } = this.insets;
    return { x0: left, y0: top, x1: this.width - right, y1: this.height - bottom };
  }

  get middle() {
    const { x0, y0, x1, y1 } = this.free;
    return [(x0 + x1) / 2, (y0 + y1) / 2];
  }

  // A step to the right and up on the screen, in the same unit on the map.
  along(right, up) {
    return this.turn ? [up, -right] : [right, up];
  }

  toScreen(x, y) {
    const [dx, dy] = [(x - this.x) * this.scale, (y - this.y) * this.scale];
    return this.turn ? [this.width / 2 - dy, this.height / 2 - dx] : [this.width / 2 + dx, this.height / 2 - dy];
  }

  toWorld(px, py) {
    const [dx, dy] = this.along((px - this.width / 2) / this.scale, (this.height / 2 - py) / this.scale);
    return [this.x + dx, this.y + dy];
  }

  #fitScale() {
    const [[x0, y0, x1, y1], free] = [this.bounds, this.free];
    const margin = Math.min(this.width, this.height) < 600 ? 14 : 36;
    const [width, height] = [free.x1 - free.x0 - 2 * margin, free.y1 - free.y0 - 2 * margin];
    const [across, down] = this.turn ? [y1 - y0, x1 - x0] : [x1 - x0, y1 - y0];
    return Math.max(4, Math.min(width / across, height / down));
  }

  fit() {
    const [x0, y0, x1, y1] = this.bounds;
    this.turn = portrait.matches && x1 - x0 > LANDSCAPE * (y1 - y0) ? Math.PI / 2 : 0;
    this.scale = this.#fitScale();
    this.centre((x0 + x1) / 2, (y0 + y1) / 2);
    this.fitted = true;
  }

  // Shows a place in the middle of the free rectangle.
  centre(x, y) {
    [this.x, this.y] = [x, y];
    const [px, py] = this.middle;
    this.pan(px - this.width / 2, py - this.height / 2);
  }

  resize(width, height) {
    [this.width, this.height] = [width, height];
    if (this.fitted) this.fit();
  }

  zoom(times, [px, py] = this.middle) {
    const fixed = this.toWorld(px, py);
    this.scale = Math.min(400, Math.max(0.5 * this.#fitScale(), this.scale * times));
    const moved = this.toWorld(px, py);
    if (!this.following) {
      this.x += fixed[0] - moved[0];
      this.y += fixed[1] - moved[1];
    }
    this.fitted = false;
  }

  pan(dx, dy) {
    const [x, y] = this.along(dx / this.scale, -dy / this.scale);
    this.x -= x;
    this.y -= y;
    this.fitted = false;
  }
}

// What covers the map: rectangles of its shown elements with the attribute `data-covers`, in pixels of the map.
export function cardsOn(map) {
  const { left, top, width, height } = map.getBoundingClientRect();
  return [...map.querySelectorAll("[data-covers]")].map((card) => card.getBoundingClientRect())
    .filter((card) => card.width * card.height > SMALL * width * height
      || (card.width * card.height > 0 && (card.width > SPANS * width || card.height > SPANS * height)))
    .map((card) => ({ x0: card.left - left, x1: card.right - left, y0: card.top - top, y1: card.bottom - top }));
}

// The pixels that cards cover at each side of a map of this size.
export function insetsOf(cards, width, height) {
  const insets = { top: 0, right: 0, bottom: 0, left: 0 };
  const add = (side, pixels) => (insets[side] = Math.max(insets[side], pixels));
  for (const { x0, x1, y0, y1 } of cards) {
    if (x1 - x0 > SPANS * width) y0 + y1 < height ? add("top", y1) : add("bottom", height - y0);
    else x0 + x1 < width ? add("left", x1) : add("right", width - x0);
  }
  if (height - insets.top - insets.bottom < LEAST_FREE * height) insets.top = insets.bottom = 0;
  if (width - insets.left - insets.right < LEAST_FREE * width) insets.left = insets.right = 0;
  return insets;
}

export const isCovered = ([x, y], cards) => cards.some(({ x0, x1, y0, y1 }) => x > x0 && x < x1 && y > y0 && y < y1);

// Pan with one pointer, pinch with two, wheel; a tap and a hover are passed on.
export function setUpGestures(canvas, view, { changed, tapped, hovered, panned }) {
  const pointers = new Map();
  let begun = null;
  const place = ({ offsetX, offsetY }) => [offsetX, offsetY];
  const spread = () => {
    const [a, b = a] = [...pointers.values()];
    return { length: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    begun = pointers.size === 1 ? { at: place(event), time: performance.now() } : null;
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = place(event);
    if (!pointers.has(event.pointerId)) {
      hovered(now);
      return;
    }
    if (begun && Math.hypot(now[0] - begun.at[0], now[1] - begun.at[1]) < TAP_PX) return;
    if (begun) canvas.classList.add("grabbed");
    begun = null;
    const old = spread();
    pointers.set(event.pointerId, now);
    const { length, middle } = spread();
    view.pan(middle[0] - old.middle[0], middle[1] - old.middle[1]);
    if (old.length > 0) view.zoom(length / old.length, middle);
    if (pointers.size === 1) panned();
    changed();
  });
  const ended = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    canvas.classList.remove("grabbed");
    if (event.type === "pointerup" && begun && performance.now() - begun.time < TAP_MS) tapped(place(event));
    begun = null;
  };
  canvas.addEventListener("pointerup", ended);
  canvas.addEventListener("pointercancel", ended);
  canvas.addEventListener("pointerleave", () => hovered(null));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    view.zoom(Math.exp(-Math.max(-120, Math.min(120, event.deltaY * lines)) * 0.0022), place(event));
    changed();
  }, { passive: false });
}
