// The axes of space, in the corner; a click looks along one.

import { drawn } from "./format.js";

const SIZE = 84;
const LENGTH = 27;
const COLOURS = ["#d55e00", "#009e73", "#0072b2"];

export class Axes {
  constructor(box, embryo) {
    this.embryo = embryo;
    this.parts = ["x", "y", "z"].map((name, axis) => this.part(name, axis));
    this.svg = drawn("svg", { width: SIZE, height: SIZE, viewBox: `0 0 ${SIZE} ${SIZE}` });
    this.svg.append(...this.parts.map(({ group }) => group));
    box.append(this.svg);
  }

  part(name, axis) {
    const line = drawn("line", { stroke: COLOURS[axis] });
    const circle = drawn("circle", { r: 9 });
    const text = drawn("text");
    text.textContent = name;
    const group = drawn("g", { role: "button", "aria-label": `Look along ${name}` }, line, circle, text);
    group.addEventListener("click", () => this.lookAlong(axis));
    return { line, circle, text, group };
  }

  // From the side that faces the viewer; from the other, if that is where the view is already.
  lookAlong(axis) {
    const here = this.embryo.camera.position.clone().normalize();
    const along = here.getComponent(axis);
    const from = [0, 0, 0];
    from[axis] = Math.abs(along) > 0.999 ? -Math.sign(along) : Math.sign(along) || 1;
    if (axis === 1) from[2] = 1e-4; // straight up has no right and left
    this.embryo.look(from);
  }

  draw() {
    const turn = this.embryo.camera.matrixWorldInverse;
    const tips = this.parts.map((part, axis) => {
      const tip = new THREE.Vector3().setComponent(axis, this.embryo.root.scale.getComponent(axis));
      return tip.transformDirection(turn);
    });
    this.parts.forEach(({ line, circle, text }, axis) => {
      const [x, y] = [tips[axis].x, -tips[axis].y];
      const middle = SIZE / 2;
      place(line, { x1: middle, y1: middle, x2: middle + LENGTH * x, y2: middle + LENGTH * y });
      const letter = [middle + (LENGTH + 10) * x, middle + (LENGTH + 10) * y];
      place(circle, { cx: letter[0], cy: letter[1] });
      place(text, { x: letter[0], y: letter[1] });
    });
    const order = [0, 1, 2].sort((a, b) => tips[a].z - tips[b].z);
    for (const axis of order) this.svg.append(this.parts[axis].group);
  }
}

function place(object, places) {
  for (const [name, value] of Object.entries(places)) object.setAttribute(name, value.toFixed(1));
}
