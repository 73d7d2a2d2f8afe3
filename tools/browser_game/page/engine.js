// The kernels of the game in WebAssembly, and the arrays in their memory by name (tools/browser_game/maps.py).

const PAGE = 65536; // bytes by which memory grows
const VIEWS = {
  f8: Float64Array, f4: Float32Array, i8: BigInt64Array, u8: BigUint64Array, i4: Int32Array, i2: Int16Array,
  i1: Int8Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array, b1: Uint8Array,
};

export async function gunzip(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// A file of the build: its header, and the stored arrays behind it.
export async function unpack(bytes) {
  const content = await gunzip(bytes);
  const length = new DataView(content.buffer).getUint32(0, true);
  const header = new TextDecoder().decode(content.subarray(4, 4 + length));
  return { header: JSON.parse(header), stored: content.subarray(4 + length) };
}

// The bytes of an array from its stored form (`Entry` in image.py).
export function restored(stored, width, lag, apart) {
  if (!lag && !apart) return stored;
  const bytes = new Uint8Array(stored.length);
  const count = stored.length / width;
  if (apart) for (let k = 0; k < stored.length; k++) bytes[(k % count) * width + Math.floor(k / count)] = stored[k];
  else bytes.set(stored);
  const numbers = new VIEWS[`u${width}`](bytes.buffer);
  if (lag) for (let k = lag; k < count; k++) numbers[k] += numbers[k - lag];
  return bytes;
}

export class Engine {
  #stored; // of the map's file; the arrays of rounds begin at #firsts
  #firsts = [];
  #round;

  // `module` is a compiled WebAssembly module; `network` and `map` are unpacked files.
  constructor(module, network, map) {
    this.exports = new WebAssembly.Instance(module, {}).exports;
    this.memory = this.exports.memory;
    this.facts = map.header.facts;
    this.#stored = map.stored;
    this.header = map.header;
    this.exports._initialize();
    const { functions, first } = network.header;
    const table = this.exports.__indirect_function_table;
    table.grow(first + functions.length - table.length);
    functions.forEach((name, k) => table.set(first + k, this.exports[name]));
    const end = Math.max(...map.header.rounds.map((round) => round.end));
    this.memory.grow(Math.ceil((end - this.memory.buffer.byteLength) / PAGE));
    this.scratch = this.exports.malloc(16);
    this.#copy(network.header.entries, network.stored, 0);
    let at = this.#copy(map.header.entries, map.stored, 0);
    for (const { entries } of map.header.rounds) {
      this.#firsts.push(at);
      at += entries.reduce((sum, [, size]) => sum + size, 0);
    }
  }

  #copy(entries, stored, first) {
    const memory = new Uint8Array(this.memory.buffer);
    let at = first;
    for (const [address, size, width, lag, apart] of entries) {
      memory.set(restored(stored.subarray(at, at + size), width, lag, apart), address);
      at += size;
    }
    return at;
  }

  // Prepares the memory of a round with this number of ghosts.
  layOut(ghosts) {
    const round = this.#round = this.header.rounds[ghosts - 1];
    new Uint8Array(this.memory.buffer).fill(0, this.header.end, round.end);
    this.#copy(round.entries, this.#stored, this.#firsts[ghosts - 1]);
    const place = (name) => this.#array("contacts", name)[0];
    const { radius_m: radius, mass_kg: mass, slop_m: slop } = this.facts.body;
    const [count] = this.#array("contacts", "segments")[2];
    const places = ["handles", "segments", "given", "taken"].map(place);
    this.exports.make_contacts(...places, count, radius, mass, slop);
  }

  #array(table, name) {
    return this.#round.tables[table].arrays[name];
  }

  array(table, name) {
    const [address, type, shape] = this.#array(table, name);
    return new VIEWS[type](this.memory.buffer, address, shape.reduce((product, length) => product * length, 1));
  }

  // One field of the records of an array, as a view of one number for each record.
  field(table, name, field, row = 0) {
    const [address, type] = this.#array(table, name);
    const { size, fields } = this.header.records[type];
    const [offset, own, length] = fields[field];
    return new VIEWS[own](this.memory.buffer, address + row * size + offset, length);
  }

  // Calls a kernel with its table; returns its result.
  call(kernel, first = 0, last = 1) {
    const table = BigInt(this.#round.tables[kernel].at);
    const { scratch } = this;
    const status = this.exports[kernel](scratch, scratch + 8, table, BigInt(first), BigInt(last));
    if (status) throw new Error(`${kernel} failed: ${status}`);
    return Number(new DataView(this.memory.buffer).getBigInt64(scratch, true));
  }
}
