// Buttons, mouse and keys: what the user does to the viewer.

import { byId } from "./format.js";

const CLICK = 5; // pixels that a click may move

export function connect(viewer) {
  byId("by").addEventListener("change", (event) => {
    viewer.by = event.target.value;
    viewer.refresh();
  });
  toggle("shell", (on) => (viewer.embryo.shell.visible = on));
  toggle("names", (on) => (viewer.labels.on = on));
  toggle("mirror", (on) => viewer.embryo.mirror(on));
  toggle("panel-button", (on) => byId("panel").classList.toggle("open", on));
  byId("reset").addEventListener("click", () => viewer.embryo.look());
  byId("picture").addEventListener("click", () => viewer.frame && viewer.savePicture());
  connectCut(viewer);
  connectMouse(viewer);
  document.addEventListener("keydown", (event) => key(viewer, event));

  function toggle(id, act) {
    byId(id).addEventListener("click", () => {
      const on = byId(id).getAttribute("aria-pressed") !== "true";
      byId(id).setAttribute("aria-pressed", on);
      act(on);
      viewer.refresh();
    });
  }
}

function connectCut(viewer) {
  const { cut } = viewer;
  byId("cut").addEventListener("click", () => {
    cut.on = !cut.on;
    cut.faceCamera();
    viewer.setCut();
  });
  for (const radio of document.querySelectorAll("[name=axis]")) {
    radio.addEventListener("change", () => {
      cut.axis = Number(radio.value);
      cut.faceCamera();
      viewer.setCut();
    });
  }
  byId("cut-place").addEventListener("input", (event) => {
    cut.share = Number(event.target.value);
    viewer.setCut();
  });
  byId("cut-flip").addEventListener("click", () => {
    cut.keepsLow = !cut.keepsLow;
    viewer.setCut();
  });
}

// A press that does not move picks; a drag turns the view.
function connectMouse(viewer) {
  const canvas = byId("canvas");
  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => {
    pressed = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
  });
  canvas.addEventListener("pointerup", (event) => {
    if (!pressed || !viewer.frame) return;
    const moved = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]);
    pressed = null;
    const { left, top } = canvas.getBoundingClientRect();
    if (moved < CLICK) viewer.pickAt(event.clientX - left, event.clientY - top);
  });
}

function key(viewer, event) {
  if (byId("app").inert) return;
  const typing = event.target.matches("input[type=search], input[type=range], input[type=radio], select");
  if (event.ctrlKey || event.metaKey || event.altKey || (typing && event.key !== "Escape")) return;
  const { timeline } = viewer;
  const acts = {
    ArrowLeft: () => timeline.step(-1),
    ArrowRight: () => timeline.step(1),
    Home: () => timeline.jump(0),
    End: () => timeline.jump(Infinity),
    Escape: () => viewer.pick(null),
    c: () => byId("cut").click(),
    n: () => byId("names").click(),
    r: () => byId("reset").click(),
  };
  if (event.key === " " && !event.target.matches("button, input")) acts[" "] = () => byId("play").click();
  if (!acts[event.key]) return;
  event.preventDefault();
  acts[event.key]();
}
