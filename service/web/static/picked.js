// Jobs that are chosen in the list: shown side by side, or cancelled, run again, pinned, deleted together.
import { at, confirmed, quiet, refuse, send, tell } from "./app.js";

const MOST = 6; // jobs side by side
const AT_ONCE = 200; // jobs of one request
const ASKED = {
  cancel: "Cancel {}? What those that run have computed so far is lost; they can be run again from their beginning.",
  retry: "Run {} again?",
  delete: "Delete {} with results, series and recordings?",
};
const DONE = { cancel: "cancelled", retry: "queued again", pin: "pinned", unpin: "no longer pinned", delete: "deleted" };
const chosen = new Map(); // id -> kind of the job
const bar = document.getElementById("picked");
const boxes = () => [...document.querySelectorAll("#jobs input[name=job]")];
const jobs = (count) => (count === 1 ? "1 job" : `${count} jobs`);

/** Show what is chosen; it stays chosen while the list is read again, unless it is gone. */
function show() {
  for (const box of boxes()) box.checked = chosen.has(box.value);
  const all = document.getElementById("pick-all");
  const here = boxes().filter((box) => box.checked).length;
  if (all) {
    all.checked = here > 0 && here === boxes().length;
    all.indeterminate = here > 0 && !all.checked;
  }
  bar.hidden = chosen.size === 0;
  const link = document.getElementById("side-by-side");
  const insertions = [...chosen].filter(([, kind]) => kind === "insertion").map(([job]) => job);
  link.href = at(`/side-by-side?${new URLSearchParams(insertions.map((job) => ["job", job]))}`);
  link.toggleAttribute("hidden", insertions.length !== chosen.size || insertions.length < 2 || insertions.length > MOST);
  const more = link.hidden ? `; 2 to ${MOST} insertions can be shown side by side` : "";
  document.getElementById("picked-count").textContent = `${chosen.size} chosen${more}`;
}

function choose(box, yes) {
  if (yes) chosen.set(box.value, box.dataset.kind);
  else chosen.delete(box.value);
}

document.addEventListener("change", ({ target }) => {
  if (target.id === "pick-all") for (const box of boxes()) choose(box, target.checked);
  else if (target.name === "job") choose(target, target.checked);
  else return;
  show();
});
document.addEventListener("refreshed", show);

document.getElementById("pick-none").addEventListener("click", () => {
  chosen.clear();
  show();
  document.getElementById("pick-all")?.focus();
});

/** One request for many jobs; those that are refused stay chosen, and it is said why. */
async function act(action) {
  const wanted = [...chosen.keys()];
  if (ASKED[action] && !(await confirmed(ASKED[action].replace("{}", `the ${jobs(wanted.length)} that you chose`)))) return;
  quiet();
  const refused = [];
  for (let first = 0; first < wanted.length; first += AT_ONCE) {
    const part = wanted.slice(first, first + AT_ONCE);
    const answer = await send(at("/api/v1/jobs/actions"), { body: { action, jobs: part } });
    if (!answer.ok) { refuse(answer); break; }
    for (const { job, done, detail } of answer.data.items) {
      if (done) chosen.delete(job);
      else refused.push([job, detail]);
    }
    report(action, wanted.length - refused.length, refused);
  }
  show();
  if (bar.hidden) (document.getElementById("pick-all") ?? document.querySelector("#list input")).focus();
  document.dispatchEvent(new CustomEvent("changed"));
}

function report(action, count, refused) {
  const items = refused.map(([job, detail]) => `${nameOf(job)}: ${detail}`);
  const rest = refused.length ? `, ${jobs(refused.length)} refused` : "";
  tell(`${jobs(count)} ${DONE[action]}${rest}.`, { kind: refused.length ? "bad" : "good", items });
}

const nameOf = (job) => document.querySelector(`#jobs tr[data-key="${CSS.escape(job)}"] th a`)?.textContent ?? job;

bar.addEventListener("click", async ({ target }) => {
  const button = target.closest("button[data-act]");
  if (!button || bar.getAttribute("aria-busy") === "true") return;
  bar.setAttribute("aria-busy", "true");
  await act(button.dataset.act);
  bar.removeAttribute("aria-busy");
});

show();
