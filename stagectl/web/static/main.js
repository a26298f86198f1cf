// The page: one live connection, and each part of the page shown what concerns it.

import { Health } from "./health.js";
import { KIND, Link, SILENT, setKey, takeKey, unpack } from "./link.js";
import { Orders } from "./orders.js";
import { fixed, si } from "./plot.js";
import { Records } from "./records.js";
import { Scope } from "./scope.js";
import { Strips } from "./strips.js";
import { Tools } from "./tools.js";

const at = (id) => document.getElementById(id);
let machine = null, axis = "", may = false, since = 0;

takeKey();
const link = new Link({ open, closed, news, numbers });
const strips = new Strips(link), scope = new Scope(link), orders = new Orders(), records = new Records(), health = new Health(), tools = new Tools();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => machine && choose(axis));
requestAnimationFrame(function draw() {
  strips.draw();
  scope.draw();
  requestAnimationFrame(draw);
});
setInterval(() => {
  if (since && performance.now() - since > 2000) say(`no data for ${Math.round((performance.now() - since) / 1000)} s`, true);
}, 500);

function say(words, lost) {
  at("link").textContent = words;
  at("link").className = lost ? "lost" : "";
}

function open(greeting) {
  machine = greeting.machine;
  may = greeting.may.move;
  at("door").hidden = true;
  at("content").hidden = false;
  at("orders").hidden = at("record").hidden = !may;
  at("reading").hidden = may;
  say("live");
  const names = Object.keys(machine);
  at("axes").hidden = names.length < 2;
  at("axes").replaceChildren(...names.map((name) => {
    const button = document.createElement("button");
    button.textContent = name;
    button.onclick = () => choose(name);
    return button;
  }));
  choose(names.includes(axis) ? axis : names[0]);
}

function choose(name) {
  axis = name;
  const about = machine[axis];
  at("machine").textContent = about.name;
  document.title = `${about.name} - stagectl`;
  for (const button of at("axes").children) button.setAttribute("aria-pressed", button.textContent === axis);
  strips.show(axis, about);
  scope.show(axis, about);
  orders.show(axis, about, Object.keys(machine).length > 1);
  records.show(axis, about);
  health.show(about);
  if (may) tools.show(axis, about);
}

function closed(code) {
  since = 0;
  if (code === 1008) {
    at("content").hidden = true;
    at("door").hidden = false;
    at("door-words").textContent = sessionStorage.getItem("stagectl-key") ? "This key is wrong." : "This page needs a key.";
    say("no key", true);
    at("door-key").focus();
  } else {
    say(code === 1013 ? "too many viewers; trying again" : "the service does not answer; trying again", true);
    gone();
  }
}

// Nothing of the machine is known any more: no figure of the past stands there as if it were of now.
function gone() {
  words(at("state"), SILENT);
  at("fault").hidden = true;
  for (const id of ["position", "reference", "error", "speed", "current", "homed"]) words(at(id), "not known");
  at("progress").className = "";
  orders.gone();
}

at("door").onsubmit = (event) => {
  event.preventDefault();
  setKey(at("door-key").value.trim());
  link.again();
};

function numbers(data) {
  const found = unpack(data);
  if (found.kind === KIND.strip) strips.take(found);
  else scope.take(found);
}

function news(message) {
  if (message.error) return scope.refused(message.error);
  if (message.waiting) return scope.waiting(message.waiting);
  since = performance.now();
  const now = message.status.axes.find((one) => one.axis === axis);
  if (!now) return;
  say(message.status.alive ? "live" : "the real-time process does not respond", !message.status.alive);
  state(now);
  orders.take(now, message.status.axes);
  records.take(now, message.status.faults);
  health.take(now, message.status);
}

// Makes a sentence of the state: a verb takes "The axis", a condition "The axis is"; the rest is a sentence already.
function sentence(state) {
  if (/^(holds|moves|looks|brakes)/.test(state)) return `The axis ${state}`;
  if (/^(without|stopped)/.test(state)) return `The axis is ${state}`;
  return state[0].toUpperCase() + state.slice(1);
}

function words(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function state(now) {
  words(at("state"), sentence(now.state_words) + (now.in_position && now.state === "standing" ? ", in position" : ""));
  const wrong = now.fault !== "" || ["offline", "no_answer"].includes(now.state);
  at("fault").hidden = !wrong;
  words(at("fault-name"), now.fault ? `${now.fault.replaceAll("_", " ")}:` : "");
  words(at("fault-words"), now.words);
  const linear = now.unit === "m", heard = now.position !== null;
  const place = (value, digits) => (linear ? fixed(value, 1e-3, digits, "mm") : fixed(value, 1, digits + 1, "rad"));
  words(at("position"), place(now.position, 5));
  words(at("reference"), place(now.reference, 5));
  const small = now.error !== null && Math.abs(now.error) < 1e-6;
  words(at("error"), linear ? (small ? fixed(now.error, 1e-9, 1, "nm") : fixed(now.error, 1e-6, 3, "µm")) : fixed(now.error, 1e-6, 1, "µrad"));
  words(at("speed"), linear ? fixed(now.speed, 1e-3, 2, "mm/s") : fixed(now.speed, 1, 4, "rad/s"));
  words(at("current"), now.current === null ? "not known" : si(Math.abs(now.current) < 5e-4 ? 0 : now.current, "A", 3));
  words(at("homed"), now.homed ? "known" : heard ? "not homed" : "not known");
  const going = now.state === "moving" && now.progress !== null;
  at("progress").className = going ? "on" : "";
  if (going) at("progress").value = now.progress;
}
