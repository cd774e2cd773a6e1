// The slider of time, play and pause.

import { byId, drawn, timeText } from "./format.js";

const LENGTH = 12000; // ms that a run takes to play, within these:
const [SHORTEST, LONGEST] = [60, 500];
const SHAPES = { play: "M2 1 L13 7 L2 13 Z", pause: "M2 1 H5 V13 H2 Z M9 1 H12 V13 H9 Z" };

export class Timeline {
  // `go(index)` shows a time, and resolves when it is shown.
  constructor(go) {
    this.go = go;
    this.times = [];
    this.index = 0;
    this.turn = null; // an object while it plays
    this.slider = byId("time");
    this.button = byId("play");
    this.slider.addEventListener("input", () => this.jump(Number(this.slider.value)));
    this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    this.draw();
  }

  set(times, index) {
    this.times = times;
    this.index = index;
    this.draw();
  }

  // To a time that the user has chosen.
  jump(index) {
    this.pause();
    return this.go(Math.min(Math.max(index, 0), this.times.length - 1));
  }

  step(by) {
    return this.jump(this.index + by);
  }

  async play() {
    if (this.times.length < 2) return;
    const turn = (this.turn = {}); // a turn before, paused, may still wait
    const goesOn = () => this.turn === turn;
    this.draw();
    if (this.index === this.times.length - 1) await this.go(0);
    const pause = Math.min(Math.max(LENGTH / this.times.length, SHORTEST), LONGEST);
    while (goesOn() && this.index < this.times.length - 1) {
      await new Promise((done) => setTimeout(done, pause));
      if (goesOn()) await this.go(this.index + 1);
    }
    if (goesOn()) this.pause();
  }

  pause() {
    this.turn = null;
    this.draw();
  }

  get playing() {
    return this.turn !== null;
  }

  draw() {
    const last = Math.max(this.times.length - 1, 0);
    this.slider.max = last;
    this.slider.value = this.index;
    this.slider.disabled = this.button.disabled = last === 0;
    const text = this.times.length ? `t = ${timeText(this.times[this.index])}` : "";
    byId("time-value").textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
    const shape = this.playing ? "pause" : "play";
    if (this.shape === shape) return;
    this.shape = shape;
    this.button.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    this.button.replaceChildren(drawn("svg", { viewBox: "0 0 14 14" }, drawn("path", { d: SHAPES[shape] })));
  }
}
