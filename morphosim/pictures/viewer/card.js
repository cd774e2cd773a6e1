// Figures of the picked cell at the time that is shown.

import { chart } from "./chart.js";
import { errorOf } from "./colours.js";
import { element, number, signed } from "./format.js";

// `acts` are close(), hide(name), only(name), pick(name); `colourOf(k)` colours the k-th cell.
export function drawCard(box, { data, frame, name, colourOf, acts }) {
  box.hidden = !name;
  if (!name) return;
  const k = frame.cells.indexOf(name);
  const mother = data.cells.find((cell) => cell.name === name)?.parent;
  const parts = k < 0 ? [element("p", { class: "soft" }, "Not there at this time.")] : [
    figures(frame, k, mother),
    actions(name, acts),
    ...course(data, frame, name, colourOf(k)),
    ...neighbours(frame, k, colourOf, acts),
  ];
  box.replaceChildren(head(name, k < 0 ? null : colourOf(k), acts), ...parts);
}

function head(name, colour, acts) {
  return element("div", { class: "card-head" },
    element("span", { class: "swatch", style: `background:${colour ?? "transparent"}` }),
    element("h2", {}, name),
    element("button", { type: "button", class: "plain", "aria-label": "Close", on: { click: acts.close } }, "×"),
  );
}

function figures(frame, k, mother) {
  const error = errorOf(frame, k);
  const rows = [
    ["Type", frame.types[k]],
    ["Volume", unit(frame.volume[k], "µm³")],
    ["Target", unit(frame.target[k], "µm³")],
    ["Error", error === null ? null : `${signed(error, Math.abs(error) < 10 ? 2 : 1)} %`],
    ["Surface", unit(frame.surface[k], "µm²")],
    ["Mother", mother],
  ];
  return element("table", {}, ...rows.filter(([, text]) => text).map(([title, text]) =>
    element("tr", {}, element("th", { scope: "row" }, title), element("td", {}, text))));
}

function unit(value, name) {
  return value === null ? null : `${number(value)} ${name}`;
}

function course(data, frame, name, colour) {
  const points = data.frames.flatMap((one) => {
    const k = one.cells.indexOf(name);
    return k < 0 ? [] : [{ time: one.time, volume: one.volume[k], target: one.target[k] }];
  });
  const drawing = chart(points, frame.time, colour);
  return drawing ? [element("h3", {}, "Volume, µm³ (dashed: target)"), drawing] : [];
}

function neighbours(frame, k, colourOf, acts) {
  const touching = frame.contacts
    .filter(([i, j]) => i === k || j === k)
    .map(([i, j, area]) => ({ other: i === k ? j : i, area }))
    .sort((a, b) => b.area - a.area);
  if (!touching.length) return [];
  const widest = touching[0].area || 1;
  return [
    element("h3", {}, `Contacts, µm² (${touching.length})`),
    ...touching.map(({ other, area }) =>
      element("button", { type: "button", class: "neighbour", on: { click: () => acts.pick(frame.cells[other]) } },
        element("i", { style: `width:${(100 * area) / widest}%;background:${colourOf(other)}` }),
        element("span", {}, frame.cells[other]),
        element("span", {}, number(area)),
      )),
  ];
}

function actions(name, acts) {
  return element("div", { class: "actions" },
    element("button", { type: "button", on: { click: () => acts.hide(name) } }, "Hide"),
    element("button", { type: "button", on: { click: () => acts.only(name) } }, "Show only this"),
  );
}
