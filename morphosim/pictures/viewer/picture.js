// A PNG of the view: cells, names, time, legend.

import { capital } from "./format.js";

const MARGIN = 14;

// `view` has canvas, width, height (CSS pixels), draw(ratio), labels, back, ink, title, when, way,
// entries.
export async function savePicture(view, name) {
  const ratio = Math.max(2, window.devicePixelRatio);
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [view.width * ratio, view.height * ratio];
  const pen = sheet.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = view.back;
  pen.fillRect(0, 0, view.width, view.height);
  view.draw(ratio);
  pen.drawImage(view.canvas, 0, 0, view.width, view.height);
  drawNames(pen, view.labels);
  drawText(pen, view);
  download(await new Promise((done) => sheet.toBlob(done)), name);
}

function drawNames(pen, labels) {
  pen.font = "600 12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineJoin = "round";
  for (const { name, middle, shown } of labels) {
    if (!shown) continue;
    pen.lineWidth = 3;
    pen.strokeStyle = "#ffffffdd";
    pen.strokeText(name, ...middle);
    pen.fillStyle = "#111111";
    pen.fillText(name, ...middle);
  }
}

function drawText(pen, { height, ink, title, when, way, entries }) {
  pen.textAlign = "left";
  pen.fillStyle = ink;
  pen.font = "600 14px system-ui, sans-serif";
  pen.fillText(title, MARGIN, height - MARGIN - 20);
  pen.font = "13px system-ui, sans-serif";
  pen.fillText(when, MARGIN, height - MARGIN);
  if (way.scale) drawBar(pen, way, ink);
  else if (entries.length) drawEntries(pen, way, entries, ink);
}

function drawEntries(pen, way, entries, ink) {
  drawHeading(pen, way.title);
  entries.forEach(([text, colour], k) => {
    const y = MARGIN + 24 + 18 * k;
    pen.fillStyle = colour;
    pen.fillRect(MARGIN, y - 6, 12, 12);
    pen.fillStyle = ink;
    pen.fillText(text, MARGIN + 19, y);
  });
}

function drawBar(pen, { title, scale }, ink) {
  drawHeading(pen, title);
  const width = 170;
  const fade = pen.createLinearGradient(MARGIN, 0, MARGIN + width, 0);
  scale.stops.forEach((stop, k) => fade.addColorStop(k / (scale.stops.length - 1), stop));
  pen.fillStyle = fade;
  pen.fillRect(MARGIN, MARGIN + 16, width, 12);
  pen.fillStyle = ink;
  scale.ticks.forEach(([value, text], k) => {
    pen.textAlign = k === 0 ? "left" : k === scale.ticks.length - 1 ? "right" : "center";
    const place = (value - scale.low) / (scale.high - scale.low || 1);
    pen.fillText(text, MARGIN + width * place, MARGIN + 38);
  });
}

function drawHeading(pen, title) {
  pen.font = "600 12px system-ui, sans-serif";
  pen.fillText(capital(title), MARGIN, MARGIN + 4);
  pen.font = "12px system-ui, sans-serif";
}

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
