// The page's controls: the selected season and route, and all parts of the page that depend on them.

const ZOOM_RANGE = 8;
// At the largest zoom the scale bar stands for a metre.
const MAX_ZOOM = Math.log2(SCALE_BAR);
// Time for which the hint on the wheel is shown, milliseconds.
const HINT_MS = 1600;

class Explorer {
  /** `root` holds a Leaflet map and the controls; `press` is called when a line is pressed (see RouteMap). */
  constructor(root, map, press) {
    this.root = root;
    this.data = null;
    this.lists = [...root.querySelectorAll("[data-routes]")];
    this.layers = [...root.querySelectorAll("[data-layer]")];
    this.strip = new Strip(root);
    this.map = new RouteMap(map, { select: (season, index) => this.select(season, index), hover: (at) => this.hover(at), press });
    this.playback = new Playback(root, (now, share) => { this.map.moveVessel(now.place, now.bearing); this.strip.move(share); });
    this.probe = new Probe(map, root.querySelector(".probe"));
    // Particles stay off, until asked for, where the reader prefers less motion.
    root.querySelector("[data-layer=particles]").checked = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.listen();
  }

  /** Show the data of a plan. */
  load(data) {
    this.data = data;
    this.season = Math.max(0, data.seasons.findIndex((season) => season.routes.length > 0));
    this.selected = data.seasons.map(() => 0);
    this.map.load(data);
    this.probe.load(data);
    this.update();
  }

  /** Show none. */
  clear() {
    this.playback.pause();
    this.data = null;
    this.map.clear();
    this.probe.load(null);
    this.root.querySelector(".player").hidden = true;
  }

  /** Give a class to the cards and rows of a route [season, index], and to no others. */
  mark(name, at) {
    for (const row of document.querySelectorAll("[data-route]")) row.classList.toggle(name, at !== null && row.dataset.route === at.join("-"));
  }

  listen() {
    for (const radio of this.root.querySelectorAll("[name=season]")) radio.addEventListener("change", () => this.select(Number(radio.value), this.selected[Number(radio.value)]));
    for (const box of [...this.layers, ...this.root.querySelectorAll("[data-shown]")]) box.addEventListener("change", () => this.draw());
    document.addEventListener("click", ({ target }) => {
      const row = target.closest("[data-select], article[data-route]");
      if (!row || !this.data) return;
      this.select(...(row.dataset.select || row.dataset.route).split("-").map(Number));
      if (!this.root.contains(row)) this.root.querySelector("#map").scrollIntoView({ block: "nearest" });
    });
    document.addEventListener("mouseover", ({ target }) => {
      const row = target.closest("[data-route]");
      if (row || !target.closest("#map")) this.hover(row && row.dataset.route.split("-").map(Number));
    });
    for (const button of document.querySelectorAll("[data-place]")) button.addEventListener("click", () => this.reveal(button));
    for (const button of this.root.querySelectorAll("[data-all]")) button.addEventListener("click", () => this.showAll(button.dataset.all === "all"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (this.data) { this.map.load(this.data); this.update(); } });
  }

  /** Stress a route [season, index] on the map and in the text, or none. */
  hover(at) {
    if (!this.data || String(at) === String(this.map.hovered)) return;
    this.map.hovered = at;
    this.mark("hovered", at);
    this.map.showRoutes(this.map.choice);
  }

  /** Select a route and its season. */
  select(season, index) {
    this.season = season;
    this.selected[season] = index;
    this.update();
    this.playback.speakSoon();
  }

  /** Show the place that a button's row speaks of; its season, too, if it has one. */
  reveal(button) {
    if (button.dataset.season) this.select(Number(button.dataset.season), this.selected[Number(button.dataset.season)]);
    const [x, y] = button.dataset.place.split(",").map(Number);
    this.map.reveal([y, x], button.dataset.text);
    this.root.querySelector("#map").scrollIntoView({ block: "nearest" });
  }

  /** Write every figure again. */
  changeUnits() {
    this.map.showScale();
    if (this.data) this.update();
  }

  /** Show all routes of the season, or only the selected one. */
  showAll(on) {
    for (const box of this.lists[this.season].querySelectorAll("[data-shown]")) box.checked = on;
    this.draw();
  }

  isShown(season, index) {
    return this.lists[season]?.querySelectorAll("[data-shown]")[index].checked ?? true;
  }

