// Uploads: a file is sent from the list, which then has it.
import { takeFiles } from "./drop.js";
import { refresh } from "./live.js";

takeFiles(document.getElementById("drop"), document.getElementById("file"), {
  kind: () => document.getElementById("kind").value,
  sent: refresh,
});
