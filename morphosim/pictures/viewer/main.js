// The page: what is shown, and which part does what when the user or a message changes it.

import { Axes } from "./axes.js";
import { drawCard } from "./card.js";
import { CellList } from "./cells.js";
import { Colours } from "./colours.js";
import { Cut } from "./cut.js";
import { Embryo } from "./embryo.js";
import { byId, element, number, timeText } from "./format.js";
import { Ids } from "./ids.js";
import { connect } from "./inputs.js";
import { Labels } from "./labels.js";
import { drawLegend } from "./legend.js";
import { listen, tell } from "./messages.js";
import { savePicture } from "./picture.js";
import { ScaleBar } from "./scalebar.js";
import { Timeline } from "./timeline.js";
import { Unpacked, unpack } from "./unpack.js";

const LABELS_EVERY = 140; // ms between two searches for what is seen, while the view moves

class Viewer {
  constructor() {
    this.palette = JSON.parse(byId("palette").textContent);
    this.data = null;
    this.index = -1;
    this.shown = -1; // index of the frame on the canvas
    this.unpacking = null;
    this.by = "cell";
    this.hidden = new Set();
    this.picked = null;
    this.box = byId("view");
    this.embryo = new Embryo(byId("canvas"), () => this.moved());
    this.cut = new Cut(this.embryo);
    this.ids = new Ids(this.embryo, this.cut);
    this.labels = new Labels(byId("labels"), this.embryo, this.ids);
    this.axes = new Axes(byId("axes"), this.embryo);
    this.bar = new ScaleBar(byId("scale"), this.embryo);
    this.timeline = new Timeline((index) => this.go(index, true));
    this.list = new CellList({
      show: (names, visible) => this.setVisible(names, visible),
      pick: (name) => this.pick(name === this.picked ? null : name),
    });
    this.dirty = this.seek = false;
    this.sought = 0;
    connect(this);
    new ResizeObserver(() => this.resize()).observe(this.box);
    requestAnimationFrame((now) => this.tick(now));
  }

  get frame() {
    return this.data?.frames[this.shown];
  }

  get width() {
    return this.box.clientWidth;
  }

  get height() {
    return this.box.clientHeight;
  }

  // Show a run, at its last time; of the run that is shown already, at the same time.
  async load(data) {
    const same = this.data?.title === data.title;
    const time = this.frame?.time;
    this.data = { ...data, frames: [...data.frames] };
    this.colours = new Colours(this.palette, data);
    this.unpacked = new Unpacked();
    this.shown = -1;
    if (!same) this.forget(data);
    this.offerColourings();
    byId("title").textContent = data.title || "MorphoSim";
    const shell = data.shell ? (await unpack(data.shell))[0] : null;
    this.embryo.setShell(shell);
    byId("shell").hidden = !data.shell;
    this.embryo.setBounds(data.bounds);
    if (!same) this.begin(data);
    const times = this.data.frames.map((frame) => frame.time);
    const before = same ? times.findLastIndex((one) => one <= time) : -1;
    this.index = -1;
    await this.go(before < 0 ? times.length - 1 : before, false);
  }

  // See a run for the first time.
  begin({ cut }) {
    if (cut) this.cut.set(cut);
    this.showCut();
    this.embryo.look();
  }

  forget({ by }) {
    this.by = by ?? this.by;
    this.hidden = new Set();
    this.picked = null;
  }

  offerColourings() {
    const ways = this.colours.colourings;
    if (!ways.some((way) => way.by === this.by)) this.by = ways[0].by;
    byId("by").replaceChildren(...ways.map(({ by }) =>
      element("option", { value: by, selected: by === this.by }, by === "volume" ? "volume error" : by.replaceAll("_", " "))));
  }

  // One more time of a running simulation; one that is there already is replaced. Follows only
  // who looks at the last time.
  async append(frame, follow) {
    if (!this.data) return;
    const { frames } = this.data;
    const last = this.index === frames.length - 1;
    while (frames.length && frames.at(-1).time >= frame.time) frames.pop();
    frames.push(frame);
    this.timeline.set(frames.map((one) => one.time), Math.min(this.index, frames.length - 1));
    if (last && follow) await this.go(frames.length - 1, true);
    else if (this.frame) this.drawPanel();
  }

  // Show the time of an index; `told` if the parent page is to hear of it.
  async go(index, told) {
    const frame = this.data?.frames[index];
    if (!frame) return;
    const data = this.data;
    this.index = index;
    this.timeline.set(data.frames.map((one) => one.time), index);
    const overtaken = () => this.index !== index || this.data !== data;
    await this.unpacking; // one at a time, so that sliding leaves no heap of old times to do
    if (overtaken()) return;
    const found = this.unpacked.of(frame);
    this.unpacking = found.catch(() => {});
    const meshes = await found;
    if (overtaken()) return;
    this.embryo.setCells(frame.cells, meshes);
    this.embryo.widenBounds();
    this.shown = index;
    byId("notice").hidden = true;
    byId("app").inert = false;
    this.refresh();
    if (told) tell("shown", { index });
    const next = data.frames[index + 1];
    if (next && this.timeline.playing) this.unpacked.of(next);
  }

