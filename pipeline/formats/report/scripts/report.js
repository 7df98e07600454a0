// The page's controls: what is chosen, and everything that follows from a choice.

class Explorer {
  constructor(root) {
    this.root = root;
    this.data = readData();
    this.season = Math.max(0, this.data.seasons.findIndex((season) => season.routes.length > 0));
    this.chosen = this.data.seasons.map(() => 0);
    this.lists = [...root.querySelectorAll("[data-routes]")];
    this.layers = [...root.querySelectorAll("[data-layer]")];
    this.strip = new Strip(root);
    this.map = new VoyageMap(root.querySelector("#map"), this.data, (season, index) => this.pick(season, index));
    this.voyage = new Voyage(this.data, root, (now, share) => {
      this.map.moveVessel(now.place, now.bearing);
      this.strip.move(share);
    });
    this.listen();
    this.update();
  }

  /** Its row of a list for a route, and that of the season's table. */
  rows(season, index) {
    return document.querySelectorAll(`[data-route="${season}-${index}"]`);
  }

  listen() {
    for (const radio of this.root.querySelectorAll("[name=season]")) {
      radio.addEventListener("change", () => this.pick(Number(radio.value), this.chosen[Number(radio.value)]));
    }
    for (const box of [...this.layers, ...this.root.querySelectorAll("[data-shown]")]) {
      box.addEventListener("change", () => this.draw());
    }
    for (const button of document.querySelectorAll("[data-pick]")) {
      button.addEventListener("click", () => {
        const [season, index] = button.dataset.pick.split("-").map(Number);
        this.pick(season, index);
        if (!this.root.contains(button)) this.root.scrollIntoView();
      });
    }
    for (const button of this.root.querySelectorAll("[data-all]")) {
      button.addEventListener("click", () => this.showAll(button.dataset.all === "all"));
    }
    this.root.querySelector("#whole").addEventListener("click", () => this.map.fit());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.map.turn());
  }

  /** Choose a route, and with it its season. */
  pick(season, index) {
    this.season = season;
    this.chosen[season] = index;
    this.update();
    this.voyage.speakSoon();
  }

  /** Show all routes of the season, or none beside the chosen one. */
  showAll(on) {
    for (const box of this.lists[this.season].querySelectorAll("[data-shown]")) box.checked = on;
    this.draw();
  }

  isShown(season, index) {
    return this.lists[season].querySelectorAll("[data-shown]")[index].checked;
  }

  /** Set every control to the choice, then draw it. */
  update() {
    this.lists.forEach((list, season) => {
      list.hidden = season !== this.season;
    });
    for (const radio of this.root.querySelectorAll("[name=season]")) radio.checked = Number(radio.value) === this.season;
    for (const row of document.querySelectorAll("[data-route].chosen")) row.classList.remove("chosen");
    for (const row of this.rows(this.season, this.chosen[this.season])) row.classList.add("chosen");
    for (const button of this.root.querySelectorAll("[data-pick]")) {
      button.setAttribute("aria-pressed", String(button.closest(".chosen") !== null));
    }
    const route = this.data.seasons[this.season].routes[this.chosen[this.season]] || null;
    this.root.querySelector(".player").hidden = !route;
    this.root.style.setProperty("--season", `var(--map-season${this.season % SEASON_COLOURS})`);
    this.draw();
    this.strip.follow(route);
    this.voyage.follow(route);
  }

  draw() {
    const layers = Object.fromEntries(this.layers.map((box) => [box.dataset.layer, box.checked]));
    const chosen = this.chosen[this.season];
    this.map.show({ season: this.season, chosen, layers, shown: (s, r) => this.isShown(s, r) });
  }
}

/** Paper has no buttons: what is folded up is opened for it. */
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

/** The map is drawn: say when, and lay out the rest of the page. */
function ready() {
  document.documentElement.dataset.ready = Math.round(performance.now());
  setTimeout(() => document.documentElement.classList.add("settled"));
}

openForPrint();
const explorer = document.querySelector(".explorer");
if (explorer) {
  // The style sheet shows the map in place of the static pictures from here on; it needs its size.
  document.documentElement.classList.add("live");
  try {
    new Explorer(explorer);
    requestAnimationFrame(() => requestAnimationFrame(ready));
  } catch (error) {
    document.documentElement.classList.remove("live");
    throw error;
  }
}
