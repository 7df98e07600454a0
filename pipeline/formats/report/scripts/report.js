// The page's controls: the selected season and route, and all parts of the page that depend on them.

class Explorer {
  constructor(root) {
    this.root = root;
    this.data = readData();
    this.season = Math.max(0, this.data.seasons.findIndex((season) => season.routes.length > 0));
    this.selected = this.data.seasons.map(() => 0);
    this.lists = [...root.querySelectorAll("[data-routes]")];
    this.layers = [...root.querySelectorAll("[data-layer]")];
    this.strip = new Strip(root);
    this.map = new RouteMap(root.querySelector("#map"), this.data, (season, index) => this.select(season, index));
    this.playback = new Playback(this.data, root, (now, share) => {
      this.map.moveVessel(now.place, now.bearing);
      this.strip.move(share);
    });
    this.probe = new Probe(this.map.map, this.data, root.querySelector(".probe"));
    this.stillForReducedMotion();
    this.listen();
    this.update();
  }

  /** Particles stay off, until asked for, where the reader prefers less motion. */
  stillForReducedMotion() {
    const reduced = matchMedia("(prefers-reduced-motion: reduce)");
    const box = this.root.querySelector("[data-layer=particles]");
    const follow = () => { box.checked = !reduced.matches; };
    reduced.addEventListener("change", () => { follow(); this.draw(); });
    follow();
  }

  /** Rows of a route: in the list of routes, and in the season's table. */
  rows(season, index) {
    return document.querySelectorAll(`[data-route="${season}-${index}"]`);
  }

  listen() {
    for (const radio of this.root.querySelectorAll("[name=season]")) {
      radio.addEventListener("change", () => this.select(Number(radio.value), this.selected[Number(radio.value)]));
    }
    for (const box of [...this.layers, ...this.root.querySelectorAll("[data-shown]")]) {
      box.addEventListener("change", () => this.draw());
    }
    for (const button of document.querySelectorAll("[data-select]")) {
      button.addEventListener("click", () => {
        const [season, index] = button.dataset.select.split("-").map(Number);
        this.select(season, index);
        if (!this.root.contains(button)) this.root.querySelector("#map").scrollIntoView({ block: "center" });
      });
    }
    for (const button of document.querySelectorAll("[data-place]")) {
      button.addEventListener("click", () => this.reveal(button));
    }
    new UnitSwitch(this.root.querySelector("#nautical"), document.querySelector("main"), () => this.changeUnits());
    for (const button of this.root.querySelectorAll("[data-all]")) {
      button.addEventListener("click", () => this.showAll(button.dataset.all === "all"));
    }
    this.root.querySelector("#fit").addEventListener("click", () => this.map.fit());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.map.changeScheme());
  }

  /** Select a route and its season. */
  select(season, index) {
    this.season = season;
    this.selected[season] = index;
    this.update();
    this.playback.speakSoon();
  }

  /** Show the place that a button's row speaks of; its season, too, if it has one. */
  reveal(button) {
    if (button.dataset.season) this.select(Number(button.dataset.season), this.selected[Number(button.dataset.season)]);
    const [x, y] = button.dataset.place.split(",").map(Number);
    this.map.reveal([y, x], button.dataset.text);
    this.root.querySelector("#map").scrollIntoView({ block: "center" });
  }

  /** Write every figure again. */
  changeUnits() {
    this.map.showScale();
    this.update();
  }

  /** Show all routes of the season, or only the selected one. */
  showAll(on) {
    for (const box of this.lists[this.season].querySelectorAll("[data-shown]")) box.checked = on;
    this.draw();
  }

  isShown(season, index) {
    return this.lists[season].querySelectorAll("[data-shown]")[index].checked;
  }

  /** Set every control to the selection, then draw it. */
  update() {
    this.lists.forEach((list, season) => {
      list.hidden = season !== this.season;
    });
    for (const radio of this.root.querySelectorAll("[name=season]")) radio.checked = Number(radio.value) === this.season;
    for (const row of document.querySelectorAll("[data-route].selected")) row.classList.remove("selected");
    for (const row of this.rows(this.season, this.selected[this.season])) row.classList.add("selected");
    for (const button of this.root.querySelectorAll("[data-select]")) {
      button.setAttribute("aria-pressed", String(button.closest(".selected") !== null));
    }
    const route = this.data.seasons[this.season].routes[this.selected[this.season]] || null;
    this.root.querySelector(".player").hidden = !route;
    this.root.style.setProperty("--season", `var(--map-season${this.season % SEASON_COLOURS})`);
    this.draw();
    this.strip.follow(route);
    this.playback.follow(route);
  }

  draw() {
    const layers = Object.fromEntries(this.layers.map((box) => [box.dataset.layer, box.checked]));
    const selected = this.selected[this.season];
    const season = this.data.seasons[this.season];
    this.probe.follow(season.current, season.routes[selected] || null);
    this.map.show({ season: this.season, selected, layers, shown: (s, r) => this.isShown(s, r) });
  }
}

/** Open folded parts for printing. */
function openForPrint() {
  addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details:not([open])")) {
      folded.open = true;
      folded.dataset.folded = "";
    }
  });
  addEventListener("afterprint", () => {
    for (const opened of document.querySelectorAll("details[data-folded]")) {
      opened.open = false;
      delete opened.dataset.folded;
    }
  });
}

/** Record that the map is drawn, and lay out the rest of the page. */
function ready() {
  document.documentElement.dataset.ready = Math.round(performance.now());
  setTimeout(() => document.documentElement.classList.add("settled"));
}

openForPrint();
const explorer = document.querySelector(".explorer");
if (explorer) {
  // The style sheet now shows the map instead of the static ones: the map needs a size before it is made.
  document.documentElement.classList.add("live");
  try {
    new Explorer(explorer);
    requestAnimationFrame(() => requestAnimationFrame(ready));
  } catch (error) {
    document.documentElement.classList.remove("live");
    throw error;
  }
}
