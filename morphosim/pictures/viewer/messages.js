// Messages to and from the page that the viewer is a frame of: `{ morphosim: kind, … }`.

// `acts` are load(data), append(frame, follow), time(index), select(cell).
export function listen(acts) {
  const handlers = {
    load: ({ data }) => acts.load(data),
    append: ({ frame, follow }) => acts.append(frame, Boolean(follow)),
    time: ({ index }) => acts.time(index),
    select: ({ cell }) => acts.select(cell),
  };
  window.addEventListener("message", (event) => {
    if (event.source === window.parent) handlers[event.data?.morphosim]?.(event.data);
  });
}

export function tell(kind, values = {}) {
  window.parent.postMessage({ morphosim: kind, ...values }, "*");
}
