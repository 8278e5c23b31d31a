// Name, tags and note of a job. What somebody else wrote meanwhile is not overwritten unseen.
import { at, mark, quiet, refuse, send, submits, tell, unmark } from "./app.js";

const form = document.getElementById("said");
const url = at(`/api/v1/jobs/${form.dataset.job}`);
const field = (name) => form.querySelector(`[data-field="${name}"]`);
const TRIES = 5; // a job that runs has a new version twice a second

/** What the form says. */
const written = () => ({
  name: field("name").value.trim(),
  tags: field("tags").value.split(",").map((tag) => tag.trim()).filter(Boolean),
  note: field("note").value.trim().replaceAll("\r\n", "\n"),
});
const said = ({ name, tags, note }) => JSON.stringify({ name, tags, note });
let known = said(written()); // what the service said when it was last asked

async function save() {
  unmark(form);
  quiet();
  const body = written();
  for (let tries = 0; tries < TRIES; tries++) {
    const now = await read();
    if (!now.ok) return refuse(now);
    if (said(now.data) !== known) {
      known = said(now.data);
      return tell("Somebody else changed this meanwhile. Saving again replaces it by what stands here.", { items: [`Name: ${now.data.name}`, `Tags: ${now.data.tags.join(", ")}`, `Note: ${now.data.note}`] });
    }
    const answer = await send(url, { method: "PATCH", body, headers: { "If-Match": now.tag } });
    if (answer.status === 412) continue; // its progress changed in between
    if (!answer.ok) return mark(form, answer, "data-field");
    known = said(answer.data);
    field("tags").value = answer.data.tags.join(", ");
    tell("Saved.", { kind: "good" });
    document.dispatchEvent(new CustomEvent("changed"));
    return undefined;
  }
  return tell("The job changes too fast now. Try again.");
}

submits(form, save);

/** The job now, with its entity tag. */
async function read() {
  try {
    const response = await fetch(url, { cache: "no-store", headers: { Accept: "application/json" } });
    return { ok: response.ok, status: response.status, data: await response.json(), tag: response.headers.get("ETag") };
  } catch {
    return { ok: false, status: 0, data: { detail: "The service does not respond. Is it still running?" } };
  }
}
