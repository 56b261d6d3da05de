// Mouse, touch and keyboard on the picture.

// Pixels that a pointer may move in a click, and the angles of a drag across the whole window, and of a key.
const STILL = 5, SWEEP = 2.2, TURN = 0.08;

class Controls {
  // on: { turn(right, down), shift(right, down), advance(share), step(right, up, forward), click(x, y), rest() }
  constructor(canvas, on) {
    this.canvas = canvas;
    this.on = on;
    this.pointers = new Map();
    this.keys = new Set();
    const listen = (name, act) => canvas.addEventListener(name, act, { passive: false });
    listen("pointerdown", (event) => this.down(event));
    listen("pointermove", (event) => this.moved(event));
    for (const name of ["pointerup", "pointercancel"]) listen(name, (event) => this.up(event, name === "pointerup"));
    listen("contextmenu", (event) => event.preventDefault());
    listen("wheel", (event) => this.wheel(event));
    listen("keydown", (event) => this.key(event, true));
    listen("keyup", (event) => this.key(event, false));
    listen("blur", () => this.keys.size && (this.keys.clear(), this.on.rest()));
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1) this.begun = { x: event.clientX, y: event.clientY, far: false, button: event.button };
    else this.begun.far = true;
    this.on.grasp(event.clientX, event.clientY);
  }

  moved(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY }, side = Math.max(innerWidth, innerHeight);
    if (Math.hypot(now.x - this.begun.x, now.y - this.begun.y) > STILL) this.begun.far = true;
    if (!this.begun.far) return;
    const x = (now.x - before.x) / side, y = (now.y - before.y) / side;
    if (this.pointers.size === 1) {
      if (this.begun.button === 2 || event.shiftKey) this.on.shift(x, y);
      else this.on.turn(SWEEP * x, SWEEP * y);
    } else this.pinch(event.pointerId, before, now, x, y);
    this.pointers.set(event.pointerId, now);
  }

  pinch(id, before, now, x, y) {
    const other = [...this.pointers].find(([number]) => number !== id)[1];
    const apart = (one) => Math.hypot(one.x - other.x, one.y - other.y) || 1;
    this.on.advance(1 - apart(before) / apart(now));
    this.on.shift(x / 2, y / 2);
  }

  up(event, ended) {
    if (!this.pointers.delete(event.pointerId) || this.pointers.size) return;
    if (ended && !this.begun.far && this.begun.button === 0) this.on.click(event.clientX, event.clientY);
    this.on.rest();
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    this.on.advance(Math.max(-0.3, Math.min(0.3, (-event.deltaY * lines) / 800)));
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.on.rest(), 200);
  }

  key(event, pressed) {
    const steps = {
      ArrowUp: [0, 0, 1], KeyW: [0, 0, 1], ArrowDown: [0, 0, -1], KeyS: [0, 0, -1], ArrowLeft: [-1, 0, 0], KeyA: [-1, 0, 0],
      ArrowRight: [1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0],
    };
    // A key that is let go moves no more, whatever is held with it by then.
    if (!pressed && this.keys.delete(event.code) && !this.keys.size) this.on.rest();
    if (pressed && event.code === "Enter") this.on.click(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    if (!pressed || !(event.code in steps) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.keys.add(event.code);
    // The system repeats a key that is held.
    for (const code of this.keys) {
      const [right, up, forward] = steps[code];
      if (event.shiftKey && code.startsWith("Arrow")) this.on.grasp(), this.on.turn(-TURN * right, TURN * forward);
      else this.on.step(right, up, forward);
    }
  }
}
