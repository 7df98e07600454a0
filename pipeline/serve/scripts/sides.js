// What was found: a card for each side, with the reader's units; and two plans beside each other.

import { button, make } from "./elements.js";
import { SEASON_COLOURS, formatClearance, formatDecimals, formatDistance, formatTime } from "./map.js";

// Kinds of file in the reader's words, by the ends of their names.
const KINDS = { "-all.gpx": "GPX, all ways", ".gpx": "GPX", ".rtz": "RTZ", ".geojson": "GeoJSON", ".plan": "QGroundControl", ".waypoints": "ArduPilot", ".nc": "NetCDF of currents", ".gpkg": "GeoPackage", ".csv": "CSV", ".toml": "Scenario" };
const DAY_S = 86400;

const percent = (share) => `${formatDecimals(100 * share, 1)} %`;
const gapText = (gap) => (gap === null ? "not proven" : gap > 1 ? "no useful bound" : percent(Math.ceil(1000 * gap - 1e-6) / 1000));
const moment = (text) => `${text.slice(0, 16).replace("T", " ")} UTC`;

/** A duration: 2.3 days from two days on, else hours. */
function timeText(seconds) {
  return seconds >= 2 * DAY_S ? `${formatDecimals(seconds / DAY_S, 1)} days` : formatTime(seconds);
}

function facts(rows) {
  return make("dl", { className: "facts" }, ...rows.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
}

function figures(route, noGo) {
  return [
    ["Fuel", route.excess > 0 ? `+${percent(route.excess)}` : route.fuel_text],
    ["Time", timeText(route.duration_s)],
    ["Length", formatDistance(route.length_m)],
    ["Better by at most", gapText(route.gap)],
    [`Clear of ${noGo}`, formatClearance(route.clearance_m)],
    ["Turns that met land", `${route.collisions} of ${route.trials.toLocaleString("en")}`],
  ];
}

/** Cards of the best route of each side, season by season. */
export function sideCards(sides) {
  return sides.seasons.flatMap((season, s) => {
    const others = season.routes.filter((one) => !one.is_side).length;
    const bySide = season.routes.filter((one) => one.is_side);
    // As on the map: a colour for each season, or for each side of the only one.
    const colour = (route) => (sides.seasons.length > 1 ? s : bySide.indexOf(route)) % SEASON_COLOURS;
    const head = make("h3", { dir: "auto" }, season.title);
    if (season.failure) return [head, make("p", { className: "notice", dir: "auto" }, season.failure)];
    if (season.checked) return [head, make("article", { className: "card side season0", "data-route": `${s}-0` }, make("h4", { className: "answer" }, "Your route"), ...season.checked.map((line) => make("p", { dir: "auto" }, line)))];
    const cards = bySide.map((route) => make("article",
      { className: `card side season${colour(route)} ${route.rank === 1 ? "chosen" : ""}`, "data-route": `${s}-${season.routes.indexOf(route)}` },
      make("h4", { className: "answer", dir: "auto" }, make("button", { type: "button", "data-select": `${s}-${season.routes.indexOf(route)}` }, route.way || `Route ${route.rank}`)),
      make("p", { className: "because", dir: "auto" }, route.because),
      facts(figures(route, sides.no_go)),
      ...(route.departure ? [make("p", { className: "certainty" }, `Leave ${moment(route.departure)}, arrive ${moment(route.arrival)}.`)] : []),
      ...(route.certainty ? [make("p", { className: "certainty", dir: "auto" }, route.certainty)] : [])));
    const more = others ? [make("p", { className: "quiet" }, `${others === 1 ? "One more class has" : `${others} more classes have`} a route on these sides: thin lines on the map.`)] : [];
    return [head, make("div", { className: "cards" }, ...cards), ...more, ...season.choices.map(choice)];
  });
}

/** When to leave, how fast, how sure: sentences and the plot that the report has, from the server. */
function choice({ title, said, plot }) {
  const figure = make("figure", {}, make("h4", {}, title), ...said.map((text) => make("p", { dir: "auto" }, text)));
  if (!plot) return figure;
  // The page's policy takes styles from scripts only.
  const drawn = new DOMParser().parseFromString(plot.replaceAll(" style=", " data-style="), "image/svg+xml").documentElement;
  figure.append(drawn);
  for (const one of drawn.querySelectorAll("[data-style]")) one.style.cssText = one.dataset.style;
  return figure;
}

/** Links to the files of a plan: the report, each file by its kind, and all together. */
export function downloads(plan) {
  const link = (text, href, properties = { download: "" }) => make("a", { className: "button", href, ...properties }, text);
  const kinds = plan.files.flatMap((name) => {
    const found = Object.entries(KINDS).find(([end]) => name.endsWith(end));
    return found ? [link(found[1], `/api/plan/${plan.id}/files/${encodeURIComponent(name)}`, { download: name, title: name })] : [];
  });
  return [link("Open report", `/plan/${plan.id}/report.html`, { id: "report", target: "_blank", rel: "noopener" }), link("Download all files", `/api/plan/${plan.id}/files.zip`, { id: "download", download: "" }), ...kinds];
}

export const best = (plan) => plan.sides.seasons.map((season) => season.routes[0]).find(Boolean);

/** A table of the best routes of two plans. */
export function comparison(plan, other) {
  const [ours, theirs] = [best(plan), best(other)];
  if (!ours || !theirs) return [];
  const rows = [["Way", ours.way, theirs.way], ...figures(ours, plan.sides.no_go).map(([name, value], i) => [name, value, figures(theirs, other.sides.no_go)[i][1]])];
  const more = theirs.fuel / ours.fuel - 1;
  rows[1] = ["Fuel", "", `${more < 0 ? "−" : "+"}${percent(Math.abs(more))}`];
  const head = make("tr", {}, make("td", {}), make("th", { scope: "col" }, "This plan"), make("th", { scope: "col" }, "The other, dotted"));
  return [make("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Two plans compared" },
    make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows.map(([name, ...values]) => make("tr", {},
      make("th", { scope: "row" }, name), ...values.map((value) => make("td", { className: "way", dir: "auto" }, value)))))))];
}

/** A row of the list of plans. */
export function planRow(plan, { isShown, isCompared, show, compare, rename, forget }) {
  const { request } = plan;
  const name = make("input", { value: plan.title || (request.route ? "Check of a route" : `${request.start} to ${request.goal}`), maxLength: 100, "aria-label": "Name of the plan" });
  name.addEventListener("change", () => rename(name.value));
  const what = [request.vessel || request.speed, request.month.join(", ") || request.depart, request.via.length ? `${request.via.length} via` : "", request.areas.length ? `${request.areas.length} shut` : ""].filter(Boolean).join(" · ");
  return make("li", {},
    make("span", { dir: "auto" }, name, make("small", {}, `${what} · ${plan.state}`)),
    button("Show", show, { disabled: isShown, "aria-label": `Show ${request.start} to ${request.goal}, ${what}` }),
    button("Compare", compare, { disabled: isShown || plan.state !== "done", "aria-pressed": String(isCompared), "aria-label": `Compare with ${request.start} to ${request.goal}, ${what}` }),
    button("Delete", forget, { disabled: ["waiting", "running"].includes(plan.state), "aria-label": `Delete ${request.start} to ${request.goal}, ${what}; its files stay` }));
}
