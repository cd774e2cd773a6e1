// Names of cells, on what is seen of them, so that none overlap.

const LEAST_AREA = 260; // square pixels of a cell that gets a name
const GAP = 2;
const MOST = 150; // names; of more cells the best seen

export class Labels {
  constructor(box, embryo, ids) {
    Object.assign(this, { box, embryo, ids });
    this.on = true;
    this.picked = null;
    this.anchors = []; // { name, at, span, width }
  }

  // Find out anew which cells are seen, and where. Costs a drawing.
  find(width, height) {
    const { camera, cells, root } = this.embryo;
    camera.updateMatrixWorld();
    const eye = camera.position;
    const forward = camera.getWorldDirection(new THREE.Vector3());
    const seen = this.wanted(width, height);
    const anchors = seen.map(({ k, x, y }) => {
      const middle = cells[k].box.getCenter(new THREE.Vector3()).applyMatrix4(root.matrixWorld);
      const ray = new THREE.Vector3(x, y, 0.5).unproject(camera).sub(eye).normalize();
      const far = middle.sub(eye).dot(forward) / ray.dot(forward);
      return { name: cells[k].name, at: ray.multiplyScalar(far).add(eye) };
    });
    this.write(anchors);
    this.place(width, height);
  }

  // Cells to name, the most visible first; the picked cell even if it is hidden by others.
  wanted(width, height) {
    const { cells } = this.embryo;
    const seen = this.on || this.picked ? this.ids.seen(width, height) : [];
    const large = seen.filter(({ k, share }) => cells[k] && share * width * height > LEAST_AREA);
    large.sort((a, b) => b.share - a.share);
    const mine = cells.findIndex((cell) => cell.name === this.picked && cell.visible);
    const rest = this.on ? large.filter(({ k }) => k !== mine).slice(0, MOST) : [];
    if (mine < 0) return rest;
    return [seen.find(({ k }) => k === mine) ?? this.behind(mine), ...rest];
  }

  behind(k) {
    const { camera, cells, root } = this.embryo;
    const at = cells[k].box.getCenter(new THREE.Vector3()).applyMatrix4(root.matrixWorld);
    const { x, y } = at.project(camera);
    return { k, x, y, share: 0 };
  }

  write(anchors) {
    const spans = [...this.box.children];
    anchors.forEach((anchor, k) => {
      const span = spans[k] ?? this.box.appendChild(document.createElement("span"));
      if (span.textContent !== anchor.name) span.textContent = anchor.name;
      span.className = anchor.name === this.picked ? "picked" : "";
      anchor.span = span;
    });
    spans.slice(anchors.length).forEach((span) => span.remove());
    for (const anchor of anchors) {
      anchor.width = anchor.span.offsetWidth;
      anchor.height = anchor.span.offsetHeight;
    }
    this.anchors = anchors;
  }

  // Move the names to where their cells now are.
  place(width, height) {
    const taken = [];
    const point = new THREE.Vector3();
    for (const anchor of this.anchors) {
      point.copy(anchor.at).project(this.embryo.camera);
      const left = ((point.x + 1) / 2) * width - anchor.width / 2;
      const top = ((1 - point.y) / 2) * height - anchor.height / 2;
      const mine = [left, top, left + anchor.width, top + anchor.height];
      const free = point.z < 1 && inside(mine, width, height) && !taken.some((other) => overlap(mine, other));
      if (free) taken.push(mine);
      anchor.shown = free;
      anchor.middle = [left + anchor.width / 2, top + anchor.height / 2];
      anchor.span.style.visibility = free ? "visible" : "hidden";
      anchor.span.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
    }
  }
}

function inside([left, top, right, bottom], width, height) {
  return left >= 0 && top >= 0 && right <= width && bottom <= height;
}

function overlap(a, b) {
  return a[0] < b[2] + GAP && b[0] < a[2] + GAP && a[1] < b[3] + GAP && b[1] < a[3] + GAP;
}
