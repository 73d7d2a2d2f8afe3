// The picture of a map, drawn in the page's colours: walls with round edges at every zoom.

import { make } from "./dom.js";

const MOST_PIXELS = 4e6;

// The smallest rectangle around points: x0, y0, x1, y1.
export function boundsOf(points, margin = 0) {
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  return [Math.min(...xs) - margin, Math.min(...ys) - margin, Math.max(...xs) + margin, Math.max(...ys) + margin];
}

// A canvas with an image of this size, after a change of each pixel: of the four numbers of `data` from number k on.
function redrawn(image, width, height, change) {
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.imageSmoothingQuality = "high";
  context.drawImage(image, 0, 0, width, height);
  const pixels = context.getImageData(0, 0, width, height);
  for (let k = 0; k < pixels.data.length; k += 4) change(pixels.data, k);
  context.putImageData(pixels, 0, 0);
  return canvas;
}

export class MapPicture {
  #cells; // red: wall, green: known

  constructor(image, map, colours) {
    const { width, height } = image;
    this.map = map;
    this.zoom = Math.max(1, Math.min(5, Math.floor(Math.sqrt(MOST_PIXELS / (width * height))))); // pixels a cell
    let [left, top, right, bottom] = [width, height, 0, 0]; // of the known part
    this.#cells = redrawn(image, width, height, (data, k) => {
      const grey = (data[k] + data[k + 1] + data[k + 2]) / 3;
      const wall = grey < 100;
      const known = wall || grey > 225;
      data.set([wall ? 255 : 0, known ? 255 : 0, 0, 255], k);
      if (!known) return;
      const [x, y] = [(k / 4) % width, Math.floor(k / 4 / width)];
      [left, right] = [Math.min(left, x), Math.max(right, x + 1)];
      [top, bottom] = [Math.min(top, y), Math.max(bottom, y + 1)];
    });
    if (right === 0) [left, top, right, bottom] = [0, 0, width, height];
    const corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
    this.bounds = boundsOf(corners.map((cell) => this.#toWorld(cell)));
    this.paint(colours);
  }

  static async load(map, address, colours) {
    const image = new Image();
    image.src = address;
    await image.decode();
    return new MapPicture(image, map, colours);
  }

  #toWorld([column, row]) {
    const { resolution, height, origin } = this.map;
    const [x, y] = [column * resolution, (height - row) * resolution];
    const [cos, sin] = [Math.cos(origin[2] ?? 0), Math.sin(origin[2] ?? 0)];
    return [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y];
  }

  paint({ floor, wall }) {
    const { width, height } = this.#cells;
    const sharpened = (value) => Math.min(1, Math.max(0, (value - 85) / 90)); // how soft an edge is
    this.drawn = redrawn(this.#cells, width * this.zoom, height * this.zoom, (data, k) => {
      const [walled, known] = [sharpened(data[k]), sharpened(data[k + 1])];
      for (let c = 0; c < 3; c++) data[k + c] = floor[c] + (wall[c] - floor[c]) * walled;
      data[k + 3] = 255 * known;
    });
  }
}
