// Changes the distances and speeds in the page's own text between metric and nautical units.

// A number or a range of them, and its unit.
const QUANTITY = /([+−]?)(\d[\d,]*(?:\.\d+)?)(?:–(\d[\d,]*(?:\.\d+)?))? (km|m\/s|m)(?![\w/²])/g;
// Elements whose text stays: pictures, what the scripts write themselves, scaled metres, sizes of vessels.
const FIXED = "svg, script, style, code, .explorer .routes, .player, #map, .probe, [data-metric], [data-distance], [data-clearance]";

/** Texts of the page that change with the units: each node with its metric text. */
function unitTexts(root) {
  const found = [];
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    if (node.data.match(QUANTITY) && !node.parentElement.closest(FIXED)) found.push([node, node.data]);
  }
  return found;
}

/** A text with every quantity in nautical units; after "at least", quantities are rounded down. */
function inNauticalUnits(text) {
  return text.replace(QUANTITY, (whole, sign, first, second, unit, at) => {
    const values = [first, second].filter((value) => value !== undefined);
    const numbers = values.map((value) => Number(value.replaceAll(",", "")));
    if (unit === "m/s") {
      const decimals = Math.max(...values.map((value) => (value.split(".")[1] || "").length));
      const knots = numbers.map((number) => formatDecimals(number / KNOT_M_S, Math.max(2, decimals)));
      return `${sign}${knots.join("–")} kn`;
    }
    const metres = numbers.map((number) => number * (unit === "km" ? 1000 : 1));
    if (metres.some((value) => value < MILES_FROM_M)) return whole;
    const floor = text.slice(0, at).endsWith("at least ");
    return sign + metres.map((value) => (floor ? formatClearance : formatDistance)(value)).join("–");
  });
}

class UnitSwitch {
  /** `onChange` is called when the reader has chosen other units. */
  constructor(box, root, onChange) {
    this.texts = null;
    this.root = root;
    box.addEventListener("change", () => {
      this.set(box.checked);
      onChange();
    });
  }

  set(nautical) {
    this.texts ??= unitTexts(this.root);
    units.nautical = nautical;
    for (const [node, metric] of this.texts) node.data = nautical ? inNauticalUnits(metric) : metric;
    for (const one of this.root.querySelectorAll("[data-distance]")) one.textContent = formatDistance(Number(one.dataset.distance));
    for (const one of this.root.querySelectorAll("[data-clearance]")) one.textContent = formatClearance(Number(one.dataset.clearance));
  }
}
