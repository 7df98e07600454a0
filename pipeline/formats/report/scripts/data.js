// Decodes the page's data: `map_data.py` writes places and values as whole numbers, each the
// difference to the one before.

/** Running sums of a flat x, y, dx, dy, ... as places in metres: [y, x], in Leaflet's order. */
function readLine(moves, stepM, place = (y, x) => [y, x]) {
  const places = new Array(moves.length / 2);
  let x = 0;
  let y = 0;
  for (let i = 0; i < places.length; i += 1) {
    x += moves[2 * i];
    y += moves[2 * i + 1];
    places[i] = place(y * stepM, x * stepM);
  }
  return places;
}

/** Read a ring as Leaflet's own objects: a coast has too many places to create each of them twice. */
function readRing(moves, stepM) {
  return readLine(moves, stepM, (y, x) => new L.LatLng(y, x));
}

/** Running sums of a series in its own unit; null if it has infinite values. */
function readSeries({ step, moves }) {
  if (moves === null) return null;
  let sum = 0;
  return moves.map((move) => step * (sum += move));
}

/** A route with its places, and its profile along them. */
function readRoute(route, stepM) {
  const read = { rank: route.rank, way: route.way, fuelUnit: route.fuelUnit };
  for (const name of ["places", "turns", "hits", "shores"]) read[name] = readLine(route[name], stepM);
  read.narrow = route.narrow.map((line) => readLine(line, stepM));
  read.soft = route.soft.map((ring) => readRing(ring, stepM));
  for (const name of ["lon", "lat", "time", "distance", "course", "fuel", "speed", "current", "clearance"]) {
    read[name] = readSeries(route[name]);
  }
  return read;
}

/** Longitudes and latitudes, degrees, at the corners of a grid over the chart; its size is in metres. */
function readPositions({ cells, unit, size, lon, lat }, stepM) {
  const read = (moves) => readSeries({ step: unit, moves });
  return { cells, size: size.map((steps) => steps * stepM), lon: read(lon), lat: read(lat) };
}

/** Width and height of the chart, metres. */
function chartSize({ extent }, stepM) {
  const places = extent.flatMap((ring) => readLine(ring, stepM));
  return [1, 0].map((axis) => Math.max(...places.map((place) => place[axis])));
}

/** All data that the template put into the page. */
function readData() {
  const data = JSON.parse(document.getElementById("map-data").textContent);
  const { stepM } = data;
  const lines = (rings) => rings.map((ring) => readLine(ring, stepM));
  return {
    planar: data.planar,
    noGoName: data.noGoName,
    origin: data.origin,
    speedLimits: data.speedLimits,
    extent: lines(data.extent),
    sheet: lines(data.sheet),
    beyond: data.beyond.map((ring) => readRing(ring, stepM)),
    land: data.land.map((ring) => readRing(ring, stepM)),
    noGo: data.noGo.map((ring) => readRing(ring, stepM)),
    shoals: data.shoals.map((ring) => readRing(ring, stepM)),
    hazards: data.hazards.map((ring) => readRing(ring, stepM)),
    zones: data.zones.map((zone) => ({
      kind: zone.kind,
      text: zone.text,
      area: zone.area.map((ring) => readRing(ring, stepM)),
      edges: lines(zone.edges),
    })),
    start: readLine(data.start, stepM)[0],
    goal: readLine(data.goal, stepM)[0],
    via: data.via.map((place, at) => [readLine(place, stepM)[0], `Via ${at + 1}`]),
    islands: data.islands.map(({ label, names, below, place }) => ({ label, names, below, place: readLine(place, stepM)[0] })),
    positions: data.positions && readPositions(data.positions, stepM),
    size: chartSize(data, stepM),
    grid: data.grid.map((line) => ({
      label: line.label,
      meridian: line.meridian,
      foot: readLine(line.foot, stepM)[0],
      parts: lines(line.parts),
    })),
    seasons: data.seasons.map((season) => ({
      title: season.title,
      current: season.current && {
        ...season.current,
        corner: readLine(season.current.corner, stepM)[0],
        spacing: season.current.spacing * stepM,
      },
      havens: season.havens && {
        places: season.havens.places.map(({ name, place }) => ({ name, place: readLine(place, stepM)[0] })),
        ways: lines(season.havens.ways),
        stretches: season.havens.stretches.map(({ state, places }) => ({ state, places: readLine(places, stepM) })),
      },
      routes: season.routes.map((route) => readRoute(route, stepM)),
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
    current: between(route.current, at),
    course: route.course[here],
    speed: route.speed[here],
  };
}
