// The interactive map: its layers and their colours. It does not depend on the controls.

// Panes from the bottom up: water and grid, currents as arrows and as particles, soft and hard no-go zones, land, routes,
// marks on them. Vessel and labels are in Leaflet's own panes above.
const PANES = { water: 210, currents: 220, particles: 225, soft: 230, nogo: 235, land: 240, routes: 400, marks: 410 };
const BARE_PANES = ["currents", "particles"];
// Side of the part of the map that is shown around a place, as a share of the chart's shorter side.
const SPOT_SHARE = 0.12;
// Distance within which the labels of two places would overlap, as a share of that side.
const NEAR_SHARE = 0.05;
// Share of a line at each end where no price is written.
const END_SHARE = 0.15;
// Maximum length of the scale bar, in CSS pixels.
const SCALE_BAR = 100;
// Space for the parallels' labels, in CSS pixels: per letter, and beside the label.
const LETTER_WIDTH = 6.5;
const LABEL_GAP = 16;

// Lines are opaque: thinner ones are less, not paler, so that each stands out from land and sea.
const ROUTE_SELECTED = { weight: 4, dashArray: null };
const ROUTE_HOVERED = { weight: 3.4, dashArray: null };
const ROUTE_SIDE = { weight: 2.2, dashArray: null };
const ROUTE_UNSELECTED = { weight: 1.3, dashArray: null };
const ROUTE_OTHER_SEASON = { weight: 2.2, dashArray: "6 6" };
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

