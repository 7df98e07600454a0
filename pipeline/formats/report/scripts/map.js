// The interactive map: its layers and their colours. It does not depend on the controls.

// Panes from the bottom up: water and grid, currents as arrows and as particles, soft and hard no-go zones, land, routes,
// marks on them. Vessel and labels are in Leaflet's own panes above.
const PANES = { water: 210, currents: 220, particles: 225, soft: 230, nogo: 235, land: 240, routes: 400, marks: 410 };
const BARE_PANES = ["currents", "particles"];
const ZOOM_RANGE = 8;
// Time for which the hint on the wheel is shown, milliseconds.
const HINT_MS = 1600;
// Side of the part of the map that is shown around a place, as a share of the chart's shorter side.
const SPOT_SHARE = 0.12;
// Distance within which the labels of two places would overlap, as a share of that side.
const NEAR_SHARE = 0.05;
// Maximum length of the scale bar, in CSS pixels; at the largest zoom it stands for a metre.
const SCALE_BAR = 100;
const MAX_ZOOM = Math.log2(SCALE_BAR);
// Space for the parallels' labels, in CSS pixels: per letter, and beside the label.
const LETTER_WIDTH = 6.5;
const LABEL_GAP = 16;

const ROUTE_SELECTED = { weight: 4, opacity: 1, dashArray: null };
const ROUTE_UNSELECTED = { weight: 1.6, opacity: 0.6, dashArray: null };
const ROUTE_OTHER_SEASON = { weight: 2.2, opacity: 0.85, dashArray: "6 6" };
// State of a stretch of the best route -> the role of its colour.
const STATE_ROLES = { covered: "covered", "not settled": "unsettled", uncovered: "uncovered" };
// The style sheet has this many colours for seasons, `--map-season0` on.
const SEASON_COLOURS = 6;

