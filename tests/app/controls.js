// Of an element of the page, the name of the control that it is part of; "" if it is part of none.
// Names are what a user reads: the label of a field, the text of a button. `Clear X` empties the
// list X; `Upload masks` is the upload for the state `masks`; every link to a file is a `Download`.
(element) => {
  const plain = (text) => text.replace(/ \(\..*\)$/, "").trim(); // without a list of endings
  const option = element.closest?.("[role=option]");
  if (option) {
    const list = option.closest("[role=listbox]").getAttribute("aria-labelledby");
    return plain(document.getElementById(list)?.textContent ?? "");
  }
  const control = element.closest?.("button, a[href], input, textarea, select, [role=button], .v-input");
  if (!control) return "";
  if (control.matches("a[download]")) return "Download";
  if (control.matches("[data-uploads]")) return `Upload ${control.dataset.uploads}`;
  const named = control.getAttribute("aria-label");
  if (named) return plain(named);
  if (control.matches("button, a")) return control.textContent.trim();
  const label = control.closest(".v-input")?.querySelector("label");
  return plain(label?.textContent ?? `unnamed ${control.outerHTML.slice(0, 80)}`);
}
