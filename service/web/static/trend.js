// The history of a suite as plots over its dates; regressions are marked, as in the table.
import { draw } from "./plots.js";

const points = JSON.parse(document.getElementById("trend").dataset.points);
const at = points.map((point) => Date.parse(point.at) / 1e3);

function plot(id, { title, unit, digits, values, bad, range }) {
  const known = values.filter((value) => value !== null);
  const worse = values.map((value, i) => (bad(points[i]) ? value : null));
  const count = worse.filter((value) => value !== null).length;
  const marked = count === 0 ? "no run is marked as worse" : count === 1 ? "1 run is marked as worse" : `${count} runs are marked as worse`;
  draw(document.getElementById(`plot-${id}`), {
    data: [at, values, worse],
    x: { label: "date, UTC", unit: "", time: true, notes: points.map((point) => (point.commit ?? "").slice(0, 10)) },
    series: [
      { label: title, unit, digits, stroke: "--plot-1", dots: 7 },
      { label: "got worse", unit, digits, stroke: "--bad", dots: 13, width: 0 },
    ],
    range,
    sentence: known.length ? `${title}: ${known[0].toFixed(digits)} ${unit} first, ${known.at(-1).toFixed(digits)} ${unit} now; ${marked}.` : `${title}: nothing was measured.`,
  });
}

plot("rmse", { title: "RMSE", unit: "mm", digits: 4, values: points.map((p) => p.median_rmse_mm), bad: (p) => p.accuracy === "worse" });
plot("success", { title: "Success", unit: "%", digits: 0, values: points.map((p) => (p.cases ? (100 * p.successes) / p.cases : null)), bad: (p) => p.success === "worse", range: () => [0, 105] });
plot("step", { title: "Step", unit: "ms", digits: 2, values: points.map((p) => p.step_ms), bad: (p) => p.time === "worse", range: (_, low, high) => [0, (high ?? 1) * 1.15] });
