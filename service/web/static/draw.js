// A drawing of the block, its held faces, the needle and the path, from the side and from above.

const SVG = "http://www.w3.org/2000/svg";
const NEEDLE_MM = 24; // how much of the needle is drawn in front of the entry
const NEAR_MM = 0.01; // outside the block by less is on its surface

function node(name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text) element.textContent = text;
  return element;
}

/** Points of the path, mm: the line from entry to target with its sine across it, an arc, or a curve through points. */
export function curve(path, count = 200) {
  if (path.through) return spline([path.entry, ...path.through], count);
  return path.radius ? arc(path, count) : wave(path, count);
}

/** The smaller arc of a circle that bulges to a side. */
function arc({ entry, target, radius, direction }, count) {
  const chord = target.map((v, i) => v - entry[i]);
  const length = Math.hypot(...chord);
  const along = chord.map((v) => v / length);
  const part = direction.reduce((sum, v, i) => sum + v * along[i], 0);
  const across = direction.map((v, i) => v - part * along[i]);
  const size = Math.hypot(...across);
  if (!(length > 0 && size > 0 && radius >= length / 2)) return [entry, target];
  const deep = Math.sqrt(radius * radius - (length * length) / 4), half = Math.asin(Math.min(1, length / 2 / radius));
  return Array.from({ length: count + 1 }, (_, i) => {
    const angle = (2 * i / count - 1) * half;
    return entry.map((v, axis) => v + chord[axis] / 2 + ((radius * Math.cos(angle) - deep) * across[axis]) / size + radius * Math.sin(angle) * along[axis]);
  });
}

/** The natural cubic spline through points, over the length of their polygon. */
function spline(points, count) {
  const n = points.length - 1;
  const gaps = points.slice(1).map((point, i) => Math.hypot(...point.map((v, axis) => v - points[i][axis])));
  if (n < 2 || gaps.some((gap) => !(gap > 0))) return points;
  const bends = [0, 1, 2].map((axis) => bend(points.map((point) => point[axis]), gaps)); // second derivatives
  const total = gaps.reduce((sum, gap) => sum + gap, 0), found = [points[0]];
  gaps.forEach((gap, i) => {
    const pieces = Math.max(2, Math.ceil((count * gap) / total));
    for (let k = 1; k <= pieces; k += 1) {
      const b = k / pieces, a = 1 - b;
      found.push(points[i].map((v, axis) => a * v + b * points[i + 1][axis] + (((a ** 3 - a) * bends[axis][i] + (b ** 3 - b) * bends[axis][i + 1]) * gap * gap) / 6));
    }
  });
  return found;
}

function bend(values, gaps) {
  const n = values.length - 1, scale = [], right = [], found = new Array(n + 1).fill(0);
  for (let i = 1; i < n; i += 1) {
    const slope = (values[i + 1] - values[i]) / gaps[i] - (values[i] - values[i - 1]) / gaps[i - 1];
    const pivot = 2 * (gaps[i - 1] + gaps[i]) - (i > 1 ? gaps[i - 1] * scale[i - 1] : 0);
    scale[i] = gaps[i] / pivot;
    right[i] = (6 * slope - (i > 1 ? gaps[i - 1] * right[i - 1] : 0)) / pivot;
  }
  for (let i = n - 1; i > 0; i -= 1) found[i] = right[i] - scale[i] * found[i + 1];
  return found;
}

function wave({ entry, target, amplitude = 0, periods = 1, direction = [1, 0, 0] }, count) {
  const chord = target.map((v, i) => v - entry[i]);
  const length = Math.hypot(...chord);
  if (!(length > 0)) return [entry];
  const along = chord.map((v) => v / length);
  const part = direction.reduce((sum, v, i) => sum + v * along[i], 0);
  const across = direction.map((v, i) => v - part * along[i]);
  const size = Math.hypot(...across) || 1;
  return Array.from({ length: amplitude ? count + 1 : 2 }, (_, i) => {
    const s = amplitude ? i / count : i;
    const lift = amplitude * Math.sin(2 * Math.PI * periods * s);
    return entry.map((v, axis) => v + s * chord[axis] + (lift * across[axis]) / size);
  });
}

/** Length of the path, mm. */
export function length(points) {
  return points.slice(1).reduce((sum, point, i) => sum + Math.hypot(...point.map((v, axis) => v - points[i][axis])), 0);
}

/**
 * Put the drawing into an element. origin, size: of the body's box; points: the path; faces, regions: what is held;
 * tip, shaft: the way of the tip and the needle at the end, where there are any. All in mm.
 */
