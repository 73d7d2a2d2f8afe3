// The map's picture, drawn in the page's colours: walls with round edges, whatever the zoom.

const MOST_PIXELS = 4e6;

class MapPicture {
  constructor(image, map) {
    this.map = map;
    const { width, height } = image;
    const cells = new OffscreenCanvas(width, height);
    const context = cells.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, width, height);
    let [left, top, right, bottom] = [width, height, -1, -1];
    for (let k = 0; k < width * height; k++) {
      const grey = (pixels.data[4 * k] + pixels.data[4 * k + 1] + pixels.data[4 * k + 2]) / 3;
      const wall = grey < 100;
      const floor = grey > 225;
      pixels.data.set([wall ? 255 : 0, wall || floor ? 255 : 0, 0, 255], 4 * k);
      if (wall || floor) {
        const [x, y] = [k % width, Math.floor(k / width)];
        if (x < left) left = x;
        if (x > right) right = x;
        if (y < top) top = y;
        if (y > bottom) bottom = y;
      }
    }
    context.putImageData(pixels, 0, 0);
    if (right < 0) [left, top, right, bottom] = [0, 0, width - 1, height - 1];
    this.known = { left, top, right: right + 1, bottom: bottom + 1 };
    this.cells = cells;
    this.zoom = Math.max(1, Math.min(5, Math.floor(Math.sqrt(MOST_PIXELS / (width * height)))));
    this.drawn = null;
  }

  // Of the known part: x0, y0, x1, y1 in metres.
  get bounds() {
    const { left, top, right, bottom } = this.known;
    const corners = [[left, top], [right, top], [left, bottom], [right, bottom]].map(([x, y]) => this.toWorld(x, y));
    const [xs, ys] = [corners.map(([x]) => x), corners.map(([, y]) => y)];
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }

  toWorld(column, row) {
    const { resolution, height, origin } = this.map;
    const [x, y] = [column * resolution, (height - row) * resolution];
    const [cos, sin] = [Math.cos(origin[2] ?? 0), Math.sin(origin[2] ?? 0)];
    return [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y];
  }

  // The picture in these colours, `zoom` pixels a cell.
  paint({ floor, wall }) {
    const { width, height } = this.cells;
    const canvas = new OffscreenCanvas(width * this.zoom, height * this.zoom);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.imageSmoothingQuality = "high";
    context.drawImage(this.cells, 0, 0, canvas.width, canvas.height);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
    const { data } = pixels;
    const sharp = 255 / 90; // how soft an edge is
    for (let k = 0; k < data.length; k += 4) {
      const wallness = Math.min(1, Math.max(0, ((data[k] - 85) * sharp) / 255));
      const known = Math.min(1, Math.max(0, ((data[k + 1] - 85) * sharp) / 255));
      data[k] = floor[0] + (wall[0] - floor[0]) * wallness;
      data[k + 1] = floor[1] + (wall[1] - floor[1]) * wallness;
      data[k + 2] = floor[2] + (wall[2] - floor[2]) * wallness;
      data[k + 3] = 255 * known;
    }
    context.putImageData(pixels, 0, 0);
    this.drawn = canvas;
  }
}

export async function loadPicture(map, token) {
  const image = new Image();
  image.src = map.url + (token ? `${map.url.includes("?") ? "&" : "?"}token=${encodeURIComponent(token)}` : "");
  await image.decode();
  return new MapPicture(image, map);
}
