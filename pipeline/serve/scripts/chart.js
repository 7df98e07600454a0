// The map: land, the points of the way, shut areas, and the ways that are found.

import { button, make } from "./elements.js";
import { landLayer } from "./land.js";

const WORLD = [[-60, -170], [72, 170]];
// A second click within this time, milliseconds, makes a double-click, which zooms and sets nothing.
const TWICE_MS = 250;
// Distance in pixels from which a pressed line is pulled.
const PULL_PX = 5;

/** A position with as many decimals of a degree as a pixel of the map has. */
export function positionText(lat, lon, zoom) {
  const decimals = Math.min(5, Math.max(2, Math.ceil(Math.log10(2 ** zoom))));
  const part = (value, names) => `${Math.abs(value).toFixed(decimals)}${names[value < 0 ? 1 : 0]}`;
  return `${part(lat, "NS")} ${part(near(lon, 0), "EW")}`;
}

/** A longitude turned to less than half the world from another one: nothing is cut at 180 degrees. */
const near = (lon, other) => lon + 360 * Math.round((other - lon) / 360);

export class Chart {
  /** `heard` has: click(text), key(letter, text), moved(name, text), inserted(index, text), removed(name), corner(count). */
  constructor(element, heard) {
    this.heard = heard;
    this.pins = new Map();
    this.map = L.map(element, { attributionControl: false, fadeAnimation: false, zoomSnap: 0.5, minZoom: 1, maxZoom: 15, zoomAnimation: !matchMedia("(prefers-reduced-motion: reduce)").matches });
    landLayer().addTo(this.map);
    for (const name of ["shut", "drawn", "drafts", "other"]) this[name] = L.layerGroup().addTo(this.map);
    this.map.fitBounds(WORLD);
    this.map.on("click", ({ latlng }) => this.click(latlng));
    this.map.on("dblclick", () => clearTimeout(this.clicked));
    this.moving = false;
    this.map.on("movestart", () => { this.moving = true; });
    this.map.on("moveend", () => { this.moving = false; });
    element.addEventListener("keydown", (event) => {
      if (event.target !== element || event.ctrlKey || event.metaKey || event.altKey) return;
      const letter = event.key.toLowerCase();
      if ("sgv".includes(letter)) this.whenStill(() => heard.key(letter, this.text(this.map.getCenter())));
      if (letter === "a" && this.corners) this.whenStill(() => this.click(this.map.getCenter()));
    });
  }

  /** Act now, or where the map comes to rest: an arrow key moves it over some frames. */
  whenStill(act) {
    if (this.moving) this.map.once("moveend", act);
    else act();
  }

  text({ lat, lng }) {
    return positionText(lat, lng, this.map.getZoom());
  }

  click(latlng) {
    if (!this.corners) {
      clearTimeout(this.clicked);
      this.clicked = setTimeout(() => this.heard.click(this.text(latlng)), TWICE_MS);
      return;
    }
    this.corners.push(latlng);
    this.drawn.clearLayers();
    L.polygon(this.corners, { className: "shut", interactive: false }).addTo(this.drawn);
    for (const corner of this.corners) L.marker(corner, { icon: icon("corner", ""), interactive: false, keyboard: false }).addTo(this.drawn);
    this.heard.corner(this.corners.length);
  }

  /** Begin to draw an area by clicks, or end it: then its ring of [lon, lat] is returned. */
  draw(on) {
    const first = this.corners?.[0]?.lng || 0;
    const ring = (this.corners || []).map(({ lat, lng }) => [lng + near(first, 0) - first, lat].map((degrees) => Number(degrees.toFixed(5))));
    this.corners = on ? [] : null;
    this.drawn.clearLayers();
    this.map.getContainer().classList.toggle("aiming", on);
    this.map.doubleClickZoom[on ? "disable" : "enable"]();
    return ring;
  }

  /** The longitude near which everything is drawn: that of the first pin, or of the map's middle. */
  middle() {
    const [first] = this.pins.values();
    return (first ? first.getLatLng() : this.map.getCenter()).lng;
  }

