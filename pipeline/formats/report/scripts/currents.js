// The current as arrows on a canvas of their own, with a density that suits the zoom.

// An arrow of length 1 along x, centred, as on the static maps.
const ARROW = [[-0.5, -0.045], [0.12, -0.045], [0.08, -0.17], [0.5, 0], [0.08, 0.17], [0.12, 0.045], [-0.5, 0.045]];
// Minimum spacing of arrows, in CSS pixels.
const ARROW_SPACING = 26;
// Maximum length of an arrow, in CSS pixels.
const MAX_ARROW_LENGTH = 44;
// Length of an arrow of speed 0, as a share of the strongest's.
const MIN_ARROW_SHARE = 0.4;
// Spacing above which arrows are drawn between those of the lattice, too.
const MAX_ARROW_SPACING = 4 * ARROW_SPACING;
// Margin around the view in which arrows are drawn, as a share of it, for dragging the map.
const CANVAS_MARGIN = 0.2;

/** Index of the class of a speed (m/s); speeds above the last limit are in the last. */
const speedClass = (speed, limits) => (limits.findIndex((limit) => speed <= limit) + limits.length) % limits.length;

/** Add a ring of points [x, y] to a path. */
function addRing(path, points) {
  points.forEach(([x, y], i) => path[i ? "lineTo" : "moveTo"](x, y));
  path.closePath();
}

/** What shows a current on a canvas of its own; `pane` is the canvas's. */
const CurrentLayer = L.Layer.extend({
  /** `chart` is the outline, as rings of places, inside which it is drawn. */
  initialize(chart, limits, colours) {
    Object.assign(this, { _chart: chart, _limits: limits, _colours: colours, _current: null });
  },

  onAdd(map) {
    this._canvas = L.DomUtil.create("canvas", this.options.className, map.getPane(this.options.pane));
    this._draw();
  },

  onRemove() {
    this._canvas.remove();
  },

  /** Show another season's current; null shows none. */
  setCurrent(current) {
    this._current = current;
    if (this._map) this._draw();
  },

  /** Lay the canvas over the view and a margin around it, a share of it; returns its context, size and upper left layer point. */
  _place(share) {
    const size = this._map.getSize();
    const margin = size.multiplyBy(share).round();
    const corner = this._map.containerPointToLayerPoint(margin.multiplyBy(-1)).round();
    const whole = size.add(margin.multiplyBy(2));
    const ratio = window.devicePixelRatio || 1;
    Object.assign(this._canvas, { width: whole.x * ratio, height: whole.y * ratio });
    Object.assign(this._canvas.style, { width: `${whole.x}px`, height: `${whole.y}px` });
    L.DomUtil.setTransform(this._canvas, corner, 1);
    const context = this._canvas.getContext("2d");
    context.scale(ratio, ratio);
    return { context, whole, corner };
  },

  /** Where the lattice lies on the canvas: its first place, and the length of a step, in CSS pixels. */
  _lattice(corner) {
    const origin = this._map.latLngToLayerPoint(this._current.corner).subtract(corner);
    return { origin, pixels: this._current.spacing * this._map.getZoomScale(this._map.getZoom(), 0) };
  },
});

const CurrentArrows = CurrentLayer.extend({
  options: { pane: "currents", className: "leaflet-zoom-animated" },

  getEvents() {
    return { moveend: this._draw, resize: this._draw, zoomanim: this._animate };
  },

  _animate(event) {
    const scale = this._map.getZoomScale(event.zoom);
    const offset = this._map._latLngBoundsToNewLayerBounds(this._bounds, event.zoom, event.center).min;
    L.DomUtil.setTransform(this._canvas, offset, scale);
  },

  _draw() {
    const { context, whole, corner } = this._place(CANVAS_MARGIN);
    this._bounds = L.latLngBounds(this._map.layerPointToLatLng(corner), this._map.layerPointToLatLng(corner.add(whole)));
    if (!this._current) return;
    const chart = chartOutline(this._map, this._chart, corner);
    // The canvas's transform applies to the outline but not to the point.
    const ratio = context.getTransform().a;
    const paths = this._limits.map(() => new Path2D());
    this._eachArrow(corner, (x, y, u, v, spacing) => {
      if (!context.isPointInPath(chart, x * ratio, y * ratio, "evenodd")) return;
      const speed = Math.hypot(u, v);
      const kind = speedClass(speed, this._limits);
      const share = MIN_ARROW_SHARE + ((1 - MIN_ARROW_SHARE) * (kind + 1)) / this._limits.length;
      addArrow(paths[kind], x, y, u / speed, v / speed, share * Math.min(spacing, MAX_ARROW_LENGTH));
    });
    paths.forEach((path, kind) => {
      context.fillStyle = this._colours(`speed${kind}`);
      context.fill(path);
    });
  },

  /** Call back with each arrow's position on the canvas, velocity (m/s) and spacing (px). */
  _eachArrow(corner, draw) {
    const { columns, u } = this._current;
    const rows = u.length / columns;
    const { origin, pixels } = this._lattice(corner);
    const stride = arrowStride(pixels);
    const across = arrowSteps(stride, columns, -origin.x / pixels, (this._canvas.clientWidth - origin.x) / pixels);
    const up = arrowSteps(stride, rows, (origin.y - this._canvas.clientHeight) / pixels, origin.y / pixels);
    for (const row of up) {
      for (const column of across) {
        const velocity = interpolatedCurrent(this._current, row, column);
        if (velocity) draw(origin.x + column * pixels, origin.y - row * pixels, ...velocity, stride * pixels);
      }
    }
  },
});

/** The chart's outline on a canvas whose upper left is at a layer point. */
function chartOutline(map, chart, corner) {
  const outline = new Path2D();
  for (const ring of chart) addRing(outline, ring.map((place) => map.latLngToLayerPoint(place).subtract(corner)).map(({ x, y }) => [x, y]));
  return outline;
}

/** Stride in lattice steps from one arrow to the next, a power of two; `pixels` is the length of a step. */
function arrowStride(pixels) {
  if (pixels < ARROW_SPACING) return 2 ** Math.ceil(Math.log2(ARROW_SPACING / pixels));
  return pixels > MAX_ARROW_SPACING ? 2 ** -Math.ceil(Math.log2(pixels / MAX_ARROW_SPACING)) : 1;
}

/** Positions of arrows between `low` and `high` along a side of the lattice of `count` places. */
function arrowSteps(stride, count, low, high) {
  // Arrows are centred: in each group of thinned places, or in the cell around each place.
  const begin = stride < 1 ? (stride - 1) / 2 : stride >> 1;
  const end = stride < 1 ? count - 0.5 : count;
  const from = Math.max(0, Math.ceil((low - begin) / stride));
  const to = Math.min(Math.ceil((end - begin) / stride), Math.floor((high - begin) / stride) + 1);
  return Array.from({ length: Math.max(0, to - from) }, (_, i) => begin + (from + i) * stride);
}

/** The current (m/s) at a position on the lattice, from its neighbours on moving water; null without any. */
function interpolatedCurrent({ columns, u, v }, row, column) {
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
  addRing(path, ARROW.map(([along, across]) => [x + length * (along * cosine - across * sine), y - length * (along * sine + across * cosine)]));
}
