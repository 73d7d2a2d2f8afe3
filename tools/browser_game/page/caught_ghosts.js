// Frightened and caught ghosts in frames, as pacman_env/web/caught_ghosts.py describes them.

const POINTS_S = 2; // for which points are shown

export class CaughtGhosts {
  fresh = []; // numbers of the ghosts caught between the last two updates
  #streak = 0;
  #powerLeft = 0;
  #catches = []; // of each ghost: place and points of the last catch
  #places = [];
  #awayUntil = null;

  constructor(return_s, points) {
    Object.assign(this, { return_s, points });
  }

  // Fields of a frame: `until_s` are the times until which each ghost is harmless and away.
  update(places, until_s, time_s, powerLeft) {
    if (powerLeft !== this.#powerLeft) [this.#powerLeft, this.#streak] = [powerLeft, 0];
    this.#awayUntil ??= until_s.map(([, away]) => away);
    this.fresh = places.map((_, k) => k).filter((k) => until_s[k][1] > this.#awayUntil[k]);
    for (const k of this.fresh) this.#catches[k] = [...this.#places[k], this.points * 2 ** this.#streak++];
    this.#places = places;
    this.#awayUntil = until_s.map(([, away]) => away);
    const left = (column) => until_s.map((times) => Math.max(0, times[column] - time_s));
    const away_s = left(1);
    const since = (k) => time_s - until_s[k][1] + this.return_s;
    const eyes = (place, k) => place.map((own, axis) => ( // they move evenly to the place where the ghost starts
      own + Math.min(away_s[k] / this.return_s, 1) * ((this.#catches[k]?.[axis] ?? own) - own)));
    const points = this.#catches.filter((_, k) => since(k) >= 0 && since(k) < POINTS_S);
    return { ghosts: places.map(eyes), harmless_s: left(0), away_s, points };
  }
}
