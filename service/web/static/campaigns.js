// The list of campaigns, and the form of a new one: a dry run first, then start.
import { at, submits, unmark } from "./app.js";
import { refresh, span } from "./live.js";
import { campaignFields, campaignOf, post } from "./request.js";

const form = document.getElementById("campaign");
const start = document.getElementById("start");
const plan = document.getElementById("plan");
let checked = null; // the request of the last dry run

campaignFields(form);

form.addEventListener("input", () => { start.disabled = true; checked = null; });
submits(form, async () => {
  unmark(form);
  const request = campaignOf(form);
  const estimate = await post(form, at("/api/v1/campaigns?dry_run=1"), request);
  plan.replaceChildren();
  if (!estimate) return;
  checked = request;
  start.disabled = false;
  start.textContent = `Start ${estimate.jobs} ${estimate.jobs === 1 ? "job" : "jobs"}`;
  const jobs = estimate.jobs === 1 ? "1 job" : `${estimate.jobs.toLocaleString("en")} jobs`;
  const text = `${estimate.name}: ${jobs}, ${estimate.steps.toLocaleString("en")} steps, about ${span(estimate.seconds)} (${span(estimate.seconds_low)} to ${span(estimate.seconds_high)}) if nothing else runs. First cases: ${estimate.first.slice(0, 5).join(", ")}.`;
  plan.append(Object.assign(document.createElement("p"), { className: "notice good", textContent: text }));
  start.focus();
  plan.scrollIntoView({ block: "nearest" });
});
start.addEventListener("click", async () => {
  if (!checked) return;
  start.disabled = true;
  const campaign = await post(form, at("/api/v1/campaigns"), checked);
  if (campaign) location.assign(at(`/campaigns/${campaign.id}`));
});

setInterval(() => { if (document.querySelector("#campaigns .state.running")) refresh(); }, 3000);
