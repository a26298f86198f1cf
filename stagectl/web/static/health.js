// How punctual the loop is, and how full its bus.

import { si } from "./plot.js";

const at = (id) => document.getElementById(id);

export class Health {
  show(about) {
    this.about = about;
    this.edges = null;
    at("bus-meter").hidden = !about.bus;
  }

  take(now, status) {
    const late = now.lateness, share = late.rows ? `; the loop woke at most ${si(late.largest, "s", 3)} late in the last minute` : "";
    at("late").textContent = `${now.late_cycles} of ${now.cycles} cycles late since the start${share}`;
    this.bars(late);
    at("why-late").hidden = !now.late_cycles;
    at("late-virtual").hidden = !this.about.follows_sync;
    if (now.bus_load !== null) {
      at("bus").textContent = `Bus load ${(100 * now.bus_load).toFixed(0)} % (${this.about.bus}): ${now.rate.toFixed(0)} cycles/s, worst-case stuffing`;
      at("bus-meter").value = now.bus_load;
    } else at("bus").textContent = `${now.rate.toFixed(0)} cycles/s`;
    at("refused").textContent = status.refused.length ? `Refused by the kernel: ${status.refused.join("; ")}` : "";
  }

  // One bar a class, its length the logarithm of the count: one late cycle in a minute must be visible.
  bars(late) {
    const place = at("histogram");
    if (this.edges !== late.edges.length) {
      this.edges = late.edges.length;
      place.innerHTML = "";
      late.counts.forEach((_, k) => {
        const name = document.createElement("span"), bar = document.createElement("i"), count = document.createElement("span");
        const low = k ? si(late.edges[k - 1], "s", 3) : "";
        name.textContent = k < this.edges ? `< ${si(late.edges[k], "s", 3)}` : `≥ ${low}`;
        const start = k ? late.edges[k - 1] : 0;
        if (start >= this.about.period * 0.999) bar.className = "late";
        place.append(name, bar, count);
      });
    }
    const most = Math.log10(1 + Math.max(...late.counts, 1));
    late.counts.forEach((count, k) => {
      place.children[3 * k + 1].style.width = count ? `${Math.max((100 * Math.log10(1 + count)) / most, 2)}%` : "0";
      place.children[3 * k + 1].style.visibility = count ? "visible" : "hidden";
      place.children[3 * k + 2].textContent = count || "";
    });
    place.setAttribute("aria-label", `${late.rows} wake-ups, the latest by ${si(late.largest, "s", 3)}`);
  }
}
