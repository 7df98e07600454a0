// Decodes the page's data: `map_data.py` writes places and values as whole numbers, each the
// difference to the one before. Places are [y, x], in metres of the chart's plane; on a map of the world they are degrees.

/** Running sums of a flat x, y, dx, dy, ... as places [y, x], in Leaflet's order. */
function readLine(moves, step, place = (y, x) => [y, x]) {
  const places = new Array(moves.length / 2);
  let x = 0;
  let y = 0;
  for (let i = 0; i < places.length; i += 1) {
    x += moves[2 * i];
    y += moves[2 * i + 1];
    places[i] = place(y * step, x * step);
  }
  return places;
}

/** Read a ring as Leaflet's own objects: a coast has too many places to create each of them twice. */
function readRing(moves, step) {
  return readLine(moves, step, (y, x) => new L.LatLng(y, x));
}

/** Running sums of a series in its own unit; null if it has infinite values. */
function readSeries({ step, moves }) {
  if (moves === null) return null;
  let sum = 0;
  return moves.map((move) => step * (sum += move));
}

const readLines = (lines, step) => lines.map((line) => readLine(line, step));
const readRings = (rings, step) => rings.map((ring) => readRing(ring, step));
const readPlace = (line, step) => readLine(line, step)[0];

// How the fields that hold places are read; all others hold values or series.
const READERS = Object.fromEntries([
  [readPlace, ["start", "goal", "corner", "foot", "place"]],
  [readLine, ["places", "via", "turns", "hits", "shores"]],
  [readLines, ["extent", "sheet", "parts", "edges", "ways"]],
  [readRings, ["beyond", "land", "noGo", "shoals", "hazards", "area", "nearBest", "soft", "turnRoom"]],
].flatMap(([reader, names]) => names.map((name) => [name, reader])));

/** Read a value of the data, or everything below it. */
function read(value, step, name) {
  if (name in READERS) return READERS[name](value, step);
  if (value === null || typeof value !== "object" || typeof value[0] === "number") return value;
  if (Array.isArray(value)) return value.map((one) => read(one, step));
  if ("moves" in value) return readSeries(value);
  return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, read(one, step, key)]));
}

/** Read the data of a map. */
function readData(data) {
  const all = read(data, data.step);
  const bounds = L.latLngBounds(all.extent.flat());
  return { ...all, bounds, size: [bounds.getEast() - bounds.getWest(), bounds.getNorth() - bounds.getSouth()] };
}

/** Position of a value in an ascending series: [index before it, share of the step after]. */
function locate(series, value) {
  const index = Math.min(series.length - 2, Math.max(0, series.findLastIndex((one) => one <= value)));
  const share = (value - series[index]) / (series[index + 1] - series[index] || 1);
  return [index, Math.min(1, Math.max(0, share))];
}

/** A value between two places of a route; null if the route has none. */
function between(series, [index, share]) {
  if (series === null) return null;
  const next = Math.min(index + 1, series.length - 1);
  return series[index] * (1 - share) + series[next] * share;
}

/** State of the vessel on a route at a share (0 to 1) of its time. */
function stateAt(route, share) {
  const time = share * route.time[route.time.length - 1];
  const at = locate(route.time, time);
  // Course and speed hold from one place to the next, so they are not interpolated.
  const here = at[1] >= 1 ? at[0] + 1 : at[0];
  const before = route.places[at[0]];
  const after = route.places[Math.min(at[0] + 1, route.places.length - 1)];
  const move = [after[0] - before[0], after[1] - before[1]];
  return {
    place: [before[0] + at[1] * move[0], before[1] + at[1] * move[1]],
    bearing: (Math.atan2(move[1], move[0]) * 180) / Math.PI,
    time,
    lon: between(route.lon, at),
    lat: between(route.lat, at),
    distance: between(route.distance, at),
    fuel: between(route.fuel, at),
    clearance: between(route.clearance, at),
    waves: between(route.waves, at),
    wind: between(route.wind, at),
    current: between(route.current, at),
    course: route.course[here],
    speed: route.speed[here],
  };
}
