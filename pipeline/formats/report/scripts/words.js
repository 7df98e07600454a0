// Figures in words, spelt as `phrases.py` spells them.

const ABSENT = "–";

/** A number to significant digits without exponents, thousands parted: 1,235. */
function spellNumber(value, digits = 4) {
  if (value === null || !Number.isFinite(value)) return ABSENT;
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  return spellPlaces(value, Math.max(0, digits - 1 - magnitude));
}

/** A number with so many decimals. */
function spellPlaces(value, places) {
  const form = { minimumFractionDigits: places, maximumFractionDigits: places };
  return value.toLocaleString("en", form).replace("-", "−");
}

/** True metres: 712.1 km, 3.46 km, 820.4 m. */
function spellDistance(metres) {
  if (metres === null || !Number.isFinite(metres)) return ABSENT;
  if (metres >= 100000) return `${spellPlaces(metres / 1000, 1)} km`;
  if (metres >= 1000) return `${spellPlaces(metres / 1000, 2)} km`;
  return `${spellNumber(metres, metres >= 100 ? 4 : 3)} m`;
}

/** A duration in hours; what takes less, in minutes or seconds: the whole voyage gives the unit. */
function spellTime(seconds, whole = seconds) {
  if (whole >= 3600) return `${spellPlaces(seconds / 3600, 1)} h`;
  if (whole >= 120) return `${spellPlaces(seconds / 60, 1)} min`;
  return `${spellPlaces(seconds, 1)} s`;
}

/** Degrees and decimal minutes, as charts have them: 10°30.2′ N. */
function spellAngle(degrees, names) {
  const minutes = Math.round(Math.abs(degrees) * 600);
  const rest = ((minutes % 600) / 10).toFixed(1).padStart(4, "0");
  return `${Math.floor(minutes / 600)}°${rest}′ ${names[degrees < 0 ? 1 : 0]}`;
}

/** Where a vessel is: latitude and longitude, or metres of a plane. */
function spellPlace(now, planar) {
  if (planar) return `x ${spellNumber(now.place[1])} m, y ${spellNumber(now.place[0])} m`;
  const lon = ((((now.lon + 180) % 360) + 360) % 360) - 180;
  return `${spellAngle(now.lat, "NS")} ${spellAngle(lon, "EW")}`;
}

/** A course in three digits: 045°. */
function spellCourse(degrees) {
  return `${String(Math.round(degrees) % 360).padStart(3, "0")}°`;
}

/** The current's part along the way, with its sign and what it does. */
function spellCurrent(speed) {
  const sign = speed < 0 ? "" : "+";
  return `${sign}${spellPlaces(speed, 2)} m/s`;
}
