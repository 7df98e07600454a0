// The page: the form asks, the server plans, the map and the cards show what comes back.

import { ask, pause } from "./api.js";
import { Chart } from "./chart.js";
import { find, make } from "./elements.js";
import { Form } from "./form.js";
import { Explorer, readData, units } from "./map.js";
import { best, comparison, downloads, planRow, sideCards } from "./sides.js";

// Stages of a plan in the reader's words, in their order.
const STAGES = { fetch: "land and current", simplify: "coast", project: "chart", choose: "room to keep", plan: "classes and padding", compare: "sides", cover: "havens", write: "files" };
const LIVE = new Set(["waiting", "running"]);
const LOOK_MS = 150;

class Desk {
  constructor() {
    this.plan = null;
    this.other = null;
    this.spoken = "";
    this.ways = [];
    this.form = new Form({ changed: () => this.changed() });
    this.chart = new Chart(find("#map"), {
      click: (text) => this.form.click(text),
      key: (letter, text) => this.key(letter, text),
      moved: (name, text) => this.moved(() => this.form.set(name, text)),
      inserted: (index, text) => this.moved(() => this.form.addVia(text, index)),
      removed: (name) => this.moved(() => this.form.remove(name)),
      corner: (count) => { find("#close-area").disabled = count < 3; },
    });
    this.explorer = new Explorer(find("main"), this.chart.map, (season, index, event) => this.chart.pull(this.explorer.data.seasons[season].routes[index].places, event));
    this.listen();
  }

  async open() {
    await this.form.load();
    if (location.hash) await this.follow(location.hash.slice(1));
    else await this.form.example();
    this.listPlans();
    document.documentElement.dataset.ready = Math.round(performance.now());
  }

