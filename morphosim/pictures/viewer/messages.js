// Messages to and from the page that the viewer is a frame of: `{ morphosim: kind, … }`. A viewer
// that is no frame hears itself, so what is told has other kinds than what is listened to.

// `acts` are load(data), append(frame, follow), time(index), select(cell), and failed(error). What
// the page came with is loaded first; then messages are acted on in their order.
export function listen(acts, data) {
  const handlers = {
    load: ({ data }) => acts.load(data),
    // These are not waited for: the next may overtake them.
    append: ({ frame, follow }) => void acts.append(frame, Boolean(follow)).catch(acts.failed),
    time: ({ index }) => void acts.time(index).catch(acts.failed),
    select: ({ cell }) => acts.select(cell),
  };
  let last = Promise.resolve(data && acts.load(data)).then(() => tell("ready")).catch(acts.failed);
  window.addEventListener("message", (event) => {
    const act = handlers[event.data?.morphosim];
    if (!act || event.source !== window.parent) return;
    last = last.then(() => act(event.data)).catch(acts.failed);
  });
}

export function tell(kind, values = {}) {
  window.parent.postMessage({ morphosim: kind, ...values }, "*");
}
