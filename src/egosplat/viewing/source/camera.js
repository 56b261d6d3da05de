// A camera with OpenCV's axes: x right, y down, z forward.

const plus = (a, b, times = 1) => [a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]];
const inner = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / (Math.hypot(...a) || 1));

// Rotate v about a unit axis (Rodrigues).
function turned(v, axis, angle) {
  const cosine = Math.cos(angle), along = inner(v, axis) * (1 - cosine);
  return plus(plus(v.map((value) => value * cosine), cross(axis, v), Math.sin(angle)), axis, along);
}

class SceneCamera {
  constructor(up) {
    this.up = unit(up);
    this.eye = [0, 0, 0];
    this.setForward([0, 0, 1]);
  }

  // 12 numbers, rows of camera_to_world.
  setPose(pose) {
    const column = (number) => [pose[number], pose[4 + number], pose[8 + number]];
    [this.right, this.down, this.forward, this.eye] = [0, 1, 2, 3].map(column);
  }

  pose() {
    return [0, 1, 2].flatMap((row) => [this.right[row], this.down[row], this.forward[row], this.eye[row]]);
  }

  // Look along a direction with a level horizon.
  setForward(direction) {
    this.forward = unit(direction);
    const level = cross(this.forward, this.up);
    this.right = unit(Math.hypot(...level) > 1e-3 ? level : this.right ?? [1, 0, 0]);
    this.down = cross(this.forward, this.right);
  }

  lookAt(eye, target) {
    this.eye = [...eye];
    this.setForward(plus(target, eye, -1));
  }

  // Turn by angles to the right and down; about a point if one is given, else on the spot.
  turn(right, down, pivot = null) {
    const limit = Math.acos(Math.max(-1, Math.min(1, inner(this.forward, this.up))));
    // Never over the zenith or the nadir.
    const pitch = Math.max(-(limit - 0.05), Math.min(Math.PI - limit - 0.05, down));
    const apply = (v) => turned(turned(v, this.right, -pitch), this.up, -right);
    const from = pivot && apply(plus(this.eye, pivot, -1));
    this.setForward(apply(this.forward));
    if (pivot) this.eye = plus(pivot, from);
  }

  move(right, down, forward) {
    this.eye = plus(plus(plus(this.eye, this.right, right), this.down, down), this.forward, forward);
  }

  toCamera(point) {
    const from = plus(point, this.eye, -1);
    return [inner(from, this.right), inner(from, this.down), inner(from, this.forward)];
  }
}
