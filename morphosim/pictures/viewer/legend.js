// What the colours mean: entries, or a colour bar.

import { capital, element, letters } from "./format.js";

export const LETTERS = 22; // of an entry

export function drawLegend(box, way, entries) {
  const parts = way.scale ? bar(way.scale) : list(entries);
  box.replaceChildren(...(parts.length ? [element("h2", {}, capital(way.title)), ...parts] : []));
}

function list(entries) {
  if (!entries.length) return [];
  const rows = entries.map(([text, colour]) =>
    element("li", {}, element("span", { class: "swatch", style: `background:${colour}` }), element("span", {}, letters(text, LETTERS))),
  );
  return [element("ul", {}, ...rows)];
}

function bar({ low, high, stops, ticks }) {
  const marks = ticks.map(([value, text]) => {
    const left = ((100 * (value - low)) / (high - low || 1)).toFixed(1);
    return element("span", { style: `left:${left}%; transform:translateX(-${left}%)` }, text); // within the bar
  });
  return [
    element("div", { class: "bar", style: `background:linear-gradient(to right, ${stops.join(", ")})` }),
    element("div", { class: "ticks" }, ...marks),
  ];
}
