// Models: the form of a training, and uploads.
import { at, errorText, mark, quiet, send, submits, tell, unmark } from "./app.js";
import { follow, refresh } from "./live.js";

const form = document.getElementById("train");
const field = (name) => form.querySelector(`[data-field="${name}"]`);

/** Show the settings of the chosen kind. */
function settle() {
  for (const one of form.querySelectorAll("[data-kinds]")) one.hidden = !one.dataset.kinds.split(" ").includes(field("kind").value);
}

/** A typed value, undefined if empty. Text that is not a number is sent as it is: the service reports the error. */
function value(control) {
  const text = control.value.trim();
  if (control.validity.badInput) return "not a number";
  if (!text) return undefined;
  if (control.dataset.type === "text") return text;
  const number = (one) => (one.trim() === "" || Number.isNaN(Number(one)) ? one.trim() : Number(one));
  return control.dataset.type === "list" ? text.split(",").map(number) : number(text);
}

async function sendFile(input, kind) {
  const file = input.files[0];
  if (!file) return null;
  quiet();
  input.disabled = true;
  const answer = await send(at(`/api/v1/uploads?${new URLSearchParams({ kind, name: file.name })}`), { file });
  input.disabled = false;
  input.value = "";
  if (answer.ok) return answer.data;
  tell(errorText(answer));
  return null;
}

document.getElementById("file").addEventListener("change", async ({ target }) => {
  const sent = await sendFile(target, "dataset");
  if (!sent) return;
  const choice = field("data");
  if (![...choice.options].some((one) => one.value === sent.reference)) {
    choice.append(new Option(`${sent.name}: ${sent.content.drawn} rows, ${sent.content.insertions} insertions`, sent.reference));
  }
  choice.value = sent.reference;
  tell(`${sent.name} is uploaded: ${sent.content.drawn} rows of ${sent.content.insertions} insertions.`, { kind: "good" });
});

document.getElementById("model-file").addEventListener("change", async ({ target }) => {
  const sent = await sendFile(target, "model");
  if (sent) location.assign(at(`/models/${sent.id}`));
});

submits(form, async () => {
  unmark(form);
  quiet();
  const body = { data: field("data").value, kind: field("kind").value, split: field("split").value };
  for (const control of form.querySelectorAll("input[data-field]")) {
    if (control.closest("[hidden]")) continue;
    const entered = value(control);
    if (entered !== undefined) body[control.dataset.field] = entered;
  }
  const answer = await send(at("/api/v1/models/train"), { body });
  if (answer.ok) location.assign(at(`/jobs/${answer.data.id}`));
  else mark(form, answer, "data-field");
});

field("kind").addEventListener("change", settle);
settle();
follow(at("/api/v1/events"), (kind) => { if (kind !== "progress") refresh(); }, refresh);
