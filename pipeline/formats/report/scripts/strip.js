// Small plots of the selected route's profile over time, with a line for the vessel's position.

const STRIP = { width: 600, height: 46, pad: 3 };

/** An SVG element with attributes. */
function svg(tag, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

class Strip {
  /** `root` holds an element with `data-plot` for each series that is drawn. */
  constructor(root) {
    this.plots = [...root.querySelectorAll("[data-plot]")].map((holder) => {
      const { width, height } = STRIP;
      const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", "aria-hidden": "true" });
      const [zero, curve, now] = ["zero", "curve", "now"].map((name) => svg("path", { class: name }));
      picture.append(zero, curve, now);
      holder.querySelector(".plot").append(picture);
      return { holder, name: holder.dataset.plot, range: holder.querySelector(".range"), zero, curve, now };
    });
  }

  /** Draw another route's series. */
  follow(route) {
    for (const plot of this.plots) {
      plot.holder.hidden = !route?.[plot.name];
      if (route?.[plot.name]) this.draw(plot, route, route[plot.name]);
    }
  }

  draw({ name, range, zero, curve }, { time, fuelUnit, least }, series) {
    const { width, height, pad } = STRIP;
    const [low, high] = [name === "clearance" ? least : Math.min(...series), Math.max(...series)];
    // All axes but that of the speed begin at 0; that of the current includes 0.
    const bottom = Math.min(low, name === "speed" ? low : 0);
    const top = Math.max(high, name === "current" ? 0 : high);
    const y = (value) => height - pad - ((value - bottom) / (top - bottom || 1)) * (height - 2 * pad);
    const x = (value) => (value / time[time.length - 1]) * width;
    curve.setAttribute("d", series.map((value, i) => `${i ? "L" : "M"}${x(time[i]).toFixed(1)} ${y(value).toFixed(1)}`).join(""));
    zero.setAttribute("d", name === "current" ? `M0 ${y(0).toFixed(1)}H${width}` : "");
    const fuel = (value) => `${formatNumber(value)} ${fuelUnit}`;
    const waves = (value) => `${value.toFixed(1)} m`;
    const format = { clearance: formatClearance, fuel, waves }[name] || formatSpeed;
    range.textContent = `${format(low)} to ${format(high)}`;
  }

  move(share) {
    for (const { now } of this.plots) now.setAttribute("d", `M${(share * STRIP.width).toFixed(1)} 0V${STRIP.height}`);
  }
}
