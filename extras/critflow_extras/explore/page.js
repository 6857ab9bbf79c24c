"use strict";
// The page draws what the server sends and reports what the user does; every number is text from the server.
const get = (id) => document.getElementById(id),
  // What stands behind the # stays in the browser: no server and no log sees it in an address.
  token = location.hash.slice(1);
const LABELS = {
  B_0: "B₀",
  G_0: "G₀",
  C_G_stress_corrected: "C_G, stress-corrected",
  V_L: "V_L",
  V_tau: "V_τ",
  B: "B at rest",
  G: "G at rest",
  "force(γ)": "largest force at γ",
  "B(γ)": "B at γ",
  "G(γ)": "G at γ",
  "M(γ)": "modulus along γ",
  residual: "force residual / ⟨τ⟩",
  bound: "bound of B₀",
};
const ROWS = [
  "B",
  "G",
  "B_0",
  "bound",
  "G_0",
  "C_B",
  "C_G",
  "C_G_stress_corrected",
  "V_L",
  "V_tau",
  "residual",
  "self-stresses",
  "floppy modes",
  "B(γ)",
  "G(γ)",
  "M(γ)",
  "force(γ)",
];
let state = {},
  welcome = {},
  panels = {},
  series = [],
  seriesKey = null,
  point = null,
  trail = [],
  curve = null;
let legendOf = null,
  socket,
  waiting = false,
  queue = [],
  sequence = 0,
  sentAt = new Map(),
  drag = null,
  picked = null,
  requested = null;
const MEANING = {
  B_0: "bulk modulus at the transition",
  G_0: "shear modulus at the transition",
  C_B: "growth of the bulk modulus with the strain of dilation",
  C_G: "growth of the shear modulus with the strain of shear, energy convention",
  C_G_stress_corrected: "growth of the shear modulus, corrected by the stress",
  V_L: "variance of the lengths over their squared mean",
  B: "bulk modulus of springs at rest at the positions of the file",
  G: "shear modulus of springs at rest at the positions of the file",
  V_tau: "variance of the tensions over their squared mean",
  bound: "no stress of this network has a larger B₀",
  residual: "largest force on a vertex over the mean tension",
  "self-stresses": "independent stresses in balance at this configuration",
  "floppy modes": "independent motions within the network that change no length to first order",
  "B(γ)": "bulk modulus at the strain γ",
  "G(γ)": "shear modulus at the strain γ, energy convention",
  "M(γ)": "modulus along the deformation at the strain γ",
  "force(γ)": "largest force on a vertex at the strain γ",
};
const HINT =
  "Click an edge and drag it up or down, choose a population, or move γ past the transition. Every number below is exact to its error.";
const HELP = {
  edge: "Pick an edge, or type its number.",
  face: "Every edge keeps its direction and tension, so B₀ stands still.",
};
const STOPPED = "The server has stopped: start critflow explore again. The picture here no longer changes.";
const NO_FORCES =
  "This network has no force diagram here: it needs a periodic planar network without crossing edges.";
const REST = "Springs at rest carry no force: a population, or a change of an edge, stresses them.";
const SLOW =
  "This network is large: at 10,000 vertices a change takes about 0.2 s, errors half a second more, and counts another second.";
window.latencies = [];
window.replies = 0;

// Messages: one at a time; a later position of the same slider replaces one that waits.

function send(message, playing = false) {
  if (!playing) rest();
  const last = queue[queue.length - 1],
    moves = (m) => m && m.do === "change" && m.change[0] + "/" + (m.change.length === 3 ? m.change[1] : "");
  if (last && message.do === "change" && message.change[0] !== "cut" && moves(last) === moves(message)) queue.pop();
  queue.push({ ...message, at: performance.now() });
  pump();
}
function pump() {
  if (waiting || !queue.length || !socket || socket.readyState !== 1) return;
  const { at, ...message } = queue.shift();
  waiting = true;
  message.seq = ++sequence;
  message.series = seriesKey;
  sentAt.set(message.seq, at);
  socket.send(JSON.stringify(message));
}
function change(...values) {
  send({ do: "change", change: values });
}

