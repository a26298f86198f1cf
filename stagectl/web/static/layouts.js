// Named layouts of the scope, kept by this browser.

const at = (id) => document.getElementById(id);
const KEPT = "stagectl-layouts";
const FIELDS = ["span", "before", "source", "edge", "level", "mode", "lanes", "view"];

export class Layouts {
  constructor(scope) {
    this.scope = scope;
    at("layout").onchange = () => this.use(at("layout").value);
    at("layout-form").onsubmit = (event) => { event.preventDefault(); this.keep(at("layout-name").value.trim()); };
    at("layout-drop").onclick = () => this.drop(at("layout").value);
    this.list("");
  }

  kept() {
    try { return JSON.parse(localStorage.getItem(KEPT)) || {}; } catch { return {}; }
  }

  list(chosen) {
    at("layout").replaceChildren(new Option("layout ...", ""), ...Object.keys(this.kept()).sort().map((name) => new Option(name, name)));
    at("layout").value = chosen;
    at("layout-drop").disabled = !chosen;
  }

  keep(name) {
    if (!name) return this.scope.refused("give the layout a name first");
    const fields = Object.fromEntries(FIELDS.map((field) => [field, at(`scope-${field}`).value]));
    localStorage.setItem(KEPT, JSON.stringify({ ...this.kept(), [name]: { channels: this.scope.chosen, fields } }));
    at("layout-name").value = "";
    this.list(name);
  }

  drop(name) {
    const { [name]: _, ...others } = this.kept();
    localStorage.setItem(KEPT, JSON.stringify(others));
    this.list("");
  }

  use(name) {
    at("layout-drop").disabled = !name;
    const layout = this.kept()[name];
    if (!layout) return;
    for (const [field, value] of Object.entries(layout.fields)) at(`scope-${field}`).value = value;
    this.scope.choose(layout.channels);
  }
}
