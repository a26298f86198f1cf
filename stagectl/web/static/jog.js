// Jog: the axis moves while a button is held by finger, mouse or key.  The service brakes when the signs stop coming.

import { ask } from "./link.js";

const at = (id) => document.getElementById(id);
const AGAIN = 100;  // ms between two signs that it is held; the service waits three times as long

export class Jog {
  constructor(said) {
    this.said = said;
    this.press = null;
    for (const [id, sign] of [["jog-back", "-"], ["jog-forth", ""]]) this.button(at(id), sign);
    at("jog").onsubmit = (event) => event.preventDefault();
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  button(button, sign) {
    button.onpointerdown = (event) => {
      if (event.button) return;
      button.setPointerCapture(event.pointerId);
      this.begin(button, sign);
    };
    button.onkeydown = (event) => {
      if (event.key !== " " && event.key !== "Enter") return;
      event.preventDefault();
      if (!event.repeat) this.begin(button, sign);
    };
    for (const end of ["pointerup", "pointercancel", "lostpointercapture", "keyup", "blur"]) button.addEventListener(end, () => this.release());
    button.oncontextmenu = (event) => event.preventDefault();  // what a long touch opens
  }

  show(axis) {
    this.release();
    this.axis = axis;
  }

  begin(button, sign) {
    if (this.press || button.ariaDisabled === "true") return;
    const press = this.press = { number: Date.now(), button, speed: sign + at("jog-speed").value.trim() };
    button.classList.add("held");
    this.said("");
    press.timer = setInterval(() => this.sign(press), AGAIN);
    this.sign(press).then(() => this.press !== press && !press.refused && this.stop());  // released while it was laid out
  }

  async sign(press) {
    try {
      await ask("POST", "/v1/jog", { axis: this.axis, press: press.number, speed: press.speed });
    } catch (error) {
      press.refused = true;
      if (this.press !== press) return;
      this.end();
      this.said(error.message, true);
    }
  }

  end() {
    clearInterval(this.press.timer);
    this.press.button.classList.remove("held");
    this.press = null;
  }

  release() {
    if (!this.press) return;
    this.end();
    this.stop();
  }

  async stop() {
    try {
      await ask("POST", `/v1/stop?axis=${encodeURIComponent(this.axis)}`);
    } catch { /* the service does not answer: it brakes by itself */ }
  }

  take(state) {
    // Not `disabled`: a button that is loses the focus, and the next key would go nowhere.
    for (const id of ["jog-back", "jog-forth"]) at(id).setAttribute("aria-disabled", state !== "standing" && !(this.press && this.press.button === at(id)));
  }
}