// A request with the token; the sentence of the reply, or of its failure, in `text()`.
function ask(path, given = {}) {
  return fetch(path, { ...given, headers: { Authorization: `Bearer ${token}` } }).catch(() => ({
    ok: false,
    text: async () => STOPPED,
  }));
}
async function connect() {
  const tab = sessionStorage.getItem("tab") || "";
  const reply = await ask("token");
  if (!reply.ok) {
    say(await reply.text(), true);
    if (reply.status !== 403) setTimeout(connect, 2000);
    return;
  }
  socket = new WebSocket(`ws://${location.host}/socket?tab=${encodeURIComponent(tab)}`, ["critflow", token]);
  socket.binaryType = "arraybuffer";
  socket.onmessage = (event) => receive(event.data);
  socket.onclose = (event) => {
    waiting = false;
    queue = [];
    say(event.reason || STOPPED, true);
    document.body.dataset.connected = "no";
    rest();
    setTimeout(connect, 2000);
  };
}

function receive(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  if (header.busy) {
    say(`Computing: ${header.busy}`);
    get("stop").hidden = false;
    return;
  }
  if (header.fault) {
    say(header.fault, true);
    waiting = false;
    pump();
    return;
  }
  const full = "drawings" in header && Object.keys(header.drawings).length > 0;
  if (full) {
    panels = {};
    let offset = 4 + length;
    for (const [name, drawing] of Object.entries(header.drawings)) {
      drawing.segments = new Float32Array(buffer, offset, 4 * drawing.n);
      offset += 16 * drawing.n;
      drawing.edges = new Float32Array(buffer, offset, drawing.n);
      offset += 4 * drawing.n;
      panels[name] = drawing;
    }
    header.values = new Float32Array(buffer, offset, header.values);
    state = header;
  } else for (const key of ["edge", "face"]) if (key in header) state[key] = header[key];
  if (header.welcome) greet(header.welcome);
  if (header.plane && header.plane.series) {
    series = header.plane.series;
    seriesKey = header.plane.key;
    legendOf = null;
  }
  if ("point" in header) {
    point = header.point;
    trail = header.trail;
    curve = header.curve;
  }
  // The pixels are made at once: the browser may wait most of a frame before it calls back.
  if (full) drawPanels();
  // The next request leaves when the pixels are made, with the newest position of the slider.
  if (full && "seq" in header) {
    waiting = false;
    pump();
  }
  requestAnimationFrame(() => {
    if (full) controls();
    else if ("edge" in header) sliders();
    numbers(header);
    if ("point" in header || (header.plane && header.plane.series)) plots();
    if (full) setTimeout(() => painted(header), 0);
    window.replies++;
  });
}
function painted(header) {
  if (sentAt.has(header.seq)) window.latencies.push(performance.now() - sentAt.get(header.seq));
  sentAt.delete(header.seq);
  window.shown = header.seq;
  if (player && header.seq === sequence) played(header);
}
function say(sentence, error = false) {
  text(get("sentence"), sentence);
  get("sentence").className = error ? "error" : "";
}
// Text that stays is not set, which would lay out the page again.
function text(element, words) {
  words = minus(words);
  if (element.textContent !== words) element.textContent = words;
}
function adjust(input, values) {
  for (const [key, value] of Object.entries(values)) if (input[key] !== String(value)) input[key] = value;
}

// Numbers and controls

