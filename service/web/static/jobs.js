// The list of jobs: progress as it arrives, the list again when a job changes state.
import { at, errorText, send } from "./app.js";
import { follow, millimetres, refresh, span } from "./live.js";

follow(at("/api/v1/events"), (kind, data) => {
  if (kind !== "progress") return refresh();
  const row = document.querySelector(`#jobs tr[data-key="${CSS.escape(data.job)}"]`);
  if (!row) return;
  row.querySelector("[data-progress] progress").value = data.fraction;
  const left = data.eta_s ? `, ${span(data.eta_s)} left` : "";
  row.querySelector("[data-progress] span").textContent = `${data.step} of ${data.steps} steps${left}`;
  row.querySelector("[data-depth]").textContent = millimetres(data.depth_mm, 1);
  row.querySelector("[data-error]").textContent = millimetres(data.tip_error_mm, 3);
  if (document.querySelector("#campaigns table")) refresh();
}, refresh); // when the stream begins: for changes since the page was rendered

let known = ""; // the readiness texts that are shown

/** What an operator should know: a disk that is nearly full, workers that do not start. */
async function readiness() {
  const answer = await send(at("/readyz"), { method: "GET" });
  if (answer.status === 0) return; // the stream shows that
  const texts = answer.ok ? [...(answer.data.warnings ?? []), answer.data.problem].filter(Boolean) : [errorText(answer)];
  if (texts.join() === known) return; // else screen readers would repeat it
  known = texts.join();
  document.getElementById("readiness").replaceChildren(...texts.map((text) => {
    const note = Object.assign(document.createElement("div"), { className: answer.ok ? "notice" : "notice bad" });
    note.append(Object.assign(document.createElement("p"), { textContent: text.charAt(0).toUpperCase() + text.slice(1) }));
    return note;
  }));
}

let since = 0; // seconds since the last check: frequent while there is a problem
setInterval(() => {
  since += 3;
  if (document.hidden || (since < 60 && !document.querySelector("#readiness .notice"))) return;
  since = 0;
  readiness();
}, 3000);
readiness();

const MOST = 6; // jobs side by side
const chosen = new Set();

/** Which jobs are chosen to be shown side by side; they stay chosen while the list is read again. */
function pick() {
  for (const box of document.querySelectorAll("#jobs input[name=job]")) box.checked = chosen.has(box.value);
  document.getElementById("picked").hidden = chosen.size === 0;
  const link = document.getElementById("side-by-side");
  const fits = chosen.size >= 2 && chosen.size <= MOST;
  link.href = at(`/side-by-side?${new URLSearchParams([...chosen].map((job) => ["job", job]))}`);
  link.toggleAttribute("hidden", !fits);
  document.getElementById("picked-count").textContent = `${chosen.size} chosen${fits ? "" : `; 2 to ${MOST} can be shown side by side`}`;
}

document.addEventListener("change", ({ target }) => {
  if (target.name !== "job") return;
  if (target.checked) chosen.add(target.value);
  else chosen.delete(target.value);
  pick();
});
document.addEventListener("refreshed", pick);