  listen() {
    find("#ask").addEventListener("submit", (event) => { event.preventDefault(); this.start(); });
    for (const kind of ["change", "pointerover"]) find("#ask").addEventListener(kind, () => this.prepare());
    find("#cancel").addEventListener("click", () => this.cancel());
    find("#draw").addEventListener("click", () => this.draw(!this.chart.corners));
    find("#close-area").addEventListener("click", () => this.draw(false));
    find("#copy").addEventListener("click", () => this.copy());
    find("#undo").addEventListener("click", () => this.undo());
    find("#nautical").addEventListener("change", (event) => { units.nautical = event.target.checked; this.explorer.changeUnits(); this.show(); });
    addEventListener("hashchange", () => { if (location.hash.slice(1) !== this.plan?.id) this.follow(location.hash.slice(1)); });
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.chart.corners) { this.chart.draw(false); this.drawing(false); }
      // In a field, the browser takes back what was typed.
      if (event.key === "z" && (event.ctrlKey || event.metaKey) && !event.target.matches("input")) { event.preventDefault(); this.undo(); }
    });
  }

  changed() {
    const [pins, way] = [this.form.pins(), this.form.way()];
    if (JSON.stringify(way) !== JSON.stringify(this.ways.at(-1))) this.ways.push(way);
    find("#undo").disabled = this.ways.length < 2;
    this.chart.showPins(pins);
    this.chart.showAreas(this.form.areas);
    if (!pins.length) this.clear();
    if (!this.form.isExample) this.prepare();
    if (pins.length > 1) this.chart.reveal([...this.chart.pins.values()].map((pin) => pin.getLatLng()));
  }

  /** Take back the last change of the way; a plan that is shown follows. */
  undo() {
    const now = JSON.stringify(this.form.way());
    const before = this.ways.findLastIndex((way) => JSON.stringify(way) !== now);
    if (before < 0) return;
    this.ways.length = before + 1;
    this.moved(() => this.form.setWay(this.ways[before]));
  }

  /** Show no plan. */
  clear() {
    if (LIVE.has(this.plan?.state)) this.cancel();
    this.plan = this.mapped = this.started = null;
    history.replaceState(null, "", location.pathname);
    this.explorer.clear();
    this.chart.drafts.clearLayers();
    find("#outcome").classList.remove("stale");
    for (const name of ["#sides", "#warnings", "#comparison"]) find(name).replaceChildren();
    for (const name of ["#results", "#same", "#notes", "#warnings"]) find(name).hidden = true;
    this.say("Give a start and a goal, and press Plan.");
    this.listPlans();
  }

  /** Have land and currents made ready while the reader looks at the form. */
  prepare() {
    const request = this.form.read();
    if (!this.form.isComplete(request) || LIVE.has(this.plan?.state)) return;
    const body = JSON.stringify(request);
    if (body !== this.prepared) ask("/api/prepare", "POST", body).catch(() => {});
    this.prepared = body;
  }

  async key(letter, text) {
    if (letter === "v") this.form.addVia(text);
    else this.form.set(letter === "s" ? "Start" : "Goal", text);
    await this.form.located();
  }

  /** A place was changed on the map: the plan that is shown, or at work, is planned anew. */
  async moved(change) {
    change();
    const located = this.form.located();
    if (this.plan && find("#start").value && find("#goal").value) await this.start();
    await located;
  }

  draw(on) {
    const ring = this.chart.draw(on);
    this.drawing(on);
    if (!on && ring.length > 2) this.form.addArea(ring);
  }

  drawing(on) {
    find("#draw").setAttribute("aria-pressed", String(on));
    find("#draw").textContent = on ? "Do not draw" : "Draw on the map";
    find("#draw").dataset.on = on;
    find("#close-area").hidden = !on;
    find("#close-area").disabled = true;
    this.say(on ? "Click the corners on the map, or press A on it for its middle; then close the area." : this.spoken);
  }

  /** What was found before stays, in grey, until the new way comes. */
  stale(on) {
    for (const name of [".sea", "#outcome"]) find(name).classList.toggle("stale", on);
  }

  async start() {
    this.form.fault([]);
    const asked = this.started = performance.now();
    const earlier = this.plan;
    // One whose files are being written keeps nobody waiting.
    if (earlier && LIVE.has(earlier.state) && earlier.stages.at(-1) !== "write") ask(`/api/plan/${earlier.id}`, "DELETE").catch(() => {});
    this.stale(true);
    try {
      const plan = await ask("/api/plan", "POST", JSON.stringify(this.form.read()));
      // The form was cleared meanwhile, or something else was asked for.
      if (this.started !== asked) { if (!this.started) ask(`/api/plan/${plan.id}`, "DELETE").catch(() => {}); return; }
      this.asked = { id: plan.id, at: asked };
      history.replaceState(null, "", `#${plan.id}`);
      // On a phone the outcome is far below the button.
      if (find("#outcome").getBoundingClientRect().top > innerHeight) find("#outcome").scrollIntoView();
      await this.watch(plan);
    } catch (error) {
      this.stale(false);
      this.form.fault(error.faults || [String(error)]);
    }
  }

  async cancel() {
    const { plan } = this;
    const ended = await ask(`/api/plan/${plan.id}`, "DELETE");
    if (this.plan?.id === plan.id) this.take(ended);
  }

  /** Show an earlier plan, and go on with it if it is still at work. */
  async follow(id) {
    try {
      const plan = await ask(`/api/plan/${id}`);
      this.form.write(plan.request);
      this.watch(plan);
    } catch (error) {
      this.form.fault(error.faults || [String(error)]);
    }
  }

  /** Look how a plan goes until it ends, or another one is shown. */
  async watch(plan) {
    this.other = null;
    this.take(plan);
    this.listPlans();
    let now = plan;
    while (LIVE.has(now.state) && this.plan?.id === plan.id) {
      await pause(LOOK_MS);
      try {
        now = await ask(`/api/plan/${plan.id}`);
      } catch (error) {
        if (this.plan?.id === plan.id) this.form.fault(error.faults || [String(error)]);
        if (error.status) return;
        await pause(10 * LOOK_MS);
        continue;
      }
      if (this.plan?.id === plan.id && now.version !== this.plan.version) this.take(now);
    }
    this.listPlans();
  }

  take(plan) {
    const before = this.plan?.id === plan.id ? this.plan : null;
    this.plan = plan;
    if (plan.state !== before?.state && plan.faults.length) this.form.fault(plan.faults);
    this.show();
    if (plan.maps && this.mapped !== mapName(plan)) this.showMap(plan);
  }

  /** Draw what was found in the same water as the report. */
  async showMap(plan) {
    this.mapped = mapName(plan);
    const data = readData(await ask(`/api/plan/${plan.id}/map`));
    if (this.plan?.id !== plan.id) return;
    // The first route of a check is the reader's; each other one has a colour and a price of its own.
    const checked = data.seasons.filter((_, s) => this.plan.sides.seasons[s].checked);
    for (const season of checked) season.routes.forEach((one, r) => Object.assign(one, { side: r, isSide: true, price: r ? "" : "yours" }));
    this.chart.turnTo(data.start[1]);
    this.chart.showAreas(this.form.areas);
    this.explorer.load(data);
    this.chart.drafts.clearLayers();
    find(".sea").classList.remove("stale");
    this.compare();
    this.chart.reveal(data.seasons.flatMap(({ routes }) => routes.flatMap(({ places }) => places)));
  }

  /** Show the plan: its progress, its sides, and what can be had of it. */
  show() {
    const { plan } = this;
    if (!plan) return;
    const isLive = LIVE.has(plan.state);
    find("#cancel").disabled = !isLive;
    this.say(statusText(plan));
    find("#steps").hidden = !isLive;
    find("#steps").replaceChildren(...Object.entries(STAGES).map(([stage, text]) => {
      const at = plan.stages.indexOf(stage);
      return make("li", { className: at < 0 ? "" : at === plan.stages.length - 1 ? "at-work" : "done" }, text);
    }));
    // Until there is something new, the old cards stay.
    if (plan.sides || !isLive) {
      find("#sides").replaceChildren(...(plan.sides ? sideCards(plan.sides) : []));
      find("#outcome").classList.remove("stale");
      if (!plan.sides) this.explorer.clear();
    }
    const warnings = plan.sides ? plan.sides.warnings : [];
    find("#warnings").hidden = !warnings.length;
    find("#warnings").replaceChildren(...warnings.map((one) => make("p", { dir: "auto" }, `Not the current that was asked for. ${one}.`)));
    this.chart.show(this.chart.drafts, this.mapped === mapName(plan) ? [] : plan.drafts, "way-line draft");
    this.time(plan);
    find("#results").hidden = !plan.files.length;
    find("#results").replaceChildren(...downloads(plan));
    find("#same").hidden = !plan.command;
    find("#command").value = plan.command;
    const notes = plan.sides ? [...plan.sides.decided, ...plan.sides.unknown, ...plan.sides.notes] : plan.notes;
    find("#notes").hidden = !notes.length;
    find("#notes ul").replaceChildren(...[...new Set(notes)].map((note) => make("li", { dir: "auto" }, note)));
    this.compare();
  }

  /** Keep how long it took from the click to the first route and to all sides, ms. */
  time(plan) {
    if (this.asked?.id !== plan.id) return;
    const since = Math.round(performance.now() - this.asked.at);
    const found = document.documentElement.dataset;
    if (!this.asked.first && (plan.sides || plan.drafts.length)) { this.asked.first = true; found.first = since; }
    if (!this.asked.all && plan.sides) { this.asked.all = true; found.all = since; }
  }

  say(text) {
    if (find("#status").textContent !== text) find("#status").textContent = text;
    if (!this.chart.corners) this.spoken = text;
  }

  async listPlans() {
    const plans = await ask("/api/plan").catch(() => []);
    find("#earlier").hidden = plans.length === 0;
    find("#plans").replaceChildren(...plans.map((plan) => planRow(plan, {
      isShown: plan.id === this.plan?.id,
      isCompared: plan.id === this.other?.id,
      show: () => { history.replaceState(null, "", `#${plan.id}`); this.form.fault([]); this.follow(plan.id); },
      compare: () => this.with(plan.id),
      rename: (title) => ask(`/api/plan/${plan.id}/title`, "PUT", JSON.stringify(title)),
      forget: async () => { await ask(`/api/plan/${plan.id}?forget=true`, "DELETE"); if (plan.id === this.plan?.id) this.clear(); this.listPlans(); },
    })));
  }

  /** Compare the plan with another one, or no longer. */
  async with(id) {
    this.other = this.other?.id === id ? null : await ask(`/api/plan/${id}`);
    this.compare();
    this.listPlans();
  }

  compare() {
    const isBoth = this.plan?.sides && this.other?.sides;
    find("#comparison").replaceChildren(...(isBoth ? comparison(this.plan, this.other) : []));
    this.chart.show(this.chart.other, isBoth ? [best(this.other)?.line].filter(Boolean) : [], "way-line other-plan");
  }

  async copy() {
    find("#command").select();
    const isCopied = await navigator.clipboard.writeText(find("#command").value).then(() => true, () => false);
    this.say(isCopied ? "The command is copied." : "Press Ctrl and C: the command is selected.");
  }
}

/** A plan may have more than one map: its region may be widened. */
const mapName = (plan) => `${plan.id} ${plan.maps}`;

function statusText(plan) {
  const ways = plan.sides && !plan.stages.includes("compare") ? " The sides below are provisional: the region is widened." : plan.drafts.length ? ` ${plan.drafts.length === 1 ? "One way is" : `${plan.drafts.length} ways are`} found, provisional: a better one may follow.` : "";
  switch (plan.state) {
    case "waiting": return plan.before ? `${plan.before === 1 ? "1 voyage" : `${plan.before} voyages`} before yours.` : "Begins at once.";
    case "running": return plan.sides && plan.stages.at(-1) === "write" ? `All sides are found; the files are being written${plan.detail ? `: ${plan.detail}` : ""}.` : `At work: ${STAGES[plan.stages.at(-1)] || "begins"}${plan.detail ? ` – ${plan.detail}` : ""}.${ways}`;
    case "cancelled": return "Cancelled.";
    case "failed": return "No plan: see the faults above the button.";
    default: return `Planned in ${plan.seconds.toFixed(1)} s.`;
  }
}

new Desk().open();
