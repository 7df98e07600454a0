// Quantities as text, in the same form as `findings/text.py`; in nautical units if the reader asks for them.

const ABSENT = "–";
const MILE_M = 1852;
const KNOT_M_S = 1852 / 3600;
// Distance, metres, from which nautical miles are given, when they are asked for: a cable.
const MILES_FROM_M = MILE_M / 10;

/** The reader's units, the same for the whole page. */
const units = { nautical: false };

/** A number to significant digits without exponent, with thousands separators: 1,235. */
function formatNumber(value, digits = 4) {
  if (value === null || !Number.isFinite(value)) return ABSENT;
  if (value === 0) return "0";
  // Digits of the rounded value: 99.996 becomes 100, with three before the point.
  return formatDecimals(value, Math.max(0, digits - 1 - Number(value.toExponential(digits - 1).split("e")[1])));
}

/** A number to a fixed number of decimals. */
function formatDecimals(value, decimals) {
  return value.toLocaleString("en", { minimumFractionDigits: decimals, maximumFractionDigits: decimals }).replace("-", "−");
}

/** True metres: 712.1 km, 3.46 km, 820.4 m; or 384.5 NM, 1.87 NM, 0.44 NM, 82.0 m. */
function formatDistance(metres) {
  if (metres === null || !Number.isFinite(metres)) return ABSENT;
  if (units.nautical && metres >= MILES_FROM_M) return `${formatDecimals(metres / MILE_M, metres >= 10 * MILE_M ? 1 : 2)} NM`;
  if (metres >= 100000) return `${formatDecimals(metres / 1000, 1)} km`;
  if (metres >= 1000) return `${formatDecimals(metres / 1000, 2)} km`;
  return `${formatNumber(metres, metres >= 100 ? 4 : 3)} m`;
}

/** True metres of clearance to three digits, rounded down: 3.46 km, 820 m, 12.6 m; or 1.86 NM. */
function formatClearance(metres) {
  if (metres === null || !Number.isFinite(metres)) return ABSENT;
  let [unit, name, decimals] = metres >= 1000 ? [1000, "km"] : [1, "m"];
  if (units.nautical && metres >= MILES_FROM_M) [unit, name, decimals] = [MILE_M, "NM", metres >= 10 * MILE_M ? 1 : 2];
  if (decimals === undefined) decimals = metres > 0 ? Math.max(0, 2 - Math.floor(Math.log10(metres / unit))) : 2;
  const down = Math.floor((metres / unit) * 10 ** decimals + 1e-6) / 10 ** decimals;
  return `${formatDecimals(down, decimals)} ${name}`;
}

/** A speed: 1.22 m/s, or 2.37 kn. */
function formatSpeed(speed, decimals = 2) {
  return units.nautical ? `${formatDecimals(speed / KNOT_M_S, decimals)} kn` : `${formatDecimals(speed, decimals)} m/s`;
}

/** A duration in hours, minutes or seconds; the duration of the whole voyage decides the unit. */
function formatTime(seconds, whole = seconds) {
  const [unit, name] = whole >= 3600 ? [3600, "h"] : whole >= 120 ? [60, "min"] : [1, "s"];
  return `${formatDecimals(seconds / unit, 1)} ${name}`;
}

/** Degrees and decimal minutes, as on charts: 10°30.2′ N. */
function formatAngle(degrees, names) {
  const minutes = Math.round(Math.abs(degrees) * 600);
  const rest = ((minutes % 600) / 10).toFixed(1).padStart(4, "0");
  return `${Math.floor(minutes / 600)}°${rest}′ ${names[degrees < 0 ? 1 : 0]}`;
}

/** A position on earth. */
function formatLonLat(lon, lat) {
  return `${formatAngle(lat, "NS")} ${formatAngle(((((lon + 180) % 360) + 360) % 360) - 180, "EW")}`;
}

/** A vessel's position: latitude and longitude, or metres in a plane. */
function formatPosition(now, planar) {
  if (planar) return `x ${formatNumber(now.place[1])} m, y ${formatNumber(now.place[0])} m`;
  return formatLonLat(now.lon, now.lat);
}

/** A course in three digits: 045°. */
const formatCourse = (degrees) => `${String(Math.round(degrees) % 360).padStart(3, "0")}°`;

/** The current's component along the course, with its sign. */
const formatCurrent = (speed) => `${speed < 0 ? "" : "+"}${formatSpeed(speed)}`;
