"use strict";
// Lines to pixels.  Without a graphics card the strokes of a canvas take three times as long, because a path of many
// segments is filled as one shape.  The coverage of a pixel follows from the distance of its centre to the line.
function colour(text) {
  return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
}

// Segments `first` to `last` of end points (x, y, x, y) in the coordinates of a view, thickness and dashes in pixels.
function rasterise(image, segments, first, last, view, [red, green, blue], thickness, dash) {
  const { width, height } = image,
    { s, x0, y0 } = view,
    half = thickness / 2;
  const pixels = image.pixels || (image.pixels = new Uint32Array(image.data.buffer));
  // Red and blue of a pixel are blended in one product; a pixel that is covered whole is not blended.
  const whole = (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0,
    outer = (blue << 16) | red;
  for (let i = 4 * first; i < 4 * last; i += 4) {
    let ax = x0 + s * segments[i],
      ay = y0 - s * segments[i + 1],
      bx = x0 + s * segments[i + 2],
      by = y0 - s * segments[i + 3];
    // u runs along the longer side of the segment from a to b, v across it.
    const steep = Math.abs(by - ay) > Math.abs(bx - ax);
    if (steep) [ax, ay, bx, by] = [ay, ax, by, bx];
    if (bx < ax) [ax, ay, bx, by] = [bx, by, ax, ay];
    if (!(bx > ax)) continue;
    const slope = (by - ay) / (bx - ax),
      cosine = 1 / Math.sqrt(1 + slope * slope),
      length = (bx - ax) / cosine;
    // The edge of the line fades over the width of a pixel across it.
    const fade = cosine * (1 + Math.abs(slope)),
      reach = half + fade / 2,
      full = 256 * Math.min(1, thickness / fade);
    const scale = 256 / fade,
      top = scale * reach,
      drop = scale * cosine,
      across = reach / cosine;
    const stepU = steep ? width : 1,
      stepV = steep ? 1 : width,
      lastV = (steep ? width : height) - 1;
    const endU = Math.min((steep ? height : width) - 1, Math.floor(bx + reach));
    for (let u = Math.max(0, Math.floor(ax - reach)); u <= endU; u++) {
      const along = u + 0.5 - ax,
        middle = ay + along * slope - 0.5,
        end = Math.min(lastV, Math.floor(middle + across));
      for (let v = Math.max(0, Math.ceil(middle - across)); v <= end; v++) {
        const t = cosine * (along + slope * (v + 0.5 - ay)),
          tip = (t < length - t ? t : length - t) + 0.5;
        if (tip <= 0 || (dash && t % (1.5 * dash) > dash)) continue;
        const edge = top - drop * Math.abs(v - middle),
          side = edge < full ? edge : full;
        const cover = ((tip < 1 ? side * tip : side) + 0.5) | 0,
          at = u * stepU + v * stepV;
        if (cover > 255) {
          pixels[at] = whole;
          continue;
        }
        const old = pixels[at],
          rest = 256 - cover;
        pixels[at] =
          0xff000000 |
          (((Math.imul(outer, cover) + Math.imul(old & 0xff00ff, rest) + 0x800080) >>> 8) & 0xff00ff) |
          ((green * cover + ((old >>> 8) & 0xff) * rest + 0x80) & 0xff00);
      }
    }
  }
}
