// Tables where there is little space: on a phone each row of a wide one is a card whose values say what they are; one
// that is still wider than its place can be scrolled by keys.

const MOST_COLUMNS = 2; // that stay side by side on a phone

/** Write the title of its column beside each value; the style sheet shows it where rows are cards. */
function label(table) {
  const heads = [...table.querySelectorAll("thead th")];
  if (heads.length <= MOST_COLUMNS) return;
  const titles = heads.map((head) => (head.querySelector(".unseen") ? "" : head.textContent.replace(/[↑↓]/u, "").trim()));
  for (const row of table.tBodies) for (const { cells } of row.rows) [...cells].forEach((cell, i) => { if (cell.tagName === "TD") cell.dataset.label ??= titles[i] ?? ""; });
  table.classList.add("stacked");
}

/** A place that scrolls is reached by the keyboard, and has a name. */
function reach(place) {
  if (place.hasAttribute("tabindex") && !place.dataset.reached) return; // the page says so itself
  if (place.scrollWidth <= place.clientWidth + 1) {
    if (!place.dataset.reached) return;
    for (const name of ["tabindex", "role", "aria-label", "data-reached"]) place.removeAttribute(name);
    return;
  }
  const title = place.querySelector("caption") ?? place.closest("section")?.querySelector("h2") ?? document.querySelector("h1");
  place.dataset.reached = "true";
  place.tabIndex = 0;
  place.setAttribute("role", "region");
  place.setAttribute("aria-label", `Table: ${title.textContent.trim()}`);
}

function all() {
  document.querySelectorAll("table.data").forEach(label);
  document.querySelectorAll(".table").forEach(reach);
}

let later;
addEventListener("resize", () => { clearTimeout(later); later = setTimeout(all, 150); });
document.addEventListener("refreshed", all);
document.addEventListener("toggle", all, { capture: true });
all();