  /** Draw lines or rings of [lon, lat] in a layer. */
  show(layer, lines, className, draw = L.polyline) {
    layer.clearLayers();
    for (const line of lines) {
      const turn = near(line[0][0], this.middle()) - line[0][0];
      draw(line.map(([lon, lat]) => [lat, lon + turn]), { className, interactive: false }).addTo(layer);
    }
  }

  showAreas(rings) {
    this.show(this.shut, rings, "shut", L.polygon);
  }

  /** Put the pins where [name, letter, lat, lon] say; those that are not named go. */
  showPins(places) {
    let beside = this.middle();
    const names = new Set(places.map(([name]) => name));
    for (const [name, pin] of this.pins) {
      if (!names.has(name)) pin.remove();
    }
    const pins = new Map();
    for (const [name, letter, lat, lon] of places) {
      beside = near(lon, beside);
      const pin = this.pins.get(name) || this.pin(name, letter);
      pins.set(name, pin.setLatLng([lat, beside]).addTo(this.map));
      pin.getElement().setAttribute("aria-label", pin.options.alt);
    }
    this.pins = pins;
  }

  /** A pin: dragged it moves, pressed it offers to go; the Delete key does the same. */
  pin(name, letter) {
    const pin = L.marker([0, 0], { icon: icon("", letter), draggable: true, alt: `${name}: drag it, press it to remove it, or change its field` });
    const remove = () => this.heard.removed(name);
    pin.bindPopup(() => make("div", {}, button(`Remove ${name.toLowerCase()}`, remove)), { closeButton: false });
    pin.on("dragend", () => this.heard.moved(name, this.text(pin.getLatLng())));
    pin.on("keydown", ({ originalEvent }) => { if (["Delete", "Backspace"].includes(originalEvent.key)) remove(); });
    return pin;
  }

  /** Pull a point out of a line of places that was pressed; where it is let go, it is inserted. */
  pull(places, { containerPoint, latlng }) {
    const container = this.map.getContainer();
    let pin = null;
    this.map.dragging.disable();
    const move = (event) => {
      if (!pin && this.map.mouseEventToContainerPoint(event).distanceTo(containerPoint) > PULL_PX) pin = L.marker(latlng, { icon: icon("", "+"), interactive: false, keyboard: false }).addTo(this.map);
      pin?.setLatLng(this.map.mouseEventToLatLng(event));
    };
    const end = () => {
      document.removeEventListener("pointermove", move);
      this.map.dragging.enable();
      if (!pin) return;
      pin.remove();
      // The click that ends the pull chooses nothing.
      const hush = (event) => event.stopPropagation();
      container.addEventListener("click", hush, { capture: true, once: true });
      setTimeout(() => container.removeEventListener("click", hush, true));
      const along = (at) => places.reduce((best, place, i) => (this.map.distance(place, at) < best[0] ? [this.map.distance(place, at), i] : best), [Infinity, 0])[1];
      const vias = [...this.pins].filter(([name]) => name.startsWith("Point"));
      this.heard.inserted(vias.filter(([, via]) => along(via.getLatLng()) < along(latlng)).length, this.text(pin.getLatLng()));
    };
    document.addEventListener("pointermove", move);
    document.addEventListener("pointerup", end, { once: true });
  }

  /** Turn pins and view to the longitudes of a place: what is seen stays. */
  turnTo(lng) {
    const turn = near(this.middle(), lng) - this.middle();
    if (!turn) return;
    for (const pin of this.pins.values()) pin.setLatLng([pin.getLatLng().lat, pin.getLatLng().lng + turn]);
    const { lat, lng: here } = this.map.getCenter();
    this.map.setView([lat, here + turn], this.map.getZoom(), { animate: false });
  }

  /** Show all of some points or bounds, unless they are on the map already. */
  reveal(points) {
    const bounds = L.latLngBounds(points);
    if (!bounds.isValid()) return;
    if (!this.map.getBounds().contains(bounds) || this.map.getBoundsZoom(bounds) > this.map.getZoom() + 2) {
      this.map.fitBounds(bounds.pad(0.15), { maxZoom: 13 });
    }
  }
}

function icon(kind, letter) {
  const size = kind === "corner" ? 12 : 26;
  return L.divIcon({ className: `pin ${kind}`, html: make("span", {}, letter), iconSize: [size, size] });
}
