// Schedules: the form of a new one; the list is refreshed after every change.
import { at, send, submits, tell, unmark } from "./app.js";
import { refresh } from "./live.js";
import { campaignFields, campaignOf, post } from "./request.js";

const form = document.getElementById("schedule");

campaignFields(form);

submits(form, async () => {
  unmark(form);
  const body = { campaign: campaignOf(form, "campaign.") };
  for (const name of ["name", "cron", "timezone", "catchup", "overlap"]) body[name] = form.querySelector(`[data-field="${name}"]`).value.trim();
  const schedule = await post(form, at("/api/v1/schedules"), body, "campaign.");
  if (!schedule) return;
  tell(`The schedule ${schedule.name} next runs at ${schedule.next_run_at.slice(0, 16).replace("T", " ")} UTC.`, { kind: "good" });
  form.querySelector("#name").value = "";
  refresh();
});

let asked = 0;

/** What the cron line means, beside it while it is typed. */
async function preview() {
  const mine = ++asked;
  const field = (name) => form.querySelector(`[data-field="${name}"]`).value.trim();
  const query = new URLSearchParams({ cron: field("cron"), timezone: field("timezone") });
  const answer = field("cron") ? await send(at(`/api/v1/schedules/preview?${query}`), { method: "GET" }) : { ok: false };
  if (mine !== asked) return; // typed on meanwhile
  const next = answer.ok ? answer.data.next.map((moment) => moment.slice(0, 16).replace("T", " ")).join(", ") : "";
  document.getElementById("cron-words").textContent = answer.ok ? `${answer.data.words}. Next: ${next} UTC` : "";
}

let typed;
form.addEventListener("input", ({ target }) => {
  if (!["cron", "timezone"].includes(target.dataset.field)) return;
  clearTimeout(typed);
  typed = setTimeout(preview, 300);
});
preview();

setInterval(() => { if (document.querySelector("#schedules section")) refresh(); }, 15_000);
