// What is under the pointer: position, current, and the distances to land and to the soft no-go zone.

// The WGS 84 ellipsoid: equatorial radius, metres, and squared eccentricity.
const RADIUS_M = 6378137;
const ECCENTRICITY = 0.00669437999014;
const DEGREE = Math.PI / 180;

/** Longitude and latitude of a place [y, x], m, between the corners of a grid over the chart. */
function lonLatAt({ cells, size, lon, lat }, [y, x]) {
  const [column, row] = [x / size[0], y / size[1]].map((share) => Math.min(cells - 1e-9, Math.max(0, share * cells)));
  const [c, r] = [Math.floor(column), Math.floor(row)];
  const [right, up] = [column - c, row - r];
  const at = r * (cells + 1) + c;
  return [lon, lat].map(
    (values) =>
      (1 - up) * ((1 - right) * values[at] + right * values[at + 1]) +
      up * ((1 - right) * values[at + cells + 1] + right * values[at + cells + 2]),
  );
}

/** North and east, metres, from one position [lon, lat] to another that is near. */
function northEast([lon, lat], [otherLon, otherLat]) {
  const middle = ((lat + otherLat) / 2) * DEGREE;
  const flat = 1 - ECCENTRICITY * Math.sin(middle) ** 2;
  const meridian = (RADIUS_M * (1 - ECCENTRICITY)) / flat ** 1.5;
  const parallel = (RADIUS_M * Math.cos(middle)) / Math.sqrt(flat);
  return [meridian * (otherLat - lat) * DEGREE, parallel * (otherLon - lon) * DEGREE];
}

/** Rings of places with the box around each, for quick looks. */
function boxedRings(rings) {
  return rings.map((ring) => {
    const box = L.latLngBounds(ring);
    return { ring, west: box.getWest(), south: box.getSouth(), east: box.getEast(), north: box.getNorth() };
  });
}

/** Whether a place [y, x] is inside rings, and the nearest place on them; null without any. `wide` is a step of x beside one of y. */
function nearestOn(boxes, [y, x], wide) {
  let [least, nearest, turns] = [Infinity, null, 0];
  for (const { ring, west, south, east, north } of boxes) {
    const aside = wide * Math.max(west - x, x - east, 0);
    const above = Math.max(south - y, y - north, 0);
    if (aside * aside + above * above > least) continue;
    let from = ring[ring.length - 1];
    for (const to of ring) {
      const [dx, dy] = [to.lng - from.lng, to.lat - from.lat];
      const along = Math.min(1, Math.max(0, (wide * wide * (x - from.lng) * dx + (y - from.lat) * dy) / (wide * wide * dx * dx + dy * dy || 1)));
      const [px, py] = [from.lng + along * dx, from.lat + along * dy];
      const apart = (wide * (px - x)) ** 2 + (py - y) ** 2;
      if (apart < least) [least, nearest] = [apart, [py, px]];
      const left = dx * (y - from.lat) - (x - from.lng) * dy;
      if (from.lat <= y && to.lat > y && left > 0) turns += 1;
      if (from.lat > y && to.lat <= y && left < 0) turns -= 1;
      from = to;
    }
  }
  return nearest && { place: nearest, inside: turns !== 0 };
}

class Probe {
  /** The readout is an element with a field for each figure. */
  constructor(map, readout) {
    this.map = map;
    this.readout = readout;
    this.fields = new Map([...readout.querySelectorAll("[data-probe]")].map((field) => [field.dataset.probe, field]));
    this.place = null;
    map.on("mousemove click", ({ latlng }) => this.look(latlng));
    map.getContainer().addEventListener("mouseleave", () => this.leave());
    map.on("focus blur moveend", () => this.leave());
  }

  load(data) {
    this.data = data;
    this.boxes = { land: null, noGo: null, soft: null };
  }

  /** Follow another season's current, and another route's soft no-go zone. */
  follow(current, route) {
    this.current = current;
    this.boxes.soft = boxedRings(route ? route.soft : []);
    if (this.place) this.show();
  }

  /** Show what is at a place, in the next frame. */
  look({ lat, lng }) {
    if (!this.data) return;
    this.place = [lat, lng];
    cancelAnimationFrame(this.pending);
    this.pending = requestAnimationFrame(() => { if (this.place) this.show(); });
  }

  /** The pointer has left: show the map's middle while it has the keyboard's focus, else nothing. */
  leave() {
    const hasFocus = document.activeElement === this.map.getContainer() && this.map.getContainer().matches(":focus-visible");
    if (hasFocus) this.look(this.map.getCenter());
    else {
      this.place = null;
      this.readout.hidden = true;
    }
  }

  show() {
    this.boxes.land ??= boxedRings(this.data.land);
    this.boxes.noGo ??= boxedRings(this.data.noGo);
    const texts = this.texts(this.place);
    this.readout.hidden = texts === null;
    for (const [name, text] of Object.entries(texts || {})) this.fields.get(name).textContent = text;
  }

  /** The figures as text; null outside the chart. */
  texts(place) {
    if (!this.data.bounds.contains(place)) return null;
    const wide = this.data.globe ? Math.cos(place[0] * DEGREE) : 1;
    const [land, noGo, soft] = ["land", "noGo", "soft"].map((name) => nearestOn(this.boxes[name], place, wide));
    const dry = land !== null && land.inside;
    return {
      place: this.position(place),
      current: dry ? ABSENT : this.currentText(place),
      land: dry ? (this.data.noGoName === "land" ? "on land" : "inside") : this.distance(land, place) + (noGo && noGo.inside ? ", in the hard no-go zone" : ""),
      soft: soft && soft.inside ? "inside" : dry ? ABSENT : this.distance(soft, place),
    };
  }

  position(place) {
    if (this.data.planar) return `x ${formatNumber(place[1] + this.data.origin[0])} m, y ${formatNumber(place[0] + this.data.origin[1])} m`;
    return formatLonLat(...this.lonLat(place));
  }

  lonLat(place) {
    return this.data.globe ? [place[1], place[0]] : lonLatAt(this.data.positions, place);
  }

  /** True metres from a place to the nearest one found. */
  distance(found, place) {
    if (found === null) return ABSENT;
    if (this.data.planar) return formatClearance(Math.hypot(found.place[0] - place[0], found.place[1] - place[1]));
    return formatClearance(Math.hypot(...northEast(this.lonLat(place), this.lonLat(found.place))));
  }

  /** The current's speed, and the true direction that it sets to. */
  currentText([y, x]) {
    if (!this.current) return ABSENT;
    const at = this.map.project([y, x], 0).subtract(this.map.project(this.current.corner, 0)).divideBy(this.current.spacing);
    const velocity = interpolatedCurrent(this.current, -at.y, at.x);
    if (!velocity) return "none known";
    const speed = Math.hypot(...velocity);
    return `${formatSpeed(speed)} to ${formatCourse(this.bearing([y, x], velocity))}`;
  }

  /** True bearing, degrees, of a velocity along the map's axes. */
  bearing([y, x], [u, v]) {
    if (this.data.planar || this.data.globe) return (Math.atan2(u, v) / DEGREE + 360) % 360;
    const ahead = Math.min(...this.data.size) / (1000 * Math.hypot(u, v));
    const [north, east] = northEast(this.lonLat([y - v * ahead, x - u * ahead]), this.lonLat([y + v * ahead, x + u * ahead]));
    return (Math.atan2(east, north) / DEGREE + 360) % 360;
  }
}
