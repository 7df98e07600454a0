// Quantities as text, in the same form as `formats/shared/text.py`.

const ABSENT = "–";

/** A number to significant digits without exponent, with thousands separators: 1,235. */
function formatNumber(value, digits = 4) {
  if (value === null || !Number.isFinite(value)) return ABSENT;
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  return formatDecimals(value, Math.max(0, digits - 1 - magnitude));
}

/** A number to a fixed number of decimals. */
function formatDecimals(value, decimals) {
  const form = { minimumFractionDigits: decimals, maximumFractionDigits: decimals };
  return value.toLocaleString("en", form).replace("-", "−");
}

/** True metres: 712.1 km, 3.46 km, 820.4 m. */
function formatDistance(metres) {
  if (metres === null || !Number.isFinite(metres)) return ABSENT;
  if (metres >= 100000) return `${formatDecimals(metres / 1000, 1)} km`;
  if (metres >= 1000) return `${formatDecimals(metres / 1000, 2)} km`;
  return `${formatNumber(metres, metres >= 100 ? 4 : 3)} m`;
}

/** A duration in hours, minutes or seconds; the duration of the whole voyage decides the unit. */
function formatTime(seconds, whole = seconds) {
  if (whole >= 3600) return `${formatDecimals(seconds / 3600, 1)} h`;
  if (whole >= 120) return `${formatDecimals(seconds / 60, 1)} min`;
  return `${formatDecimals(seconds, 1)} s`;
}

/** Degrees and decimal minutes, as on charts: 10°30.2′ N. */
function formatAngle(degrees, names) {
  const minutes = Math.round(Math.abs(degrees) * 600);
  const rest = ((minutes % 600) / 10).toFixed(1).padStart(4, "0");
  return `${Math.floor(minutes / 600)}°${rest}′ ${names[degrees < 0 ? 1 : 0]}`;
}

/** A vessel's position: latitude and longitude, or metres in a plane. */
function formatPosition(now, planar) {
  if (planar) return `x ${formatNumber(now.place[1])} m, y ${formatNumber(now.place[0])} m`;
  const lon = ((((now.lon + 180) % 360) + 360) % 360) - 180;
  return `${formatAngle(now.lat, "NS")} ${formatAngle(lon, "EW")}`;
}

/** A course in three digits: 045°. */
function formatCourse(degrees) {
  return `${String(Math.round(degrees) % 360).padStart(3, "0")}°`;
}

/** The current's component along the course, with its sign. */
function formatCurrent(speed) {
  const sign = speed < 0 ? "" : "+";
  return `${sign}${formatDecimals(speed, 2)} m/s`;
}
