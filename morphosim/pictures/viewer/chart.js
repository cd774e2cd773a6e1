// A small chart: the volume of a cell over time, its target, and where we are.

import { drawn, number, timeText } from "./format.js";

const [WIDTH, HEIGHT, TOP, BOTTOM] = [262, 74, 8, 16];

// `points` are { time, volume, target }, in the order of time; `now` is a time.
export function chart(points, now, colour) {
  const known = points.filter(({ volume }) => volume !== null);
  if (known.length < 2) return null;
  const values = known.flatMap(({ volume, target }) => (target ? [volume, target] : [volume]));
  const across = ruler(known[0].time, known.at(-1).time, 1, WIDTH - 1);
  const up = ruler(Math.min(...values), Math.max(...values), HEIGHT - BOTTOM - 4, TOP + 8);
  const path = (key) =>
    known.map((point, k) => `${k ? "L" : "M"}${across(point.time).toFixed(1)} ${up(point[key]).toFixed(1)}`).join("");
  const line = { fill: "none", "stroke-linejoin": "round" };
  const here = known.find(({ time }) => time === now);
  const parts = [
    drawn("line", { x1: 0, x2: WIDTH, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM, stroke: "var(--line)" }),
    known.every(({ target }) => target)
      ? drawn("path", { ...line, d: path("target"), stroke: "var(--soft)", "stroke-dasharray": "3 3" })
      : null,
    drawn("path", { ...line, d: path("volume"), stroke: "var(--ink)", "stroke-width": 1.6 }),
    here ? drawn("circle", { cx: across(now), cy: up(here.volume), r: 4, fill: colour, stroke: "var(--ink)" }) : null,
    label(0, TOP, "start", number(Math.max(...values))),
    label(0, HEIGHT - 3, "start", `t ${timeText(known[0].time)}`),
    label(WIDTH, HEIGHT - 3, "end", timeText(known.at(-1).time)),
  ];
  return drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "Volume over time" },
    ...parts.filter(Boolean));
}

function ruler(low, high, from, to) {
  return (value) => from + ((value - low) / (high - low || 1)) * (to - from);
}

function label(x, y, anchor, text) {
  const made = drawn("text", { x, y, "text-anchor": anchor, "font-size": 10.5, fill: "var(--soft)" });
  made.textContent = text;
  return made;
}
