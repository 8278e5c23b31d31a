// Plots by uPlot in the colours of the page, with a sentence for those who do not see them.
/* global uPlot */
import { figure } from "./live.js";

const shown = new Map(); // element -> how to draw it

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/**
 * Draw into an element. data: [x, y, ...]; series: [{label, unit, digits, stroke, points}]; x: {label, unit, time, notes}.
 * The sentence goes to the label of the element and, unless `caption` is given, to its caption.
 */
export function draw(element, { data, series, x, sentence, caption, range }) {
  shown.set(element, { data, series, x, range });
  element.setAttribute("aria-label", sentence);
  const text = element.closest("figure")?.querySelector("figcaption");
  if (text) text.textContent = caption ?? sentence;
  paint(element);
}

function paint(element) {
  const { data, series, x, range } = shown.get(element);
  const axis = { stroke: colour("--soft"), grid: { stroke: colour("--faint"), width: 1 }, ticks: { stroke: colour("--faint"), width: 1 },
    font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 18 };
  const options = {
    width: Math.max(element.clientWidth, 200),
    height: 220,
    legend: { live: true },
    cursor: { drag: { x: true, y: false } },
    scales: { x: { time: Boolean(x.time) }, y: range ? { range } : {} },
    axes: [{ ...axis, label: x.label, size: x.time ? 50 : 36, ...(x.time ? { space: 90, values: dates } : { values: numbers }) }, { ...axis, label: series[0].unit, size: 62, values: numbers }],
    series: [
      { label: x.label, value: x.time ? (_, v, __, i) => (v === null ? "–" : `${dated(v)} ${x.notes?.[i] ?? ""}`) : (_, v) => (v === null ? "–" : `${v.toFixed(2)} ${x.unit}`) },
      ...series.map((one) => ({
        label: one.label,
        stroke: colour(one.stroke),
        width: one.width ?? 1.5,
        points: one.points ? { show: true, size: one.points, fill: colour(one.stroke) } : undefined,
        paths: one.width === 0 ? () => null : undefined,
        spanGaps: true,
        value: (_, v) => (v === null || v === undefined ? "–" : `${figure(v, one.digits)} ${one.unit}`),
      })),
    ],
  };
  if (x.time) options.tzDate = (seconds) => uPlot.tzDate(new Date(seconds * 1e3), "Etc/UTC");
  element.replaceChildren();
  new uPlot(options, data, element);
}

const dated = (moment) => new Date(moment * 1e3).toISOString().slice(0, 16).replace("T", " ");
const numbers = (_, values) => values.map((value) => (value === null ? "" : String(Number(value.toPrecision(6)))));

/** Dates of an axis; with the time of day below where they are close together. */
function dates(_, moments, axis, space, step) {
  return moments.map((moment) => {
    const [date, time] = new Date(moment * 1e3).toISOString().split("T");
    return step >= 86400 ? date : `${date}\n${time.slice(0, step < 60 ? 8 : 5)}`;
  });
}

let resized;
addEventListener("resize", () => {
  clearTimeout(resized);
  resized = setTimeout(() => { for (const element of shown.keys()) paint(element); }, 150);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const element of shown.keys()) paint(element); });
