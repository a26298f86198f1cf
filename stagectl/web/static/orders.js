// Orders, for who may give them; what the service refuses is told in its own words.

import { Jog } from "./jog.js";
import { ask } from "./link.js";

const at = (id) => document.getElementById(id);
const STILL = ["standing", "disabled", "fault"];
const POWERED = ["standing", "moving", "homing", "drive_homing", "stopping"];

export class Orders {
  constructor() {
    this.jog = new Jog((words, bad) => this.say(words, bad));
    const simple = { stop: "stop", "quick-stop": "quick-stop", enable: "enable", disable: "disable", home: "home", reset: "faults/reset" };
    for (const [id, verb] of Object.entries(simple)) at(id).onclick = () => this.give(`/v1/${verb}${this.which(id)}`, undefined, at(id).textContent);
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || at("orders").hidden) return;
      this.jog.release();
      this.give(`/v1/stop`, undefined, "Stop");
    });
    at("move").onsubmit = (event) => {
      event.preventDefault();
      const body = { [at("move-how").value]: { [this.axis]: at("move-value").value }, wait: false };
      if (at("move-speed").value) body.speed = at("move-speed").value;
      this.give("/v1/move", body, "Move");
    };
    at("sine").onsubmit = (event) => {
      event.preventDefault();
      const yaml = `type: sine\namplitude: ${at("sine-amplitude").value}\nfrequency: ${at("sine-frequency").value}\nperiods: ${at("sine-periods").value}\n`;
      this.give("/v1/trajectory", { name: "sine", yaml, axis: this.axis, wait: false }, "Follow");
    };
  }

  // Stops are for all axes of the machine, whichever is shown.
  which(id) {
    return id.includes("stop") ? "" : `?axis=${encodeURIComponent(this.axis)}`;
  }

  show(axis, about) {
    if (this.axis !== axis) at("jog-speed").value = about.unit === "m" ? "1 mm/s" : "0.1 rad/s";
    this.axis = axis;
    this.jog.show(axis);
  }

  async give(what, body, name) {
    this.say(`${name.replace("Esc", "").trim()} ...`);
    try {
      await ask("POST", what, body);
      this.say("");
    } catch (error) {
      this.say(error.message, true);
    }
  }

  say(words, bad) {
    at("said").textContent = words;
    at("said").style.color = bad ? "var(--bad)" : "";
  }

  take(now, all) {
    const state = now.state, powered = POWERED.includes(state);
    const moving = all.some((one) => !STILL.includes(one.state));  // or nobody knows whether it does
    this.jog.take(state);
    at("unpowered").hidden = state !== "disabled";
    at("enable").disabled = !["disabled", "offline"].includes(state);
    at("disable").disabled = !powered;
    at("home").disabled = state !== "standing";
    at("reset").disabled = !["fault", "offline"].includes(state);
    at("stop").disabled = !moving;
    at("quick-stop").disabled = !moving && !powered;
    for (const id of ["move", "sine"]) at(id).querySelector("button").disabled = state !== "standing";
  }

  // The service is gone: a stop can still be asked for, and is answered with what to do.
  gone() {
    this.take({ state: "no_answer" }, [{ state: "no_answer" }]);
  }
}
