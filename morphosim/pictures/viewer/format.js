// Numbers as text, and small helpers to make elements.

// 46047 -> "46 047"; as many digits as its size asks for.
export function number(value, digits = null) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const places = digits ?? (Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 1 ? 1 : 2);
  const [whole, part] = Math.abs(value).toFixed(places).split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") : whole;
  const sign = value < 0 && Number(value.toFixed(places)) !== 0 ? "−" : "";
  return sign + grouped + (part ? `.${part}` : "");
}

// Times: whole numbers without decimals.
export function timeText(value) {
  return number(value, Number.isInteger(value) ? 0 : 1);
}

export function signed(value, digits) {
  const text = number(value, digits);
  return value > 0 && text !== "–" ? `+${text}` : text;
}

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  return filled(made, attributes, children);
}

export function drawn(tag, attributes = {}, ...children) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

export function filled(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") {
      for (const [kind, act] of Object.entries(value)) made.addEventListener(kind, act);
    } else if (value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

export function byId(id) {
  return document.getElementById(id);
}

// At most so many letters; names often differ in the last ones, so that the middle is left out.
export function letters(text, most) {
  if (text.length <= most) return text;
  const ahead = Math.floor((most - 1) / 2);
  return `${text.slice(0, ahead)}…${text.slice(ahead + 1 - most)}`;
}

export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
