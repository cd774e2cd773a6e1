// Meshes from the packed form that `meshcode.py` makes and describes.

// Base64 of gzip to a list of { positions, normals, faces }, in the order of the frame's cells.
export async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return meshesOf(await new Response(stream).arrayBuffer());
}

function meshesOf(buffer) {
  const view = new DataView(buffer);
  const heads = headersOf(view);
  const vertices = heads.reduce((sum, head) => sum + head.vertices, 0);
  const faces = heads.reduce((sum, head) => sum + head.faces, 0);
  const start = 4 + 24 * heads.length;
  const places = twoPlanes(new Uint8Array(buffer, start, 6 * vertices));
  const squares = new Int8Array(buffer, start + 6 * vertices, 2 * vertices);
  const codes = twoPlanes(new Uint8Array(buffer, start + 8 * vertices, 6 * faces));
  let [vertex, face] = [0, 0];
  return heads.map((head) => {
    const mesh = {
      positions: positionsOf(head, places.subarray(3 * vertex, 3 * (vertex + head.vertices))),
      normals: normalsOf(squares.subarray(2 * vertex, 2 * (vertex + head.vertices))),
      faces: facesOf(codes.subarray(3 * face, 3 * (face + head.faces))),
    };
    vertex += head.vertices;
    face += head.faces;
    return mesh;
  });
}

function headersOf(view) {
  return Array.from({ length: view.getUint32(0, true) }, (_, k) => {
    const at = 4 + 24 * k;
    const [x, y, z, step] = [8, 12, 16, 20].map((more) => view.getFloat32(at + more, true));
    return {
      vertices: view.getUint32(at, true), faces: view.getUint32(at + 4, true), low: [x, y, z], step,
    };
  });
}

// Values of 16 bits whose low bytes come first, then all high bytes.
function twoPlanes(bytes) {
  const count = bytes.length / 2;
  return Uint16Array.from({ length: count }, (_, k) => bytes[k] | (bytes[count + k] << 8));
}

function positionsOf({ low, step }, changes) {
  const positions = new Float32Array(changes.length);
  const at = [0, 0, 0];
  for (let k = 0; k < changes.length; k++) {
    const folded = changes[k];
    at[k % 3] += folded & 1 ? -(folded + 1) / 2 : folded / 2;
    positions[k] = low[k % 3] + step * at[k % 3];
  }
  return positions;
}

function normalsOf(squares) {
  const normals = new Float32Array((squares.length / 2) * 3);
  for (let k = 0; k < squares.length / 2; k++) {
    let [x, y] = [squares[2 * k] / 127, squares[2 * k + 1] / 127];
    const z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
    const length = Math.hypot(x, y, z);
    normals.set([x / length, y / length, z / length], 3 * k);
  }
  return normals;
}

function facesOf(codes) {
  const faces = new Uint16Array(codes.length);
  let following = 0;
  for (let k = 0; k < codes.length; k++) {
    faces[k] = following - codes[k];
    if (codes[k] === 0) following += 1;
  }
  return faces;
}

// The frames unpacked last, so that sliding back and forth is quick.
export class Unpacked {
  constructor(most = 24) {
    this.most = most;
    this.kept = new Map();
  }

  of(frame) {
    const found = this.kept.get(frame) ?? unpack(frame.mesh);
    this.kept.delete(frame);
    this.kept.set(frame, found);
    if (this.kept.size > this.most) this.kept.delete(this.kept.keys().next().value);
    return found;
  }
}
