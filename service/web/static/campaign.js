// One campaign: refreshed while it runs; its report on request.
import { refresh } from "./live.js";

const head = () => document.getElementById("head");

const pause_s = Number(head().dataset.cases) > 200 ? 15 : 3; // a long table is costly for the service

setInterval(() => { if (head().dataset.state === "running") refresh(); }, 1e3 * pause_s);

document.getElementById("show-report").addEventListener("click", ({ target }) => {
  const frame = Object.assign(document.createElement("iframe"), { className: "report", title: "Report of the campaign", src: target.dataset.url });
  document.getElementById("report").replaceChildren(frame);
  target.textContent = "Reload";
});
