// What cards leave free of the map.

const SPANS = 0.6; // share of the map's width or height from which a card covers a whole side
const SMALL = 0.08; // share of the map's area below which a card covers nothing
const LEAST_FREE = 0.4; // share of the map's width or height that cards leave free, or else they are ignored

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
