// Materials of cells, of what is cut, and of the shell.

// Cells: matt, and darker where the surface turns away, which sets neighbours apart.
export function cellMaterial() {
  const material = new THREE.MeshLambertMaterial({ side: THREE.DoubleSide, vertexColors: true });
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <opaque_fragment>",
      `outgoingLight *= mix(0.45, 1.0, pow(abs(dot(normal, normalize(vViewPosition))), 0.7));
       #include <opaque_fragment>`,
    );
  };
  return material;
}

// Line around the picked cell: its back faces, moved outward by `width` µm.
export function outlineMaterial(width) {
  const material = new THREE.MeshBasicMaterial({ side: THREE.BackSide, color: "#111111" });
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace(
      "#include <begin_vertex>",
      `vec3 transformed = position + normal * ${width.toFixed(3)};`,
    );
  };
  return material;
}

export function shellMaterial(side) {
  return new THREE.MeshLambertMaterial({
    color: "#8fa3b3", transparent: true, opacity: side === THREE.BackSide ? 0.16 : 0.13,
    depthWrite: false, side,
  });
}

// Flat colour; for pictures in which the colour is the number of a cell.
export function flatMaterial(side) {
  return new THREE.MeshBasicMaterial({ side, toneMapped: false, vertexColors: true });
}

// Counts, per pixel, how often the line of sight enters and leaves a cell behind the cut.
export function countingMaterial(side) {
  const count = side === THREE.BackSide ? THREE.IncrementWrapStencilOp : THREE.DecrementWrapStencilOp;
  return new THREE.MeshBasicMaterial({
    side, colorWrite: false, depthWrite: false, depthTest: false, stencilWrite: true,
    stencilFunc: THREE.AlwaysStencilFunc, stencilFail: count, stencilZFail: count, stencilZPass: count,
  });
}

// Where a cell was counted to be cut, its inside is drawn, and the count is set back to 0.
export function capMaterial() {
  return new THREE.MeshBasicMaterial({
    side: THREE.DoubleSide, toneMapped: false, stencilWrite: true, stencilRef: 0,
    stencilFunc: THREE.NotEqualStencilFunc, stencilFail: THREE.ZeroStencilOp,
    stencilZFail: THREE.ZeroStencilOp, stencilZPass: THREE.ZeroStencilOp,
  });
}

// The number k of a cell as a colour, and back; 0 is nothing.
export function numberColour(k) {
  return new THREE.Color().setRGB(((k + 1) & 255) / 255, (((k + 1) >> 8) & 255) / 255, ((k + 1) >> 16) / 255);
}

export function paintNumber(material, k) {
  material.color.copy(numberColour(k));
  return material;
}

export function numberPainted(red, green, blue) {
  return red + 256 * green + 65536 * blue - 1;
}
