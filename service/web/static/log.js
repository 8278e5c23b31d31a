// What the attempt of a job logged and printed, followed while it runs and somebody looks.
import { at } from "./app.js";

const holder = document.getElementById("log");
const text = holder.querySelector("pre");
const MOST_LINES = 500;
const PAUSE_MS = 2000;
let waiting;

async function read() {
  clearTimeout(waiting);
  if (!holder.open) return;
  const { id, attempt, terminal } = document.getElementById("job").dataset;
  const answer = await fetch(at(`/api/v1/jobs/${id}/log`), { cache: "no-store" }).catch(() => null);
  if (answer?.ok) show(await answer.text(), attempt);
  else if (answer?.status === 404) show("", attempt);
  if (terminal !== "true" && !document.hidden) waiting = setTimeout(read, PAUSE_MS);
}

/** The last lines; the end stays in view unless the reader scrolled up. */
function show(log, attempt) {
  const lines = log.trimEnd().split("\n");
  const cut = lines.length > MOST_LINES ? `… ${lines.length - MOST_LINES} lines before\n` : "";
  const atEnd = text.scrollTop + text.clientHeight >= text.scrollHeight - 4;
  text.textContent = log.trim() ? cut + lines.slice(-MOST_LINES).join("\n") : `Attempt ${attempt} has logged nothing.`;
  if (atEnd) text.scrollTop = text.scrollHeight;
}

holder.addEventListener("toggle", read);
document.addEventListener("refreshed", read);
document.addEventListener("visibilitychange", () => { if (!document.hidden) read(); });
