// The recording's cameras over the picture: the wearer's way, and frusta with photographs at some of its places.

// Length of a frustum in shares of the scene's reach, and the largest side of a photograph in shares of the window's.
const FRUSTUM = 0.05, LARGEST = 0.15;

class Cameras {
  constructor(canvas, scene, addresses, loaded) {
    this.canvas = canvas;
    this.scene = scene;
    this.drawn = [];
    const { facts, poses } = scene;
    this.way = facts.frames.map((_, row) => [3, 7, 11].map((entry) => poses[12 * row + entry]));
    this.reach = reach(scene.means, this.way);
    this.length = FRUSTUM * this.reach;
    this.frusta = facts.pictures.map(({ frame }, number) => {
      const image = new Image(), row = facts.frames.indexOf(frame);
      image.onload = loaded;
      image.src = addresses[number];
      return { row, image, eye: this.way[row], corners: corners(facts.camera, poses.subarray(12 * row, 12 * row + 12), this.length) };
    });
  }

  // onScreen: of a point, its window coordinates, or null behind the viewer; current: the row of the slider.
  draw(onScreen, viewer, [width, height], current) {
    const context = this.canvas.getContext("2d"), ratio = devicePixelRatio;
    [this.canvas.width, this.canvas.height] = [width, height].map((side) => Math.round(side * ratio));
    Object.assign(this.canvas.style, { width: `${width}px`, height: `${height}px` });
    const away = (point) => Math.hypot(...plus(point, viewer, -1));
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawWay(context, this.way.map((eye) => (away(eye) > this.length ? onScreen(eye) : null)));
    this.drawn = [];
    for (const one of this.frusta.sort((a, b) => away(b.eye) - away(a.eye))) {
      const apex = onScreen(one.eye), quad = one.corners.map(onScreen);
      // Whoever stands among the cameras would see nothing else.
      const isSmall = apex && quad.every(Boolean) && longestSide(quad) < LARGEST * Math.max(width, height);
      if (isSmall) this.drawn.push({ row: one.row, outline: drawFrustum(context, ratio, one.image, apex, quad, one.row === current) });
    }
  }

  drawWay(context, places) {
    context.beginPath();
    places.forEach((at, place) => at && (places[place - 1] ? context.lineTo(...at) : context.moveTo(...at)));
    context.strokeStyle = "rgba(255, 190, 60, .7)";
    context.stroke();
  }

  // The row of the nearest frustum at a point of the window; null for none.
  at(x, y) {
    const context = this.canvas.getContext("2d"), ratio = devicePixelRatio;
    return this.drawn.findLast(({ outline }) => context.isPointInPath(outline, x * ratio, y * ratio))?.row ?? null;
  }
}

// Median distance of the Gaussians from the middle of the way.
function reach(means, way) {
  const middle = [0, 1, 2].map((axis) => way.reduce((sum, eye) => sum + eye[axis], 0) / way.length);
  const stride = 3 * Math.ceil(means.length / 3000), away = [];
  for (let start = 0; start < means.length; start += stride) away.push(Math.hypot(...plus(means.subarray(start, start + 3), middle, -1)));
  return away.sort((a, b) => a - b)[away.length >> 1] ?? 1;
}

// The corners of what a camera sees at a depth: upper left and right, lower right and left of its picture.
function corners({ width, height, fx, fy, cx, cy }, pose, depth) {
  return [[0, 0], [width, 0], [width, height], [0, height]].map(([x, y]) => {
    const ray = [((x - cx) / fx) * depth, ((y - cy) / fy) * depth, depth];
    return [0, 1, 2].map((row) => inner(pose.subarray(4 * row, 4 * row + 3), ray) + pose[4 * row + 3]);
  });
}

const longestSide = (quad) => Math.max(...quad.map(([x, y], place) => Math.hypot(x - quad.at(place - 1)[0], y - quad.at(place - 1)[1])));

// Returns the outline of the photograph, for clicks.
function drawFrustum(context, ratio, image, apex, quad, isCurrent) {
  const [first, right, , below] = quad, [width, height] = [image.naturalWidth || 1, image.naturalHeight || 1];
  const outline = new Path2D(), edges = new Path2D();
  quad.forEach((corner, place) => (place ? outline.lineTo(...corner) : outline.moveTo(...corner)));
  outline.closePath();
  for (const corner of quad) edges.moveTo(...apex), edges.lineTo(...corner);
  context.strokeStyle = isCurrent ? "#fff" : "#ffbe3c";
  context.lineWidth = isCurrent ? 2 : 1;
  context.stroke(edges);
  context.save();
  // A small picture is flat enough for an affine map.
  context.setTransform(
    (ratio * (right[0] - first[0])) / width, (ratio * (right[1] - first[1])) / width,
    (ratio * (below[0] - first[0])) / height, (ratio * (below[1] - first[1])) / height, ratio * first[0], ratio * first[1],
  );
  context.drawImage(image, 0, 0);
  context.restore();
  context.stroke(outline);
  return outline;
}
