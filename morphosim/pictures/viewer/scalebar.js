// A scale bar. The view is a perspective: it holds where what the view turns around is, at
// mid-depth; what is nearer is larger.

import { element, number } from "./format.js";

const SHARE = 0.25; // most of the view's width
const LONGEST = 180; // pixels

export class ScaleBar {
  constructor(box, embryo) {
    this.embryo = embryo;
    this.text = element("span");
    this.line = element("i");
    box.append(this.text, this.line);
  }

  draw(width, height) {
    const perPixel = this.embryo.micrometres() / height;
    const room = Math.min(SHARE * width, LONGEST) * perPixel;
    if (!(room > 0)) return; // no cells yet
    const length = roundBelow(room);
    this.pixels = length / perPixel;
    this.label = `${number(length, Math.max(0, -Math.floor(Math.log10(length))))} µm, mid-depth`;
    this.text.textContent = this.label;
    this.line.style.width = `${this.pixels.toFixed(1)}px`;
  }
}

// Largest of 1, 2, 5, 10, … times a power of ten up to a value.
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return Math.max(...[1, 2, 5].filter((step) => step * power <= value * (1 + 1e-9))) * power;
}
