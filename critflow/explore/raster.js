"use strict";
// Lines to pixels.  Without a graphics card the strokes of a canvas take three times as long, because a path of many
// segments is filled as one shape.  The coverage of a pixel follows from the distance of its centre to the line.
function colour(text) { return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16)); }

// Segments `first` to `last` of end points (x, y, x, y) in the coordinates of a view, thickness and dashes in pixels.
function rasterise(image, segments, first, last, view, [red, green, blue], thickness, dash) {
  const { data, width, height } = image, { s, x0, y0 } = view, half = thickness / 2;
  for (let i = 4 * first; i < 4 * last; i += 4) {
    let ax = x0 + s * segments[i], ay = y0 - s * segments[i + 1], bx = x0 + s * segments[i + 2], by = y0 - s * segments[i + 3];
    // u runs along the longer side of the segment from a to b, v across it.
    const steep = Math.abs(by - ay) > Math.abs(bx - ax);
    if (steep) [ax, ay, bx, by] = [ay, ax, by, bx];
    if (bx < ax) [ax, ay, bx, by] = [bx, by, ax, ay];
    if (!(bx > ax)) continue;
    const slope = (by - ay) / (bx - ax), cosine = 1 / Math.hypot(1, slope), length = (bx - ax) / cosine;
    // The edge of the line fades over the width of a pixel across it.
    const fade = cosine * (1 + Math.abs(slope)), reach = half + fade / 2, full = Math.min(1, thickness / fade);
    const stepU = steep ? 4 * width : 4, stepV = steep ? 4 : 4 * width, lastV = (steep ? width : height) - 1;
    const endU = Math.min((steep ? height : width) - 1, Math.floor(bx + reach));
    for (let u = Math.max(0, Math.floor(ax - reach)); u <= endU; u++) {
      const along = u + 0.5 - ax, middle = ay + along * slope - 0.5, end = Math.min(lastV, Math.floor(middle + reach / cosine));
      for (let v = Math.max(0, Math.ceil(middle - reach / cosine)); v <= end; v++) {
        const t = cosine * (along + slope * (v + 0.5 - ay)), tip = Math.min(t, length - t) + 0.5;
        if (tip <= 0 || (dash && t % (1.5 * dash) > dash)) continue;
        const cover = Math.min(full, (reach - cosine * Math.abs(v - middle)) / fade) * Math.min(tip, 1), at = u * stepU + v * stepV;
        data[at] += cover * (red - data[at]); data[at + 1] += cover * (green - data[at + 1]); data[at + 2] += cover * (blue - data[at + 2]);
      }
    }
  }
}
