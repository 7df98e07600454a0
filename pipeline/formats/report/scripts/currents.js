// The current as arrows on a canvas of their own: as many as the zoom has room for.

// An arrow of length 1 along x, centred, as the static maps draw it.
const ARROW = [[-0.5, -0.045], [0.12, -0.045], [0.08, -0.17], [0.5, 0], [0.08, 0.17], [0.12, 0.045], [-0.5, 0.045]];
// Room for an arrow, in CSS pixels; the longest fills it, one of the weakest class this share.
const ARROW_ROOM = 26;
const ARROW_LONGEST = 44;
const ARROW_SHORTEST = 0.4;
// Closer in than this, arrows are drawn between those of the lattice, too.
const ARROW_FAR = 4 * ARROW_ROOM;
// How far beyond the view arrows are drawn, so that a drag uncovers no bare water at once.
const ARROW_MARGIN = 0.2;

/** Class of a speed (m/s): the number of limits below it, at most the last class. */
function speedClass(speed, limits) {
  const index = limits.findIndex((limit) => speed <= limit);
  return index < 0 ? limits.length - 1 : index;
}

const CurrentArrows = L.Layer.extend({
  /** `chart` is the outline that arrows stand in: rings of places. */
  initialize(chart, limits, colours) {
    this._chart = chart;
    this._limits = limits;
    this._colours = colours;
    this._current = null;
  },

  onAdd(map) {
    this._canvas = L.DomUtil.create("canvas", "leaflet-zoom-animated", map.getPane("currents"));
    this._draw();
  },

  onRemove() {
    this._canvas.remove();
  },

  getEvents() {
    return { moveend: this._draw, resize: this._draw, zoomanim: this._animate };
  },

  /** Draw another season's current; null draws none. */
  setCurrent(current) {
    this._current = current;
    if (this._map) this._draw();
  },

  redraw() {
    if (this._map) this._draw();
  },

  _animate(event) {
    const scale = this._map.getZoomScale(event.zoom);
    const offset = this._map._latLngBoundsToNewLayerBounds(this._bounds, event.zoom, event.center).min;
    L.DomUtil.setTransform(this._canvas, offset, scale);
  },

  /** Lay the canvas over the view and a margin; returns its upper left corner as a layer point. */
  _place() {
    const size = this._map.getSize();
    const margin = size.multiplyBy(ARROW_MARGIN).round();
    const corner = this._map.containerPointToLayerPoint(margin.multiplyBy(-1)).round();
    const whole = size.add(margin.multiplyBy(2));
    const ratio = window.devicePixelRatio || 1;
    this._canvas.width = whole.x * ratio;
    this._canvas.height = whole.y * ratio;
    this._canvas.style.width = `${whole.x}px`;
    this._canvas.style.height = `${whole.y}px`;
    this._canvas.getContext("2d").scale(ratio, ratio);
    this._bounds = L.latLngBounds(
      this._map.layerPointToLatLng(corner),
      this._map.layerPointToLatLng(corner.add(whole)),
    );
    L.DomUtil.setTransform(this._canvas, corner, 1);
    return corner;
  },

  _draw() {
    const corner = this._place();
    if (!this._current) return;
    const context = this._canvas.getContext("2d");
    const chart = this._outline(corner);
    // The canvas's own transform holds for the outline and not for the point.
    const ratio = context.getTransform().a;
    const paths = this._limits.map(() => new Path2D());
    this._eachArrow(corner, (x, y, u, v, room) => {
      if (!context.isPointInPath(chart, x * ratio, y * ratio, "evenodd")) return;
      const speed = Math.hypot(u, v);
      const kind = speedClass(speed, this._limits);
      const share = ARROW_SHORTEST + ((1 - ARROW_SHORTEST) * (kind + 1)) / this._limits.length;
      addArrow(paths[kind], x, y, u / speed, v / speed, share * Math.min(room, ARROW_LONGEST));
    });
    paths.forEach((path, kind) => {
      context.fillStyle = this._colours(`speed${kind}`);
      context.fill(path);
    });
  },

  /** The chart's outline on the canvas. */
  _outline(corner) {
    const outline = new Path2D();
    for (const ring of this._chart) {
      ring.forEach((place, i) => {
        const { x, y } = this._map.latLngToLayerPoint(place).subtract(corner);
        if (i === 0) outline.moveTo(x, y);
        else outline.lineTo(x, y);
      });
      outline.closePath();
    }
    return outline;
  },

  /** Call back with each arrow's place on the canvas, velocity (m/s) and room (px). */
  _eachArrow(corner, draw) {
    const { corner: first, spacing, columns, u } = this._current;
    const rows = u.length / columns;
    const pixels = spacing * this._map.getZoomScale(this._map.getZoom(), 0);
    const stride = arrowStride(pixels);
    const origin = this._map.latLngToLayerPoint(first).subtract(corner);
    const across = arrowSteps(stride, columns, -origin.x / pixels, (this._canvas.clientWidth - origin.x) / pixels);
    const up = arrowSteps(stride, rows, (origin.y - this._canvas.clientHeight) / pixels, origin.y / pixels);
    for (const row of up) {
      for (const column of across) {
        const velocity = currentAt(this._current, row, column);
        if (velocity) draw(origin.x + column * pixels, origin.y - row * pixels, ...velocity, stride * pixels);
      }
    }
  },
});

/** Steps of the lattice from one arrow to the next, a power of two, where one step is so many pixels. */
function arrowStride(pixels) {
  if (pixels < ARROW_ROOM) return 2 ** Math.ceil(Math.log2(ARROW_ROOM / pixels));
  return pixels > ARROW_FAR ? 2 ** -Math.ceil(Math.log2(pixels / ARROW_FAR)) : 1;
}

/** Where arrows stand on a side of the lattice of so many places, from one place of it to another. */
function arrowSteps(stride, count, low, high) {
  // Thinned ones stand in the middle of those left out, added ones evenly in the cells about the places.
  const begin = stride < 1 ? (stride - 1) / 2 : stride >> 1;
  const end = stride < 1 ? count - 0.5 : count;
  const from = Math.max(0, Math.ceil((low - begin) / stride));
  const to = Math.min(Math.ceil((end - begin) / stride), Math.floor((high - begin) / stride) + 1);
  return Array.from({ length: Math.max(0, to - from) }, (_, i) => begin + (from + i) * stride);
}

/** The current (m/s) between the lattice's places, from those around it on moving water; null without. */
function currentAt({ columns, u, v }, row, column) {
  const rows = u.length / columns;
  let [east, north, known] = [0, 0, 0];
  for (const r of [Math.floor(row), Math.floor(row) + 1]) {
    for (const c of [Math.floor(column), Math.floor(column) + 1]) {
      const weight = (1 - Math.abs(row - r)) * (1 - Math.abs(column - c));
      const at = r * columns + c;
      if (weight > 0 && r >= 0 && c >= 0 && r < rows && c < columns && (u[at] || v[at])) {
        east += weight * u[at];
        north += weight * v[at];
        known += weight;
      }
    }
  }
  return known > 0 && (east || north) ? [east / known / 100, north / known / 100] : null;
}

/** Add an arrow's outline to a path: centre, direction (unit vector, y up) and length in pixels. */
function addArrow(path, x, y, cosine, sine, length) {
  ARROW.forEach(([along, across], i) => {
    const px = x + length * (along * cosine - across * sine);
    const py = y - length * (along * sine + across * cosine);
    if (i === 0) path.moveTo(px, py);
    else path.lineTo(px, py);
  });
  path.closePath();
}