export function drawing(element, { origin = [0, 0, 0], size, points, faces, regions = [], mesh, tip, shaft }) {
  const [x, y, z] = size;
  const width = 340, margin = 12, caption = 20;
  const scale = Math.min((width - 2 * margin) / (z + NEEDLE_MM), 150 / y, 150 / x);
  const left = margin + NEEDLE_MM * scale;
  const views = [
    { text: "from the side: z right, y down", high: y, axis: 1, edges: { y_min: [0, 0, z, 0], y_max: [0, y, z, y], z_max: [z, 0, z, y] } },
    { text: "from above: z right, x down", high: x, axis: 0, edges: { x_min: [0, 0, z, 0], x_max: [0, x, z, x], z_max: [z, 0, z, x] } },
  ];
  const height = views.reduce((sum, view) => sum + caption + view.high * scale + margin, 0);
  const root = node("svg", { viewBox: `0 0 ${width} ${Math.ceil(height)}`, role: "img" });
  const beyond = mesh ? [] : points.filter((point) => point.some((v, i) => v < origin[i] - NEAR_MM || v > origin[i] + size[i] + NEAR_MM));
  root.append(node("title", {}, sentence({ size, points, faces, regions, mesh, tip, beyond })));
  let top = 0;
  for (const view of views) {
    top += caption;
    const start = top;
    const flat = (point) => [left + (point[2] - origin[2]) * scale, start + (point[view.axis] - origin[view.axis]) * scale];
    const window = { x: left, y: top, width: z * scale, height: view.high * scale };
    root.append(node("text", { x: left, y: top - 7 }, view.text));
    root.append(node("rect", { class: "block", ...window }));
    inRegions(root, regions, window, { flat, scale, axis: view.axis });
    hold(root, faces, view.edges, { left, top, scale });
    if (shaft) way(root, shaft.filter((point) => flat(point)[0] >= 0), flat, "needle");
    else needle(root, points, flat);
    trace(root, points, flat);
    way(root, beyond, flat, "beyond");
    if (tip) way(root, tip, flat, "tip");
    top += view.high * scale + margin;
  }
  element.replaceChildren(root);
}

function sentence({ size, points, faces, regions, mesh, tip, beyond }) {
  const round = (point) => point.map((v) => Math.round(v * 10) / 10).join(", ");
  const parts = [...faces, ...(regions.length ? [`${regions.length} ${regions.length === 1 ? "region" : "regions"}`] : [])];
  const held = parts.length ? `held: ${parts.join(", ")}` : "no face is held";
  const block = `Block of ${size.map((v) => Math.round(v * 10) / 10).join(" by ")} mm${mesh ? ", the box around the mesh" : ""}`;
  const end = tip ? ` The tip ended at ${round(tip.at(-1))} mm.` : "";
  const leaves = beyond.length ? ", which leaves the block" : "";
  return `${block}; path from ${round(points[0])} to ${round(points.at(-1))} mm${leaves}; ${held}.${end}`;
}

let clips = 0; // a region is drawn inside the block alone

function inRegions(root, regions, window, view) {
  if (!regions.length) return;
  clips += 1;
  const clip = node("clipPath", { id: `block-${clips}` }), group = node("g", { "clip-path": `url(#block-${clips})` });
  clip.append(node("rect", window));
  for (const region of regions) { const shape = regionShape(region, window, view); if (shape) group.append(shape); }
  root.append(clip, group);
}

/** A box, a ball, or the strip of a plane that is seen from its edge; a plane seen askew has no outline of its own. */
function regionShape(region, window, { flat, scale, axis }) {
  if (region.kind === "sphere") {
    const [cx, cy] = flat(region.centre_mm);
    return node("circle", { class: "region", cx, cy, r: region.radius_mm * scale });
  }
  if (region.kind === "plane") {
    const across = [region.normal[2], region.normal[axis]], size = Math.hypot(...region.normal), seen = Math.hypot(...across);
    if (!(seen > 0.99 * size)) return null;
    const [cx, cy] = flat(region.point_mm), thick = Math.max(2 * (region.within_mm ?? 0.5) * scale, 3);
    const long = 2 * (window.width + window.height), turn = (Math.atan2(across[1], across[0]) * 180) / Math.PI;
    return node("rect", { class: "region", x: cx - thick / 2, y: cy - long / 2, width: thick, height: long, transform: `rotate(${turn} ${cx} ${cy})` });
  }
  const [x1, y1] = flat(region.min_mm), [x2, y2] = flat(region.max_mm);
  return node("rect", { class: "region", x: x1, y: y1, width: Math.max(0, x2 - x1), height: Math.max(0, y2 - y1) });
}

function needle(root, points, flat) {
  const start = points[0], next = points[Math.min(3, points.length - 1)];
  const back = start.map((v, i) => v - next[i]);
  const reach = Math.hypot(...back) || 1;
  const [x1, y1] = flat(start.map((v, i) => v + (back[i] / reach) * NEEDLE_MM * 0.9)), [x2, y2] = flat(start);
  root.append(node("line", { class: "needle", x1, y1, x2, y2 }));
}

function hold(root, faces, edges, { left, top, scale }) {
  for (const [face, [x1, y1, x2, y2]] of Object.entries(edges)) {
    if (!faces.includes(face)) continue;
    root.append(node("line", { class: "held", x1: left + x1 * scale, y1: top + y1 * scale, x2: left + x2 * scale, y2: top + y2 * scale }));
  }
}

function way(root, points, flat, kind) {
  root.append(node("polyline", { class: kind, points: points.map((point) => flat(point).map((v) => v.toFixed(1)).join(",")).join(" ") }));
}

function trace(root, points, flat) {
  way(root, points, flat, "path");
  const [ex, ey] = flat(points[0]), [tx, ty] = flat(points.at(-1));
  root.append(node("circle", { class: "entry", cx: ex, cy: ey, r: 3.5 }));
  root.append(node("circle", { class: "target", cx: tx, cy: ty, r: 4 }));
}
