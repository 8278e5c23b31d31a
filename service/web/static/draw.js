// A drawing of the block, its held faces, the needle and the path, from the side and from above.

const SVG = "http://www.w3.org/2000/svg";
const NEEDLE_MM = 24; // how much of the needle is drawn in front of the entry

function node(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

/** Points of the path, mm: the line from entry to target with its sine across it. */
export function curve({ entry, target, amplitude = 0, periods = 1, direction = [1, 0, 0] }, count = 200) {
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

/** Put the drawing into an element. faces: names of the held ones. */
export function drawing(element, { size, points, faces, mesh }) {
  const [x, y, z] = size;
  const width = 340, gap = 26, margin = 22;
  const scale = Math.min((width - 2 * margin) / (z + NEEDLE_MM), 130 / y);
  const side = { left: margin + NEEDLE_MM * scale, top: 26, scale };
  const aboveScale = Math.min(130 / y, (width - 2 * margin) / x, scale * 1.6);
  const above = { left: margin + NEEDLE_MM * scale, top: side.top + y * scale + gap + 16, scale: aboveScale };
  const height = above.top + y * aboveScale + 22;
  const root = node("svg", { viewBox: `0 0 ${width} ${Math.ceil(height)}`, role: "img" });
  const end = points.at(-1);
  const round = (point) => point.map((v) => Math.round(v * 10) / 10).join(", ");
  root.append(node("title", {}, `Block of ${size.join(" by ")} mm${mesh ? ", the box around the mesh" : ""}; path from ${round(points[0])} to ${round(end)} mm; held: ${faces.join(", ") || "none"}.`));
  const s = (point) => [side.left + point[2] * scale, side.top + point[1] * scale];
  const a = (point) => [above.left + point[0] * aboveScale, above.top + point[1] * aboveScale];
  root.append(node("text", { x: side.left, y: side.top - 9 }, "from the side: depth z to the right, y down"));
  root.append(node("rect", { class: "block", x: side.left, y: side.top, width: z * scale, height: y * scale }));
  hold(root, faces, { y_min: [0, 0, z, 0], y_max: [0, y, z, y], z_max: [z, 0, z, y] }, side);
  trace(root, points, s);
  root.append(node("text", { x: above.left, y: above.top - 9 }, "from the entry: x to the right, y down"));
  root.append(node("rect", { class: "block", x: above.left, y: above.top, width: x * aboveScale, height: y * aboveScale }));
  hold(root, faces, { x_min: [0, 0, 0, y], x_max: [x, 0, x, y], y_min: [0, 0, x, 0], y_max: [0, y, x, y] }, above);
  trace(root, points, a);
  const start = points[0], next = points[Math.min(3, points.length - 1)];
  const back = start.map((v, i) => v - next[i]);
  const reach = Math.hypot(...back) || 1;
  const base = start.map((v, i) => v + (back[i] / reach) * NEEDLE_MM);
  const [x1, y1] = s(base), [x2, y2] = s(start);
  root.append(node("line", { class: "needle", x1, y1, x2, y2 }));
  element.replaceChildren(root);
}

function hold(root, faces, edges, { left, top, scale }) {
  for (const [face, [x1, y1, x2, y2]] of Object.entries(edges)) {
    if (!faces.includes(face)) continue;
    root.append(node("line", { class: "held", x1: left + x1 * scale, y1: top + y1 * scale, x2: left + x2 * scale, y2: top + y2 * scale }));
  }
}

function trace(root, points, flat) {
  root.append(node("polyline", { class: "path", points: points.map((point) => flat(point).map((v) => v.toFixed(1)).join(",")).join(" ") }));
  const [ex, ey] = flat(points[0]), [tx, ty] = flat(points.at(-1));
  root.append(node("circle", { class: "entry", cx: ex, cy: ey, r: 3.5 }));
  root.append(node("circle", { class: "target", cx: tx, cy: ty, r: 4 }));
}