function numbers(header) {
  const body = get("numbers"),
    rows = {};
  for (const row of body.rows) rows[row.dataset.key] = row;
  const put = (number, due = false) => {
    let row = rows[number.key];
    if (!row) {
      row = document.createElement("tr");
      row.dataset.key = number.key;
      const head = document.createElement("th");
      head.scope = "row";
      symbols(head, LABELS[number.key] || number.key);
      head.title = MEANING[number.key];
      row.append(head, document.createElement("td"), document.createElement("td"));
      row.cells[1].append(digitsOf(number.key));
      const after = [...body.rows].find((other) => ROWS.indexOf(other.dataset.key) > ROWS.indexOf(number.key));
      body.insertBefore(row, after || null);
      rows[number.key] = row;
    }
    if (row.className !== (due ? "due" : "")) row.className = due ? "due" : "";
    if (number.text !== undefined) {
      const digits = row.cells[1].firstChild;
      Object.assign(digits.dataset, { text: number.text, short: number.short });
      digits.title = `${number.text}: a click copies all digits`;
      text(digits, get("all").checked ? number.text : number.short);
      text(row.cells[2], [number.error, number.note].filter(Boolean).join("; "));
    }
  };
  if (header.due) {
    if (header.rows)
      for (const key of Object.keys(rows))
        if (!header.rows.includes(key)) {
          rows[key].remove();
          delete rows[key];
        }
    for (const key of header.due) put({ key }, true);
  }
  if (header.bound) put(header.bound);
  const due = new Set(header.due || []);
  for (const number of header.numbers || []) put(number, due.has(number.key));
}
// A single letter after an underscore stands below the line, as in C_B: each second part of the result.
const subscripts = (words) => words.split(/_([\p{L}\d])(?![\p{L}\d_])/u);
function symbols(node, words) {
  node.replaceChildren(
    ...subscripts(words).map((part, n) => {
      if (n % 2 === 0) return part;
      const below = document.createElement("sub");
      below.textContent = part;
      return below;
    }),
  );
}
// The value of a number: four digits until all are asked for; a click copies all.
function digitsOf(key) {
  const digits = document.createElement("button");
  digits.className = "digits";
  digits.onclick = async () => {
    const copied = await navigator.clipboard.writeText(digits.dataset.text).then(
      () => true,
      () => false,
    );
    say(`${LABELS[key] || key} = ${digits.dataset.text}${copied ? " is copied." : ""}`);
  };
  return digits;
}
get("all").onchange = () => {
  for (const digits of document.querySelectorAll(".digits"))
    text(digits, digits.dataset[get("all").checked ? "text" : "short"] || "");
};
function controls() {
  document.body.dataset.connected = "yes";
  if (!queue.length) get("stop").hidden = true;
  if ("sentence" in state) say(state.sentence || (state.slow ? SLOW : HINT), state.error);
  text(get("title"), state.title);
  text(get("sizes"), state.sizes);
  if (document.title !== `critflow: ${state.title}`) document.title = `critflow: ${state.title}`;
  get("undo").disabled = !state.undo;
  get("redo").disabled = !state.redo;
  sliders();
  drawScale();
  if (welcome.dataset && state.case !== null && !waiting && !queue.length) showCase();
  get("colour").value = state.scale.colour;
  if (state.strain[0]) get("deformation").value = state.strain[0];
  const busy = waiting || queue.length;
  bounds();
  if (!busy) adjust(get("gamma"), { value: state.strain[1] });
  text(get("gammavalue"), (+state.strain[1]).toFixed(3));
  if (state.random)
    for (const [id, value] of [
      ["vertices", state.random[0]],
      ["seed", state.random[1]],
    ])
      if (document.activeElement !== get(id)) adjust(get(id), { value });
  if (!busy)
    state.weights.forEach((weight, i) => {
      const input = get("blend").querySelectorAll("input")[i];
      if (input) {
        adjust(input, { value: weight });
        text(input.nextSibling, weight.toFixed(2));
      }
    });
  if (!get("script").hidden) showScript();
}
function sliders() {
  const busy = waiting || queue.length;
  slide("stress", state.edge, busy);
  slide("size", state.face, busy);
  for (const [id, item] of [
    ["edge", state.edge],
    ["face", state.face],
  ]) {
    if (document.activeElement !== get(id)) get(id).value = item ? item.number : "";
    text(get(id + "text"), item ? item.text : HELP[id]);
  }
}
function slide(id, item, busy) {
  const input = get(id);
  input.disabled = !item || item.low === item.high;
  if (!item) adjust(input, { min: -1, max: 1, value: 0 });
  else if (!busy) adjust(input, { min: item.low, max: item.high, value: item.value });
  text(get(id + "value"), item ? item.value.toPrecision(4) : "0");
}
function bounds() {
  const limit = welcome.strains[get("deformation").value];
  adjust(get("gamma"), { min: -limit / 5, max: limit / 5 });
}
function option(value, text = value) {
  const o = document.createElement("option");
  o.value = value;
  o.textContent = text;
  return o;
}

