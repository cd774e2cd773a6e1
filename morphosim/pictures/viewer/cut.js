// A plane that cuts the embryo open. Cut cells look filled, with a line around each section.

import { capMaterial, countingMaterial, paintNumber } from "./materials.js";

const AXES = ["x", "y", "z"];
const LIFT = 0.04; // µm that the lines stand out

export class Cut {
  constructor(embryo) {
    this.embryo = embryo;
    this.on = false;
    this.axis = 2;
    this.share = 0.5; // of the way from one end to the other
    this.keepsLow = true;
    this.plane = new THREE.Plane();
    this.caps = new THREE.Group();
    this.capped = []; // { cell, cap, plain, numbered } of the cells that are cut
    this.materials = []; // of the cap of the k-th cell, kept as those of the cells
    this.counting = [THREE.BackSide, THREE.FrontSide].map(countingMaterial);
    for (const material of this.counting) material.clippingPlanes = [this.plane];
    this.square = new THREE.PlaneGeometry(1, 1);
    this.lines = new THREE.LineSegments(
      new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: "#111111" }),
    );
    this.lines.frustumCulled = false;
    embryo.root.add(this.caps, this.lines);
    this.update();
  }

  // Coordinate of the plane, µm.
  get place() {
    const { min, max } = this.embryo.bounds;
    const name = AXES[this.axis];
    return min[name] + this.share * (max[name] - min[name]);
  }

  // Cut as data say: { axis, place, keepsLow }; without a place in the middle.
  set({ axis, place, keepsLow }) {
    const { min, max } = this.embryo.bounds;
    const [low, high] = [min[AXES[axis]], max[AXES[axis]]];
    const share = place === null ? 0.5 : (place - low) / (high - low);
    Object.assign(this, { on: true, axis, keepsLow, share: Math.min(Math.max(share, 0), 1) });
  }

  // Keep the half that the camera sees last, so that it looks onto the cut.
  faceCamera() {
    const towards = this.embryo.camera.position.getComponent(this.axis);
    this.keepsLow = towards * this.embryo.root.scale.getComponent(this.axis) >= 0;
  }

  // Do what the settings, the cells and the bounds now ask for.
  update() {
    this.clear();
    this.embryo.clip(this.on ? [this.plane] : null);
    if (!this.on) return;
    this.setPlane();
    this.embryo.cells.filter((cell) => cell.visible && this.meets(cell)).forEach((cell, k) => {
      this.addCap(cell, 1 + 3 * k);
    });
    this.drawLines();
  }

  // Caps take the colours of their cells.
  paint() {
    for (const { cell, plain } of this.capped) plain.color.copy(cell.colour);
  }

  clear() {
    this.capped = [];
    this.caps.clear();
    this.lines.visible = false;
  }

  setPlane() {
    const scale = this.embryo.root.scale.getComponent(this.axis);
    const at = this.embryo.root.position.getComponent(this.axis) + scale * this.place;
    const towards = (this.keepsLow ? -1 : 1) * scale;
    this.plane.normal.set(0, 0, 0).setComponent(this.axis, towards);
    this.plane.constant = -towards * at;
  }

  meets({ box }) {
    const name = AXES[this.axis];
    return box.min[name] < this.place && box.max[name] > this.place;
  }

  // Count back and front faces, then fill where they differ.
  addCap(cell, order) {
    for (const [later, material] of this.counting.entries()) {
      const faces = new THREE.Mesh(cell.geometry, material);
      faces.renderOrder = order + later;
      this.caps.add(faces);
    }
    const { k } = cell;
    this.materials[k] ??= { plain: capMaterial(), numbered: paintNumber(capMaterial(), k) };
    const cap = new THREE.Mesh(this.square, this.materials[k].plain);
    cap.renderOrder = order + 2;
    cap.onAfterRender = (renderer) => renderer.clearStencil(); // of pixels beside the square too
    this.spread(cap, cell.box);
    this.caps.add(cap);
    this.capped.push({ cell, cap, ...this.materials[k] });
  }

  // Lay the square over the section of a cell's box.
  spread(cap, box) {
    const size = box.getSize(new THREE.Vector3()).addScalar(1);
    box.getCenter(cap.position).setComponent(this.axis, this.place);
    if (this.axis === 0) cap.rotation.y = Math.PI / 2;
    if (this.axis === 1) cap.rotation.x = Math.PI / 2;
    const [across, up] = [[size.z, size.y], [size.x, size.z], [size.x, size.y]][this.axis];
    cap.scale.set(across, up, 1);
  }

  drawLines() {
    const points = this.capped.flatMap(({ cell }) => this.section(cell.geometry));
    this.lines.geometry.dispose();
    this.lines.geometry = new THREE.BufferGeometry();
    this.lines.geometry.setAttribute(
      "position", new THREE.BufferAttribute(new Float32Array(points), 3),
    );
    this.lines.renderOrder = 1 + 3 * this.capped.length;
    this.lines.visible = points.length > 0;
  }

  // Ends of the lines in which the triangles of a cell meet the plane.
  section(geometry) {
    const at = geometry.attributes.position.array;
    const faces = geometry.index.array;
    const place = this.place;
    const lift = this.keepsLow ? LIFT : -LIFT;
    const points = [];
    for (let face = 0; face < faces.length; face += 3) {
      for (let side = 0; side < 3; side++) {
        const a = 3 * faces[face + side];
        const b = 3 * faces[face + ((side + 1) % 3)];
        const [below, above] = [at[a + this.axis] - place, at[b + this.axis] - place];
        if (below < 0 === above < 0) continue;
        const share = below / (below - above);
        for (let k = 0; k < 3; k++) {
          const value = at[a + k] + share * (at[b + k] - at[a + k]);
          points.push(k === this.axis ? place + lift : value);
        }
      }
    }
    return points;
  }
}
