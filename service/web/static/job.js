// One job: its progress as it arrives, its plots, its recording in the viewer.
import { at, refuse, send } from "./app.js";
import { figure, follow, millimetres, newtons, refresh, span } from "./live.js";
import { drawing } from "./draw.js";
import { draw } from "./plots.js";

const job = () => document.getElementById("job");
const id = job().dataset.id;
const path = { depth: [], error: [], lateral: [], force: [] }; // of the running attempt
const NAMES = ["depth", "error", "lateral", "force"];
let source = null;
let series = null;
let attempt = null;
let spokenAt = 0;

function progress(data) {
  if (attempt !== null && data.attempt !== attempt) {
    forget();
    if (document.querySelector("iframe.viewer")) watch(); // the recording of the previous attempt has ended
  }
  attempt = data.attempt;
  const part = (name) => job().querySelector(`[data-${name}]`);
  const put = (name, text) => { const place = part(name); if (place) place.textContent = text; };
  put("step", data.step);
  put("depth", millimetres(data.depth_mm, 1));
  put("error", millimetres(data.tip_error_mm, 3));
  put("force", newtons(data.insertion_force_n));
  put("eta", span(data.eta_s));
  const bar = job().querySelector("progress");
  if (bar) bar.value = data.fraction;
  if (Date.now() - spokenAt > 10_000) { // for screen readers: often enough to follow, rarely enough not to interrupt
    spokenAt = Date.now();
    const left = data.eta_s ? `, about ${span(data.eta_s)} left` : "";
    document.getElementById("spoken-progress").textContent = `Step ${data.step} of ${data.steps}${left}`;
  }
  if (typeof data.depth_mm !== "number" || typeof data.tip_error_mm !== "number") return;
  addPoint([data.depth_mm, data.tip_error_mm, data.cross_track_mm ?? null, data.insertion_force_n ?? null]);
  drawLive();
}

/** Add a point to the live plots; a plot over depth needs an axis that does not fall. */
function addPoint(point) {
  if (point[0] < path.depth.at(-1)) return;
  NAMES.forEach((name, i) => path[name].push(point[i]));
}

function forget() {
  for (const values of Object.values(path)) values.length = 0;
}

/** The points from before this page was opened. */
function begin() {
  const { course } = document.getElementById("plots").dataset;
  attempt = Number(job().dataset.attempt) || null;
  for (const point of JSON.parse(course)) addPoint(point);
  if (path.depth.length) drawLive();
}

/** The axis of depths, live and afterwards: as far as the path leads. */
function overDepth() {
  const planned = Number(document.getElementById("plots").dataset.depthMm);
  return { label: "depth, mm", unit: "mm", range: planned > 0 ? [0, planned] : null };
}

function drawLive() {
  const x = overDepth();
  const worst = Math.max(...path.error);
  const strongest = Math.max(...path.force.filter((v) => v !== null));
  const force = path.force.at(-1);
  document.getElementById("plots").hidden = false;
  draw(document.getElementById("plot-error"), {
    data: [path.depth, path.error, path.lateral],
    x,
    series: [
      { label: "tip error", unit: "mm", digits: 3, stroke: "--plot-1", dots: 4 },
      { label: "distance from the path", unit: "mm", digits: 3, stroke: "--plot-3", dots: 4 },
    ],
    sentence: `Tip error over depth: ${figure(path.error.at(-1), 3)} mm now, ${figure(worst, 3)} mm at most.`,
    caption: `So far ${figure(worst, 3)} mm at most.`,
  });
  document.getElementById("force").hidden = force === null;
  if (force === null) return;
  draw(document.getElementById("plot-force"), {
    data: [path.depth, path.force],
    x,
    series: [{ label: "insertion force", unit: "N", digits: 3, stroke: "--plot-2", dots: 4 }],
    sentence: `Insertion force over depth: ${force.toFixed(3)} N now, ${strongest.toFixed(3)} N at most.`,
    caption: `So far ${strongest.toFixed(3)} N at most.`,
  });
}

async function loadSeries() {
  const answer = await send(at(`/api/v1/jobs/${id}/series?names=t_s,depth_m,tip_m,target_m,insertion_force_n`), { method: "GET" });
  if (!answer.ok) return refuse(answer);
  const { t_s, depth_m, tip_m, target_m, insertion_force_n } = answer.data;
  series = {
    time: t_s,
    depth: depth_m.map((v) => v * 1e3),
    error: tip_m.map((tip, i) => (i ? 1e3 * Math.hypot(...tip.map((v, axis) => v - target_m[i - 1][axis])) : null)), // as rmse_commanded_mm has it
    force: insertion_force_n,
  };
  document.getElementById("axis").hidden = false;
  document.getElementById("draw").hidden = true;
  document.getElementById("force").hidden = false;
  drawSeries();
}

