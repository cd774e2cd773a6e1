// What of the page is cut off, overlaps or does not fit into the window, in words.
() => {
  const faults = [];
  const wide = document.documentElement.scrollWidth;
  if (wide > window.innerWidth) faults.push(`the page scrolls sideways: ${wide} px`);
  const shown = (each) => each.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && !each.closest(".scroll");
  const all = (selector) => [...document.querySelectorAll(selector)].filter(shown);
  const text = (each) => (each.ariaLabel || each.textContent || each.outerHTML).trim().slice(0, 60);
  for (const each of all("h1, h2, h3, p, span.note, strong, label, .v-btn, .v-alert, .figures td")) {
    if (each.scrollWidth > each.clientWidth + 1 && each.clientWidth)
      faults.push(`cut off: ${text(each)}`);
  }
  const boxes = all(".v-input, .v-btn, a, .upload, h1, h2, h3, p, img, iframe, .scroll, .v-alert, table");
  const inside = (box) => box.left >= 0 && box.right <= window.innerWidth;
  boxes.forEach((one, k) => {
    const a = one.getBoundingClientRect();
    if (!inside(a)) faults.push(`outside of the window: ${text(one)}`);
    for (const two of boxes.slice(k + 1)) {
      if (one.contains(two) || two.contains(one)) continue;
      const b = two.getBoundingClientRect();
      const [x, y] = [
        Math.min(a.right, b.right) - Math.max(a.left, b.left),
        Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top),
      ];
      if (x > 1 && y > 1) faults.push(`overlap: ${text(one)} / ${text(two)}`);
    }
  });
  return faults;
}
