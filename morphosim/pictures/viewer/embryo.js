// The 3-D scene: cells, shell, camera. Knows nothing of the page around its canvas.

import { cellMaterial, flatMaterial, numberColour, outlineMaterial, shellMaterial } from "./materials.js";

const VIEW_FROM = [0.18, 0.28, 1];
const FIELD_OF_VIEW = 28;
const OUTLINE = 0.35;
const LIGHTER = new THREE.Color("#2b2b2b"); // of the picked cell
const ROOM = 0.5; // µm that cells may stand out of the bounds

export class Embryo {
  // `changed` is called when something has to be drawn anew.
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, stencil: true });
    this.renderer.localClippingEnabled = true;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1000);
    this.root = new THREE.Group(); // all that is in the run's coordinates
    this.cells = []; // { name, k, geometry, box, visible, colour }
    // All cells are one mesh, for one call to the GPU: in their colours, or in their numbers.
    this.plain = new THREE.BufferGeometry();
    this.numbered = new THREE.BufferGeometry();
    this.materials = { plain: cellMaterial(), numbered: flatMaterial(THREE.DoubleSide) };
    this.whole = new THREE.Mesh(this.plain, this.materials.plain);
    this.whole.frustumCulled = false;
    this.shell = new THREE.Group();
    this.outline = new THREE.Mesh(new THREE.BufferGeometry(), outlineMaterial(OUTLINE));
    this.outline.visible = false;
    this.planes = null;
    this.mirrored = false;
    this.bounds = new THREE.Box3(new THREE.Vector3(), new THREE.Vector3(1, 1, 1));
    this.root.add(this.whole, this.shell, this.outline);
    this.scene.add(this.root, this.camera);
    this.light();
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.18;
    this.controls.addEventListener("change", changed);
  }

  light() {
    const lamp = new THREE.DirectionalLight("#ffffff", 2.1);
    lamp.position.set(-0.5, 0.9, 1);
    this.camera.add(lamp); // shines over the viewer's shoulder
    this.camera.add(lamp.target);
    lamp.target.position.set(0, 0, -1);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#9a9fa8", 1.5));
  }

  // The distance changes with the shape of the canvas, so that what fitted still fits.
  resize(width, height, ratio) {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    const before = this.distance;
    this.camera.aspect = width / height;
    this.keepFit(before);
  }

  // What fitted from the distance `before` fits from the one that is right now.
  keepFit(before) {
    const { camera, controls, distance } = this;
    camera.position.sub(controls.target).multiplyScalar(distance / before).add(controls.target);
    camera.near = distance / 50;
    camera.far = distance * 20;
    camera.updateProjectionMatrix();
    controls.minDistance = distance / 16;
    controls.maxDistance = distance * 8;
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }

  // Show the cells of a frame: names, and meshes of the same order.
  setCells(names, meshes) {
    for (const { geometry } of [...this.cells, { geometry: this.plain }, { geometry: this.numbered }]) {
      geometry.dispose();
    }
    this.cells = meshes.map((mesh, k) => {
      const geometry = geometryOf(mesh);
      const box = geometry.boundingBox;
      return { name: names[k], k, geometry, box, visible: true, colour: new THREE.Color() };
    });
    this.merge();
  }

  // Put the meshes of all cells into one.
  merge() {
    const { plain, numbered } = this;
    for (const name of ["position", "normal"]) {
      const joined = joinedValues(this.cells.map(({ geometry }) => geometry.attributes[name].array));
      const attribute = new THREE.BufferAttribute(joined, 3);
      plain.setAttribute(name, attribute);
      numbered.setAttribute(name, attribute);
    }
    const { count } = plain.attributes.position;
    for (const geometry of [plain, numbered]) {
      geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    }
    this.fill(numbered, ({ k }) => numberColour(k));
    const corners = this.cells.reduce((sum, { geometry }) => sum + geometry.index.count, 0);
    const index = new THREE.BufferAttribute(new Uint32Array(corners), 1);
    for (const geometry of [plain, numbered]) geometry.setIndex(index);
    this.index();
  }

  // Give all vertices of each cell its colour.
  fill(geometry, colourOf) {
    const { array } = geometry.attributes.color;
    let at = 0;
    for (const cell of this.cells) {
      const { r, g, b } = colourOf(cell);
      const end = at + 3 * cell.geometry.attributes.position.count;
      for (; at < end; at += 3) [array[at], array[at + 1], array[at + 2]] = [r, g, b];
    }
    geometry.attributes.color.needsUpdate = true;
  }

  // Draw the faces of the cells that are not hidden.
  index() {
    const { index } = this.plain;
    let [at, first] = [0, 0];
    for (const { geometry, visible } of this.cells) {
      if (visible) for (const corner of geometry.index.array) index.array[at++] = first + corner;
      first += geometry.attributes.position.count;
    }
    index.needsUpdate = true;
    for (const geometry of [this.plain, this.numbered]) geometry.setDrawRange(0, at);
  }

  // Show all cells "plain" or "numbered".
  swap(kind) {
    this.whole.geometry = this[kind];
    this.whole.material = this.materials[kind];
  }

  setShell(mesh) {
    for (const part of [...this.shell.children]) {
      this.shell.remove(part);
      part.geometry.dispose();
    }
    if (!mesh) return;
    const geometry = geometryOf(mesh);
    for (const [order, side] of [THREE.BackSide, THREE.FrontSide].entries()) {
      const part = new THREE.Mesh(geometry, shellMaterial(side));
      part.renderOrder = 1e6 + order;
      this.shell.add(part);
    }
  }

  // `colourOf(k)` is the colour of the k-th cell.
  paint(colourOf) {
    this.cells.forEach((cell, k) => cell.colour.set(colourOf(k)));
    this.fill(this.plain, (cell) => cell.colour);
  }

  hide(hidden) {
    const changed = this.cells.filter((cell) => cell.visible === hidden.has(cell.name));
    for (const cell of changed) cell.visible = !cell.visible;
    if (changed.length) this.index();
  }

  highlight(name) {
    const picked = this.cells.find((cell) => cell.name === name);
    this.outline.visible = Boolean(picked?.visible);
    if (!picked) return;
    this.outline.geometry = picked.geometry;
    picked.colour.add(LIGHTER);
    this.fill(this.plain, (cell) => cell.colour);
  }

  // Cut all but what lies on the inner side of these planes; null: cut nothing.
  clip(planes) {
    this.planes = planes;
    const materials = [this.materials.plain, this.materials.numbered, this.outline.material];
    materials.push(...this.shell.children.map((part) => part.material));
    for (const material of materials) material.clippingPlanes = planes;
  }

  // Bounds in the run's coordinates, around which the view turns.
  setBounds([low, high]) {
    const before = this.distance;
    this.bounds.set(new THREE.Vector3(...low), new THREE.Vector3(...high));
    this.place();
    this.keepFit(before);
  }

  // Take in cells that have left the bounds.
  widenBounds() {
    const all = this.cells.reduce((sum, { box }) => sum.union(box), this.bounds.clone());
    const room = this.bounds.clone().expandByScalar(ROOM);
    if (!room.containsBox(all)) this.setBounds([all.min, all.max]);
  }

  mirror(mirrored) {
    this.mirrored = mirrored;
    this.place();
  }

  // Put the middle of the bounds at the origin.
  place() {
    const sign = this.mirrored ? -1 : 1;
    const middle = this.bounds.getCenter(new THREE.Vector3());
    this.root.scale.set(1, 1, sign);
    this.root.position.set(-middle.x, -middle.y, -sign * middle.z);
    this.root.updateMatrixWorld();
  }

  // From where the camera sees everything.
  get distance() {
    const sphere = this.bounds.getSize(new THREE.Vector3()).length() / 2;
    const half = (FIELD_OF_VIEW / 2) * (Math.PI / 180);
    const across = Math.atan(Math.tan(half) * this.camera.aspect);
    return sphere * Math.max(0.74 / Math.sin(half), 0.9 / Math.sin(across));
  }

  // µm from the upper to the lower rim of the picture, as far away as the point it turns around.
  micrometres() {
    const depth = this.camera.position.distanceTo(this.controls.target);
    return 2 * depth * Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));
  }

  // Look at everything, from a direction in the page's coordinates.
  look(from = VIEW_FROM) {
    this.stop();
    this.camera.position.set(...from).normalize().multiplyScalar(this.distance);
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.changed();
  }

  // A drag that has ended turns the camera a little further: let it not.
  stop() {
    this.controls.enableDamping = false;
    this.controls.update();
    this.controls.enableDamping = true;
  }
}

function joinedValues(parts) {
  const joined = new Float32Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    joined.set(part, at);
    at += part.length;
  }
  return joined;
}

function geometryOf({ positions, normals, faces }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  geometry.computeBoundingBox();
  geometry.computeBoundingSphere();
  return geometry;
}
