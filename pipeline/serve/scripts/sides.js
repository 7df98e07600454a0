// What was found: a card for each side, with the reader's units; and two plans beside each other.

import { button, make } from "./elements.js";
import { formatClearance, formatDecimals, formatDistance, formatTime } from "./text.js";

const SEASON_COLOURS = 6;
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
    ["Fuel", route.excess > 0 ? `${route.fuel_text} (+${percent(route.excess)})` : route.fuel_text],
    ["Time", timeText(route.duration_s)],
    ["Length", formatDistance(route.length_m)],
    ["Gap to the bound", gapText(route.gap)],
    [`Clear of ${noGo}`, formatClearance(route.clearance_m)],
    ["Turns that met land", `${route.collisions} of ${route.trials.toLocaleString("en")}`],
  ];
}

/** Cards of the best route of each side, season by season. */
export function sideCards(sides) {
  return sides.seasons.flatMap((season, s) => {
    const others = season.routes.filter((one) => !one.is_side).length;
    const head = make("h3", { dir: "auto" }, season.title);
    if (season.failure) return [head, make("p", { className: "notice", dir: "auto" }, season.failure)];
    const cards = season.routes.filter((one) => one.is_side).map((route) => make("article",
      { className: `card side season${s % SEASON_COLOURS} ${route.rank === 1 ? "chosen" : ""}` },
      make("h4", { className: "answer", dir: "auto" }, route.way || `Route ${route.rank}`),
      make("p", { className: "because", dir: "auto" }, route.because),
      facts(figures(route, sides.no_go)),
      ...(route.departure ? [make("p", { className: "certainty" }, `Leave ${moment(route.departure)}, arrive ${moment(route.arrival)}.`)] : []),
      ...(route.certainty ? [make("p", { className: "certainty", dir: "auto" }, route.certainty)] : [])));
    const more = others ? [make("p", { className: "quiet" }, `${others === 1 ? "One more class has" : `${others} more classes have`} a route on these sides: thin lines on the map.`)] : [];
    return [head, make("div", { className: "cards" }, ...cards), ...more];
  });
}

/** Lines of a plan for the map, the best last so that it lies on top. */
export function lines(sides) {
  return sides.seasons.flatMap((season, s) => season.routes.map((route) => ({
    line: route.line,
    kind: route.rank === 1 ? "best" : route.is_side ? "" : "minor",
    season: s % SEASON_COLOURS,
  }))).filter((one) => one.line.length).sort((a, b) => (a.kind === "best") - (b.kind === "best"));
}

const best = (plan) => plan.sides.seasons.map((season) => season.routes[0]).find(Boolean);

/** A table of the best routes of two plans. */
export function comparison(plan, other) {
  const [ours, theirs] = [best(plan), best(other)];
  if (!ours || !theirs) return [];
  const rows = [["Way", ours.way, theirs.way], ...figures({ ...ours, excess: 0 }, plan.sides.no_go).map(([name, value], i) => [name, value, figures({ ...theirs, excess: 0 }, other.sides.no_go)[i][1]])];
  rows[1][2] += theirs.fuel === ours.fuel ? "" : ` (${theirs.fuel > ours.fuel ? "+" : "−"}${percent(Math.abs(theirs.fuel / ours.fuel - 1))})`;
  const head = make("tr", {}, make("td", {}), make("th", { scope: "col" }, "This plan"), make("th", { scope: "col" }, "The other, dotted"));
  return [make("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Two plans compared" },
    make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows.map(([name, ...values]) => make("tr", {},
      make("th", { scope: "row" }, name), ...values.map((value) => make("td", { className: "way", dir: "auto" }, value)))))))];
}

/** A row of the list of plans. */
export function planRow(plan, { isShown, isCompared, show, compare }) {
  const { request } = plan;
  const what = [request.vessel || request.speed, request.month.join(", ") || request.depart, request.via.length ? `${request.via.length} via` : "", request.areas.length ? `${request.areas.length} shut` : ""].filter(Boolean).join(" · ");
  return make("li", {},
    make("span", { dir: "auto" }, `${request.start} to ${request.goal}`, make("br"), make("small", {}, `${what} · ${plan.state}`)),
    button("Show", show, { disabled: isShown, "aria-label": `Show ${request.start} to ${request.goal}, ${what}` }),
    button("Compare", compare, { disabled: isShown || plan.state !== "done", "aria-pressed": String(isCompared), "aria-label": `Compare with ${request.start} to ${request.goal}, ${what}` }));
}
