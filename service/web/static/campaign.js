// One campaign: refreshed while it runs; its report on request.
import { at } from "./app.js";
import { refresh } from "./live.js";

const head = () => document.getElementById("head");

const pause_s = Number(head().dataset.cases) > 200 ? 15 : 3; // a long table is costly for the service

setInterval(() => { if (head().dataset.state === "running") refresh(); }, 1e3 * pause_s);

document.getElementById("show-report").addEventListener("click", ({ target }) => {
  const frame = Object.assign(document.createElement("iframe"), { className: "report", title: "Report of the campaign", src: target.dataset.url });
  document.getElementById("report").replaceChildren(frame);
  target.textContent = "Reload";
});

// A point of the picture leads to its insertion, as its row of the table does.
document.addEventListener("click", ({ target }) => {
  const point = target.closest(".points [data-job]");
  if (point) location.assign(at(`/jobs/${point.dataset.job}`));
});
