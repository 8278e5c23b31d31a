// The list of jobs: progress as it arrives, the list again when a job changes state.
import { at, errorText, send } from "./app.js";
import "./picked.js";
import { follow, millimetres, refresh, span } from "./live.js";

follow(at("/api/v1/events"), (kind, data) => {
  if (kind !== "progress") return refresh();
  const row = document.querySelector(`#jobs tr[data-key="${CSS.escape(data.job)}"]`);
  if (!row) return;
  const left = data.eta_s ? `, ${span(data.eta_s)} left` : "";
  const bar = row.querySelector("[data-progress] progress");
  if (bar) bar.value = data.fraction;
  put(row, "[data-progress] span", `${data.step} of ${data.steps} steps${left}`);
  put(row, "[data-depth]", millimetres(data.depth_mm, 1));
  put(row, "[data-error]", millimetres(data.tip_error_mm, 3));
  if (document.querySelector("#campaigns table")) refresh();
}, refresh); // when the stream begins: for changes since the page was rendered

/** Into a column that may not be shown. */
function put(row, place, text) {
  const found = row.querySelector(place);
  if (found) found.textContent = text;
}

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

const form = document.getElementById("list");
form.addEventListener("change", ({ target }) => { if (target.name !== "column" && target.name !== "q") form.requestSubmit(); });
form.addEventListener("submit", () => { // an address says only what was chosen
  const columns = [...form.querySelectorAll("[name=column]")];
  const usual = columns.every((box) => box.checked === box.hasAttribute("data-usual"));
  for (const control of form.elements) control.disabled = control.value === "" || (control.name === "column" && usual);
  if (!form.elements.sort.value) form.elements.down.disabled = true;
});
addEventListener("pageshow", () => { for (const control of form.elements) control.disabled = false; }); // back from another page