function greet(found) {
  welcome = found;
  sessionStorage.setItem("tab", found.tab);
  get("deformation").replaceChildren(...Object.keys(found.strains).map((name) => option(name, name.replace("_", " "))));
  const buttons = Object.entries(found.populations).map(([name, label]) => {
    const button = document.createElement("button");
    symbols(button, label);
    button.onclick = () => {
      say(`Computing ${label} …`);
      change("population", name);
    };
    return button;
  });
  const equal = document.createElement("button");
  equal.textContent = "equal σ";
  equal.title = "the stress of each edge is its stiffness";
  equal.onclick = () => change("equal_stress");
  get("populations").replaceChildren(...buttons, equal);
  const sliders = Object.entries(found.populations).map(([name, label]) => {
    const box = document.createElement("label"),
      words = document.createElement("span"),
      input = document.createElement("input"),
      value = document.createElement("output");
    Object.assign(input, { type: "range", min: 0, max: 1, step: 0.01, value: 0 });
    input.oninput = () => {
      const weights = [...get("blend").querySelectorAll("input")].map((i) => +i.value);
      if (weights.some((w) => w > 0)) change("blend", ...weights);
    };
    symbols(words, label);
    box.append(words, input, value);
    return box;
  });
  get("blend").replaceChildren(...sliders);
  get("colour").replaceChildren(
    ...Object.entries(found.quantities).map(([name, label]) => option(name, label.split(" ")[0])),
  );
  dataset(found.dataset);
}
function dataset(found) {
  get("data").hidden = !found;
  if (!found) return;
  get("datatitle").textContent = found.title;
  get("axes").replaceChildren(
    ...found.axes.map((axis) => {
      const box = document.createElement("label"),
        select = document.createElement("select");
      box.append(axis.name + " ", select);
      select.dataset.axis = axis.name;
      select.append(...axis.labels.map((label, i) => option(i, label)));
      select.onchange = chooseCase;
      return box;
    }),
  );
  for (const id of ["x", "y"])
    get(id).replaceChildren(
      option("", "automatic"),
      ...Object.entries(found.variables).map(([name, text]) => option(name, `${name}: ${text}`)),
    );
  get("status").replaceChildren(
    option("", "all"),
    ...Object.entries(found.statuses).map(([name, count]) => option(name, `${name} (${count})`)),
  );
}
function chooseCase() {
  const index = welcome.dataset.axes.reduce(
    (sum, axis, k) => sum * axis.labels.length + +get("axes").querySelectorAll("select")[k].value,
    0,
  );
  send({ do: "case", case: index });
}
// The choices show the case on the page, which a point, an option of the command or a reload may have opened.
function showCase() {
  let rest = state.case;
  [...welcome.dataset.axes]
    .map((axis, k) => [k, axis.labels.length])
    .reverse()
    .forEach(([k, size]) => {
      get("axes").querySelectorAll("select")[k].value = rest % size;
      rest = Math.floor(rest / size);
    });
}

// Mouse and keys

