// What all pages share: addresses, requests, error messages, action buttons, marked fields.
import "./tables.js";

/** An address of the service as the browser sees it: a proxy may show it under a path of its own. */
export const at = (path) => (document.documentElement.dataset.root ?? "") + path;

/** Send a request with JSON or a file; returns {ok, status, data}, with status 0 if the service does not respond. */
export async function send(url, { method = "POST", body, file, headers = {} } = {}) {
  const options = { method, headers: { Accept: "application/json", ...headers } };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["Content-Type"] = "application/json";
  }
  if (file !== undefined) {
    options.body = file;
    options.headers["Content-Type"] = "application/octet-stream";
  }
  try {
    const response = await fetch(url, options);
    const text = await response.text();
    let data = null;
    try { data = text ? JSON.parse(text) : null; } catch { data = null; }
    return { ok: response.ok, status: response.status, data };
  } catch {
    return { ok: false, status: 0, data: { detail: "The service does not respond. Is it still running?" } };
  }
}

/** What went wrong, as a sentence. */
export function errorText(answer) {
  const detail = answer.data?.detail || `The service returned the status ${answer.status}.`;
  return detail.charAt(0).toUpperCase() + detail.slice(1);
}

/** Show what went wrong above the page. */
export function refuse(answer) {
  if (answer.status !== 401) return tell(errorText(answer), { kind: answer.status === 0 ? "bad away" : "bad" });
  tell("You are no longer logged in. ");
  const link = { href: at("/login"), target: "_blank", textContent: "Log in in a new window, then try again here" };
  document.querySelector("#messages p").append(Object.assign(document.createElement("a"), link));
}

/** Show a message above the page; items become a list. */
export function tell(text, { kind = "bad", items = [] } = {}) {
  const box = document.createElement("div");
  box.className = `notice ${kind}`;
  box.append(Object.assign(document.createElement("p"), { textContent: text }));
  if (items.length) {
    const list = document.createElement("ul");
    for (const item of items) list.append(Object.assign(document.createElement("li"), { textContent: item }));
    box.append(list);
  }
  const messages = document.getElementById("messages");
  messages.replaceChildren(box);
  messages.scrollIntoView({ block: "nearest" });
}

/**
 * What a form does when it is submitted. Its button is disabled in the page until this runs: a browser would
 * otherwise submit the form by itself, to nowhere. Coming back to a page that was kept makes it work again.
 */
export function submits(form, handler) {
  const button = form.querySelector("button[type=submit]");
  form.addEventListener("submit", (event) => { event.preventDefault(); handler(); });
  button.disabled = false;
  addEventListener("pageshow", ({ persisted }) => { if (persisted) button.disabled = false; });
}

export function quiet() {
  document.getElementById("messages").replaceChildren();
}

/**
 * Mark the fields below `root` that an answer names; other errors are shown above the page, and the first field gets the focus.
 * aside: only mark, for an answer that nobody asked for.
 */
export function mark(root, answer, attribute, prefix = "", { aside = false } = {}) {
  unmark(root);
  const errors = answer.data?.errors;
  if (!errors) return aside ? undefined : refuse(answer);
  const rest = [];
  let first = null;
  for (const { field, message } of errors) {
    const holder = findField(root, attribute, field, prefix);
    if (!holder) { rest.push(field ? `${field}: ${message}` : message); continue; }
    const note = document.createElement("span");
    note.className = "problem";
    note.id = `problem-${document.querySelectorAll(".problem").length}`;
    note.textContent = message;
    const controls = holder.matches("input, select, textarea") ? [holder] : holder.querySelectorAll("input, select, textarea");
    for (const control of controls) {
      control.setAttribute("aria-invalid", "true");
      control.dataset.described ??= control.getAttribute("aria-describedby") ?? "";
      control.setAttribute("aria-describedby", `${control.dataset.described} ${note.id}`.trim());
    }
    (holder.matches("input, select, textarea") ? holder.parentElement : holder).append(note);
    for (let around = aside ? null : holder.closest("details"); around; around = around.parentElement.closest("details")) around.open = true;
    first ??= controls[0];
  }
  if (aside) return undefined;
  const count = errors.length === 1 ? "One field needs" : `${errors.length} fields need`;
  const all = errors.map(({ field, message }) => (field ? `${field}: ${message}` : message));
  tell(first ? `${count} another value.` : errorText(answer), { items: first ? all : rest.length > 1 ? rest : [] });
  first?.focus({ preventScroll: true });
  first?.scrollIntoView({ block: "center" });
}

/** The field of this name, else the one that holds it: trajectory.entry_mm for trajectory.entry_mm[0]. */
function findField(root, attribute, field, prefix) {
  const visible = (one) => !one.disabled && !one.closest("[hidden], :disabled");
  let name = field.replace(/\[\d+\]/g, "");
  for (;;) {
    for (const wanted of [name, prefix + name]) {
      const holder = [...root.querySelectorAll(`[${attribute}="${CSS.escape(wanted)}"]`)].find(visible);
      if (holder) return holder;
    }
    if (!name.includes(".")) return null;
    name = name.slice(0, name.lastIndexOf("."));
  }
}

export function unmark(root) {
  for (const note of root.querySelectorAll(".problem")) note.remove();
  for (const control of root.querySelectorAll("[aria-invalid]")) {
    control.removeAttribute("aria-invalid");
    if (control.dataset.described) control.setAttribute("aria-describedby", control.dataset.described);
    else control.removeAttribute("aria-describedby");
  }
}

/** Ask before an action that cannot be undone. */
export function confirmed(text) {
  const dialog = document.getElementById("confirm");
  dialog.querySelector("p").textContent = text;
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((done) => dialog.addEventListener("close", () => done(dialog.returnValue === "yes"), { once: true }));
}

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button[data-action]");
  if (!button || button.getAttribute("aria-busy") === "true") return;
  const { action, method, confirm, goto, body, match } = button.dataset;
  if (confirm && !(await confirmed(confirm))) return;
  button.setAttribute("aria-busy", "true");
  const answer = await send(action, { method, body: body && JSON.parse(body), headers: match ? { "If-Match": match } : {} });
  button.removeAttribute("aria-busy");
  if (!answer.ok) refuse(answer);
  else if (goto) { location.assign(goto); return; }
  else quiet();
  document.dispatchEvent(new CustomEvent("changed"));
});

document.addEventListener("click", async ({ target }) => {
  const button = target.closest("button[data-copy]");
  if (!button) return;
  const text = document.getElementById(button.dataset.copy).textContent;
  const before = button.firstChild.textContent;
  try {
    await navigator.clipboard.writeText(text);
    button.firstChild.textContent = "Copied";
  } catch { // a page that is not of this machine and not https may not write there
    getSelection().selectAllChildren(document.getElementById(button.dataset.copy));
    button.firstChild.textContent = "Selected";
  }
  setTimeout(() => { button.firstChild.textContent = before; }, 2000);
});
