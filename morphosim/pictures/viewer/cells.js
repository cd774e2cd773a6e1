// The list of cells: find, show and hide, pick.

import { byId, element, number } from "./format.js";

export class CellList {
  // `acts` are show(names, visible) and pick(name).
  constructor(acts) {
    this.acts = acts;
    this.list = byId("cells");
    this.search = byId("search");
    this.rows = [];
    this.key = null;
    this.search.addEventListener("input", () => this.filter());
    byId("show-all").addEventListener("click", () => acts.show(this.listed(), true));
    byId("hide-all").addEventListener("click", () => acts.show(this.listed(), false));
  }

  listed() {
    return this.rows.filter(({ row }) => !row.hidden).map(({ name }) => name);
  }

  draw({ frame, hidden, picked, colourOf }) {
    const key = frame.cells.join("\n");
    if (key !== this.key) this.make(frame.cells);
    this.key = key;
    this.rows.forEach(({ name, row, box, swatch, volume }, k) => {
      box.checked = !hidden.has(name);
      row.classList.toggle("picked", name === picked);
      swatch.style.background = colourOf(k);
      volume.textContent = frame.volume[k] === null ? "" : number(frame.volume[k]);
    });
  }

  // Bring the row of a cell into sight.
  reveal(name) {
    this.rows.find((one) => one.name === name)?.row.scrollIntoView({ block: "nearest" });
  }

  make(names) {
    this.rows = names.map((name) => this.row(name));
    this.none = element("li", { class: "none", hidden: true }, "No such cell.");
    this.list.replaceChildren(...this.rows.map(({ row }) => row), this.none);
    this.filter();
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

  filter() {
    const text = this.search.value.trim().toLowerCase();
    for (const { name, row } of this.rows) row.hidden = !name.toLowerCase().includes(text);
    if (this.none) this.none.hidden = this.listed().length > 0 || !this.rows.length;
  }
}
