// The connection to the service: one live connection that reconnects by itself, and single requests.

export const SILENT = "The service does not answer: where an axis still moves, press the emergency stop";
const place = sessionStorage;
let key = "";

export function takeKey() {
  const fragment = decodeURIComponent(location.hash.slice(1));
  if (fragment) {
    place.setItem("stagectl-key", fragment);
    history.replaceState(null, "", location.pathname);  // keeps the key out of sight and of the history
  }
  key = place.getItem("stagectl-key") || "";
  return key;
}

export function setKey(entered) {
  key = entered;
  place.setItem("stagectl-key", entered);
}

function headers() {
  return key ? { Authorization: `Bearer ${key}` } : {};
}

// The answer as JSON; a refusal, and silence, are thrown as an Error with words for a person.
export async function ask(method, what, body) {
  const about = { method, headers: headers() };
  if (body !== undefined) {
    about.headers["Content-Type"] = "application/json";
    about.body = JSON.stringify(body);
  }
  const answer = await fetch(what, about).catch(() => { throw new Error(SILENT); });
  const result = await answer.json();
  if (!answer.ok) throw new Error(result.error || `${answer.status}`);
  return result;
}

export async function download(what) {
  const answer = await fetch(what, { headers: headers() });
  if (!answer.ok) throw new Error((await answer.json()).error);
  save(await answer.blob(), /filename="(.+)"/.exec(answer.headers.get("Content-Disposition"))[1]);
}

export function save(blob, name) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 60000);
}

// The live connection.  `on`: open(), closed(code), news(object), numbers(Float64Array).
export class Link {
  constructor(on) {
    this.on = on;
    this.wait = 250;
    this.open();
  }

  open() {
    const link = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/v1/live`);
    link.binaryType = "arraybuffer";
    this.link = link;
    link.onopen = () => link.send(JSON.stringify({ key }));
    link.onmessage = (event) => {
      if (typeof event.data !== "string") return this.on.numbers(new Float64Array(event.data));
      const message = JSON.parse(event.data);
      if (message.machine) {
        this.wait = 250;
        this.on.open(message);
      } else this.on.news(message);
    };
    link.onclose = (event) => {
      this.on.closed(event.code);
      if (event.code === 1008) return;  // a wrong key: another try does not help
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(this.wait * 1.5, 3000);
    };
  }

  again() {
    this.wait = 250;
    this.open();
  }

  ask(kind, body) {
    if (this.link.readyState === WebSocket.OPEN) this.link.send(JSON.stringify({ [kind]: body }));
  }
}

export const KIND = { strip: 0, capture: 1, detail: 2, free: 3 };

// A message of numbers, see web/live.py.
export function unpack(data) {
  const [kind, channels, buckets, size, start, period, at, number] = data;
  const row = (index) => data.subarray(8 + index * buckets, 8 + (index + 1) * buckets);
  const low = [], high = [];
  for (let k = 0; k < channels; k++) {
    low.push(row(k));
    high.push(row(size === 1 ? k : channels + k));
  }
  return { kind, channels, buckets, size, start, period, at, number, low, high };
}
