// Schedules: the form of a new one; the list is refreshed after every change.
import { at, submits, tell, unmark } from "./app.js";
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

setInterval(() => { if (document.querySelector("#schedules section")) refresh(); }, 15_000);
