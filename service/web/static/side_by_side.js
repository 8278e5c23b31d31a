// Jobs side by side: the series of all of them in one plot each, their recordings next to each other.
/* global uPlot */
import { at, refuse, send } from "./app.js";
import { figure } from "./live.js";
import { draw } from "./plots.js";

const { jobs, names, order } = Object.fromEntries(Object.entries(document.getElementById("plots").dataset).map(([key, text]) => [key, JSON.parse(text)]));
const ARRAYS = "t_s,depth_m,tip_m,target_m,insertion_force_n,rcm_error_m,entry_drag_m";
const PLOTS = { error: ["tip error", "mm", 3], rcm: ["RCM error", "mm", 3], force: ["insertion force", "N", 3], drag: ["entry drag", "mm", 3] };
const known = []; // {job, time, depth, error, rcm, force, drag}

const scaled = (values) => values.map((value) => (value === null ? null : 1e3 * value));

async function load() {
  for (const job of jobs) {
    const answer = await send(at(`/api/v1/jobs/${job}/series?names=${ARRAYS}`), { method: "GET" });
    if (!answer.ok) { refuse(answer); continue; }
    const { t_s, depth_m, tip_m, target_m, insertion_force_n, rcm_error_m, entry_drag_m } = answer.data;
    const error = tip_m.map((tip, i) => (i ? 1e3 * Math.hypot(...tip.map((v, axis) => v - target_m[i - 1][axis])) : null)); // as rmse_commanded_mm has it
    known.push({ job, time: t_s, depth: scaled(depth_m), error, rcm: scaled(rcm_error_m), force: insertion_force_n, drag: scaled(entry_drag_m) });
    drawAll();
  }
}

/** The rows at which an axis rises: uPlot needs that, and a withdrawal is not drawn over depth. */
function rising(along) {
  let most = -Infinity;
  return along.flatMap((value, i) => (value > most ? ((most = value), [i]) : []));
}

function drawAll() {
  const axis = document.getElementById("over-time").checked ? "time" : "depth";
  const x = axis === "time" ? { label: "time, s", unit: "s" } : { label: "depth, mm", unit: "mm" };
  for (const [name, [title, unit, digits]] of Object.entries(PLOTS)) {
    const tables = known.map((one) => { const rows = rising(one[axis]); return [rows.map((i) => one[axis][i]), rows.map((i) => one[name][i])]; });
    const most = known.map((one, i) => Math.max(...tables[i][1].filter((value) => value !== null)));
    draw(document.getElementById(`plot-${name}`), {
      data: uPlot.join(tables),
      x,
      series: known.map(({ job }) => ({ label: label(job), unit, digits, stroke: `--plot-${order.indexOf(job) + 1}` })),
      sentence: `Largest ${title}: ${known.map(({ job }, i) => `${label(job)} ${Number.isFinite(most[i]) ? `${figure(most[i], digits)} ${unit}` : "unknown"}`).join(", ")}.`,
    });
  }
}

/** A job's name; with the beginning of its id where another is called the same. */
function label(job) {
  const name = names[order.indexOf(job)];
  return names.filter((other) => other === name).length > 1 ? `${name} ${job.slice(0, 4)}` : name;
}

document.getElementById("over-time").addEventListener("change", drawAll);
document.getElementById("open-recordings")?.addEventListener("click", () => {
  show(recorded().map((job) => viewer(at(`/recordings/${job}.rrd`), label(job))), "columns");
});
document.getElementById("open-together")?.addEventListener("click", () => {
  show([viewer(at(`/side-by-side/${recorded().join("-")}.rrd`), recorded().map(label).join(", "))], "");
});

function recorded() { return JSON.parse(document.getElementById("recordings").dataset.jobs); }

function show(cards, kind) {
  const place = document.getElementById("viewers");
  place.className = kind;
  place.replaceChildren(...cards);
}

/** A card with the viewer of a recording at an address. */
function viewer(path, title) {
  const theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  const url = new URL(path, location.href).href;
  const frame = document.createElement("iframe");
  Object.assign(frame, { className: "viewer", title: `Recording of ${title}`, allow: "fullscreen" });
  frame.src = at(`/viewer/index.html?${new URLSearchParams({ url, hide_welcome_screen: "1", persist: "0", notebook: "0", theme })}`);
  const card = Object.assign(document.createElement("section"), { className: "card" });
  card.append(Object.assign(document.createElement("h2"), { textContent: title }), frame);
  return card;
}

load();
