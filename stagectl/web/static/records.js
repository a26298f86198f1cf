// Recordings: begin, end, have; and the list of faults.

import { ask, download } from "./link.js";

const at = (id) => document.getElementById(id);
const FORMATS = ["h5", "csv", "mcap"];

export class Records {
  constructor() {
    this.going = false;
    this.asked = this.shown = 0;  // number of the last question, and of the one whose answer is shown
    at("record").onsubmit = async (event) => {
      event.preventDefault();
      try {
        if (this.going) await ask("POST", `/v1/recordings/end?axis=${encodeURIComponent(this.axis)}`);
        else await ask("POST", "/v1/recordings", { axis: this.axis, name: at("record-name").value, before: Number(at("record-before").value) });
        this.words = "";
      } catch (error) {
        this.words = error.message;
        at("recording").textContent = error.message;
      }
      this.list();
    };
    setInterval(() => this.axis && !document.hidden && this.list(), 5000);
  }

  show(axis, about) {
    this.axis = axis;
    this.machine = about.name;
    at("files").replaceChildren();
    this.list();
  }

  take(now, faults) {
    const going = now.recording !== null;
    if (this.going && !going) this.list();
    this.going = going;
    at("record-button").textContent = going ? "End" : "Record";
    at("record-button").setAttribute("aria-pressed", going);
    at("recording").textContent = going ? `recording ${now.recording.file}: ${now.recording.seconds.toFixed(1)} s` : this.words || "";
    const last = faults.length ? faults[faults.length - 1].time + faults.length : "none";
    if (last === this.last) return;
    this.last = last;
    at("faults").replaceChildren(...[...faults].reverse().map((one) => item(`${one.time.slice(11, 19)} ${one.axis || "service"}: ${one.fault.replaceAll("_", " ")}`, one.words)));
    if (!faults.length) at("faults").append(item("", "none since the service started"));
    this.list();
  }

  async list() {
    const turn = ++this.asked;
    let files;
    try {
      files = await ask("GET", "/v1/recordings");
    } catch { return; }
    if (turn < this.shown) return;  // an answer that a later one has overtaken
    this.shown = turn;
    update(at("files"), files.slice(0, 40), (one) => this.file(one), "none yet");
  }

  file(one) {
    const kind = one.kind === "blackbox" ? `black box of ${this.machine}${one.axis === this.axis ? "" : `, axis ${one.axis}`}, ` : "";
    const entry = item(one.file.replace(/\.h5$/, ""), `${kind}${one.going_on ? "in progress" : `${(one.bytes / 1e6).toFixed(1)} MB`}`);
    if (one.going_on) return entry;
    for (const to of FORMATS) {
      const button = document.createElement("button");
      button.textContent = to;
      button.setAttribute("aria-label", `Download ${one.file} as ${to}`);
      button.onclick = async () => {
        button.disabled = true;
        try {
          await download(`/v1/recordings/${one.kind}/${one.axis}/${encodeURIComponent(one.file)}?to=${to}`);
        } catch (error) {
          at("recording").textContent = this.words = error.message;
        }
        button.disabled = false;
      };
      entry.append(button);
    }
    return entry;
  }
}

// Entries that did not change stay as they are: a button that is being pressed is not replaced.
function update(list, records, entryOf, none) {
  const texts = records.length ? records.map((one) => JSON.stringify(one)) : [none], wanted = new Set(texts);
  for (const entry of [...list.children]) if (!wanted.has(entry.record)) entry.remove();
  texts.forEach((text, index) => {
    const there = list.children[index];
    if (there?.record === text) return;
    const entry = records.length ? entryOf(records[index]) : item("", none);
    entry.record = text;
    list.insertBefore(entry, there ?? null);
  });
  while (list.children.length > texts.length) list.lastChild.remove();
}

function item(name, words) {
  const entry = document.createElement("li"), bold = document.createElement("b");
  bold.textContent = name;
  entry.append(bold, name ? " " : "", words);
  return entry;
}
