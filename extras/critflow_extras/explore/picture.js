"use strict";
// The pictures of the network and of its force diagram.
// Colours of all canvases; those of the other elements are in page.css.
const INKS = {
  light: {
    paper: "#ffffff",
    ink: "#14202b",
    grid: "#e3e7ea",
    frame: "#8a949e",
    face: "#fbe3b5",
    edge: "#f2bf4d",
    blend: "multiply",
  },
  dark: {
    paper: "#161d24",
    ink: "#e6ebef",
    grid: "#2c3640",
    frame: "#7b8792",
    face: "#5c4310",
    edge: "#a86f00",
    blend: "screen",
  },
};
let theme = "light";
// Sizes of the canvases as they are laid out: a drawing that asked for them would lay out the page once more.
const boxes = new Map();
const observer = new ResizeObserver((entries) => {
  for (const { target, contentRect } of entries) boxes.set(target, contentRect);
  if (state.marks) {
    drawPanels();
    plots();
  }
});
const zoom = { network: { k: 1, x: 0, y: 0 }, forces: { k: 1, x: 0, y: 0 } };

function context(canvas) {
  const ratio = window.devicePixelRatio || 1,
    box = boxes.get(canvas) || canvas.getBoundingClientRect();
  const width = Math.max(1, Math.round(box.width * ratio)),
    height = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  // Opaque: a picture that covers what is below it is composed in less time.
  const c = canvas.getContext("2d", { alpha: false });
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [c, box.width, box.height];
}
function fit(outline, width, height, { k, x: dx, y: dy }) {
  const xs = outline.map((p) => p[0]),
    ys = outline.map((p) => p[1]),
    margin = 6;
  const x0 = Math.min(...xs),
    y0 = Math.min(...ys),
    w = Math.max(...xs) - x0,
    h = Math.max(...ys) - y0;
  const plain = Math.min((width - 2 * margin) / w, (height - 2 * margin) / h),
    s = k * plain;
  const left = (k * (width - plain * w)) / 2 + dx,
    top = (k * (height - plain * h)) / 2 + dy;
  return {
    s,
    x0: left - s * x0,
    y0: top + s * (h + y0),
    x: (v) => left + s * (v - x0),
    y: (v) => top + s * (h - v + y0),
    inverse: (px, py) => [(px - left) / s + x0, h + y0 - (py - top) / s],
  };
}
function path(c, view, corners) {
  c.beginPath();
  corners.forEach(([x, y], i) => (i ? c.lineTo : c.moveTo).call(c, view.x(x), view.y(y)));
  c.closePath();
}
function drawPanels() {
  for (const name of ["network", "forces"]) {
    const drawing = panels[name],
      canvas = get(name);
    canvas.hidden = !drawing;
    if (drawing) drawPanel(canvas, drawing, name === "network" ? state.marks.face : []);
  }
  get("noforces").hidden = Boolean(panels.forces);
  text(get("noforces"), state.rest ? REST : NO_FORCES);
}
function drawPanel(canvas, drawing, faces) {
  const [c, width, height] = context(canvas),
    view = (drawing.view = fit(drawing.outline, width, height, zoom[canvas.id])),
    ratio = canvas.width / width;
  const { segments, edges, runs, n } = drawing,
    palette = welcome.palettes[theme],
    ink = INKS[theme],
    unit = Math.min(2.2, Math.max(0.35, (60 * Math.min(width, height)) / 500 / Math.sqrt(n)));
  if (!canvas.image || canvas.image.width !== canvas.width || canvas.image.height !== canvas.height)
    canvas.image = c.createImageData(canvas.width, canvas.height);
  const [red, green, blue] = colour(ink.paper);
  new Uint32Array(canvas.image.data.buffer).fill(0xff000000 | (blue << 16) | (green << 8) | red);
  const scaled = { s: ratio * view.s, x0: ratio * view.x0, y0: ratio * view.y0 };
  runs.forEach(([shade, first], k) => {
    const last = k + 1 < runs.length ? runs[k + 1][1] : n,
      compressed = shade === palette.length - 1;
    const thickness = unit * (compressed ? 1.6 : shade >= palette.length - 2 ? 0.6 : 0.6 + (1.5 * shade) / 32);
    rasterise(
      canvas.image,
      segments,
      first,
      last,
      scaled,
      colour(palette[shade]),
      ratio * thickness,
      compressed ? 4 * ratio : 0,
    );
  });
  c.putImageData(canvas.image, 0, 0);
  c.globalCompositeOperation = ink.blend;
  c.fillStyle = ink.face;
  for (const face of faces) {
    path(c, view, face);
    c.fill();
  }
  if (state.marks.edge !== null) {
    c.beginPath();
    c.lineCap = "round";
    c.lineWidth = 9;
    c.strokeStyle = ink.edge;
    for (let i = 0; i < n; i++)
      if (edges[i] === state.marks.edge) {
        c.moveTo(view.x(segments[4 * i]), view.y(segments[4 * i + 1]));
        c.lineTo(view.x(segments[4 * i + 2]), view.y(segments[4 * i + 3]));
      }
    c.stroke();
  }
  c.globalCompositeOperation = "source-over";
  if (canvas.id === "network") {
    c.fillStyle = ink.ink;
    for (const [x, y] of state.marks.pins) c.fillRect(view.x(x) - 3, view.y(y) - 3, 6, 6);
  }
  path(c, view, drawing.outline);
  c.rect(-1, -1, width + 2, height + 2);
  c.fillStyle = ink.paper;
  c.fill("evenodd");
  path(c, view, drawing.outline);
  c.strokeStyle = ink.frame;
  c.lineWidth = 1;
  c.stroke();
}

// The colour bar below the pictures: the values at its ends, and the name of what is coloured.

function drawScale() {
  const { name, low, high } = state.scale;
  text(get("low"), low);
  text(get("high"), high);
  text(get("scalename"), name);
  get("scale").style.backgroundImage = `linear-gradient(to right, ${welcome.palettes[theme].slice(0, 32).join()})`;
  get("scales").style.setProperty("--slack", welcome.palettes[theme][32]);
}