  /** Set every control to the selection, then draw it. */
  update() {
    this.lists.forEach((list, season) => { list.hidden = season !== this.season; });
    for (const radio of this.root.querySelectorAll("[name=season]")) radio.checked = Number(radio.value) === this.season;
    for (const card of document.querySelectorAll("[data-card]")) card.classList.toggle("folded", Number(card.dataset.card) !== this.season);
    this.mark("selected", [this.season, this.selected[this.season]]);
    for (const button of document.querySelectorAll("button[data-select]")) {
      button.setAttribute("aria-pressed", String(button.closest(".selected") !== null));
    }
    const route = this.data.seasons[this.season].routes[this.selected[this.season]] || null;
    this.root.querySelector(".player").hidden = !route;
    this.root.style.setProperty("--season", `var(--map-${this.map.role(this.season, this.selected[this.season])})`);
    this.draw();
    this.strip.follow(route);
    this.playback.follow(route, this.data);
  }

  draw() {
    if (!this.data) return;
    const layers = Object.fromEntries(this.layers.map((box) => [box.dataset.layer, box.checked]));
    const selected = this.selected[this.season];
    const season = this.data.seasons[this.season];
    this.probe.follow(season.current, season.routes[selected] || null);
    this.map.show({ season: this.season, selected, layers, shown: (s, r) => this.isShown(s, r) });
  }
}

/** A Leaflet map of a chart's plane. */
function planeMap(container) {
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const map = L.map(container, {
    crs: L.CRS.Simple,
    attributionControl: false,
    zoomControl: false,
    // One finger scrolls the page, two move the map.
    dragging: !matchMedia("(pointer: coarse)").matches,
    scrollWheelZoom: false,
    zoomSnap: 0,
    zoomDelta: 1,
    wheelPxPerZoomLevel: 90,
    minZoom: -30,
    maxZoom: 30,
    zoomAnimation: !isStill,
    fadeAnimation: false,
    inertia: !isStill,
  });
  L.control.zoom({ position: "topright" }).addTo(map);
  listenToWheel(map, container);
  return map;
}

/** The wheel scrolls the page; with Ctrl (or Cmd) it zooms the map. */
function listenToWheel(map, container) {
  const hint = container.parentElement.querySelector(".wheel-hint");
  let hiding = 0;
  container.addEventListener("wheel", (event) => {
    const zooms = event.ctrlKey || event.metaKey;
    map.scrollWheelZoom[zooms ? "enable" : "disable"]();
    // Before Leaflet listens, too, Ctrl and the wheel must not zoom or scroll the page.
    if (zooms) event.preventDefault();
    hint.hidden = zooms;
    clearTimeout(hiding);
    hiding = setTimeout(() => { hint.hidden = true; }, HINT_MS);
  }, { capture: true, passive: false });
}

/** Show the whole chart, and limit pan and zoom to it. */
function fit(map, { bounds, grid }) {
  const letters = grid.map(({ label, meridian }) => (meridian ? 0 : label.length));
  const left = LABEL_GAP + LETTER_WIDTH * Math.max(0, ...letters);
  map.setMinZoom(-30).setMaxZoom(30);
  map.fitBounds(bounds, { animate: false, paddingTopLeft: [left, 14], paddingBottomRight: [56, 54] });
  const zoom = map.getZoom();
  map.setMinZoom(zoom - 0.5).setMaxZoom(Math.max(zoom, Math.min(zoom + ZOOM_RANGE, MAX_ZOOM)));
  map.setMaxBounds(bounds.pad(0.5));
}

/** Show the map of a report; there is none where this script is part of another page. */
function openReport(explorer) {
  // The style sheet now shows the map instead of the static ones: the map needs a size before it is made.
  document.documentElement.classList.add("live");
  try {
    const data = readData(JSON.parse(document.getElementById("map-data").textContent));
    const map = planeMap(explorer.querySelector("#map"));
    fit(map, data);
    const shown = new Explorer(explorer, map);
    shown.load(data);
    explorer.querySelector("#fit").addEventListener("click", () => fit(map, data));
    new UnitSwitch(explorer.querySelector("#nautical"), document.querySelector("main"), () => shown.changeUnits());
    // When the map is drawn, the rest of the page is laid out.
    requestAnimationFrame(() => requestAnimationFrame(() => {
      document.documentElement.dataset.ready = Math.round(performance.now());
      setTimeout(() => document.documentElement.classList.add("settled"));
    }));
  } catch (error) {
    document.documentElement.classList.remove("live");
    throw error;
  }
}

const found = document.querySelector(".explorer");
if (found) openReport(found);
