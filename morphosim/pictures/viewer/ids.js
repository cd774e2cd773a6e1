// Which cell is seen where: the scene drawn with a number for each cell instead of its colour.

import { numberPainted } from "./materials.js";

const LONGEST = 320; // pixels along the longer side of the picture that names are placed by

export class Ids {
  constructor(embryo, cut) {
    this.embryo = embryo;
    this.cut = cut;
    this.target = new THREE.WebGLRenderTarget(1, 1, {
      stencilBuffer: true, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
    });
  }

  // Number of the cell at a place of the canvas (CSS pixels); -1 for none.
  at(x, y, width, height) {
    const { camera } = this.embryo;
    camera.setViewOffset(width, height, x, y, 1, 1);
    const pixels = this.draw(1, 1);
    camera.clearViewOffset();
    return numberPainted(pixels[0], pixels[1], pixels[2]);
  }

  // Of each cell that is seen: its number, the share of the picture that it takes, and the place
  // of the pixel of it that is nearest to the middle of all, from -1 to 1 along both axes.
  seen(width, height) {
    const scale = LONGEST / Math.max(width, height);
    const [w, h] = [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
    const pixels = this.draw(w, h);
    const found = sums(pixels, w);
    nearest(pixels, w, found);
    return [...found].map(([k, { count, place }]) => ({
      k, share: count / (w * h),
      x: (2 * ((place % w) + 0.5)) / w - 1, y: (2 * (Math.floor(place / w) + 0.5)) / h - 1,
    }));
  }

  draw(width, height) {
    const { renderer, scene, camera, shell, outline } = this.embryo;
    const others = [shell, outline, this.cut.lines];
    const visible = others.map((object) => object.visible);
    others.forEach((object) => (object.visible = false));
    this.swap("numbered");
    this.target.setSize(width, height);
    renderer.setRenderTarget(this.target);
    renderer.clear();
    renderer.render(scene, camera);
    const pixels = new Uint8Array(4 * width * height);
    renderer.readRenderTargetPixels(this.target, 0, 0, width, height, pixels);
    renderer.setRenderTarget(null);
    this.swap("plain");
    others.forEach((object, k) => (object.visible = visible[k]));
    return pixels;
  }

  swap(kind) {
    this.embryo.swap(kind);
    for (const capped of this.cut.capped) capped.cap.material = capped[kind];
  }
}

function numberAt(pixels, place) {
  return numberPainted(pixels[4 * place], pixels[4 * place + 1], pixels[4 * place + 2]);
}

function sums(pixels, width) {
  const found = new Map();
  for (let place = 0; 4 * place < pixels.length; place++) {
    const k = numberAt(pixels, place);
    if (k < 0) continue;
    if (!found.has(k)) found.set(k, { count: 0, x: 0, y: 0, place: -1, far: Infinity });
    const sum = found.get(k);
    sum.count += 1;
    sum.x += place % width;
    sum.y += Math.floor(place / width);
  }
  return found;
}

// Middles may lie outside of a crescent: take the pixel next to them.
function nearest(pixels, width, found) {
  for (let place = 0; 4 * place < pixels.length; place++) {
    const sum = found.get(numberAt(pixels, place));
    if (!sum) continue;
    const far = Math.hypot((place % width) - sum.x / sum.count, Math.floor(place / width) - sum.y / sum.count);
    if (far < sum.far) Object.assign(sum, { far, place });
  }
}
