// Plots by uPlot in the colours of the page, with a sentence for those who do not see them.
/* global uPlot */
import { figure } from "./live.js";

const shown = new Map(); // element -> {plot, shape, given, zoomed}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/**
 * Draw into an element; the plot is returned. data: [x, y, ...]; series: [{label, unit, digits, stroke, dots}]; x: {label, unit, range, time, notes}.
 * Called again with the same series it keeps its plot, with what the reader zoomed to or points at, and shows the new data.
 * The sentence goes to the label of the element and, unless `caption` is given, to its caption.
 */
export function draw(element, given) {
  element.setAttribute("aria-label", given.sentence);
  const text = element.closest("figure")?.querySelector("figcaption");
  if (text) text.textContent = given.caption ?? given.sentence;
  const { x, series } = given;
  const shape = JSON.stringify([x.label, x.unit, series.map((one) => [one.label, one.unit, one.stroke])]);
  const before = shown.get(element);
  if (before?.shape !== shape) return make(element, given, shape).plot;
  before.given = given;
  before.plot.setData(given.data, !before.zoomed);
  if (before.zoomed) before.plot.redraw();
  return before.plot;
}

/** A new plot in the place of whatever is there. */
function make(element, given, shape) {
  const one = { shape, given, zoomed: false };
  shown.get(element)?.plot.destroy();
  element.replaceChildren();
  one.plot = new uPlot(options(element, one), given.data, element);
  one.plot.over.addEventListener("dblclick", () => { one.zoomed = false; }, { capture: true }); // before uPlot shows all again
  shown.set(element, one);
  return one;
}

const height = 220;
const width = (element) => Math.max(element.clientWidth, 200);
const FEW = 60; // up to so many values are drawn as dots too

function options(element, one) {
  const { series, x, range } = one.given;
  const axis = { stroke: colour("--soft"), grid: { stroke: colour("--faint"), width: 1 }, ticks: { stroke: colour("--faint"), width: 1 },
    font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 18 };
  const settings = {
    width: width(element),
    height,
    legend: { live: true },
    cursor: { drag: { x: true, y: false } },
    hooks: { setSelect: [(plot) => { if (plot.select.width > 0) one.zoomed = true; }] },
    scales: { x: { time: Boolean(x.time), ...(x.range ? { range: (_, low, high) => (one.zoomed ? [low, high] : spanning(one.given.x.range ?? [low, high], low, high)) } : {}) }, y: range ? { range } : {} },
    axes: [{ ...axis, label: x.label, size: x.time ? 50 : 36, ...(x.time ? { space: 90, values: dates } : { values: numbers }) }, { ...axis, label: series[0].unit, size: 62, values: numbers }],
    series: [
      { label: x.label, value: x.time ? (_, v, __, i) => (v === null ? "–" : `${dated(v)} ${one.given.x.notes?.[i] ?? ""}`) : (_, v) => (v === null ? "–" : `${v.toFixed(2)} ${x.unit}`) },
      ...series.map((line) => ({
        label: line.label,
        stroke: colour(line.stroke),
        width: line.width ?? 1.5,
        points: line.dots ? { show: (plot) => line.width === 0 || x.time || plot.data[0].length < FEW, size: line.dots, fill: colour(line.stroke) } : undefined,
        paths: line.width === 0 ? () => null : undefined,
        spanGaps: true,
        value: (_, v) => (v === null || v === undefined ? "–" : `${figure(v, line.digits)} ${line.unit}`),
      })),
    ],
  };
  if (x.time) settings.tzDate = (seconds) => uPlot.tzDate(new Date(seconds * 1e3), "Etc/UTC");
  return settings;
}

/** The range that was planned, and more where the data leave it. */
const spanning = ([from, to], low, high) => [Math.min(from, low ?? from), Math.max(to, high ?? to)];

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
  resized = setTimeout(() => { for (const [element, { plot }] of shown) plot.setSize({ width: width(element), height }); }, 150);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const [element, { given, shape }] of shown) make(element, given, shape); });
