// What colour each cell has.

export const NO_COLOUR = "#999999";

export class Colours {
  constructor(palette, data) {
    this.palette = palette;
    this.made = new Map();
    this.colourings = data.colourings.length ? data.colourings : LIVE;
  }

  // How `by` colours; the first way where it is not known.
  coloured(by) {
    return this.colourings.find((one) => one.by === by) ?? this.colourings[0];
  }

  // Colour of the k-th cell of a frame.
  of(by, frame, k) {
    const way = this.coloured(by);
    if (way.by === "volume") return this.onScale(way.scale, errorOf(frame, k));
    if (way.measured) return this.onScale(way.scale, frame.values?.[way.by]?.[k] ?? null);
    if (way.by === "type") return this.one(way.types, frame.types[k] || "no type");
    return this.one(way.cells, frame.cells[k]);
  }

  // A name that the run did not have when it was read gets the next colour of the palette.
  one(known, name) {
    if (known[name]) return known[name];
    if (!this.made.has(known)) this.made.set(known, new Map());
    const made = this.made.get(known);
    if (!made.has(name)) {
      const next = Object.keys(known).length + made.size;
      made.set(name, this.palette.cells[next % this.palette.cells.length]);
    }
    return made.get(name);
  }

  onScale(scale, value) {
    if (value === null) return NO_COLOUR;
    return between(scale.stops ?? this.palette.errors, (value - scale.low) / (scale.high - scale.low));
  }

  // Entries of the legend, those of cells that are there; or [].
  legend(by, frame) {
    const way = this.coloured(by);
    if (way.scale) return [];
    const there = new Set(frame.cells.map((_, k) => this.of(by, frame, k)));
    const entries = way.by === "type" ? this.types(way, frame) : way.legend;
    return entries.filter(([, colour]) => there.has(colour));
  }

  types(way, frame) {
    const names = [...new Set([...Object.keys(way.types), ...frame.types.map((kind) => kind || "no type")])];
    return names.map((name) => [name, this.one(way.types, name)]);
  }
}

// Ways to colour where the data say none.
const LIVE = [
  { by: "cell", title: "cell", cells: {}, types: {}, legend: [], scale: null },
  { by: "type", title: "type", cells: {}, types: {}, legend: [], scale: null },
  {
    by: "volume", title: "volume error, %", cells: {}, types: {}, legend: [],
    scale: { low: -5, high: 5, ticks: [[-5, "−5"], [0, "0"], [5, "+5"]] },
  },
];

// Error of the volume in % of the target; null where it is not known.
export function errorOf(frame, k) {
  const [volume, target] = [frame.volume[k], frame.target[k]];
  return volume === null || !target ? null : 100 * (volume / target - 1);
}

function between(stops, place) {
  const at = Math.min(Math.max(place, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  const [from, to] = [channels(stops[low]), channels(stops[low + 1])];
  const mixed = from.map((value, k) => Math.round(value + (at - low) * (to[k] - value)));
  return `#${mixed.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}

function channels(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}
