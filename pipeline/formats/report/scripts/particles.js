// The current as particles that drift with it, on a canvas above the arrows.

// Water for each particle, in square CSS pixels, and the largest number of particles.
const PARTICLE_AREA = 420;
const MAX_PARTICLES = 2200;
// Drift on the screen at the strongest current of the season, CSS pixels per second.
const FASTEST = 55;
// Range of the time that a particle lives, seconds, and longest step of its way.
const LIVES = [1.5, 4.5];
const MAX_STEP_S = 0.05;
// Share by which the trails fade in a second.
const FADING = 0.93;

const CurrentParticles = CurrentLayer.extend({
  options: { pane: "particles", className: "" },

  onAdd(map) {
    CurrentLayer.prototype.onAdd.call(this, map);
    this._watch = new IntersectionObserver(([entry]) => {
      this._seen = entry.isIntersecting;
      this._draw();
    });
    this._watch.observe(map.getContainer());
    map.getContainer().classList.add("flowing");
  },

  onRemove(map) {
    this._stop();
    this._watch.disconnect();
    this._canvas.remove();
    map.getContainer().classList.remove("flowing");
  },

  getEvents() {
    return { movestart: this._stop, zoomstart: this._stop, moveend: this._draw, resize: this._draw };
  },

  _stop() {
    cancelAnimationFrame(this._frame);
    this._canvas.width = 0;
  },

  _draw() {
    this._stop();
    if (!this._current || this._seen === false) return;
    const { context, whole: { x: width, y: height }, corner } = this._place(0);
    context.clip(chartOutline(this._map, this._chart, corner), "evenodd");
    const view = { ...this._lattice(corner), width, height, rate: FASTEST / this._limits[this._limits.length - 1] };
    const particles = Array.from({ length: Math.min(MAX_PARTICLES, (width * height) / PARTICLE_AREA) }, () => ({ left: 0 }));
    let last = null;
    const step = (stamp) => {
      this._move(context, view, particles, last === null ? 0 : Math.min(MAX_STEP_S, (stamp - last) / 1000));
      last = stamp;
      this._frame = requestAnimationFrame(step);
    };
    this._frame = requestAnimationFrame(step);
  },

  /** Move all particles by a step of `seconds`, and draw their ways. */
  _move(context, view, particles, seconds) {
    const { origin, pixels, width, height, rate } = view;
    context.globalCompositeOperation = "destination-out";
    context.globalAlpha = 1 - (1 - FADING) ** seconds;
    context.fillRect(0, 0, width, height);
    context.globalCompositeOperation = "source-over";
    context.globalAlpha = 1;
    const paths = this._limits.map(() => new Path2D());
    for (const particle of particles) {
      if (particle.left <= 0) {
        particle.x = Math.random() * width;
        particle.y = Math.random() * height;
        particle.left = LIVES[0] + Math.random() * (LIVES[1] - LIVES[0]);
      }
      const velocity = interpolatedCurrent(this._current, (origin.y - particle.y) / pixels, (particle.x - origin.x) / pixels);
      particle.left = velocity ? particle.left - seconds : 0;
      if (!velocity) continue;
      const [u, v] = velocity;
      const path = paths[speedClass(Math.hypot(u, v), this._limits)];
      path.moveTo(particle.x, particle.y);
      particle.x += rate * u * seconds;
      particle.y -= rate * v * seconds;
      path.lineTo(particle.x, particle.y);
    }
    context.lineWidth = 1.3;
    context.lineCap = "round";
    paths.forEach((path, kind) => {
      context.strokeStyle = this._colours(`speed${Math.min(kind + 1, this._limits.length - 1)}`);
      context.stroke(path);
    });
  },
});
