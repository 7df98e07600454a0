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

/** A route with its places, and its profile along them. */
function readRoute(route, step) {
  const { rank, way, side, isSide, excess, fuelUnit } = route;
  const read = { rank, way, side, isSide, excess, fuelUnit };
  for (const name of ["places", "turns", "hits", "shores"]) read[name] = readLine(route[name], step);
  read.marked = route.marked.map(({ role, places }) => ({ role, places: readLine(places, step) }));
  for (const name of ["soft", "turnRoom"]) read[name] = route[name].map((ring) => readRing(ring, step));
  for (const name of ["lon", "lat", "time", "distance", "course", "fuel", "speed", "current", "clearance", "waves", "wind"]) {
    read[name] = readSeries(route[name]);
  }
  return read;
}

/** Longitudes and latitudes, degrees, at the corners of a grid over the chart; its size is in metres. */
function readPositions({ cells, unit, size, lon, lat }, step) {
  const read = (moves) => readSeries({ step: unit, moves });
  return { cells, size: size.map((steps) => steps * step), lon: read(lon), lat: read(lat) };
}

/** Read the data of a map. */
function readData(data) {
  const { step } = data;
  const lines = (rings) => rings.map((ring) => readLine(ring, step));
  const bounds = L.latLngBounds(lines(data.extent).flat());
  return {
    globe: data.globe,
    bounds,
    size: [bounds.getEast() - bounds.getWest(), bounds.getNorth() - bounds.getSouth()],
    planar: data.planar,
    noGoName: data.noGoName,
    origin: data.origin,
    speedLimits: data.speedLimits,
    extent: lines(data.extent),
    sheet: lines(data.sheet),
    beyond: data.beyond.map((ring) => readRing(ring, step)),
    land: data.land.map((ring) => readRing(ring, step)),
    noGo: data.noGo.map((ring) => readRing(ring, step)),
    shoals: data.shoals.map((ring) => readRing(ring, step)),
    hazards: data.hazards.map((ring) => readRing(ring, step)),
    zones: data.zones.map((zone) => ({
      kind: zone.kind,
      text: zone.text,
      area: zone.area.map((ring) => readRing(ring, step)),
      edges: lines(zone.edges),
    })),
    start: readLine(data.start, step)[0],
    goal: readLine(data.goal, step)[0],
    via: data.via.map((place, at) => [readLine(place, step)[0], `Via ${at + 1}`]),
    islands: data.islands.map(({ label, names, below, place }) => ({ label, names, below, place: readLine(place, step)[0] })),
    positions: data.positions && readPositions(data.positions, step),
    grid: data.grid.map((line) => ({
      label: line.label,
      meridian: line.meridian,
      foot: readLine(line.foot, step)[0],
      parts: lines(line.parts),
    })),
    seasons: data.seasons.map((season) => ({
      title: season.title,
      current: season.current && {
        ...season.current,
        corner: readLine(season.current.corner, step)[0],
        // In Leaflet's units at zoom 0: metres, or pixels of a map of the world.
        spacing: season.current.spacing * (data.globe ? 1 : step),
      },
      havens: season.havens && {
        places: season.havens.places.map(({ name, place }) => ({ name, place: readLine(place, step)[0] })),
        ways: lines(season.havens.ways),
        stretches: season.havens.stretches.map(({ state, places }) => ({ state, places: readLine(places, step) })),
      },
      nearBest: season.nearBest.map((ring) => readRing(ring, step)),
      routes: season.routes.map((route) => readRoute(route, step)),
    })),
  };
}

/** Position of a value in an ascending series: [index before it, share of the step after]. */
function locate(series, value) {
  let low = 0;
  let high = series.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (series[middle] <= value) low = middle;
    else high = middle;
  }
  const width = series[high] - series[low];
  const share = width > 0 ? (value - series[low]) / width : 0;
  return [low, Math.min(1, Math.max(0, share))];
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
