// The fields of a campaign, in the form of a campaign and in that of a schedule.
import { mark, quiet, send } from "./app.js";

/** Make the switch between suite and grid work, and the axes. */
export function campaignFields(form) {
  const axes = form.querySelector("#axes");
  const choose = () => {
    const what = form.querySelector("input[name=what]:checked").value;
    for (const part of form.querySelectorAll("div[data-what]")) part.hidden = part.dataset.what !== what;
    if (what === "grid" && !axes.children.length) addAxis(axes);
  };
  form.addEventListener("change", (event) => { if (event.target.name === "what") choose(); });
  form.querySelector("#add-axis").addEventListener("click", () => addAxis(axes).querySelector("input").focus());
  choose();
}

function addAxis(axes) {
  const number = axes.children.length + 1;
  const row = Object.assign(document.createElement("div"), { className: "axis" });
  const name = input(`Field of axis ${number}`, "tissue.young_kpa");
  name.setAttribute("list", "scenario-fields");
  name.dataset.axis = "";
  const values = input(`Values of axis ${number}, separated by commas`, "3, 6.3, 12");
  const drop = Object.assign(document.createElement("button"), { type: "button", className: "slim", textContent: "Remove" });
  drop.setAttribute("aria-label", `Remove axis ${number}`);
  drop.addEventListener("click", () => row.remove());
  row.append(name, values, drop);
  axes.append(row);
  return row;
}

function input(label, placeholder) {
  const element = Object.assign(document.createElement("input"), { placeholder, autocomplete: "off" });
  element.setAttribute("aria-label", label);
  return element;
}

/** The request of a campaign from the form. */
export function campaignOf(form, prefix = "") {
  const field = (name) => form.querySelector(`[data-field="${prefix}${name}"]`);
  const request = {};
  if (form.querySelector("input[name=what]:checked").value === "suite") request.suite = field("suite").value;
  else {
    if (field("scenario").value) request.scenario = field("scenario").value;
    request.grid = {};
    for (const row of form.querySelectorAll(".axis")) {
      const [name, values] = row.querySelectorAll("input");
      if (name.value.trim()) request.grid[name.value.trim()] = list(values.value);
    }
  }
  if (field("name").value.trim()) request.name = field("name").value.trim();
  return request;
}

/** "3, 6.3, sine" -> [3, 6.3, "sine"]; a JSON list is kept as it is. */
function list(text) {
  try { const parsed = JSON.parse(text); if (Array.isArray(parsed)) return parsed; } catch { /* not JSON: separated by commas */ }
  return text.split(",").map((one) => one.trim()).filter(Boolean).map((one) => {
    try { return JSON.parse(one); } catch { return one; }
  });
}

/** Send a form's request and mark the wrong fields. Returns the answer's data, or null. */
export async function post(form, url, body, prefix = "") {
  quiet();
  const answer = await send(url, { body });
  if (answer.ok) return answer.data;
  mark(form, answer, "data-field", prefix);
  return null;
}
