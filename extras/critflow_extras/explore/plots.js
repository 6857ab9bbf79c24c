"use strict";
// The plane of the network among others, and the curve past the transition.
// Okabe and Ito's colours, and a shape for each, so that none depends on colour alone.
const COLOURS = ["#0072B2", "#56B4E9", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#7F7F7F"];
// The first blue is too dark for a dark page, and black has no colour there.
const seriesColour = (kind) => (theme === "dark" && kind % 8 === 0 ? "#2f8fd6" : COLOURS[kind % 8] || INKS[theme].ink);

// Words with the sign of minus in numbers, as figures have it, in place of the hyphen.
const minus = (words) => String(words).replace(/(^|[\s(]|\de)-(?=\.?\d)/g, "$1−");

function ticks(low, high) {
  const step = 10 ** Math.floor(Math.log10((high - low) / 3)),
    factor = (high - low) / step > 12 ? 5 : (high - low) / step > 6 ? 2 : 1;
  const out = [];
  for (let v = Math.ceil(low / step / factor); v * step * factor <= high; v++)
    out.push(+(v * step * factor).toPrecision(12));
  return out;
}
function range(values) {
  let low = Infinity,
    high = -Infinity;
  for (const v of values) {
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (!(high > low)) {
    const pad = Math.abs(low) / 10 || 1;
    return [low - pad, high + pad];
  }
  const pad = 0.06 * (high - low);
  return [low - pad, high + pad];
}
function blank(canvas) {
  const [c, width, height] = context(canvas);
  c.fillStyle = INKS[theme].paper;
  // The pixels may end beyond a width that is no whole number.
  c.fillRect(0, 0, width + 1, height + 1);
  return [c, width, height];
}
function axes(canvas, xs, ys, xlabel, ylabel) {
  const [c, width, height] = blank(canvas),
    [x0, x1] = range(xs),
    [y0, y1] = range(ys),
    b = 34,
    r = 8,
    t = 8;
  c.font = "12px system-ui, sans-serif";
  const l = 28 + Math.max(...ticks(y0, y1).map((v) => c.measureText(minus(v)).width));
  const x = (v) => l + ((v - x0) / (x1 - x0)) * (width - l - r),
    y = (v) => height - b - ((v - y0) / (y1 - y0)) * (height - b - t);
  c.fillStyle = INKS[theme].ink;
  c.strokeStyle = INKS[theme].grid;
  c.lineWidth = 1;
  c.textAlign = "center";
  for (const v of ticks(x0, x1)) {
    c.beginPath();
    c.moveTo(x(v), t);
    c.lineTo(x(v), height - b);
    c.stroke();
    c.fillText(minus(v), x(v), height - b + 14);
  }
  c.textAlign = "right";
  for (const v of ticks(y0, y1)) {
    c.beginPath();
    c.moveTo(l, y(v));
    c.lineTo(width - r, y(v));
    c.stroke();
    c.fillText(minus(v), l - 4, y(v) + 4);
  }
  title(c, xlabel, (l + width) / 2, height - 4);
  c.save();
  c.translate(11, (height - b) / 2);
  c.rotate(-Math.PI / 2);
  title(c, ylabel, 0, 0);
  c.restore();
  return [c, x, y];
}
// A title of an axis with its subscripts, centred.
function title(c, words, x, y) {
  const fonts = ["12px system-ui, sans-serif", "9px system-ui, sans-serif"],
    parts = subscripts(words).map((part, n) => [part, fonts[n % 2], 3 * (n % 2)]);
  const widths = parts.map(([part, font]) => ((c.font = font), c.measureText(part).width));
  c.textAlign = "left";
  x -= widths.reduce((sum, width) => sum + width) / 2;
  parts.forEach(([part, font, lower], n) => {
    c.font = font;
    c.fillText(part, x, y + lower);
    x += widths[n];
  });
}
function mark(c, kind, x, y, r) {
  c.beginPath();
  c.fillStyle = c.strokeStyle = seriesColour(kind);
  const shape = kind % 6,
    polygon = (n, turn) => {
      for (let k = 0; k < n; k++)
        c.lineTo(
          x + 1.25 * r * Math.cos(turn + (2 * Math.PI * k) / n),
          y + 1.25 * r * Math.sin(turn + (2 * Math.PI * k) / n),
        );
      c.closePath();
      c.fill();
    };
  if (shape === 0) {
    c.arc(x, y, r, 0, 7);
    c.fill();
  } else if (shape === 1) polygon(4, Math.PI / 4);
  else if (shape === 2) polygon(3, -Math.PI / 2);
  else if (shape === 3) polygon(4, 0);
  else {
    const a = shape === 4 ? 0 : Math.PI / 4;
    for (const t of [a, a + Math.PI / 2]) {
      c.moveTo(x - r * Math.cos(t) * 1.2, y - r * Math.sin(t) * 1.2);
      c.lineTo(x + r * Math.cos(t) * 1.2, y + r * Math.sin(t) * 1.2);
    }
    c.lineWidth = 2;
    c.stroke();
  }
}
function plots() {
  const own = state.plane.own && point ? [...trail, point] : [];
  // The curve takes part of the width of the plane.
  get("curvebox").hidden = !curve;
  get("plane").hidden = get("legend").hidden = !(series.length || own.length);
  get("noplane").hidden = !get("plane").hidden;
  symbols(
    get("noplane"),
    state.plane.own ? "B₀ or C_B of this network has no value." : "No case of the dataset is shown.",
  );
  if (series.length || own.length) {
    const [c, x, y] = axes(
      get("plane"),
      [...series.flatMap((s) => s.x), ...own.map((p) => p[0])],
      [...series.flatMap((s) => s.y), ...own.map((p) => p[1])],
      state.plane.x,
      state.plane.y,
    );
    get("plane").places = [];
    for (const s of series)
      s.x.forEach((v, i) => {
        mark(c, s.kind, x(v), y(s.y[i]), 3.2);
        get("plane").places.push([x(v), y(s.y[i]), s.cases[i]]);
      });
    if (own.length) {
      c.beginPath();
      c.strokeStyle = INKS[theme].ink;
      c.lineWidth = 1;
      own.forEach((p) => c.lineTo(x(p[0]), y(p[1])));
      c.stroke();
      const [px, py] = own[own.length - 1];
      c.beginPath();
      c.arc(x(px), y(py), 6.5, 0, 7);
      c.lineWidth = 4;
      c.strokeStyle = INKS[theme].paper;
      c.stroke();
      c.lineWidth = 2.2;
      c.strokeStyle = INKS[theme].ink;
      c.stroke();
    }
    if (legendOf !== Boolean(own.length)) legend(own.length);
  } else {
    blank(get("plane"));
    get("plane").places = [];
  }
  if (!curve) return;
  symbols(get("curvename"), `${curve.name} against γ${curve.line ? "; the line is B₀ + C_B γ" : ""}`);
  const line = curve.line || [[], []],
    [c, x, y] = axes(get("curve"), [...curve.x, ...line[0]], [...curve.y, ...line[1]], "γ", curve.name);
  c.beginPath();
  c.strokeStyle = "#56B4E9";
  c.lineWidth = 2;
  line[0].forEach((v, i) => c.lineTo(x(v), y(line[1][i])));
  c.stroke();
  c.beginPath();
  c.strokeStyle = seriesColour(0);
  c.lineWidth = 1;
  curve.x.forEach((v, i) => c.lineTo(x(v), y(curve.y[i])));
  c.stroke();
  curve.x.forEach((v, i) => mark(c, 0, x(v), y(curve.y[i]), 3.5));
}
function legend(own) {
  const box = get("legend");
  box.replaceChildren();
  legendOf = Boolean(own);
  for (const s of series) {
    const item = document.createElement("span"),
      drawn = document.createElement("canvas"),
      icon = document.createElement("img");
    item.append(icon, s.label.replace(/([a-z])_(?=[a-z])/g, "$1 "));
    box.append(item);
    drawn.width = 24;
    drawn.height = 24;
    const c = drawn.getContext("2d");
    c.scale(2, 2);
    mark(c, s.kind, 6, 6, 3.6);
    // Each canvas of a page costs time in every frame, an image does not.
    icon.alt = "";
    icon.src = drawn.toDataURL();
  }
  if (own) {
    const item = document.createElement("span");
    item.textContent = "◯ this network, with its trail";
    box.append(item);
  }
}
