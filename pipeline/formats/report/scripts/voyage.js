// The voyage: a clock that a button starts and a slider sets, and the figures of the moment.

const VOYAGE_SECONDS = 30;
// Without motion the vessel goes on in steps, each this long.
const STILL_STEP_SECONDS = 1.5;
const SPEAK_AFTER_MS = 700;

class Voyage {
  /** `onMove(now)` is called with the moment whenever it changes. */
  constructor(data, root, onMove) {
    this.planar = data.planar;
    this.onMove = onMove;
    this.button = root.querySelector("#play");
    this.slider = root.querySelector("#time");
    this.spoken = root.querySelector("#spoken");
    this.fields = new Map([...root.querySelectorAll("[data-now]")].map((field) => [field.dataset.now, field]));
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.share = 0;
    this.route = null;
    this.frame = 0;
    this.button.addEventListener("click", () => (this.frame ? this.pause() : this.play()));
    this.slider.addEventListener("input", () => {
      this.pause();
      this.set(this.slider.value / this.slider.max);
      this.speakSoon();
    });
  }

  /** Follow another route, as far along its time as the last one. */
  follow(route) {
    this.route = route;
    const idle = !route;
    this.button.disabled = idle;
    this.slider.disabled = idle;
    if (idle) this.pause();
    else this.set(this.share);
  }

  set(share) {
    this.share = share;
    if (!this.route) return;
    const now = moment(this.route, share);
    const whole = this.route.time[this.route.time.length - 1];
    this.slider.value = Math.round(share * this.slider.max);
    this.slider.setAttribute("aria-valuetext", `${spellTime(now.time, whole)} of ${spellTime(whole)}`);
    for (const [name, text] of Object.entries(this.words(now, whole))) this.fields.get(name).textContent = text;
    this.onMove(now, share);
  }

  /** The figures of the moment, spelt. */
  words(now, whole) {
    return {
      time: spellTime(now.time, whole),
      place: spellPlace(now, this.planar),
      course: spellCourse(now.course),
      speed: `${spellPlaces(now.speed, 2)} m/s`,
      current: spellCurrent(now.current),
      clearance: spellDistance(now.clearance),
      fuel: spellNumber(now.fuel),
      distance: spellDistance(now.distance),
    };
  }

  play() {
    if (this.share >= 1) this.set(0);
    this.button.querySelector("span").textContent = "Pause";
    this.button.classList.add("playing");
    let last = null;
    let owed = 0;
    const step = (stamp) => {
      const passed = last === null ? 0 : Math.min(0.25, (stamp - last) / 1000);
      last = stamp;
      owed += passed;
      const due = this.still.matches ? owed >= STILL_STEP_SECONDS : true;
      if (due) {
        this.set(Math.min(1, this.share + owed / VOYAGE_SECONDS));
        owed = 0;
      }
      if (this.share >= 1) this.pause();
      else this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
  }

  pause() {
    if (!this.frame) return;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.button.querySelector("span").textContent = "Play the voyage";
    this.button.classList.remove("playing");
    this.speakSoon();
  }

  /** Tell a screen reader where the vessel is, once it has stayed there for a moment. */
  speakSoon() {
    clearTimeout(this.speaking);
    this.speaking = setTimeout(() => {
      if (!this.route || this.frame) return;
      const whole = this.route.time[this.route.time.length - 1];
      const now = this.words(moment(this.route, this.share), whole);
      this.spoken.textContent =
        `After ${now.time}: ${now.place}, course ${now.course}, ${now.speed} over ground, ` +
        `current along ${now.current}, ${now.clearance} from land, fuel ${now.fuel}.`;
    }, SPEAK_AFTER_MS);
  }
}
