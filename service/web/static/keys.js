// Keys: a new one is shown once, here and nowhere else.
import { at, mark, quiet, send, submits, unmark } from "./app.js";
import { refresh } from "./live.js";

const form = document.getElementById("create");

if (form) submits(form, async () => {
  unmark(form);
  quiet();
  const field = (name) => form.querySelector(`[data-field=${name}]`);
  const button = form.querySelector("button[type=submit]");
  button.disabled = true;
  const answer = await send(at("/api/v1/keys"), { body: { scope: field("scope").value, note: field("note").value.trim() } });
  button.disabled = false;
  if (!answer.ok) { mark(form, answer, "data-field"); return; }
  field("note").value = "";
  show(answer.data);
  refresh();
});

/** The text of a new key, with a button that copies it. */
function show({ key, id, scope }) {
  const element = (name, properties) => Object.assign(document.createElement(name), properties);
  const box = element("div", { className: "notice good under" });
  const code = element("code", { id: "new-key", textContent: key });
  const copy = element("button", { type: "button", className: "slim", textContent: "Copy" });
  copy.dataset.copy = "new-key";
  const row = element("p", { className: "row" });
  row.append(code, copy);
  box.append(element("p", { textContent: `Key ${id} of scope ${scope}. Keep it now: it is not shown again.` }), row);
  document.getElementById("made").replaceChildren(box);
}