  colourOf(k) {
    return this.colours.of(this.by, this.frame, k);
  }

  // Bring everything to what is now shown, hidden and picked.
  refresh() {
    if (!this.frame) return;
    this.embryo.hide(this.hidden);
    this.embryo.paint((k) => this.colourOf(k));
    this.embryo.highlight(this.picked);
    this.cut.update();
    this.cut.paint();
    this.labels.picked = this.picked;
    this.drawPanel();
    this.moved();
  }

  drawPanel() {
    const { frame } = this;
    byId("when").textContent = whenText(frame);
    const way = this.colours.coloured(this.by);
    drawLegend(byId("legend"), this.completed(way), this.colours.legend(this.by, frame));
    const colourOf = (k) => this.colourOf(k);
    this.list.draw({ frame, hidden: this.hidden, picked: this.picked, colourOf });
    drawCard(byId("card"), { data: this.data, frame, name: this.picked, colourOf, acts: this.cardActs() });
  }

  cardActs() {
    return {
      close: () => this.pick(null),
      pick: (name) => this.pick(name),
      hide: (name) => this.setVisible([name], false),
      only: (name) => {
        const names = [...this.data.cells.map((cell) => cell.name), ...this.frame.cells];
        this.hidden = new Set(names.filter((one) => one !== name));
        this.refresh();
      },
    };
  }

  // A scale without colours has those of errors.
  completed(way) {
    return way.scale && !way.scale.stops
      ? { ...way, scale: { ...way.scale, stops: this.palette.errors } }
      : way;
  }

  setVisible(names, visible) {
    for (const name of names) this.hidden[visible ? "delete" : "add"](name);
    this.refresh();
  }

  pick(name, told = true) {
    this.picked = name;
    this.refresh();
    if (name) this.list.reveal(name);
    if (told) tell("picked", { cell: name });
  }

  pickAt(x, y) {
    const k = this.ids.at(x, y, this.width, this.height);
    this.pick(this.embryo.cells[k]?.name ?? null);
  }

  setCut() {
    this.showCut();
    this.refresh();
  }

  showCut() {
    byId("cut-bar").hidden = !this.cut.on;
    byId("cut").setAttribute("aria-pressed", this.cut.on);
    document.querySelectorAll("[name=axis]")[this.cut.axis].checked = true;
    byId("cut-place").value = this.cut.share;
    byId("cut-value").textContent = `${"xyz"[this.cut.axis]} = ${number(this.cut.place, 1)} µm`;
  }

  resize() {
    if (!this.width || !this.height) return;
    this.embryo.resize(this.width, this.height, Math.min(window.devicePixelRatio, 2));
    this.draw(); // at once: setting the size has emptied the canvas
    this.moved();
  }

  // Draw with the next picture of the screen, and look anew for what is seen.
  moved() {
    this.dirty = this.seek = true;
  }

  draw() {
    this.embryo.draw();
    this.axes.draw();
    this.bar.draw(this.width, this.height);
  }

  tick(now) {
    this.embryo.controls.update();
    const drawn = this.dirty;
    if (drawn) {
      this.dirty = false;
      this.draw();
      this.labels.place(this.width, this.height);
    }
    if (this.seek && this.frame && now - this.sought > LABELS_EVERY) {
      this.seek = drawn; // once more when the view has come to rest
      this.sought = now;
      this.labels.find(this.width, this.height);
    }
    requestAnimationFrame((then) => this.tick(then));
  }

  savePicture() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    savePicture({
      canvas: byId("canvas"), width: this.width, height: this.height,
      draw: (ratio) => {
        this.embryo.resize(this.width, this.height, ratio);
        this.draw();
        this.dirty = true;
      },
      labels: this.labels.anchors, bar: this.bar, back: colour("--back"), ink: colour("--ink"),
      title: this.data.title, when: whenText(this.frame),
      way: this.completed(this.colours.coloured(this.by)),
      entries: this.colours.legend(this.by, this.frame),
    }, `${this.data.title || "cells"}-t${this.frame.time}.png`).finally(() => this.resize());
  }
}

function whenText(frame) {
  const count = frame.cells.length;
  const parts = [`t = ${timeText(frame.time)}`, frame.stage && `stage ${frame.stage}`];
  parts.push(count === 1 ? "1 cell" : `${count} cells`);
  return parts.filter(Boolean).join(" · ");
}

function begin() {
  let viewer;
  try {
    viewer = new Viewer();
  } catch (error) {
    byId("notice").textContent = `This browser cannot draw in 3-D (WebGL 2): ${error.message}`;
    return;
  }
  const data = JSON.parse(byId("data").textContent);
  listen({
    load: (data) => viewer.load(data),
    append: (frame, follow) => viewer.append(frame, follow),
    time: (index) => viewer.go(index, false),
    select: (cell) => viewer.pick(cell ?? null, false),
    failed: (error) => {
      byId("notice").textContent = `This browser cannot show the cells: ${error.message}`;
      byId("notice").hidden = false;
    },
  }, data);
}

begin();
