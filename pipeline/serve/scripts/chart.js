// The map: land, the points of the way, shut areas, and routes.

import { landLayer } from "./land.js";

const WORLD = [[-60, -170], [72, 170]];

/** A position with as many decimals of a degree as a pixel of the map has. */
export function positionText(lat, lon, zoom) {
  const decimals = Math.min(5, Math.max(2, Math.ceil(Math.log10(2 ** zoom))));
  const turned = ((((lon + 180) % 360) + 360) % 360) - 180;
  const part = (value, names) => `${Math.abs(value).toFixed(decimals)}${names[value < 0 ? 1 : 0]}`;
  return `${part(lat, "NS")} ${part(turned, "EW")}`;
}

export class Chart {
  /** `heard` has: click(text), key(letter, text), moved(name, text), corner(lon, lat). */
  constructor(element, heard) {
    this.heard = heard;
    this.pins = new Map();
    this.map = L.map(element, { zoomControl: true, attributionControl: false, worldCopyJump: true, zoomSnap: 0.5, minZoom: 1, maxZoom: 15, zoomAnimation: !matchMedia("(prefers-reduced-motion: reduce)").matches });
    landLayer().addTo(this.map);
    L.control.scale({ imperial: false }).addTo(this.map);
    this.shut = L.layerGroup().addTo(this.map);
    this.drawn = L.layerGroup().addTo(this.map);
    this.routes = L.layerGroup().addTo(this.map);
    this.other = L.layerGroup().addTo(this.map);
    this.map.fitBounds(WORLD);
    this.map.on("click", (event) => this.click(event.latlng));
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

  text(latlng) {
    return positionText(latlng.lat, latlng.lng, this.map.getZoom());
  }

  click(latlng) {
    if (!this.corners) {
      this.heard.click(this.text(latlng));
      return;
    }
    this.corners.push(latlng.wrap());
    this.drawn.clearLayers();
    L.polygon(this.corners, { className: "shut", interactive: false }).addTo(this.drawn);
    for (const corner of this.corners) L.marker(corner, { icon: icon("corner", ""), interactive: false, keyboard: false }).addTo(this.drawn);
    this.heard.corner(this.corners.length);
  }

  /** Begin to draw an area by clicks, or end it: then its ring of [lon, lat] is returned. */
  draw(on) {
    const ring = (this.corners || []).map(({ lat, lng }) => [Number(lng.toFixed(5)), Number(lat.toFixed(5))]);
    this.corners = on ? [] : null;
    this.drawn.clearLayers();
    this.map.getContainer().classList.toggle("aiming", on);
    if (on) this.map.doubleClickZoom.disable();
    else this.map.doubleClickZoom.enable();
    return ring;
  }

  showAreas(rings) {
    this.shut.clearLayers();
    for (const ring of rings) L.polygon(ring.map(([lon, lat]) => [lat, lon]), { className: "shut", interactive: false }).addTo(this.shut);
  }

  /** Put the pins where [name, letter, lat, lon] say; those that are not named go. */
  showPins(places) {
    const names = new Set(places.map(([name]) => name));
    for (const [name, pin] of this.pins) {
      if (!names.has(name)) {
        pin.remove();
        this.pins.delete(name);
      }
    }
    for (const [name, letter, lat, lon] of places) {
      const known = this.pins.get(name);
      if (known) known.setLatLng([lat, lon]);
      else this.pins.set(name, this.pin(name, letter, [lat, lon]));
    }
  }

  pin(name, letter, at) {
    const pin = L.marker(at, { icon: icon("", letter), draggable: true, keyboard: true, alt: `${name}: drag it, or change its field` });
    pin.on("dragend", () => this.heard.moved(name, this.text(pin.getLatLng())));
    pin.addTo(this.map).getElement().setAttribute("aria-label", `${name}: drag it, or change its field`);
    return pin;
  }

  /** Draw lines: {line: [[lon, lat], ...], kind, season}. */
  showRoutes(lines, layer = this.routes) {
    layer.clearLayers();
    for (const { line, kind, season } of lines) {
      const drawn = L.polyline(line.map(([lon, lat]) => [lat, lon]), { className: `way-line ${kind}`, interactive: false, smoothFactor: 1 }).addTo(layer);
      drawn.getElement().classList.add(`season${season}`);
    }
  }

  /** Show all of some points [lat, lon], unless they are on the map already. */
  reveal(points) {
    if (!points.length) return;
    const bounds = L.latLngBounds(points);
    if (!this.map.getBounds().contains(bounds) || this.map.getBoundsZoom(bounds) > this.map.getZoom() + 2) {
      this.map.fitBounds(bounds.pad(0.15), { maxZoom: 11 });
    }
  }
}

function icon(kind, letter) {
  const size = kind === "corner" ? 12 : 26;
  const shown = document.createElement("span");
  shown.textContent = letter;
  return L.divIcon({ className: `pin ${kind}`, html: shown, iconSize: [size, size] });
}
