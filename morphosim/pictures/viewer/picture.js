// A PNG of the view: cells, names, time, legend.

import { capital, letters } from "./format.js";
import { LETTERS } from "./legend.js";

const MARGIN = 14;
const [ROW, COLUMN] = [18, 170]; // of the legend, pixels
const BELOW = 110; // pixels that it leaves free, with its heading

// `view` has canvas, width, height (CSS pixels), draw(ratio), labels, bar, back, ink, title, when, way,
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
  drawScale(pen, view);
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

// Text with a rim of the background's colour, read on any cell.
function write(pen, text, x, y, { back, ink }, most) {
  pen.lineWidth = 3;
  pen.strokeStyle = back;
  pen.strokeText(text, x, y, most);
  pen.fillStyle = ink;
  pen.fillText(text, x, y, most);
}

function drawText(pen, view) {
  const { height, ink, title, when, way, entries } = view;
  pen.textAlign = "left";
  pen.fillStyle = ink;
  pen.font = "600 14px system-ui, sans-serif";
  pen.fillText(title, MARGIN, height - MARGIN - 20);
  pen.font = "13px system-ui, sans-serif";
  pen.fillText(when, MARGIN, height - MARGIN);
  if (way.scale) drawBar(pen, way, ink);
  else if (entries.length) drawEntries(pen, view);
}

function drawEntries(pen, view) {
  const { way, entries, height } = view;
  drawHeading(pen, way.title);
  const rows = Math.max(Math.floor((height - BELOW) / ROW), 1);
  entries.forEach(([text, colour], k) => {
    const x = MARGIN + COLUMN * Math.floor(k / rows);
    const y = MARGIN + 24 + ROW * (k % rows);
    pen.fillStyle = colour;
    pen.fillRect(x, y - 6, 12, 12);
    write(pen, letters(text, LETTERS), x + 19, y, view, COLUMN - 26);
  });
}

function drawScale(pen, view) {
  const { bar, width, height, ink } = view;
  const right = width - MARGIN;
  pen.fillStyle = ink;
  pen.fillRect(right - bar.pixels, height - MARGIN - 3, bar.pixels, 3);
  pen.textAlign = "right";
  pen.font = "12px system-ui, sans-serif";
  write(pen, bar.label, right, height - MARGIN - 13, view);
}

function drawBar(pen, { title, scale }, ink) {
  drawHeading(pen, title);
  const width = 170;
  const fade = pen.createLinearGradient(MARGIN, 0, MARGIN + width, 0);
  scale.stops.forEach((stop, k) => fade.addColorStop(k / (scale.stops.length - 1), stop));
  pen.fillStyle = fade;
  pen.fillRect(MARGIN, MARGIN + 16, width, 12);
  pen.fillStyle = ink;
  scale.ticks.forEach(([value, text]) => {
    const place = (value - scale.low) / (scale.high - scale.low || 1);
    pen.textAlign = "left";
    pen.fillText(text, MARGIN + (width - pen.measureText(text).width) * place, MARGIN + 38); // within the bar
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
