// The list of campaigns, and the form of a new one: a dry run first, then start.
import { unmark } from "./app.js";
import { refresh, span } from "./live.js";
import { campaignFields, campaignOf, post } from "./request.js";

const form = document.getElementById("campaign");
const start = document.getElementById("start");
const plan = document.getElementById("plan");
let checked = null; // the request of the last dry run

campaignFields(form);

form.addEventListener("input", () => { start.disabled = true; checked = null; });
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  unmark(form);
  const request = campaignOf(form);
  const found = await post(form, "/api/v1/campaigns?dry_run=1", request);
  plan.replaceChildren();
  if (!found) return;
  checked = request;
  start.disabled = false;
  start.textContent = `Start ${found.jobs} ${found.jobs === 1 ? "job" : "jobs"}`;
  const jobs = found.jobs === 1 ? "1 job" : `${found.jobs.toLocaleString("en")} jobs`;
  const text = `${found.name}: ${jobs}, ${found.steps.toLocaleString("en")} steps, about ${span(found.seconds)} if nothing else runs. First cases: ${found.first.slice(0, 5).join(", ")}.`;
  plan.append(Object.assign(document.createElement("p"), { className: "notice good", textContent: text }));
  start.focus();
  plan.scrollIntoView({ block: "nearest" });
});
start.addEventListener("click", async () => {
  if (!checked) return;
  start.disabled = true;
  const made = await post(form, "/api/v1/campaigns", checked);
  if (made) location.assign(`/campaigns/${made.id}`);
});

setInterval(() => { if (document.querySelector("#campaigns .state.running")) refresh(); }, 3000);
