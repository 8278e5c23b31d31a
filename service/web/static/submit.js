// The form of a scenario: changed fields become JSON; a drawing and an estimate follow.
import { at, confirmed, mark, quiet, send, submits, unmark } from "./app.js";
import { curve, drawing, length } from "./draw.js";
import { takeFiles } from "./drop.js";
import { span } from "./live.js";

const form = document.getElementById("scenario");
const presets = JSON.parse(form.dataset.presets);
const given = JSON.parse(form.dataset.given);
const preset = document.getElementById("preset");
const fields = [...form.querySelectorAll("[data-path]")];
const MOST_SHOWN = 4000; // characters of the JSON that are shown

const inputs = (field) => [...field.querySelectorAll("input:not([type=file]), select, textarea")];
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
const sorted = (list) => [...(list ?? [])].sort();

/** The value of a field; undefined if it is the default. */
function value(field) {
  const { entry } = field.dataset;
  const standard = JSON.parse(field.dataset.default);
  const parts = inputs(field);
  const text = parts[0].value.trim();
  let entered;
  const number = (one) => (one.validity.badInput ? "not a number" : Number(one.value));
  const empty = (one) => one.value.trim() === "" && !one.validity.badInput;
  if (entry === "number" || entry === "integer") entered = empty(parts[0]) ? undefined : number(parts[0]);
  else if (entry === "switch") entered = parts[0].checked;
  else if (entry === "choices") entered = parts.filter((one) => one.checked).map((one) => one.value);
  else if (entry === "list") entered = text === "" ? undefined : text.split(",").map((one) => one.trim()).filter(Boolean);
  else if (entry === "vector") {
    entered = parts.every(empty) ? undefined : parts.map((one, i) => (empty(one) ? standard[i] : number(one)));
  } else if (entry === "json") {
    if (text !== "") try { entered = JSON.parse(text); } catch { entered = text; }
  } else entered = text === "" ? undefined : text;
  if (entered === undefined) return undefined;
  return same(entered, standard) || (entry === "choices" && same(sorted(entered), sorted(standard))) ? undefined : entered;
}

/** Put a value into a field; null and undefined empty it. */
function put(field, entered) {
  const { entry } = field.dataset;
  const standard = JSON.parse(field.dataset.default);
  const parts = inputs(field);
  const chosen = entered ?? standard;
  const asStandard = same(chosen, standard);
  if (entry === "switch") parts[0].checked = chosen;
  else if (entry === "choices") for (const one of parts) one.checked = (chosen ?? []).includes(one.value);
  else if (entry === "choice" || entry === "kind") parts[0].value = chosen;
  else if (entry === "vector") parts.forEach((one, i) => { one.value = asStandard ? "" : chosen[i]; });
  else if (asStandard) parts[0].value = "";
  else if (entry === "list") parts[0].value = chosen.join(", ");
  else parts[0].value = entry === "json" ? JSON.stringify(chosen) : chosen;
}

const valueAt = (data, path) => path.split(".").reduce((here, name) => here?.[name], data);

/** Put a scenario, and what else a job is given (as `body` has them), into the form. */
function fill({ scenario, ...rest }) {
  unmark(form);
  for (const field of fields) {
    const { path } = field.dataset;
    if (path.startsWith("@")) { put(field, rest[path.slice(1)]); continue; }
    let entered = valueAt(scenario, path);
    if (!["kind", "json"].includes(field.dataset.entry) && entered !== null && typeof entered === "object" && !Array.isArray(entered)) entered = undefined;
    put(field, entered);
  }
  update();
}

/** Fields of other kinds of a block are hidden and never sent. */
function settle() {
  for (const part of form.querySelectorAll("[data-kinds]")) {
    const block = (part.dataset.path ?? part.dataset.group).split(".").slice(0, -1).join(".");
    const kind = form.querySelector(`[data-path="${CSS.escape(block)}.kind"] select`).value;
    part.hidden = !part.dataset.kinds.split(" ").includes(kind);
  }
}