const NOTES = { error: ", from the tip to the target of its step", force: "" };

function drawSeries() {
  const depth = !document.getElementById("over-time").checked;
  const order = depth ? deepening(series.depth) : series.time.map((_, i) => i);
  const x = depth ? overDepth() : { label: "time, s", unit: "s" };
  const along = order.map((i) => (depth ? series.depth[i] : series.time[i]));
  for (const [name, title, unit, digits, stroke] of [["error", "Tip error", "mm", 3, "--plot-1"], ["force", "Insertion force", "N", 3, "--plot-2"]]) {
    const values = order.map((i) => series[name][i]);
    const known = values.filter((v) => v !== null);
    const top = known.reduce((a, b) => Math.max(a, b), -Infinity);
    const where = along[values.indexOf(top)];
    draw(document.getElementById(`plot-${name}`), {
      data: [along, values],
      x,
      series: [{ label: title.toLowerCase(), unit, digits, stroke }],
      sentence: known.length ? `${title}${NOTES[name]}: ${figure(top, digits)} ${unit} at most, at ${where?.toFixed(1)} ${x.unit}; ${figure(known.at(-1), digits)} ${unit} at the end.` : `${title}: nothing was measured.`,
    });
  }
}

/** Steps that go deeper than all before them: a plot over depth needs an axis that rises. */
function deepening(depths) {
  const indices = [];
  let deepest = -Infinity;
  depths.forEach((depth, i) => { if (depth > deepest) { deepest = depth; indices.push(i); } });
  return indices;
}

/** The still picture of an insertion that has ended. */
function picture() {
  const place = document.getElementById("still");
  if (!place || place.firstChild) return;
  const { path, ...rest } = JSON.parse(place.dataset.still);
  drawing(place, { ...rest, points: path });
}

function settle() {
  picture();
  const { state, terminal, plotted, plotAtOnce, recorded } = job().dataset;
  if (terminal === "true") document.getElementById("plots").hidden = plotted !== "true" && !path.depth.length; // what ended early keeps its plots
  if (state === "queued") { forget(); document.getElementById("plots").hidden = true; }
  if (terminal !== "true" && !source) listen();
  if (terminal === "true" && source) { source.close(); source = null; }
  const opener = document.getElementById("open-recording");
  if (opener && terminal === "true" && !document.querySelector("iframe.viewer")) opener.textContent = "Open recording";
  const recording = document.getElementById("recording");
  if (recording) recording.hidden = recorded !== "true";
  if (terminal !== "true") series = null; // another attempt will have its own
  if (plotted !== "true" || series) return;
  if (plotAtOnce === "true") loadSeries();
  else { document.getElementById("axis").hidden = false; document.getElementById("draw").hidden = false; }
}

function listen() {
  source = follow(at(`/api/v1/jobs/${id}/events?after=${job().dataset.event}`), (kind, data) => {
    if (kind === "progress") return progress(data);
    document.getElementById("spoken-progress").textContent = `The job: ${kind.replace("_", " ")}`;
    refresh();
  });
}

document.addEventListener("refreshed", settle);
document.getElementById("over-time").addEventListener("change", drawSeries);
document.getElementById("draw").addEventListener("click", loadSeries);

/** Address of the viewer with the recording of this job in it. */
function viewerUrl() {
  const recording = new URL(document.getElementById("recording").dataset.url, location.href).href;
  const theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  return at(`/viewer/index.html?${new URLSearchParams({ url: recording, hide_welcome_screen: "1", persist: "0", notebook: "0", theme })}`);
}

function watch() {
  const frame = document.createElement("iframe");
  frame.className = "viewer";
  frame.title = "Recording of the job in the Rerun viewer";
  frame.allow = "fullscreen";
  frame.src = viewerUrl();
  document.getElementById("viewer").replaceChildren(frame);
  document.getElementById("open-recording").textContent = "Reload";
}

document.getElementById("alone")?.addEventListener("click", ({ target }) => { target.href = viewerUrl(); });
document.getElementById("open-recording")?.addEventListener("click", watch);

begin();
settle();
setInterval(() => { if (job().dataset.state === "queued") refresh(); }, 4000); // its place in the queue