const tool = () => document.querySelector("input[name=tool]:checked").value;
for (const name of ["network", "forces"]) {
  const canvas = get(name);
  const fingers = new Map();
  // Midpoint and distance of two fingers.
  const spread = () => {
    const [[x, y], [u, v]] = fingers.values();
    return [(x + u) / 2, (y + v) / 2, Math.hypot(x - u, y - v) || 1];
  };
  const magnify = (factor, x, y) => {
    const box = canvas.getBoundingClientRect(),
      z = zoom[name],
      f = Math.max(1, Math.min(200, z.k * factor)) / z.k;
    const px = x - box.left,
      py = y - box.top;
    Object.assign(
      z,
      f * z.k === 1 ? { k: 1, x: 0, y: 0 } : { k: f * z.k, x: px - f * (px - z.x), y: py - f * (py - z.y) },
    );
    drawPanels();
  };
  canvas.onwheel = (event) => {
    event.preventDefault();
    magnify(1.002 ** -event.deltaY, event.clientX, event.clientY);
  };
  canvas.ondblclick = () => {
    Object.assign(zoom[name], { k: 1, x: 0, y: 0 });
    drawPanels();
  };
  canvas.onpointerdown = (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size > 1) {
      drag = { pinch: true };
      return;
    }
    if (event.shiftKey || event.button === 1) {
      canvas.setPointerCapture(event.pointerId);
      drag = { pan: true };
      return;
    }
    const box = canvas.getBoundingClientRect(),
      [x, y] = panels[name].view.inverse(event.clientX - box.left, event.clientY - box.top);
    canvas.setPointerCapture(event.pointerId);
    const kind = name === "forces" && tool() === "face" ? "edge" : tool();
    drag = { kind, y: event.clientY, moved: false, from: null };
    // A cut waits for the release: the finger may be the first of two.
    if (kind === "cut") drag.cut = { do: "pick", panel: name, x, y, tool: kind };
    else send({ do: "pick", panel: name, x, y, tool: kind });
  };
  canvas.onpointermove = (event) => {
    if (!event.buttons) describe(canvas, event);
    const before = fingers.size > 1 && spread();
    if (fingers.has(event.pointerId)) fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (before) {
      const [x, y, size] = spread();
      zoom[name].x += x - before[0];
      zoom[name].y += y - before[1];
      magnify(size / before[2], x, y);
      return;
    }
    if (drag && drag.pan) {
      zoom[name].x += event.movementX;
      zoom[name].y += event.movementY;
      drawPanels();
      return;
    }
    if (!drag || !(event.buttons & 1)) return;
    const up = drag.y - event.clientY,
      item = state[drag.kind];
    if (!item || (!drag.moved && Math.abs(up) < 4) || (!drag.moved && waiting)) return;
    if (!drag.moved) {
      drag.moved = true;
      drag.from = item.value;
      drag.number = item.number;
    }
    if (item.number === drag.number)
      move(
        drag.kind,
        item,
        drag.from + (drag.kind === "edge" ? up / 50 : (up / 120) * (up > 0 ? item.high : -item.low)),
      );
  };
  canvas.onpointerup = (event) => {
    if (drag && drag.cut) send(drag.cut);
    canvas.onpointercancel(event);
  };
  canvas.onpointercancel = (event) => {
    fingers.delete(event.pointerId);
    if (!fingers.size) drag = null;
  };
  canvas.onkeydown = (event) => {
    const kind = tool() === "face" ? "face" : "edge",
      item = state[kind],
      step = { ArrowLeft: -1, ArrowRight: 1 }[event.key],
      sign = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (step) send({ do: "select", [kind]: item ? (item.number + step + item.count) % item.count : 0 });
    else if (sign && item)
      move(kind, item, latest(kind, item) + sign * (kind === "edge" ? 0.1 : (item.high - item.low) / 40));
    else if (event.key === "x" && state.edge) change("cut", state.edge.number);
    else return;
    event.preventDefault();
  };
}
// The tooltip of a picture: the edge below the pointer, and the value that colours it.
const NEAR = 6;
function describe(canvas, event) {
  const { view, segments, edges, n } = panels[canvas.id],
    box = canvas.getBoundingClientRect(),
    [x, y] = view.inverse(event.clientX - box.left, event.clientY - box.top);
  let near = (NEAR / view.s) ** 2,
    edge = null;
  for (let i = 0; i < n; i++) {
    const x0 = segments[4 * i] - x,
      y0 = segments[4 * i + 1] - y,
      u = segments[4 * i + 2] - x - x0,
      v = segments[4 * i + 3] - y - y0;
    const part = Math.max(0, Math.min(1, -(x0 * u + y0 * v) / (u * u + v * v || 1))),
      square = (x0 + part * u) ** 2 + (y0 + part * v) ** 2;
    if (square < near) [near, edge] = [square, edges[i]];
  }
  const words = edge === null ? "" : minus(`edge ${edge}: ${state.scale.name}: ${state.values[edge].toPrecision(4)}`);
  if (canvas.title !== words) canvas.title = words;
}
function move(kind, item, value) {
  requested = [kind, item.number, Math.min(item.high, Math.max(item.low, value))];
  change(...requested);
}
// Keys that repeat continue from the value requested last, which the server may not have shown yet.
function latest(kind, item) {
  return (waiting || queue.length) && requested && requested[0] === kind && requested[1] === item.number
    ? requested[2]
    : item.value;
}
get("stress").oninput = () => state.edge && change("edge", state.edge.number, +get("stress").value);
get("size").oninput = () => state.face && change("face", state.face.number, +get("size").value);
get("gamma").oninput = () => change("strain", get("deformation").value, +get("gamma").value);
get("deformation").onchange = () => {
  bounds();
  get("gamma").value = 0;
  change("strain", get("deformation").value, 0);
};

