// What is needed less often: gains, trajectory files, and the faults of a virtual drive.

import { ask } from "./link.js";

const at = (id) => document.getElementById(id);

export class Tools {
  constructor() {
    at("gains").ontoggle = () => at("gains").open && this.gains();
    at("gains-form").onsubmit = (event) => { event.preventDefault(); this.change(); };
    at("file-form").onsubmit = (event) => { event.preventDefault(); this.follow(); };
    at("inject").onsubmit = (event) => { event.preventDefault(); this.inject(at("inject-fault").value); };
    at("inject-clear").onclick = () => this.inject("");
    at("inject-fault").onchange = () => { at("inject-words").textContent = at("inject-fault").selectedOptions[0]?.title || ""; };
  }

  show(axis, about) {
    this.axis = axis;
    this.about = about;
    at("faulty").hidden = !about.virtual;
    if (about.virtual && !at("inject-fault").options.length) this.kinds();
    if (at("gains").open) this.gains();
  }

  async gains() {
    const values = (await ask("GET", "/v1/parameters/written"))[this.axis];
    at("gains-fields").replaceChildren(...Object.entries(values).map(([name, value]) => {
      const label = document.createElement("label"), field = document.createElement("input");
      field.name = name;
      field.size = 9;
      field.value = field.dataset.was = value;
      label.append(`${name.replaceAll("_", " ")} `, field);
      return label;
    }));
  }

  async change() {
    const fields = [...at("gains-fields").querySelectorAll("input")].filter((field) => field.value !== field.dataset.was);
    if (!fields.length) return this.say("gains-said", "nothing was changed");
    const control = Object.fromEntries(fields.map((field) => [field.name, field.value.trim()]));
    const well = await this.tried("gains-said", () => ask("PATCH", "/v1/parameters", { axis: this.axis, control }));
    if (!well) return;
    await this.gains();
    this.say("gains-said", "in force, without a jump of the current; the stage file is as it was");
  }

  async follow() {
    const files = [...at("file").files], motions = files.filter((file) => /\.ya?ml$/i.test(file.name));
    if (motions.length !== 1) return this.say("file-said", "choose one trajectory file (.yaml), and the tables (.csv) that it names", true);
    const tables = Object.fromEntries(await Promise.all(files.filter((file) => file !== motions[0]).map(async (file) => [file.name, await file.text()])));
    const name = motions[0].name.replace(/\.ya?ml$/i, "").slice(0, 80), yaml = await motions[0].text();
    const well = await this.tried("file-said", () => ask("POST", "/v1/trajectory", { name, yaml, tables, axis: this.axis, wait: false }));
    if (well) this.say("file-said", `follows ${name}`);
  }

  async kinds() {
    const kinds = await ask("GET", "/v1/virtual/faults");
    at("inject-fault").replaceChildren(...kinds.map(({ fault, words }) => Object.assign(new Option(fault, fault), { title: words })));
    at("inject-fault").onchange();
  }

  inject(fault) {
    const words = at("inject-parameters").value.split(",").map((word) => word.trim()).filter(Boolean);
    return this.tried("inject-said", async () => {
      const { active } = await ask("POST", "/v1/virtual/faults", { axis: this.axis, fault, parameters: fault ? words : [] });
      return active.length ? `acts: ${active.join(", ")}` : "no fault acts";
    });
  }

  async tried(place, action) {
    try {
      const words = await action();
      this.say(place, typeof words === "string" ? words : "");
      return true;
    } catch (error) {
      this.say(place, error.message, true);
      return false;
    }
  }

  say(place, words, bad) {
    at(place).textContent = words;
    at(place).style.color = bad ? "var(--bad)" : "";
  }
}
