// Playback of the route: a clock that a button starts and a slider sets, and the vessel at that time.

const PLAYBACK_SECONDS = 30;
// With reduced motion the vessel moves in steps of this duration.
const STEP_SECONDS = 1.5;
const SPEAK_AFTER_MS = 700;

class Playback {
  /** `onMove(now, share)` is called with the vessel's state whenever it changes. */
  constructor(root, onMove) {
    this.onMove = onMove;
    this.button = root.querySelector("#play");
    this.slider = root.querySelector("#time");
    this.spoken = root.querySelector("#spoken");
    this.fields = new Map([...root.querySelectorAll("[data-now]")].map((field) => [field.dataset.now, field]));
    this.reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
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

  /** Follow another route of a map's data, at the same share of its time as the last one. */
  follow(route, { planar, noGoName }) {
    Object.assign(this, { route, planar, noGoName });
    this.button.disabled = this.slider.disabled = !route;
    if (!route) this.pause();
    else this.set(this.share);
  }

  set(share) {
    this.share = share;
    if (!this.route) return;
    const now = stateAt(this.route, share);
    const whole = this.route.time[this.route.time.length - 1];
    this.slider.value = Math.round(share * this.slider.max);
    this.slider.setAttribute("aria-valuetext", `${formatTime(now.time, whole)} of ${formatTime(whole)}`);
    for (const [name, text] of Object.entries(this.texts(now, whole))) this.fields.get(name).textContent = text;
    this.onMove(now, share);
  }

  /** The vessel's figures as text. */
  texts(now, whole) {
    return {
      time: formatTime(now.time, whole),
      place: formatPosition(now, this.planar),
      course: formatCourse(now.course),
      speed: formatSpeed(now.speed),
      current: formatCurrent(now.current),
      clearance: formatClearance(now.clearance),
      waves: now.waves === null ? "" : `${now.waves.toFixed(1)} m`,
      wind: now.wind === null ? "" : formatSpeed(now.wind),
      fuel: `${formatNumber(now.fuel)} ${this.route.fuelUnit}`,
      distance: formatDistance(now.distance),
    };
  }

  play() {
    if (this.share >= 1) this.set(0);
    this.button.querySelector("span").textContent = "Pause";
    this.button.classList.add("playing");
    let [last, waited] = [null, 0];
    const step = (stamp) => {
      const passed = last === null ? 0 : Math.min(0.25, (stamp - last) / 1000);
      last = stamp;
      waited += passed;
      if (!this.reducedMotion.matches || waited >= STEP_SECONDS) {
        this.set(Math.min(1, this.share + waited / PLAYBACK_SECONDS));
        waited = 0;
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

  /** Announce the vessel's position to a screen reader, once it has stayed there for a moment. */
  speakSoon() {
    clearTimeout(this.speaking);
    this.speaking = setTimeout(() => {
      if (!this.route || this.frame) return;
      const whole = this.route.time[this.route.time.length - 1];
      const now = this.texts(stateAt(this.route, this.share), whole);
      this.spoken.textContent =
        `After ${now.time}: ${now.place}, course ${now.course}, ${now.speed} over ground, ` +
        `current along course ${now.current}, ${now.clearance} from ${this.noGoName}, fuel ${now.fuel}.`;
    }, SPEAK_AFTER_MS);
  }
}
