// Between the page's state and the 3-D viewers in its iframes.
//
// The state `live_stream` and `run_stream`, {key, count}, say what a viewer shows: part 0 of the
// stream `key` opens it, the parts up to `count` are frames that follow. `run_cell` and
// `run_index` say what is chosen. What viewers tell goes to the trigger `viewer_said`. And the order
// of what the page tells the server: see `putInOrder`.
(() => {
  const wanted = { live: null, run: null };
  const shown = { live: null, run: null };
  const busy = { live: false, run: false };
  const ready = { live: false, run: false };
  const STILL = 1000; // ms without a move of its own, after which the run's viewer follows others
  let [at, moved] = [-1, 0]; // what time it shows, and when it has last told so

  const frame = (id) => document.getElementById(`${id}-viewer`);

  function post(id, message) {
    frame(id)?.contentWindow?.postMessage(message, window.location.origin);
  }

  async function part(key, number) {
    const answer = await fetch(`streams/${key}/${number}`);
    return answer.ok ? answer.json() : null;
  }

  // Bring a viewer to what is wanted, one part after the other.
  async function follow(id) {
    if (busy[id] || !ready[id]) return;
    busy[id] = true;
    try {
      while (wanted[id]?.key && !same(id)) await next(id, wanted[id].key);
    } finally {
      busy[id] = false;
    }
  }

  function same(id) {
    return shown[id]?.key === wanted[id].key && shown[id].count >= wanted[id].count;
  }

  async function next(id, key) {
    const begins = shown[id]?.key !== key;
    const number = begins ? 0 : shown[id].count;
    const data = await part(key, number);
    shown[id] = { key, count: number + 1 };
    if (!data) return;
    if (begins) open(id, data);
    else post(id, { morphosim: "append", frame: data, follow: true });
  }

  function open(id, data) {
    post(id, { morphosim: "load", data });
    if (id !== "run") return;
    const state = window.trame.state.state;
    [at, moved] = [-1, 0];
    agree();
    if (state.run_cell) post(id, { morphosim: "select", cell: state.run_cell });
  }

  // Show the time that the state says, which may be the choice of another window.
  function agree() {
    const still = performance.now() - moved;
    const index = window.trame.state.state.run_index;
    if (still < STILL) setTimeout(agree, STILL - still);
    else if (index >= 0 && index !== at) post("run", { morphosim: "time", index: (at = index) });
  }

  window.addEventListener("message", (event) => {
    const id = ["live", "run"].find((name) => frame(name)?.contentWindow === event.source);
    const kind = event.data?.morphosim;
    if (!id || !kind) return;
    if (kind === "ready") {
      ready[id] = true;
      shown[id] = null;
      follow(id);
    } else if (kind === "picked" || kind === "shown") {
      const value = event.data[kind === "picked" ? "cell" : "index"];
      if (id === "run" && kind === "shown") [at, moved] = [value, performance.now()];
      window.trame.trigger("viewer_said", [id, kind, value]);
    }
  });

  // What is asked for comes after the values that controls have changed: trame sends these later
  // than a trigger of the same event, and not at all while it waits for an answer. So each trigger,
  // whatever control it is of, first lets all handlers of its event run and sends what they say.
  function putInOrder(trame) {
    const pull = trame.trigger;
    let last = Promise.resolve();
    trame.trigger = (...request) => {
      const sent = last.then(() => allSaid(trame));
      last = sent.catch(() => {}); // a request that fails holds up no other
      return sent.then(() => pull(...request));
    };
  }

  async function allSaid(trame) {
    do await new Promise((done) => setTimeout(done));
    while (trame.client.isBusy());
    await trame.state.flush();
  }

  // trame hangs up whenever the page may be left, which a link that downloads does not do.
  window.addEventListener("beforeunload", (event) => event.stopImmediatePropagation(), true);

  const FAREWELL = 2000; // ms in which a server that ends may still answer

  // Where the connection is lost the page says so, see `LOST`; it comes back with the server.
  async function comeBack() {
    const answer = await fetch(window.location.href).catch(() => null);
    if (answer?.ok) window.location.reload();
    else setTimeout(comeBack, 1000);
  }

  // A browser that goes back may show the page as it was left, without its connection.
  window.addEventListener("pageshow", (event) => event.persisted && window.location.reload());

  function watch() {
    const state = window.trame?.state;
    if (!state) return setTimeout(watch, 50);
    putInOrder(window.trame);
    window.trame.client.onConnectionClose(() => setTimeout(comeBack, FAREWELL));
    for (const id of ["live", "run"]) {
      state.watch([`${id}_stream`], (stream) => {
        wanted[id] = stream;
        follow(id);
      });
    }
    state.watch(["run_cell"], (cell) => post("run", { morphosim: "select", cell: cell || null }));
    state.watch(["run_index"], agree);
  }
  watch();

  // Send a file to the folder, beside one that has been sent before; what is said to it.
  async function send(file, beside) {
    const query = beside ? `?beside=${encodeURIComponent(beside)}` : "";
    const address = `files/${encodeURIComponent(file.name)}${query}`;
    try {
      const answer = await fetch(address, { method: "POST", body: file });
      return { ok: answer.ok, text: await answer.text() };
    } catch (error) {
      return { ok: false, text: `${file.name} could not be sent: ${error.message}` };
    }
  }

  // Send files of an <input type="file"> to the folder, a scene before what lies beside it; then
  // `name` of the state is the name of the first.
  window.addEventListener("change", async (event) => {
    const name = event.target?.dataset?.uploads;
    const files = [...(event.target?.files ?? [])];
    if (!name || !files.length) return;
    const isScene = (file) => /\.toml$/i.test(file.name);
    files.sort((a, b) => isScene(b) - isScene(a));
    let first = "";
    let answer = { ok: true };
    for (const file of files) {
      answer = await send(file, first);
      if (!answer.ok) break;
      first ||= answer.text;
    }
    window.trame.trigger("uploaded", [name, answer.ok, answer.ok ? first : answer.text]);
    event.target.value = ""; // so that the same file can be sent again
  });
})();
