// Keeps a page current: events of the service, and parts of the page that are reloaded when something changed.
import { at } from "./app.js";

const PAUSE_MS = 1200; // between two reloads of the page
let reading = false;
let due = false;
let last = 0;
const read = new Map(); // id of a part -> its HTML as last read

const KINDS = ["queued", "started", "progress", "requeued", "crashed", "cancel_requested", "finished", "failed",
  "cancelled", "timed_out", "pinned", "unpinned", "edited", "deleted"];
const AGAIN_MS = 5000; // before a refused stream is requested again
const AWAY_MS = 2500; // without a response before that is shown
let silence = null;

/** Follow a stream of events until close(), through restarts. `received` gets (kind, data); `opened` is called at each connection. */
export function follow(url, received, opened = () => {}) {
  const pulse = document.getElementById("pulse");
  let source = null;
  let over = false;
  const begin = () => {
    if (over) return;
    source = new EventSource(url);
    for (const kind of KINDS) source.addEventListener(kind, (event) => received(kind, JSON.parse(event.data)));
    source.onopen = () => {
      pulse.hidden = false;
      pulse.classList.add("on");
      pulse.textContent = "live";
      answers(true);
      opened();
    };
    source.onerror = () => {
      pulse.classList.remove("on");
      pulse.textContent = "connecting";
      answers(false);
      if (source.readyState !== EventSource.CLOSED) return; // else the browser tries again by itself
      setTimeout(() => { refresh(); begin(); }, AGAIN_MS);
    };
  };
  const close = () => { over = true; source.close(); pulse.hidden = true; };
  addEventListener("pagehide", close);
  addEventListener("pageshow", (event) => { if (event.persisted) location.reload(); }); // back from the browser's cache
  begin();
  return { close };
}

/** Show whether the service responds; the notice disappears when it is back. */
function answers(yes) {
  const note = document.getElementById("away");
  if (!yes) {
    if (note.hidden) silence ??= setTimeout(doubt, AWAY_MS);
    return;
  }
  clearTimeout(silence);
  silence = null;
  note.hidden = true;
  for (const notice of document.querySelectorAll("#messages .away")) notice.remove();
}

/** A stream may end for other reasons than a service that is down: check. */
async function doubt() {
  const mine = silence;
  const alive = await fetch(at("/healthz"), { cache: "no-store" }).then(() => true, () => false);
  if (silence !== mine) return;
  silence = null;
  document.getElementById("away").hidden = alive;
}

/** Reload the page soon and replace the parts marked data-live that differ; then the event `refreshed` is sent. */
export async function refresh() {
  due = true;
  if (reading || busy()) return;
  reading = true;
  try {
    while (due && !busy()) {
      const wait = last + PAUSE_MS - Date.now();
      if (wait > 0) await new Promise((done) => setTimeout(done, wait));
      due = false;
      last = Date.now();
      const answer = await fetch(location.href, { cache: "no-store" }).catch(() => null);
      if (answer?.status === 404 || answer?.redirected) { location.reload(); return; } // deleted, or logged out
      answers(answer !== null);
      if (busy()) { due = true; return; }
      if (answer?.ok) exchange(new DOMParser().parseFromString(await answer.text(), "text/html"));
    }
  } finally {
    reading = false;
  }
}

function exchange(fresh) {
  let focused = null;
  for (const old of document.querySelectorAll("[data-live]")) {
    const now = fresh.getElementById(old.id);
    if (!now || now.outerHTML === read.get(old.id)) continue;
    read.set(old.id, now.outerHTML);
    const back = held(old);
    const { scrollLeft } = old;
    const own = old === document.activeElement; // a table that is scrolled by keys
    const opened = [...old.querySelectorAll("details")].map((one) => one.open);
    old.replaceWith(now);
    now.querySelectorAll("details").forEach((one, i) => { if (opened[i] !== undefined) one.open = opened[i]; });
    back(now);
    now.scrollLeft = scrollLeft;
    if (own) focused = now;
  }
  document.dispatchEvent(new CustomEvent("refreshed"));
  focused?.focus({ preventScroll: true });
}

/** Nobody looks, or somebody is asked something whose button is in the page, or presses what may be exchanged: a link
 * that is replaced between press and release is never clicked. */
const busy = () => document.hidden || pressed || document.querySelector("dialog[open]") !== null;

let pressed = false;
const release = () => setTimeout(() => { pressed = false; if (due) refresh(); });
document.addEventListener("pointerdown", () => { pressed = true; }, true);
document.addEventListener("pointerup", release, true);
document.addEventListener("pointercancel", release, true);
window.addEventListener("blur", release);

const CONTROLS = "a, button, summary, input, select";
const controls = (part) => [...part.querySelectorAll(CONTROLS)];

/** Remember which control of a part has the focus; the returned function gives it to the same one of the fresh part: in
 * the same row where there are rows, however many stand before it now, else at the same place. */
function held(part) {
  const active = document.activeElement;
  const place = controls(part).indexOf(active);
  if (place < 0) return () => {};
  const row = active.closest("[data-key]");
  const column = row ? controls(row).indexOf(active) : -1;
  return (fresh) => {
    const same = row && fresh.querySelector(`[data-key="${CSS.escape(row.dataset.key)}"]`);
    const among = controls(same ?? fresh);
    const wanted = Math.min(same ? column : place, among.length - 1);
    (among[wanted] ?? document.getElementById("main")).focus({ preventScroll: true });
  };
}

document.addEventListener("changed", refresh);
document.addEventListener("visibilitychange", () => { if (due) refresh(); });
document.getElementById("confirm").addEventListener("close", () => { if (due) refresh(); });

/** 48 s, 3 min 20 s, 2 h 5 min. */
export function span(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  const [unit, below, size, part] = whole < 3600 ? ["min", "s", 60, 1] : whole < 86400 ? ["h", "min", 3600, 60] : ["d", "h", 86400, 3600];
  const rest = Math.floor((whole % size) / part);
  return `${Math.floor(whole / size)} ${unit}${rest ? ` ${rest} ${below}` : ""}`;
}

export function newtons(value) {
  return typeof value === "number" ? `${value.toFixed(2)} N` : "–";
}

export function millimetres(value, digits) {
  return typeof value === "number" ? `${figure(value, digits)} mm` : "–";
}

/** With so many decimals, and at least two significant digits. */
export function figure(value, digits) {
  const small = value !== 0 && digits > 1 && Math.abs(value) < 10 ** (1 - digits);
  return small ? String(Number(value.toPrecision(2))) : value.toFixed(digits);
}
