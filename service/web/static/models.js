// Models: the form of a training, and uploads.
import { at, mark, quiet, send, submits, unmark } from "./app.js";
import { takeFiles } from "./drop.js";
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

function drop(id, kind, sent) {
  const input = document.getElementById(id), holder = input.closest(".field");
  holder.classList.add("drop");
  takeFiles(holder, input, { kind: () => kind, sent });
}

drop("file", "dataset", ({ name, reference, content }) => {
  const choice = field("data");
  if (![...choice.options].some((one) => one.value === reference)) {
    choice.append(new Option(`${name}: ${content.drawn} rows, ${content.insertions} insertions`, reference));
  }
  choice.value = reference;
});
drop("model-file", "model", ({ id }) => location.assign(at(`/models/${id}`)));

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
