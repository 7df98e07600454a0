// The form: what is asked for, as the server takes it, and the places that the map shows of it.

import { ask, send } from "./api.js";
import { button, find, make } from "./elements.js";

const STILL = "still";
// The vessel that is chosen at first.
const VESSEL = "usv-7m";
// What a fault names first: a field by its title, or a stop by its key.
const NAMED = /^(?:'([^']+)'|(start|goal|via\[(\d+)\]))/i;
// Where a stop that lies on land may be moved to, as [lon, lat], and how far.
const REMEDY = /([\d.,]+ k?m) from the [^[]*? at \[([-\d.]+), ([-\d.]+)\]; move/;

// The server made the form from its table of options: every field says which option it is.
const fieldsOf = (area) => [...document.querySelectorAll(`${area} [data-option]`)];
const uploads = () => [...document.querySelectorAll("#ask [data-file]")];
const isMany = (field) => "many" in field.dataset;

export class Form {
  /** `heard` has changed(), when the places or areas changed. */
  constructor(heard) {
    this.heard = heard;
    this.areas = [];
    this.files = Object.fromEntries(uploads().map((field) => [field.dataset.file, []]));
    this.places = new Map();
    this.listen();
  }

  async load() {
    const { vessels, currents, tides } = await ask("/api/catalogue");
    const named = { vessels, sources: currents, stations: Object.fromEntries(tides.map((name) => [name, name])) };
    for (const field of document.querySelectorAll("#ask [data-section]")) {
      for (const [name, title] of Object.entries(named[field.dataset.section])) field.append(make("option", { value: name }, name === STILL ? "Still water" : title || name));
    }
    find("#vessel").value = VESSEL;
    find("#month").value = new Date().toISOString().slice(0, 7);
    this.showFigures();
  }

  /** An example, until the reader sets a point. */
  example() {
    this.isExample = true;
    this.setWay({ start: find("#start").placeholder, goal: find("#goal").placeholder, via: [], areas: [] });
  }

  listen() {
    find("#vessel").addEventListener("change", () => this.showFigures());
    for (const name of ["start", "goal"]) find(`#${name}`).addEventListener("change", () => this.located());
    find("#add-via").addEventListener("click", () => this.addVia("").focus());
    find("#swap").addEventListener("click", () => {
      const { start, goal, via, areas } = this.way();
      this.setWay({ start: goal, goal: start, via: via.reverse(), areas });
    });
    find("#clear").addEventListener("click", () => this.setWay({ start: "", goal: "", via: [], areas: [] }));
    find("#add-area").addEventListener("click", () => this.typedArea());
    for (const field of uploads()) {
      field.addEventListener("change", (event) => {
        this.upload(field.dataset.file, [...event.target.files], isMany(field));
        event.target.value = "";
      });
    }
    const drop = find("#drop");
    for (const target of [drop, find("#map")]) {
      target.addEventListener("dragover", (event) => { event.preventDefault(); drop.classList.add("over"); });
      target.addEventListener("dragleave", () => drop.classList.remove("over"));
      target.addEventListener("drop", (event) => {
        event.preventDefault();
        drop.classList.remove("over");
        this.upload("currents", [...event.dataTransfer.files], true);
      });
    }
  }

  showFigures() {
    find("#figures").hidden = find("#vessel").value !== "";
  }

  vias() {
    return [...document.querySelectorAll("#vias input")];
  }

  addVia(text, at = this.vias().length) {
    const input = make("input", { value: text, autocomplete: "off", spellcheck: false });
    const row = make("li", {}, input, button("Remove", () => { row.remove(); this.located(); }));
    input.addEventListener("change", () => this.located());
    find("#vias").insertBefore(row, find("#vias").children[at] || null);
    this.number();
    return input;
  }

  number() {
    this.vias().forEach((input, i) => {
      input.setAttribute("aria-label", `Point ${i + 1} on the way`);
      input.nextElementSibling.setAttribute("aria-label", `Remove point ${i + 1}`);
    });
  }

  /** The fields of places, by the names that their pins have. */
  fields() {
    return new Map([["Start", find("#start")], ...this.vias().map((input, i) => [`Point ${i + 1}`, input]), ["Goal", find("#goal")]]);
  }

  /** Ask where the typed places are, and show them. */
  async located() {
    this.number();
    const asked = (this.asking = (this.asking || 0) + 1);
    const found = new Map();
    for (const [name, input] of this.fields()) {
      input.removeAttribute("aria-invalid");
      if (!input.value.trim()) continue;
      try {
        found.set(name, await ask(`/api/position?text=${encodeURIComponent(input.value)}`));
      } catch {
        input.setAttribute("aria-invalid", "true");
      }
    }
    if (asked !== this.asking) return;
    this.places = found;
    const [{ start, goal }, example] = [this.way(), [find("#start"), find("#goal")]];
    this.isExample &&= start === example[0].placeholder && goal === example[1].placeholder;
    this.heard.changed();
  }

  /** Pins for the map: [name, letter, lat, lon]. */
  pins() {
    return [...this.places].map(([name, { lat, lon }]) => [name, name.startsWith("Point") ? name.slice(6) : name[0], lat, lon]);
  }

  /** The points of the way and the shut areas, as they are typed. */
  way() {
    return { start: find("#start").value, goal: find("#goal").value, via: this.vias().map((input) => input.value), areas: [...this.areas] };
  }

  setWay({ start, goal, via, areas }) {
    find("#start").value = start;
    find("#goal").value = goal;
    find("#vias").replaceChildren();
    for (const text of via) this.addVia(text);
    this.areas = areas;
    this.showAreas();
    return this.located();
  }

  /** Remove a place by the name of its pin. */
  remove(name) {
    const field = this.fields().get(name);
    if (name.startsWith("Point")) field.closest("li").remove();
    else field.value = "";
    return this.located();
  }

  /** Set a place by a click: what is still missing first. */
  async click(text) {
    if (this.isExample) for (const name of ["start", "goal"]) find(`#${name}`).value = "";
    this.isExample = false;
    const name = !find("#start").value ? "Start" : !find("#goal").value ? "Goal" : "";
    if (name) this.set(name, text);
    else this.addVia(text);
    return this.located();
  }

  set(name, text) {
    const field = this.fields().get(name);
    // An anchorage's hours stay with it.
    field.value = `${text}${(field.value.match(/ wait .*/) || [""])[0]}`;
  }

  /** Tell faults beside the button and at the fields that they name; the first of these has the focus. */
  fault(lines) {
    for (const told of document.querySelectorAll("#ask .told")) {
      told.previousElementSibling.removeAttribute("aria-invalid");
      told.remove();
    }
    find("#faults").hidden = !lines.length;
    find("#faults").replaceChildren(...lines.map((line) => make("li", { dir: "auto" }, line)));
    const named = lines.map((line) => [line, this.fieldOf(line)]).filter(([, field]) => field);
    for (const [line, field] of named) {
      const folded = field.closest("details");
      if (folded) folded.open = true;
      field.setAttribute("aria-invalid", "true");
      field.after(make("p", { className: "told", dir: "auto" }, line, ...this.remedies(line, field)));
    }
    named[0]?.[1].focus();
  }

  /** The field that a fault names; null without any. */
  fieldOf(line) {
    const [, title, key, via] = line.match(NAMED) || [];
    if (via) return this.vias()[Number(via)];
    if (key) return find(`#${key.toLowerCase()}`);
    return (title && document.querySelector(`#ask [data-title="${CSS.escape(title)}"]`)) || null;
  }

  /** A button for the remedy of a fault, if it has one that can be done here. */
  remedies(line, field) {
    const [, distance, lon, lat] = line.match(REMEDY) || [];
    if (!distance) return [];
    return [" ", button(`Move it to the nearest water, ${distance}`, async () => {
      field.value = `${lat}, ${lon}`.replace(/(-?)([\d.]+), (-?)([\d.]+)/, (_, south, y, west, x) => `${y}${south ? "S" : "N"} ${x}${west ? "W" : "E"}`);
      this.fault([]);
      await this.located();
      find("#ask").requestSubmit();
    })];
  }

  addArea(ring) {
    this.areas.push(ring);
    this.showAreas();
    this.heard.changed();
  }

  typedArea() {
    const ring = find("#corners").value.split(";").filter((one) => one.trim()).map((one) => one.split(",").map(Number));
    if (ring.length < 3 || ring.some((corner) => corner.length !== 2 || !corner.every(Number.isFinite))) {
      this.fault(["An area needs three corners or more, longitude first: 118,9; 119,9; 118.5,10"]);
      return;
    }
    find("#corners").value = "";
    this.addArea(ring);
  }

  showAreas() {
    find("#areas").replaceChildren(...this.areas.map((ring, i) => make("li", {},
      make("span", {}, `Area ${i + 1}: ${ring.length} corners`),
      button("Remove", () => { this.areas.splice(i, 1); this.showAreas(); this.heard.changed(); }, { "aria-label": `Remove area ${i + 1}` }))));
  }

  async upload(kind, files, many) {
    for (const file of files) {
      const entry = { name: file.name, id: "", size: file.size };
      if (!many) this.files[kind].length = 0;
      this.files[kind].push(entry);
      this.showFiles();
      try {
        entry.id = (await send(file)).id;
      } catch (error) {
        this.files[kind].splice(this.files[kind].indexOf(entry), 1);
        this.fault(error.faults || [String(error)]);
      }
      this.showFiles();
    }
  }

  showFiles() {
    const rows = (kind) => this.files[kind].map((entry, i) => make("li", {},
      make("span", { dir: "auto" }, `${kind === "currents" ? "" : `${kind}: `}${entry.name}${entry.size ? `, ${(entry.size / 1e6).toFixed(1)} MB` : ""}${entry.id ? "" : " (being sent)"}`),
      button("Remove", () => { this.files[kind].splice(i, 1); this.showFiles(); }, { "aria-label": `Remove ${entry.name}` })));
    find("#files").replaceChildren(...rows("currents"));
    find("#checked").replaceChildren(...rows("route"));
    find("#charted").replaceChildren(...Object.keys(this.files).filter((kind) => !["currents", "route"].includes(kind)).flatMap(rows));
    find("#plan").textContent = this.files.route.length ? "Check" : "Plan";
    find("#source").disabled = this.files.currents.length > 0;
  }

  /** The request, as the server takes it. */
  read() {
    const request = { via: this.vias().map((input) => input.value.trim()).filter(Boolean), areas: this.areas };
    for (const field of fieldsOf("#ask")) {
      const text = field.value.trim();
      if (field.type === "checkbox") request[field.dataset.option] = field.checked;
      else if (isMany(field)) request[field.dataset.option] = text.split(/[\s,]+/).filter(Boolean);
      else if (text) request[field.dataset.option] = text;
    }
    if (request.vessel) for (const field of fieldsOf("#figures")) delete request[field.dataset.option];
    for (const field of uploads()) {
      const ids = this.files[field.dataset.file].map((one) => one.id).filter(Boolean);
      if (ids.length) request[field.dataset.file] = isMany(field) ? ids : ids[0];
    }
    // The ends of a route that is checked are its own.
    if (request.route) Object.assign(request, { start: request.start || "", goal: request.goal || "" });
    request.currents ??= [find("#source").value].filter(Boolean);
    return request;
  }

  /** Whether a request may be planned, as far as can be seen here. */
  isComplete(request) {
    if (request.route) return false;
    const isVessel = request.vessel || (request.speed && request.length && request.turning_circle);
    const isTime = request.month.length || request.depart || request.currents[0] === STILL;
    return Boolean(this.places.has("Start") && this.places.has("Goal") && isVessel && isTime);
  }

  /** Fill the form with an earlier request. */
  write(request) {
    for (const field of fieldsOf("#ask")) {
      const value = request[field.dataset.option];
      if (field.type === "checkbox") field.checked = Boolean(value);
      else field.value = isMany(field) ? value.join(", ") : value || "";
    }
    const known = new Set([...find("#source").options].map((one) => one.value));
    find("#source").value = request.currents.find((one) => known.has(one)) || "";
    const named = (id) => ({ name: `file ${id}`, id, size: 0 });
    for (const kind of Object.keys(this.files)) this.files[kind] = [request[kind] || []].flat().filter((one) => !known.has(one)).map(named);
    this.showFiles();
    this.showFigures();
    return this.setWay(request);
  }
}
