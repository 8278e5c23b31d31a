// The service lately: the plots are kept and get what the page has of new moments.
import { refresh } from "./live.js";
import { draw } from "./plots.js";

const EVERY_MS = 10_000; // as often as the service looks at itself

const PLOTS = {
  jobs: [["waiting", "", 0, "queued"], ["running", "", 0, "running"]],
  workers: [["warm", "", 0, "ready"], ["busy", "", 0, "busy"]],
  memory: [["service and workers", "MB", 0, "memory_mb"], ["free on the machine", "MB", 0, "available_mb"]],
  disk: [["free disk", "GB", 2, "disk_free_gb"]],
};

function drawAll() {
  const moments = JSON.parse(document.getElementById("history").dataset.moments);
  if (!moments.length) return;
  const at = moments.map((moment) => moment.at);
  for (const [id, lines] of Object.entries(PLOTS)) {
    const values = lines.map((line) => moments.map((moment) => moment[line[3]]));
    const said = lines.map(([label, unit, digits], i) => {
      const last = values[i].at(-1);
      return `${label} ${last === null ? "not known" : `${last.toFixed(digits)} ${unit}`.trim()}`;
    });
    draw(document.getElementById(`plot-${id}`), {
      data: [at, ...values],
      x: { label: "time, UTC", unit: "", time: true },
      series: lines.map(([label, unit, digits], i) => ({ label, unit, digits, stroke: `--plot-${i + 1}` })),
      range: (_, low, high) => [0, Math.max(1, (high ?? 1) * 1.1)],
      sentence: `${moments.length} moments; last: ${said.join(", ")}.`,
    });
  }
}

document.addEventListener("refreshed", drawAll);
setInterval(refresh, EVERY_MS);
drawAll();
