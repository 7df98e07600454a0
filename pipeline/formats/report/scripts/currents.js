// The current as arrows on a canvas of their own: as many as the zoom has room for.

// An arrow of length 1 along x, centred, as the static maps draw it.
const ARROW = [[-0.5, -0.045], [0.12, -0.045], [0.08, -0.17], [0.5, 0], [0.08, 0.17], [0.12, 0.045], [-0.5, 0.045]];
// Room for an arrow, in CSS pixels; the longest fills it, one of the weakest class this share.
const ARROW_ROOM = 26;
const ARROW_LONGEST = 44;
const ARROW_SHORTEST = 0.4;
// How far beyond the view arrows are drawn, so that a drag uncovers no bare water at once.
const ARROW_MARGIN = 0.2;

/** Class of a speed (m/s): the number of limits below it, at most the last class. */
function speedClass(speed, limits) {
  const index = limits.findIndex((limit) => speed <= limit);
  return index < 0 ? limits.length - 1 : index;
}

const CurrentArrows = L.Layer.extend({
  initialize(limits, colours) {
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
    const paths = this._limits.map(() => new Path2D());
    this._eachArrow(corner, (x, y, u, v, room) => {
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

  /** Call back with each arrow's place on the canvas, velocity (m/s) and room (px). */
  _eachArrow(corner, draw) {
    const { corner: first, spacing, columns, u, v } = this._current;
    const rows = u.length / columns;
    const pixels = spacing * this._map.getZoomScale(this._map.getZoom(), 0);
    const stride = 2 ** Math.max(0, Math.ceil(Math.log2(ARROW_ROOM / pixels)));
    const origin = this._map.latLngToLayerPoint(first).subtract(corner);
    const width = this._canvas.clientWidth;
    const height = this._canvas.clientHeight;
    // Thinned rows stand in the middle of those left out.
    const begin = stride >> 1;
    for (let row = begin; row < rows; row += stride) {
      const y = origin.y - row * pixels;
      if (y < 0 || y > height) continue;
      for (let column = begin; column < columns; column += stride) {
        const x = origin.x + column * pixels;
        const at = row * columns + column;
        if (x >= 0 && x <= width && (u[at] || v[at])) draw(x, y, u[at] / 100, v[at] / 100, stride * pixels);
      }
    }
  },
});

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
