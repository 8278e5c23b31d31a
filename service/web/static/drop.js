// Files by choice or by drag and drop, with their progress and what is wrong with them beside the field.
import { at, errorText } from "./app.js";

/** Send a file with its progress, 0 to 1; the answer is that of `send`. */
function upload(file, kind, progressed) {
  return new Promise((done) => {
    const request = new XMLHttpRequest();
    request.open("POST", at(`/api/v1/uploads?${new URLSearchParams({ kind, name: file.name })}`));
    request.setRequestHeader("Accept", "application/json");
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.addEventListener("progress", (event) => { if (event.lengthComputable) progressed(event.loaded / event.total); });
    request.addEventListener("load", () => {
      let data = null;
      try { data = JSON.parse(request.responseText); } catch { data = null; }
      done({ ok: request.status >= 200 && request.status < 300, status: request.status, data });
    });
    request.addEventListener("error", () => done({ ok: false, status: 0, data: { detail: "The service does not respond. Is it still running?" } }));
    request.send(file);
  });
}

const element = (name, properties) => Object.assign(document.createElement(name), properties);

/**
 * Make a field take files: those chosen in `input`, and those dropped anywhere on it. kind: () => what a file is. sent: gets the upload.
 */
export function takeFiles(field, input, { kind, sent }) {
  const told = element("div", { className: "sending" });
  told.setAttribute("role", "status");
  field.append(told);
  let busy = false;

  async function take(file) {
    if (!file || busy) return;
    busy = input.disabled = true;
    input.removeAttribute("aria-invalid");
    const bar = element("progress", { max: 1, value: 0 });
    bar.setAttribute("aria-label", `${file.name} is being sent`);
    const words = element("span", { className: "small soft", textContent: `${file.name}: 0 %` });
    told.replaceChildren(bar, words);
    const answer = await upload(file, kind(), (share) => {
      bar.value = share;
      words.textContent = share < 1 ? `${file.name}: ${Math.round(100 * share)} %` : `${file.name} is being checked`;
    });
    busy = input.disabled = false;
    input.value = "";
    if (answer.ok) {
      told.replaceChildren(element("span", { className: "small soft", textContent: `${file.name} is here.` }));
      sent(answer.data);
      return;
    }
    const problem = element("span", { className: "problem", id: `${input.id}-problem`, textContent: errorText(answer) });
    told.replaceChildren(problem);
    input.setAttribute("aria-invalid", "true");
  }

  input.addEventListener("change", () => take(input.files[0]));
  field.addEventListener("dragover", (event) => { event.preventDefault(); field.classList.add("over"); });
  field.addEventListener("dragleave", () => field.classList.remove("over"));
  field.addEventListener("drop", (event) => {
    event.preventDefault();
    field.classList.remove("over");
    take(event.dataTransfer.files[0]);
  });
}