// γ goes to the end of its slider and back until stopped.  The next position is sent when the last one is painted, so
// that one request at most is under way; the server computes each state once.

const STEPS = 50,
  INTERVAL = 40;
let player = null;
get("play").onclick = () => (player ? rest() : play());
function play() {
  const slider = get("gamma"),
    end = +slider.value < 0 ? +slider.min : +slider.max;
  player = { step: Math.round((+slider.value / end) * STEPS) || 0, forward: true, last: STEPS, end, at: 0 };
  text(get("play"), "■ Stop");
  advance();
}
function rest() {
  if (player) clearTimeout(player.timer);
  player = null;
  text(get("play"), "▶ Play");
}
function advance() {
  if (player.step >= player.last) player.forward = false;
  if (player.step <= 0) player.forward = true;
  player.step += player.forward ? 1 : -1;
  player.at = performance.now();
  const gamma = +((player.end * player.step) / STEPS).toFixed(6);
  send({ do: "change", change: ["strain", get("deformation").value, gamma] }, true);
}
// After a position is painted: one that was refused is the end of the path, and of a path that ends where it begins
// the other sign is tried, since one sign of a shear loosens the network.
function played(header) {
  if (header.error) player.last = player.step - 1;
  if (player.last < 1) {
    if (player.turned) return rest();
    player = { ...player, step: 0, forward: true, last: STEPS, end: -player.end, turned: true };
  }
  player.timer = setTimeout(advance, Math.max(0, INTERVAL - (performance.now() - player.at)));
}

for (const id of ["edge", "face"])
  get(id).onchange = () => get(id).value !== "" && send({ do: "select", [id]: +get(id).value });
