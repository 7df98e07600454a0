// The page: the form asks, the server plans, the map and the cards show what comes back.

import { ask, pause } from "./api.js";
import { Chart } from "./chart.js";
import { find, make } from "./elements.js";
import { Form } from "./form.js";
import { comparison, lines, planRow, sideCards } from "./sides.js";
import { units } from "./text.js";

// Stages of a plan in the reader's words, in their order.
const STAGES = { fetch: "land and current", simplify: "coast", project: "chart", choose: "room to keep", plan: "classes and padding", compare: "sides", cover: "havens", write: "files" };
const LIVE = new Set(["waiting", "running"]);
const LOOK_MS = 150;

class Desk {
  constructor() {
    this.plan = null;
    this.other = null;
    this.spoken = "";
    this.form = new Form({ changed: () => this.changed(), fault: (lines) => this.fault(lines) });
    this.chart = new Chart(find("#map"), {
      click: (text) => this.form.click(text),
      key: (letter, text) => this.key(letter, text),
      moved: (name, text) => this.moved(name, text),
      corner: (count) => { find("#close-area").disabled = count < 3; },
    });
    this.listen();
  }

  async open() {
    await this.form.load();
    await this.follow(location.hash.slice(1));
    document.documentElement.dataset.ready = Math.round(performance.now());
  }

  listen() {
    find("#ask").addEventListener("submit", (event) => { event.preventDefault(); this.start(); });
    find("#ask").addEventListener("change", () => this.prepare());
    find("#cancel").addEventListener("click", () => this.cancel());
    find("#draw").addEventListener("click", () => this.draw(!this.chart.corners));
    find("#close-area").addEventListener("click", () => this.draw(false));
    find("#copy").addEventListener("click", () => this.copy());
    find("#nautical").addEventListener("change", (event) => { units.nautical = event.target.checked; this.show(); });
    addEventListener("hashchange", () => { if (location.hash.slice(1) !== this.plan?.id) this.follow(location.hash.slice(1)); });
    addEventListener("keydown", (event) => { if (event.key === "Escape" && this.chart.corners) { this.chart.draw(false); this.drawing(false); } });
  }

  changed() {
    const pins = this.form.pins();
    this.chart.showPins(pins);
    this.chart.showAreas(this.form.areas);
    this.prepare();
    if (pins.length > 1) this.chart.reveal(pins.map(([, , lat, lon]) => [lat, lon]));
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

  /** A pin was dragged: the plan that is shown, or at work, is planned anew. */
  async moved(name, text) {
    this.form.set(name, text);
    const located = this.form.located();
    if (this.plan) await this.start();
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

  fault(faults) {
    const list = find("#faults");
    list.hidden = !faults.length;
    list.replaceChildren(...faults.map((one) => make("li", { dir: "auto" }, one)));
  }

  async start() {
    this.fault([]);
    const asked = performance.now();
    const earlier = this.plan;
    if (earlier && LIVE.has(earlier.state)) ask(`/api/plan/${earlier.id}`, "DELETE").catch(() => {});
    try {
      const plan = await ask("/api/plan", "POST", JSON.stringify(this.form.read()));
      this.asked = { id: plan.id, at: asked };
      history.replaceState(null, "", `#${plan.id}`);
      // On a phone the outcome is far below the button.
      if (find("#outcome").getBoundingClientRect().top > innerHeight) find("#outcome").scrollIntoView();
      await this.watch(plan);
    } catch (error) {
      this.fault(error.faults || [String(error)]);
    }
  }

  async cancel() {
    if (this.plan) this.take(await ask(`/api/plan/${this.plan.id}`, "DELETE"));
  }

  /** Show an earlier plan, and go on with it if it is still at work. */
  async follow(id) {
    if (id) {
      try {
        const plan = await ask(`/api/plan/${id}`);
        this.form.write(plan.request);
        this.watch(plan);
        return;
      } catch (error) {
        this.fault(error.faults || [String(error)]);
      }
    }
    this.listPlans();
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
        if (this.plan?.id === plan.id) this.fault(error.faults || [String(error)]);
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
    if (plan.state !== before?.state && plan.faults.length) this.fault(plan.faults);
    this.show();
    if (plan.sides && !before?.sides) this.chart.reveal(lines(plan.sides).flatMap(({ line }) => line.map(([lon, lat]) => [lat, lon])));
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
    find("#sides").replaceChildren(...(plan.sides ? sideCards(plan.sides) : []));
    const warnings = plan.sides ? plan.sides.warnings : [];
    find("#warnings").hidden = !warnings.length;
    find("#warnings").replaceChildren(...warnings.map((one) => make("p", { dir: "auto" }, `Not the current that was asked for. ${one}.`)));
    this.chart.showRoutes(plan.sides ? lines(plan.sides) : plan.drafts.map((line) => ({ line, kind: "draft", season: 0 })));
    this.time(plan);
    find("#results").hidden = plan.state !== "done";
    if (plan.state === "done") {
      find("#report").href = `/plan/${plan.id}/report.html`;
      find("#download").href = `/api/plan/${plan.id}/files.zip`;
    }
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
    if (text === this.spoken && find("#status").textContent === text) return;
    find("#status").textContent = text;
    if (!this.chart.corners) this.spoken = text;
  }

  async listPlans() {
    const plans = await ask("/api/plan").catch(() => []);
    find("#earlier").hidden = plans.length === 0;
    find("#plans").replaceChildren(...plans.map((plan) => planRow(plan, {
      isShown: plan.id === this.plan?.id,
      isCompared: plan.id === this.other?.id,
      show: () => { history.replaceState(null, "", `#${plan.id}`); this.fault([]); this.follow(plan.id); },
      compare: () => this.with(plan.id),
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
    const theirs = isBoth ? lines(this.other.sides).filter(({ kind }) => kind === "best") : [];
    this.chart.showRoutes(theirs.map((one) => ({ ...one, kind: "other-plan" })), this.chart.other);
  }

  async copy() {
    const command = find("#command");
    command.select();
    try {
      await navigator.clipboard.writeText(command.value);
      this.say("The command is copied.");
    } catch {
      this.say("Press Ctrl and C: the command is selected.");
    }
  }
}

function statusText(plan) {
  const ways = plan.drafts.length ? ` ${plan.drafts.length === 1 ? "One way is" : `${plan.drafts.length} ways are`} found.` : "";
  switch (plan.state) {
    case "waiting": return "Waits for its turn.";
    case "running": return plan.sides && plan.stages.at(-1) === "write" ? "All sides are found; the files are being written." : `At work: ${STAGES[plan.stages.at(-1)] || "begins"}${plan.detail ? ` – ${plan.detail}` : ""}.${ways}`;
    case "cancelled": return "Cancelled.";
    case "failed": return "No plan: see the faults above the button.";
    default: return `Planned in ${plan.seconds.toFixed(1)} s.`;
  }
}

new Desk().open();
