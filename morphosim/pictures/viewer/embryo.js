// The 3-D scene: cells, shell, camera. Knows nothing of the page around its canvas.

import { cellMaterial, flatMaterial, outlineMaterial, paintNumber, shellMaterial } from "./materials.js";

const VIEW_FROM = [0.18, 0.28, 1];
const FIELD_OF_VIEW = 28;
const OUTLINE = 0.35;
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
    this.cells = []; // { name, mesh, plain, numbered, box }
    this.materials = []; // of the k-th cell, kept: the last one's end costs its shader anew
    this.shell = new THREE.Group();
    this.outline = new THREE.Mesh(new THREE.BufferGeometry(), outlineMaterial(OUTLINE));
    this.outline.visible = false;
    this.planes = null;
    this.mirrored = false;
    this.bounds = new THREE.Box3(new THREE.Vector3(), new THREE.Vector3(1, 1, 1));
    this.root.add(this.shell, this.outline);
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
    for (const cell of this.cells) {
      this.root.remove(cell.mesh);
      cell.mesh.geometry.dispose();
    }
    this.cells = meshes.map((mesh, k) => this.cell(names[k], geometryOf(mesh), k));
    for (const cell of this.cells) this.root.add(cell.mesh);
    this.clip(this.planes);
  }

  cell(name, geometry, k) {
    this.materials[k] ??= {
      plain: cellMaterial(), numbered: paintNumber(flatMaterial(THREE.DoubleSide), k),
    };
    const mesh = new THREE.Mesh(geometry, this.materials[k].plain);
    return { name, mesh, ...this.materials[k], box: geometry.boundingBox };
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
    this.cells.forEach((cell, k) => cell.plain.color.set(colourOf(k)));
  }

  hide(hidden) {
    for (const cell of this.cells) cell.mesh.visible = !hidden.has(cell.name);
  }

  highlight(name) {
    for (const cell of this.cells) {
      cell.plain.emissive.set(cell.name === name ? "#2b2b2b" : "#000000");
    }
    const picked = this.cells.find((cell) => cell.name === name);
    this.outline.visible = Boolean(picked?.mesh.visible);
    if (picked) this.outline.geometry = picked.mesh.geometry;
  }

  // Cut all but what lies on the inner side of these planes; null: cut nothing.
  clip(planes) {
    this.planes = planes;
    const materials = this.cells.flatMap((cell) => [cell.plain, cell.numbered]);
    materials.push(this.outline.material, ...this.shell.children.map((part) => part.material));
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

function geometryOf({ positions, normals, faces }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  geometry.computeBoundingBox();
  geometry.computeBoundingSphere();
  return geometry;
}
