// The list of cells: find, show and hide, pick.

import { byId, element, number } from "./format.js";

const MOST_ROWS = 300;

export class CellList {
  // `acts` are show(names, visible) and pick(name).
  constructor(acts) {
    this.acts = acts;
    this.list = byId("cells");
    this.search = byId("search");
    this.state = null; // what was drawn last
    this.rows = [];
    this.places = new Map(); // of the cells in the frame
    this.key = null;
    this.search.addEventListener("input", () => this.state && this.draw(this.state));
    byId("show-all").addEventListener("click", () => acts.show(this.listed(), true));
    byId("hide-all").addEventListener("click", () => acts.show(this.listed(), false));
  }

  // Names of all cells that the search finds, also of those that have no row.
  listed() {
    const text = this.search.value.trim().toLowerCase();
    return this.state ? this.state.frame.cells.filter((name) => name.toLowerCase().includes(text)) : [];
  }

  draw(state) {
    this.state = state;
    const names = this.listed();
    const key = names.join("\n");
    if (key !== this.key) this.make(names);
    this.key = key;
    const { frame, hidden, picked, colourOf } = state;
    this.places = new Map(frame.cells.map((name, k) => [name, k]));
    for (const { name, row, box, swatch, volume } of this.rows) {
      const k = this.places.get(name);
      box.checked = !hidden.has(name);
      row.classList.toggle("picked", name === picked);
      swatch.style.background = colourOf(k);
      volume.textContent = frame.volume[k] === null ? "" : number(frame.volume[k]);
    }
  }

  // Bring the row of a cell into sight.
  reveal(name) {
    this.rows.find((one) => one.name === name)?.row.scrollIntoView({ block: "nearest" });
  }

  make(names) {
    this.rows = names.slice(0, MOST_ROWS).map((name) => this.row(name));
    const more = names.length - this.rows.length;
    const text = names.length ? `${number(more, 0)} more: find them by name.` : "No such cell.";
    const told = more > 0 || (!names.length && this.state.frame.cells.length > 0);
    const note = element("li", { class: "none", hidden: !told }, text);
    this.list.replaceChildren(...this.rows.map(({ row }) => row), note);
  }

  row(name) {
    const box = element("input", { type: "checkbox", "aria-label": `Show ${name}` });
    box.addEventListener("change", () => this.acts.show([name], box.checked));
    const swatch = element("span", { class: "swatch" });
    const volume = element("span", { title: "volume, µm³" });
    const button = element("button", { type: "button", on: { click: () => this.acts.pick(name) } },
      element("span", {}, name), volume);
    return { name, box, swatch, volume, row: element("li", {}, box, swatch, button) };
  }
}
