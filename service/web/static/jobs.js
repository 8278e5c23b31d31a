// The list of jobs: progress as it is told, the list anew when a job changes its state.
import { send, words } from "./app.js";
import { follow, millimetres, refresh, span } from "./live.js";

const stream = follow("/api/v1/events", (kind, data) => {
  if (kind !== "progress") return refresh();
  const row = document.querySelector(`#jobs tr[data-key="${CSS.escape(data.job)}"]`);
  if (!row) return;
  row.querySelector("[data-progress] progress").value = data.fraction;
  const left = data.eta_s ? `, ${span(data.eta_s)} left` : "";
  row.querySelector("[data-progress] span").textContent = `${data.step} of ${data.steps} steps${left}`;
  row.querySelector("[data-depth]").textContent = millimetres(data.depth_mm, 1);
  row.querySelector("[data-error]").textContent = millimetres(data.tip_error_mm, 3);
  if (document.querySelector("#campaigns table")) refresh();
});
stream.addEventListener("open", () => refresh()); // what happened after the page was made and before the stream began

/** What an operator should know: a disk that runs short, workers that do not start. */
async function readiness() {
  const answer = await send("/readyz", { method: "GET" });
  const texts = answer.ok ? [...(answer.data.warnings ?? []), answer.data.problem].filter(Boolean) : [words(answer)];
  const box = document.getElementById("readiness");
  box.replaceChildren(...texts.map((text) => {
    const note = Object.assign(document.createElement("div"), { className: answer.ok ? "notice" : "notice bad" });
    note.setAttribute("role", "status");
    note.append(Object.assign(document.createElement("p"), { textContent: text }));
    return note;
  }));
}

readiness();
setInterval(() => { if (!document.hidden) readiness(); }, 60_000);