const counts = (field) => !field.closest("[hidden]");

function body() {
  const scenario = {};
  const rest = {};
  for (const field of fields) {
    const entered = counts(field) ? value(field) : undefined;
    const { path } = field.dataset;
    field.classList.toggle("changed", entered !== undefined);
    if (entered === undefined) continue;
    if (path.startsWith("@")) { rest[path.slice(1)] = entered; continue; }
    const names = path.split(".");
    const last = names.pop();
    let here = scenario;
    for (const name of names) here = here[name] ??= {};
    here[last] = entered;
  }
  for (const path of Object.keys(scenario)) needKind(scenario, path, path);
  return { scenario, ...rest };
}

/** A block whose kind is the default one is sent with its kind, so that the JSON says what it is. */
function needKind(holder, name, path) {
  const select = [...form.querySelectorAll(`[data-path="${CSS.escape(path)}.kind"] select`)].find(counts);
  const block = holder[name];
  if (!select || block === null || typeof block !== "object" || Array.isArray(block)) return;
  holder[name] = { kind: select.value, ...block };
  for (const inner of Object.keys(block)) needKind(holder[name], inner, `${path}.${inner}`);
}

/** The effective value of a field: typed, else the default. */
function now(path) {
  const field = fields.find((one) => one.dataset.path === path && counts(one));
  return field && (value(field) ?? JSON.parse(field.dataset.default));
}

function update() {
  settle();
  const data = body();
  const text = JSON.stringify(data, null, 2).replace(/\[[^[\]{}]*\]/g, (list) => list.replace(/\s+/g, " "));
  document.getElementById("json").textContent = text.length > MOST_SHOWN ? `${text.slice(0, MOST_SHOWN)}\n… ${text.length} characters in total` : text;
  for (const group of form.querySelectorAll("details[data-group]")) {
    const count = [...group.querySelectorAll(".changed")].filter(counts).length;
    group.querySelector("[data-count]").textContent = count ? `${count} set` : "";
  }
  keep(data);
  picture();
  ask();
}

const KEPT = `needlebench ${location.pathname}${location.search}`; // in this tab, so that a reload loses nothing
let chosen = preset.value; // what the form was last filled from
let typed = false; // whether anything was entered since

function keep(data) {
  try {
    if (typed) sessionStorage.setItem(KEPT, JSON.stringify({ chosen, ...data }));
    else sessionStorage.removeItem(KEPT);
  } catch { /* a browser that keeps nothing */ }
}

function kept() {
  try { return JSON.parse(sessionStorage.getItem(KEPT)); } catch { return null; }
}

/** Start from defaults, a preset or what the address asks for. */
function startFrom(name) {
  preset.value = chosen = name;
  typed = false;
  fill({ scenario: (name === "@given" ? given : presets[name]) ?? {} });
}

function picture() {
  const kind = now("trajectory.kind") ?? "line", typed = kind === "waypoints" && now("trajectory.points_mm");
  const through = Array.isArray(typed) && typed.length && typed.every((point) => Array.isArray(point) && point.length === 3) ? typed : null;
  const size = now("tissue.size_mm"), entry = now("trajectory.entry_mm"), target = through ? through.at(-1) : now("trajectory.target_mm") ?? [];
  if (![...size, ...entry, ...(through ?? [target]).flat()].every(Number.isFinite) || target.length !== 3) return;
  const sine = kind === "sine" || Boolean(now("trajectory.amplitude_mm"));
  const path = { entry, target };
  if (through) path.through = through;
  if (kind === "arc") Object.assign(path, { radius: now("trajectory.radius_mm"), direction: now("trajectory.direction") });
  if (sine) Object.assign(path, { amplitude: now("trajectory.amplitude_mm"), periods: now("trajectory.periods"), direction: now("trajectory.direction") });
  const points = curve(path);
  const regions = [now("tissue.fixed_regions") ?? []].flat().filter((one) => one && typeof one === "object");
  const named = (now("tissue.fixed_sets") ?? []).length > 0 || regions.length > 0;
  const faces = now("tissue.fixed_faces") ?? (named ? [] : ["y_min", "y_max"]);
  drawing(document.getElementById("drawing"), { size, points, faces, regions: regions.filter(complete), mesh: now("tissue.mesh_file") });
  const poses = now("controller.poses");
  const time = kind === "reach" ? now("trajectory.time_s") : length(points) / now("trajectory.speed_mm_s");
  const steps = Array.isArray(poses) ? poses.length : Math.ceil(time / now("dt_s") - 1e-9);
  const cells = size.map((v) => Math.max(1, Math.round(v / now("tissue.element_size_mm")))).reduce((a, b) => a * b, 1);
  const mesh = now("tissue.mesh_file") ? "a mesh from a file" : `${cells.toLocaleString("en")} cells`;
  document.getElementById("length").textContent = Number.isFinite(steps) ? `${length(points).toFixed(1)} mm, ${steps.toLocaleString("en")} steps, ${mesh}.` : "";
}

