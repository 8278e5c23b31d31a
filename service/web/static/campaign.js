// One campaign: read anew while it runs; its report on request.
import { refresh } from "./live.js";

const head = () => document.getElementById("head");

setInterval(() => { if (head().dataset.state === "running") refresh(); }, 3000);

document.getElementById("show-report").addEventListener("click", ({ target }) => {
  const frame = Object.assign(document.createElement("iframe"), { className: "report", title: "Report of the campaign", src: target.dataset.url });
  document.getElementById("report").replaceChildren(frame);
  target.textContent = "Load again";
});