get("colour").onchange = () => send({ do: "colour", by: get("colour").value });
get("undo").onclick = () => send({ do: "undo" });
get("redo").onclick = () => send({ do: "redo" });
get("stop").onclick = () => socket.send(JSON.stringify({ do: "stop" }));
for (const id of ["x", "y", "status"]) get(id).onchange = () => send({ do: "filter", [id]: get(id).value });
get("plane").onclick = (event) => {
  const box = get("plane").getBoundingClientRect(),
    x = event.clientX - box.left,
    y = event.clientY - box.top;
  const near = (get("plane").places || [])
    .map((p) => [Math.hypot(p[0] - x, p[1] - y), p[2]])
    .sort((a, b) => a[0] - b[0])[0];
  if (near && near[0] < 12) send({ do: "case", case: near[1] });
};
get("plane").onkeydown = (event) => {
  const places = (get("plane").places || []).slice().sort((a, b) => a[0] - b[0]),
    step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!places.length || !(step || event.key === "Enter")) return;
  event.preventDefault();
  if (!step) {
    if (picked !== null) send({ do: "case", case: places[picked][2] });
    return;
  }
  picked = picked === null ? 0 : (picked + step + places.length) % places.length;
  plots();
  const c = get("plane").getContext("2d");
  c.beginPath();
  c.arc(places[picked][0], places[picked][1], 8, 0, 7);
  c.strokeStyle = "#e69f00";
  c.lineWidth = 3;
  c.stroke();
};
get("new").onsubmit = (event) => {
  event.preventDefault();
  say("Making the network …");
  send({ do: "open", n_vertices: +get("vertices").value, seed: +get("seed").value });
};
// The file that was sent last: a refusal is answered in the fields, and the same file is opened again.
let sent = null;
function openSent() {
  const fields = Object.fromEntries(["cell", "pins", "volume"].map((id) => [id, get(id).value]));
  send({ do: "file", name: sent, ...fields, voronoi: get("voronoi").checked ? "yes" : "" });
}
get("own").onsubmit = (event) => {
  event.preventDefault();
  if (sent === null) say("Choose a file first.", true);
  else openSent();
};
get("file").onchange = async () => {
  const chosen = [...get("file").files];
  if (!chosen.length) return;
  for (const file of chosen) {
    const name = encodeURIComponent(file.name);
    const reply = await ask(`upload?tab=${welcome.tab}&name=${name}`, { method: "POST", body: file });
    if (!reply.ok) return say(await reply.text(), true);
  }
  sent = chosen[0].name;
  get("again").hidden = false;
  text(get("again"), `Open ${sent} again`);
  openSent();
  get("file").value = "";
};
async function save(name) {
  const reply = await ask(`export/${name}?tab=${welcome.tab}`);
  if (!reply.ok) return say(await reply.text(), true);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await reply.blob());
  link.download = /filename="(.+)"/.exec(reply.headers.get("Content-Disposition"))[1];
  link.click();
  URL.revokeObjectURL(link.href);
  say(`${link.download} is saved.`);
}
get("picture").onclick = () => save(`picture.${get("pictureformat").value}`);
get("savenetwork").onclick = () => save(`network.${get("networkformat").value}`);
async function showScript() {
  const reply = await ask(`export/script.py?tab=${welcome.tab}`);
  if (reply.ok) {
    get("script").textContent = await reply.text();
    get("script").hidden = false;
  }
}
get("showscript").onclick = () => {
  if (get("script").hidden) showScript();
  else get("script").hidden = true;
};
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.type === "number") return;
  event.preventDefault();
  send({ do: event.shiftKey ? "redo" : "undo" });
});
// The theme of the browser, or the one chosen, which stays for later visits.

const darkBrowser = matchMedia("(prefers-color-scheme: dark)");
function dress() {
  const chosen = localStorage.getItem("theme") || "auto";
  get("theme").value = chosen;
  theme = chosen === "auto" ? (darkBrowser.matches ? "dark" : "light") : chosen;
  document.documentElement.dataset.theme = chosen;
  if (!state.marks) return;
  legendOf = null;
  drawPanels();
  drawScale();
  plots();
}
darkBrowser.onchange = dress;
get("theme").onchange = () => {
  localStorage.setItem("theme", get("theme").value);
  dress();
};

// A reload finds its state under the name of the tab, which must be free by then.
window.addEventListener("pagehide", () => {
  if (!socket) return;
  socket.onclose = null;
  socket.close();
});
for (const id of ["network", "forces", "plane", "curve"]) observer.observe(get(id));
window.addEventListener("hashchange", () => location.reload());
dress();
connect();