const numbers = (list) => Array.isArray(list) && list.length === 3 && list.every(Number.isFinite);

/** Whether a region that is being typed can be drawn already. */
function complete({ kind = "box", ...region }) {
  if (kind === "sphere") return numbers(region.centre_mm) && Number.isFinite(region.radius_mm);
  if (kind === "plane") return numbers(region.point_mm) && numbers(region.normal);
  return numbers(region.min_mm) && numbers(region.max_mm);
}

const PAUSE_MS = 500; // after the last change before the service is asked
let asked = 0; // number of the latest question
let pause;

/** Ask the service what the job would take; what it would refuse is marked at its field, before Submit. */
function ask() {
  clearTimeout(pause);
  pause = setTimeout(async () => {
    const mine = ++asked;
    const answer = await send(at("/api/v1/jobs?dry_run=1"), { body: body() });
    if (mine !== asked || sending) return; // an answer to something else
    const estimate = document.getElementById("estimate");
    if (answer.ok) {
      const { seconds, seconds_low, seconds_high, measured_on } = answer.data;
      const pace = measured_on ? `by the pace of the latest ${measured_on === 1 ? "insertion" : `${measured_on} insertions`} here` : "before anything was measured on this machine";
      estimate.textContent = `About ${span(seconds)}, between ${span(seconds_low)} and ${span(seconds_high)}, ${pace}.`;
    } else estimate.textContent = "";
    if (answer.ok) unmark(form);
    else if (answer.status === 422) mark(form, answer, "data-path", "@", { aside: true });
  }, PAUSE_MS);
}

let sending = false;

preset.addEventListener("change", async () => {
  const wanted = preset.value, { text } = preset.selectedOptions[0];
  if (typed && !(await confirmed(`Replace what you entered by ${text.split(":")[0]}?`))) preset.value = chosen;
  else startFrom(wanted);
});
document.getElementById("reset").addEventListener("click", () => { startFrom(""); quiet(); });
form.addEventListener("input", ({ target }) => {
  if (target === preset) return;
  typed = true;
  update();
});
submits(form, async () => {
  const button = form.querySelector("button[type=submit]");
  button.disabled = true;
  sending = true;
  quiet();
  const answer = await send(at("/api/v1/jobs"), { body: body() });
  sending = false;
  if (answer.ok) {
    typed = false;
    keep();
    location.assign(at(`/jobs/${answer.data.id}`));
    return;
  }
  button.disabled = false;
  mark(form, answer, "data-path", "@");
});

for (const input of form.querySelectorAll("input[data-send]")) {
  const field = input.closest("[data-path]");
  field.classList.add("drop");
  takeFiles(field, input, {
    kind: () => input.dataset.send,
    sent: ({ reference }) => { put(field, reference); typed = true; update(); },
  });
}
const draft = kept();
if (draft) {
  preset.value = chosen = draft.chosen;
  typed = true;
  fill(draft);
} else fill({ scenario: given ?? {} });