/** The place of a route that is closest to land; null if there is none. */
const closestPlace = ({ clearance, places }) => clearance && places[clearance.indexOf(Math.min(...clearance))];

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
  /** `heard` has what is called with the season and index of a route: select, hover (without any: no more) and press. */
  constructor(map, heard) {
    this.map = map;
    this.heard = heard;
    this.drawn = [];
    // Leaflet rounds places to whole pixels, which makes stairs of lines with many places.
    map.latLngToLayerPoint = (place) => map.project(place).subtract(map.getPixelOrigin());
    this.renderers = {};
    for (const [name, height] of Object.entries(PANES)) {
      this.map.createPane(name).style.zIndex = height;
      if (!BARE_PANES.includes(name)) this.renderers[name] = L.canvas({ pane: name, padding: 0.2, tolerance: 6 });
    }
    this.map.on("zoomend", () => this.thinMeridians());
    this.showScale();
  }

  /** Draw what all seasons share, in place of what was drawn. */
  load(data) {
    this.clear();
    this.data = data;
    this.colours = new Map();
    this.drawWater();
    this.makeZones();
    const [arrows, particles] = [CurrentArrows, CurrentParticles].map((Kind) => new Kind(data.extent, data.speedLimits, (role) => this.colour(role)));
    this.currents = this.add(arrows);
    this.particles = this.add(particles);
    this.makeRoutes();
    this.drawIslandLabels();
    this.drawStartAndGoal();
    this.vessel = this.makeVessel();
  }

  /** Draw nothing more. */
  clear() {
    for (const layer of this.drawn) layer.remove();
    this.drawn = [];
    this.data = null;
  }

  add(layer) {
    this.drawn.push(layer);
    return layer.addTo(this.map);
  }

  /** Show the scale bar in the reader's units. */
  showScale() {
    if (this.scale) this.scale.remove();
    this.scale = new (units.nautical ? NauticalScale : L.Control.Scale)({ imperial: false, position: "bottomright", maxWidth: SCALE_BAR });
    this.scale.addTo(this.map);
  }

  /** A colour of the page, light or dark, by its role; each is read once, for that is slow. */
  colour(role) {
    if (!this.colours.has(role)) this.colours.set(role, getComputedStyle(document.documentElement).getPropertyValue(`--map-${role}`).trim());
    return this.colours.get(role);
  }

  /** The role of a route's colour: its season's among several seasons, else its side's. */
  role(season, index) {
    const route = this.data.seasons[season].routes[index];
    return `season${(this.data.seasons.length > 1 || !route ? season : route.side) % SEASON_COLOURS}`;
  }

  /** An area in the colour of a role; with one for its edge, it has one. */
  area(rings, pane, fill, style = {}, edge = null) {
    const options = { renderer: this.renderers[pane], pane, interactive: false, stroke: edge !== null, weight: 0.7 };
    return L.polygon(rings, { ...options, color: this.colour(edge), fillColor: this.colour(fill), fillRule: "nonzero", fillOpacity: 1, smoothFactor: 0.6, ...style });
  }

  line(places, pane, role, style = {}) {
    const options = { renderer: this.renderers[pane], pane, interactive: false, smoothFactor: 0.6 };
    return L.polyline(places, { ...options, color: this.colour(role), ...style });
  }

  /** Water, grid, land and shoals, the same in all seasons. */
  drawWater() {
    const { extent, sheet, beyond, grid, land, noGo, shoals, hazards } = this.data;
    // Sea and land are drawn beyond the chart: a reader would take a blank for open water.
    this.add(this.area(sheet, "water", "water"));
    this.add(this.area(beyond, "water", "land", {}, "coast"));
    this.add(this.area(extent, "water", "water"));
    for (const { parts } of grid) this.add(this.line(parts, "water", "grid", { weight: 1 }));
    this.add(this.area(noGo, "nogo", "nogo"));
    this.add(this.area(land, "land", "land", {}, "coast"));
    // Shoals are no-go, so they lie inside the areas drawn as land.
    this.add(this.area(shoals, "land", "shoal"));
    this.add(this.area(extent, "land", null, { fill: false, weight: 1 }, "frame"));
    // The smallest are seen by their edges.
    this.add(this.area(hazards, "land", "hazard", { weight: 1.5 }, "hazard"));
    this.meridians = [];
    for (const line of grid) {
      const direction = line.meridian ? "bottom" : "left";
      const label = this.add(this.label(line.foot, line.label, "grid-label", direction));
      if (line.meridian) this.meridians.push(label);
    }
    this.thinMeridians();
  }

  /** Show the labels of as many meridians as have room beside each other: of all, every second and so on. */
  thinMeridians() {
    if (!this.data) return;
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
    this.drawn.push(this.zones);
    for (const { kind, text, area, edges } of this.data.zones) {
      this.area(area, "soft", kind, { fillOpacity: 0.06 }).addTo(this.zones);
      const edge = this.line(edges, "routes", kind, { interactive: true, weight: 1.5, dashArray: "6 4" });
      edge.bindTooltip(element("span", "", text), { sticky: true, className: "route-label" }).addTo(this.zones);
    }
  }

  /** A permanent label beside a place. */
  label(place, text, className, direction, colour = "") {
    const options = { permanent: true, direction, className, opacity: 1, interactive: false };
    return L.tooltip(options).setLatLng(place).setContent(element("span", colour, text));
  }

  /** Lines for all routes of all seasons; `show` decides which are drawn. */
  makeRoutes() {
    this.casing = this.line([], "routes", "halo", { weight: 5 });
    this.halo = this.line([], "routes", "halo", { opacity: 0.95, weight: 8 });
    this.drawn.push(this.casing, this.halo);
    this.routes = this.data.seasons.map((season, s) =>
      season.routes.map((route, r) => {
        const line = this.line(route.places, "routes", this.role(s, r), { interactive: true, smoothFactor: 0.4 });
        const name = `${season.title}, ${route.rank}${route.way && `: ${route.way}`}`;
        line.bindTooltip(element("span", "", name), { sticky: true, className: "route-label" });
        line.on("mouseover", () => this.heard.hover([s, r])).on("mouseout", () => this.heard.hover(null));
        line.on("mousedown", (event) => this.heard.press?.(s, r, event));
        // A click on a line is none on the map.
        line.on("click", (event) => { L.DomEvent.stopPropagation(event); this.heard.select(s, r); });
        this.drawn.push(line);
        return line;
      }),
    );
    this.hovered = null;
    this.nearBest = this.area([], "soft", null, { fillOpacity: 0.1 }).addTo(this.map);
    this.soft = this.area([], "soft", "soft", { fillOpacity: 0.38 });
    this.turnRoom = this.area([], "soft", "turning", { fillOpacity: 0.45 });
    for (const name of ["havens", "turns", "shores", "marked", "closest", "spot", "prices"]) this[name] = this.add(L.layerGroup());
    this.drawn.push(this.nearBest, this.soft, this.turnRoom);
  }

  /** Label islands: those that distinguish ways by number or name, all others in names of classes smaller, by number. */
  drawIslandLabels() {
    this.classLabels = L.layerGroup();
    this.drawn.push(this.classLabels);
    for (const { label, names, below, place } of this.data.islands) {
      const made = this.label(place, label, names ? "island-label" : "island-label minor", below ? "bottom" : "center");
      if (names) this.add(made);
      else made.addTo(this.classLabels);
    }
  }

  /** Show a place [y, x], m, that the page's text mentions, with a label. */
  reveal(place, text) {
    this.spot.clearLayers();
    this.dot(place, "hit", null, { radius: 11, weight: 3 }).addTo(this.spot);
    this.label(place, text, "closest-label", this.labelSide(place)).addTo(this.spot);
    const half = (SPOT_SHARE * Math.min(...this.data.size)) / 2;
    this.map.fitBounds(L.latLngBounds([place[0] - half, place[1] - half], [place[0] + half, place[1] + half]), { animate: false });
  }

  drawStartAndGoal() {
    this.endMarkers = [[this.data.start, "Start"], ...this.data.via.map((place, i) => [place, `Via ${i + 1}`]), [this.data.goal, "Goal"]].map(([place, name]) => {
      this.add(this.label(place, name, "end-label", this.labelSide(place)));
      return this.add(this.dot(place, "ink", "halo", { radius: 6, weight: 3 }));
    });
  }

  /** The side of a place, towards the map's middle, on which a label fits. */
  labelSide(place) {
    return place[1] > this.data.bounds.getCenter().lng ? "left" : "right";
  }

  /** A dot, or without a fill a ring. */
  dot(place, role, fill, style) {
    const options = { renderer: this.renderers.marks, pane: "marks", interactive: false, fill: fill !== null, fillOpacity: 1 };
    return L.circleMarker(place, { ...options, color: this.colour(role), fillColor: this.colour(fill), ...style });
  }

  makeVessel() {
    // The shape only; colours come from the style sheet.
    const html = '<svg viewBox="-14 -14 28 28" aria-hidden="true"><path d="M0-11 7 10 0 6-7 10Z"/></svg>';
    const icon = L.divIcon({ className: "vessel", iconSize: [28, 28], html });
    const marker = L.marker(this.data.start, { icon, interactive: false, keyboard: false });
    return this.add(marker);
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
    this.nearBest.setLatLngs(season.nearBest).setStyle({ fillColor: this.colour(this.role(choice.season, 0)) });
    for (const name of ["soft", "turnRoom"]) {
      this[name].setLatLngs(route ? route[name] : []);
      this.toggle(this[name], choice.layers.soft && Boolean(route));
    }
    this.havens.clearLayers();
    this.toggle(this.havens, Boolean(choice.layers.havens));
    if (season.havens && choice.selected === 0) this.showHavens(season.havens);
    this.toggle(this.turns, choice.layers.turns);
    for (const layer of [this.turns, this.shores, this.marked, this.closest]) layer.clearLayers();
    if (route) this.showSafety(route);
    const accent = this.colour(this.role(choice.season, choice.selected));
    for (const marker of this.endMarkers) marker.setStyle({ color: accent });
    this.vessel.setOpacity(route ? 1 : 0).getElement().style.setProperty("--vessel", accent);
  }

  toggle(layer, on) {
    layer[on ? "addTo" : "remove"](this.map);
  }

  /** The selected route bold on a halo, the season's others thin, other seasons' best ones dashed; prices at the best of each side. */
  showRoutes({ season, selected, shown, layers }) {
    const { routes } = this.data.seasons[season];
    const isSeveral = routes.some((one) => one.side > 0);
    const cased = [];
    this.prices.clearLayers();
    this.routes.forEach((lines, s) => {
      for (let r = lines.length - 1; r >= 0; r -= 1) {
        const mine = s === season;
        const on = mine ? shown(s, r) || r === selected : layers.others && r === 0;
        this.toggle(lines[r], on);
        lines[r].setStyle(!mine ? ROUTE_OTHER_SEASON : String(this.hovered) === `${s},${r}` ? ROUTE_HOVERED : routes[r].isSide ? ROUTE_SIDE : ROUTE_UNSELECTED);
        // Better routes lie over worse ones, in whatever order they are switched on.
        if (on) lines[r].bringToFront();
        if (on && mine) cased.push(lines[r].getLatLngs());
        if (on && mine && isSeveral && routes[r].isSide) this.showPrice(s, r);
      }
    });
    this.casing.setLatLngs(cased).addTo(this.map).bringToBack();
    const route = routes[selected];
    this.toggle(this.halo, Boolean(route));
    if (!route) return;
    this.halo.setLatLngs(route.places).bringToFront();
    this.routes[season][selected].setStyle(ROUTE_SELECTED).bringToFront();
    // Under the pointer routes are drawn again, and what marks them stays above.
    this.marked.eachLayer((line) => line.bringToFront());
  }

  /** Write how much more fuel a route needs than the best, where it is far from the routes of other sides and from what is written. */
  showPrice(season, index) {
    const { routes } = this.data.seasons[season];
    const { places: all, excess, price } = routes[index];
    // Not at the ends, which have labels of their own.
    const places = all.slice(Math.floor(END_SHARE * all.length), Math.ceil((1 - END_SHARE) * all.length));
    const others = routes.filter((one, r) => one.isSide && r !== index).flatMap((one) => one.places);
    const written = this.prices.getLayers().map((label) => label.getLatLng());
    const closest = closestPlace(routes[this.choice.selected]);
    if (closest) written.push(L.latLng(closest));
    written.push(L.latLng(places[0]), L.latLng(places.at(-1)));
    const apart = places.map(([y, x]) => {
      const beside = written.map(({ lat, lng }) => Math.hypot(lat - y, lng - x) / 4);
      return Math.min(...others.map(([by, bx]) => Math.hypot(by - y, bx - x))) + Math.min(...this.data.size, ...beside);
    });
    const at = places[apart.indexOf(Math.max(...apart))];
    const text = price || (index ? `${excess < 0 ? "−" : "+"}${formatDecimals(100 * Math.abs(excess), 1)} %` : "best");
    this.label(at, text, "price-label", "center", this.role(season, index)).addTo(this.prices);
  }

  /** Stretches without room to turn and near land without thrust, hard-over turns, land of another shoreline, and the closest point to land. */
  showSafety(route) {
    for (const { role, places } of route.marked) this.line(places, "routes", role, { weight: 3, dashArray: role === "adrift" ? "3 5" : null }).addTo(this.marked);
    for (const place of route.shores) this.dot(place, "shut", null, { radius: 7, weight: 2 }).addTo(this.shores);
    for (const place of route.turns) this.dot(place, "ink", "halo", { radius: 1.8, weight: 1 }).addTo(this.turns);
    for (const place of route.hits) this.dot(place, "halo", "hit", { radius: 5, weight: 2 }).addTo(this.turns);
    const place = closestPlace(route);
    if (!place) return;
    this.dot(place, "ink", null, { radius: 7, weight: 2 }).addTo(this.closest);
    // Below the labels of start and goal.
    const ends = [this.data.start, ...this.data.via, this.data.goal];
    const room = NEAR_SHARE * Math.min(...this.data.size);
    const isNear = ends.some((end) => Math.hypot(end[0] - place[0], end[1] - place[1]) < room);
    this.label(place, `${formatClearance(route.least)} to ${this.data.noGoName}`, "closest-label", isNear ? "bottom" : this.labelSide(place)).addTo(this.closest);
    this.toggle(this.closest, true);
  }

  /** Havens, the ways to them, and along the best route what is covered. */
  showHavens({ havens, ways, stretches }) {
    for (const way of ways) this.line(way, "routes", "haven", { weight: 1.5, dashArray: "5 4" }).addTo(this.havens);
    for (const { state, places: along } of stretches) this.line(along, "routes", STATE_ROLES[state], { weight: 3 }).addTo(this.havens);
    for (const { name, place } of havens) {
      this.dot(place, "haven", "halo", { radius: 6, weight: 2 }).addTo(this.havens);
      this.label(place, name, "end-label", this.labelSide(place)).addTo(this.havens);
    }
  }
}