/** An element with a class and a text; text is never read as HTML. */
function element(tag, className, text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

/** A scale bar in nautical miles. */
const NauticalScale = L.Control.Scale.extend({
  _updateMetric(maxMetres) {
    const miles = maxMetres / MILE_M;
    const power = 10 ** Math.floor(Math.log10(miles));
    const round = [5, 2, 1].find((factor) => factor * power <= miles) * power;
    this._updateScale(this._mScale, `${Number(round.toPrecision(1))} NM`, round / miles);
  },
});

class RouteMap {
  /** Draw what all seasons share; `onSelect(season, index)` is called when a route is clicked. */
  constructor(container, data, onSelect) {
    this.data = data;
    this.onSelect = onSelect;
    const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.map = L.map(container, {
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
      zoomAnimation: !reducedMotion,
      fadeAnimation: false,
      inertia: !reducedMotion,
    });
    // Leaflet rounds places to whole pixels, which makes stairs of lines with many places.
    this.map.latLngToLayerPoint = (place) => this.map.project(place).subtract(this.map.getPixelOrigin());
    this.renderers = {};
    for (const [name, height] of Object.entries(PANES)) {
      this.map.createPane(name).style.zIndex = height;
      if (!BARE_PANES.includes(name)) this.renderers[name] = L.canvas({ pane: name, padding: 0.2, tolerance: 6 });
    }
    this.readColours();
    this.fit();
    this.drawWater();
    this.makeZones();
    this.currents = new CurrentArrows(data.extent, data.speedLimits, (role) => this.colour(role));
    this.currents.addTo(this.map);
    this.particles = new CurrentParticles(data.extent, data.speedLimits, (role) => this.colour(role));
    this.makeRoutes();
    this.drawIslandLabels();
    this.drawStartAndGoal();
    this.vessel = this.makeVessel();
    L.control.zoom({ position: "topright" }).addTo(this.map);
    this.showScale();
    this.listenToWheel(container);
  }

  /** The wheel scrolls the page; with Ctrl (or Cmd) it zooms the map. */
  listenToWheel(container) {
    const hint = container.parentElement.querySelector(".wheel-hint");
    const listen = (event) => {
      const zooms = event.ctrlKey || event.metaKey;
      this.map.scrollWheelZoom[zooms ? "enable" : "disable"]();
      // Before Leaflet listens, too, Ctrl and the wheel must not zoom or scroll the page.
      if (zooms) event.preventDefault();
      hint.hidden = zooms;
      clearTimeout(this.hiding);
      this.hiding = setTimeout(() => { hint.hidden = true; }, HINT_MS);
    };
    container.addEventListener("wheel", listen, { capture: true, passive: false });
  }

  /** Show the scale bar in the reader's units. */
  showScale() {
    if (this.scale) this.scale.remove();
    this.scale = new (units.nautical ? NauticalScale : L.Control.Scale)({ imperial: false, position: "bottomright", maxWidth: SCALE_BAR });
    this.scale.addTo(this.map);
  }

  /** A colour of the page, as last read by `readColours`. */
  colour(role) {
    return this.colours.get(role);
  }

  /** Read the page's colours by role, light or dark, once: reading each on use is slow. */
  readColours() {
    const style = getComputedStyle(document.documentElement);
    const seasons = Array.from({ length: SEASON_COLOURS }, (_, i) => `season${i}`);
    const speeds = this.data.speedLimits.map((_, i) => `speed${i}`);
    const roles = ["water", "grid", "frame", "land", "coast", "nogo", "shoal", "hazard", "soft", "halo", "ink", "hit", "restricted", "traffic", "shut", "haven", "narrow", "adrift", ...Object.values(STATE_ROLES), ...seasons, ...speeds];
    this.colours = new Map(roles.map((role) => [role, style.getPropertyValue(`--map-${role}`).trim()]));
  }

  /** The colour of a season's routes. */
  seasonColour(season) {
    return this.colour(`season${season % SEASON_COLOURS}`);
  }

  /** Show the whole chart, and limit pan and zoom to it. */
  fit() {
    const bounds = L.latLngBounds(this.data.extent.flat());
    const letters = this.data.grid.map(({ label, meridian }) => (meridian ? 0 : label.length));
    const left = LABEL_GAP + LETTER_WIDTH * Math.max(0, ...letters);
    this.map.setMinZoom(-30).setMaxZoom(30);
    this.map.fitBounds(bounds, { animate: false, paddingTopLeft: [left, 14], paddingBottomRight: [56, 54] });
    const zoom = this.map.getZoom();
    this.map.setMinZoom(zoom - 0.5).setMaxZoom(Math.max(zoom, Math.min(zoom + ZOOM_RANGE, MAX_ZOOM)));
    this.map.setMaxBounds(bounds.pad(0.5));
  }

  area(rings, pane, style) {
    const options = { renderer: this.renderers[pane], pane, interactive: false, stroke: false };
    return L.polygon(rings, { ...options, fillRule: "nonzero", fillOpacity: 1, smoothFactor: 0.6, ...style });
  }

  line(places, pane, style) {
    const options = { renderer: this.renderers[pane], pane, interactive: false, smoothFactor: 0.6 };
    return L.polyline(places, { ...options, ...style });
  }

  /** Water, grid, land and shoals, the same in all seasons. */
  drawWater() {
    const { extent, sheet, beyond, grid, land, noGo, shoals, hazards } = this.data;
    // Sea and land are drawn beyond the chart: a reader would take a blank for open water.
    this.sheet = this.area(sheet, "water", {}).addTo(this.map);
    this.beyond = this.area(beyond, "water", { stroke: true, weight: 0.7 }).addTo(this.map);
    this.water = this.area(extent, "water", {}).addTo(this.map);
    this.grid = grid.map((line) => this.line(line.parts, "water", { weight: 1 }).addTo(this.map));
    this.noGo = this.area(noGo, "nogo", {}).addTo(this.map);
    this.land = this.area(land, "land", { stroke: true, weight: 0.7 }).addTo(this.map);
    // Shoals are no-go, so they lie inside the areas drawn as land.
    this.shoals = this.area(shoals, "land", {}).addTo(this.map);
    this.edge = this.area(extent, "land", { stroke: true, weight: 1, fill: false }).addTo(this.map);
    // The smallest are seen by their edges.
    this.hazards = this.area(hazards, "land", { stroke: true, weight: 1.5 }).addTo(this.map);
    this.meridians = [];
    for (const line of grid) {
      const direction = line.meridian ? "bottom" : "left";
      const label = this.label(line.foot, line.label, "grid-label", direction).addTo(this.map);
      if (line.meridian) this.meridians.push(label);
    }
    this.map.on("zoomend", () => this.thinMeridians());
    this.thinMeridians();
  }

  /** Show the labels of as many meridians as have room beside each other: of all, every second and so on. */
  thinMeridians() {
    const placed = this.meridians.map((label) => [this.map.latLngToLayerPoint(label.getLatLng()).x, label]);
    placed.sort(([one], [other]) => one - other);
    const gaps = placed.slice(1).map(([x], i) => x - placed[i][0]);
    const letters = Math.max(...placed.map(([, label]) => label.getContent().textContent.length));
    const every = Math.ceil((LETTER_WIDTH * letters + LABEL_GAP / 2) / Math.min(...gaps));
    for (const [i, [, label]] of placed.entries()) label.setOpacity(i % every ? 0 : 1);
  }

  /** Restricted areas and traffic schemes; only their edges react, since one may fill the whole map. */
  makeZones() {
    this.zones = L.featureGroup();
    for (const { kind, text, area, edges } of this.data.zones) {
      this.area(area, "soft", { fillOpacity: 0.06, kind }).addTo(this.zones);
      const edge = this.line(edges, "routes", { interactive: true, weight: 1.5, dashArray: "6 4", kind });
      edge.bindTooltip(element("span", "", text), { sticky: true, className: "route-label" }).addTo(this.zones);
    }
  }

  /** A permanent label beside a place. */
  label(place, text, className, direction) {
    const options = { permanent: true, direction, className, opacity: 1, interactive: false };
    return L.tooltip(options).setLatLng(place).setContent(element("span", "", text));
  }

  /** Lines for all routes of all seasons; `show` decides which are drawn. */
  makeRoutes() {
    this.halo = this.line([], "routes", { opacity: 0.95, weight: 8 });
    this.routes = this.data.seasons.map((season, s) =>
      season.routes.map((route, r) => {
        const line = this.line(route.places, "routes", { interactive: true, smoothFactor: 0.4 });
        const name = `${season.title}, ${route.rank}${route.way && `: ${route.way}`}`;
        line.bindTooltip(element("span", "", name), { sticky: true, className: "route-label" });
        return line.on("click", () => this.onSelect(s, r));
      }),
    );
    this.nearBest = this.area([], "soft", {}).addTo(this.map);
    this.soft = this.area([], "soft", {});
    this.havens = L.layerGroup();
    this.turns = L.layerGroup();
    this.shores = L.layerGroup().addTo(this.map);
    this.marked = L.layerGroup().addTo(this.map);
    this.closest = L.layerGroup();
    this.spot = L.layerGroup().addTo(this.map);
  }

  /** Label islands: those that distinguish ways by number or name, all others in names of classes smaller, by number. */
  drawIslandLabels() {
    this.classLabels = L.layerGroup();
    for (const { label, names, below, place } of this.data.islands) {
      this.label(place, label, names ? "island-label" : "island-label minor", below ? "bottom" : "center").addTo(names ? this.map : this.classLabels);
    }
  }

  /** Show a place [y, x], m, that the page's text mentions, with a label. */
  reveal(place, text) {
    this.spot.clearLayers();
    this.dot(place, { radius: 11, weight: 3, fill: false, spot: true }).addTo(this.spot);
    this.label(place, text, "closest-label", this.labelSide(place)).addTo(this.spot);
    const half = (SPOT_SHARE * Math.min(...this.data.size)) / 2;
    this.map.fitBounds(L.latLngBounds([place[0] - half, place[1] - half], [place[0] + half, place[1] + half]), { animate: false });
    this.recolour();
  }

  drawStartAndGoal() {
    this.endMarkers = [[this.data.start, "Start"], ...this.data.via, [this.data.goal, "Goal"]].map(([place, name]) => {
      const marker = this.dot(place, { radius: 6, weight: 3, fillOpacity: 1 }).addTo(this.map);
      this.label(place, name, "end-label", this.labelSide(place)).addTo(this.map);
      return marker;
    });
  }

  /** The side of a place, towards the map's middle, on which a label fits. */
  labelSide(place) {
    const bounds = L.latLngBounds(this.data.extent.flat());
    return place[1] > bounds.getCenter().lng ? "left" : "right";
  }

  dot(place, style) {
    const options = { renderer: this.renderers.marks, pane: "marks", interactive: false };
    return L.circleMarker(place, { ...options, ...style });
  }

  makeVessel() {
    // The shape only; colours come from the style sheet.
    const html = '<svg viewBox="-14 -14 28 28" aria-hidden="true"><path d="M0-11 7 10 0 6-7 10Z"/></svg>';
    const icon = L.divIcon({ className: "vessel", iconSize: [28, 28], html });
    const marker = L.marker(this.data.start, { icon, interactive: false, keyboard: false });
    marker.addTo(this.map);
    return marker;
  }

  /** Move the vessel to a place; `bearing` is in degrees clockwise from the map's upward direction. */
  moveVessel(place, bearing) {
    this.vessel.setLatLng(place);
    this.vessel.getElement().firstChild.style.transform = `rotate(${bearing}deg)`;
  }

  /** Draw a choice: `{season, selected, shown(s, r), layers}`. */
  show(choice) {
    const season = this.data.seasons[choice.season];
    const route = season.routes[choice.selected];
    this.choice = choice;
    this.toggle(this.currents, choice.layers.currents && season.current !== null);
    this.currents.setCurrent(season.current);
    this.toggle(this.particles, choice.layers.particles && season.current !== null);
    this.particles.setCurrent(season.current);
    this.toggle(this.classLabels, choice.layers.islands);
    this.toggle(this.zones, choice.layers.zones);
    this.zones.bringToBack();
    this.showRoutes(choice);
    this.nearBest.setLatLngs(season.nearBest);
    this.soft.setLatLngs(route ? route.soft : []);
    this.toggle(this.soft, choice.layers.soft && Boolean(route));
    this.havens.clearLayers();
    this.toggle(this.havens, Boolean(choice.layers.havens));
    if (season.havens && choice.selected === 0) this.showHavens(season.havens);
    this.toggle(this.turns, choice.layers.turns);
    this.turns.clearLayers();
    this.shores.clearLayers();
    this.marked.clearLayers();
    this.closest.clearLayers();
    if (route) this.showSafety(route);
    this.vessel.setOpacity(route ? 1 : 0);
    this.recolour();
  }

  toggle(layer, on) {
    if (on) layer.addTo(this.map);
    else layer.remove();
  }

  /** The selected route bold on a halo, the season's others thin, other seasons' best ones dashed. */
  showRoutes({ season, selected, shown, layers }) {
    this.routes.forEach((lines, s) => {
      for (let r = lines.length - 1; r >= 0; r -= 1) {
        const mine = s === season;
        const on = mine ? shown(s, r) || r === selected : layers.others && r === 0;
        this.toggle(lines[r], on);
        lines[r].setStyle(mine ? ROUTE_UNSELECTED : ROUTE_OTHER_SEASON);
        // Better routes lie over worse ones, in whatever order they are switched on.
        if (on) lines[r].bringToFront();
      }
    });
    const route = this.data.seasons[season].routes[selected];
    this.toggle(this.halo, Boolean(route));
    if (!route) return;
    this.halo.setLatLngs(route.places).bringToFront();
    this.routes[season][selected].setStyle(ROUTE_SELECTED).bringToFront();
  }

  /** Stretches without room to turn and near land without thrust, hard-over turns, land of another shoreline, and the closest point to land. */
  showSafety(route) {
    for (const { role, places } of route.marked) this.line(places, "routes", { weight: 3, opacity: 1, role }).addTo(this.marked);
    for (const place of route.shores) this.dot(place, { radius: 7, weight: 2, fill: false, shore: true }).addTo(this.shores);
    for (const place of route.turns) this.dot(place, { radius: 1.8, weight: 1, fillOpacity: 1, hit: false }).addTo(this.turns);
    for (const place of route.hits) this.dot(place, { radius: 5, weight: 2, fillOpacity: 1, hit: true }).addTo(this.turns);
    if (route.clearance === null) return;
    const least = Math.min(...route.clearance);
    const place = route.places[route.clearance.indexOf(least)];
    this.dot(place, { radius: 7, weight: 2, fill: false, ring: true }).addTo(this.closest);
    // Below the labels of start and goal.
    const ends = [this.data.start, ...this.data.via.map(([via]) => via), this.data.goal];
    const room = NEAR_SHARE * Math.min(...this.data.size);
    const isNear = ends.some((end) => Math.hypot(end[0] - place[0], end[1] - place[1]) < room);
    this.label(place, `${formatClearance(least)} to ${this.data.noGoName}`, "closest-label", isNear ? "bottom" : this.labelSide(place)).addTo(this.closest);
    this.toggle(this.closest, true);
  }

  /** Havens, the ways to them, and along the best route what is covered. */
  showHavens({ places, ways, stretches }) {
    for (const way of ways) this.line(way, "routes", { weight: 1.5, opacity: 0.9, dashArray: "5 4", role: "haven" }).addTo(this.havens);
    for (const { state, places: along } of stretches) this.line(along, "routes", { weight: 3, opacity: 1, role: STATE_ROLES[state] }).addTo(this.havens);
    for (const { name, place } of places) {
      this.dot(place, { radius: 6, weight: 2, fillOpacity: 1, role: "haven" }).addTo(this.havens);
      this.label(place, name, "end-label", this.labelSide(place)).addTo(this.havens);
    }
  }

  /** Follow the page's change between light and dark. */
  changeScheme() {
    this.readColours();
    this.recolour();
    this.currents.redraw();
  }

  /** Set the colour of everything that is drawn. */
  recolour() {
    const colour = (role) => this.colour(role);
    this.water.setStyle({ fillColor: colour("water") });
    for (const line of this.grid) line.setStyle({ color: colour("grid") });
    this.shoals.setStyle({ fillColor: colour("shoal") });
    this.hazards.setStyle({ color: colour("hazard"), fillColor: colour("hazard") });
    this.noGo.setStyle({ fillColor: colour("nogo") });
    this.sheet.setStyle({ fillColor: colour("water") });
    for (const land of [this.beyond, this.land]) land.setStyle({ fillColor: colour("land"), color: colour("coast") });
    this.edge.setStyle({ color: colour("frame") });
    this.nearBest.setStyle({ fillColor: this.seasonColour(this.choice.season), fillOpacity: 0.1 });
    this.soft.setStyle({ fillColor: colour("soft"), fillOpacity: 0.38 });
    this.zones.eachLayer((zone) => zone.setStyle({ color: colour(zone.options.kind), fillColor: colour(zone.options.kind) }));
    this.routes.forEach((lines, s) => lines.forEach((line) => line.setStyle({ color: this.seasonColour(s) })));
    this.halo.setStyle({ color: colour("halo") });
    const accent = this.seasonColour(this.choice.season);
    for (const marker of this.endMarkers) marker.setStyle({ color: accent, fillColor: colour("halo") });
    this.turns.eachLayer((dot) => {
      const { hit } = dot.options;
      dot.setStyle({ fillColor: colour(hit ? "hit" : "halo"), color: colour(hit ? "halo" : "ink") });
    });
    this.havens.eachLayer((layer) => {
      if (layer.options.role) layer.setStyle({ color: colour(layer.options.role), fillColor: colour("halo") });
    });
    this.marked.eachLayer((line) => line.setStyle({ color: colour(line.options.role) }));
    this.shores.eachLayer((dot) => dot.setStyle({ color: colour("shut") }));
    this.spot.eachLayer((layer) => {
      if (layer.options.spot) layer.setStyle({ color: colour("hit") });
    });
    this.closest.eachLayer((layer) => {
      if (layer.options.ring) layer.setStyle({ color: colour("ink") });
    });
    this.vessel.getElement().style.setProperty("--vessel", accent);
  }
}
