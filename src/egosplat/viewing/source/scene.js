// The scene as plain arrays: Gaussians, codes, what frames show.

function buildScene({ facts, arrays }) {
  // Queries know the Gaussians of what stays, the first ones; those of what rests for a while are drawn, too.
  const { count, drawn } = facts, levels = facts.levels.length;
  const values = (name) => arrays[name].values;
  const scene = {
    facts, count, drawn, levels,
    means: centers(facts, arrays),
    scales: new Float32Array(3 * drawn),
    covariances: new Float32Array(6 * drawn),
    radii: new Float32Array(drawn),
    opacities: new Float32Array(drawn),
    colors: rows(values("color"), 3, drawn, (byte) => lerp(facts.color_range, byte / 255)),
    bands: rows(values("bands"), 3 * facts.bands, drawn, (byte) => (byte / 127) * facts.band_limit),
    codeIndex: split(values("code_index"), levels, count),
    codeShare: split(values("code_share"), levels, count),
    sizeOdds: arrays.size_odds ? split(values("size_odds"), facts.size_words.length, arrays.size_odds.shape[1]) : null,
    instance: arrays.instance ? split(values("instance"), levels, count) : null,
    palette: split(values("palette"), levels, values("palette").length / levels),
    paletteSize: arrays.palette.shape[1],
    channels: arrays.palette.shape[2],
    wordVectors: split(values("word_vectors"), facts.words.length, arrays.word_vectors.shape[1]),
    canonical: split(values("canonical_vectors"), ...arrays.canonical_vectors.shape),
    carriedThings: facts.carried_things.map(readHistory),
    carriedVectors: arrays.carried_vectors ? split(values("carried_vectors"), ...arrays.carried_vectors.shape) : [],
    poses: values("poses"),
    pictures: values("pictures"),
    arrays,
  };
  for (const name of ["answers", "catalog"]) facts[name] = facts[name].map((answer) => readAnswer(facts, answer));
  for (let index = 0; index < drawn; index++) scene.opacities[index] = values("opacity")[index] / 255;
  shapes(scene, values("log_scale"), values("rotation"));
  seenShares(scene, values("visible"), values("seen"), values("seen_share"));
  return scene;
}

const lerp = ([low, high], share) => low + share * (high - low);

// (channels, count) quantized values -> (count, channels) float32.
function rows(quantized, channels, count, value) {
  const result = new Float32Array(channels * count);
  for (let channel = 0; channel < channels; channel++)
    for (let index = 0; index < count; index++)
      result[index * channels + channel] = value(quantized[channel * count + index]);
  return result;
}

const split = (values, parts, size) =>
  Array.from({ length: parts }, (_, part) => values.subarray(part * size, (part + 1) * size));

function centers(facts, arrays) {
  const count = facts.drawn, blocks = arrays.block_low.shape[1];
  const position = arrays.position.values, low = arrays.block_low.values, step = arrays.block_step.values;
  const means = new Float32Array(3 * count);
  for (let axis = 0; axis < 3; axis++)
    for (let index = 0; index < count; index++) {
      const block = axis * blocks + Math.floor(index / facts.block);
      means[3 * index + axis] = low[block] + position[axis * count + index] * step[block];
    }
  return means;
}

// Standard deviations, the largest of each Gaussian, and covariances (xx, xy, xz, yy, yz, zz).
function shapes(scene, logScale, rotation) {
  const { drawn: count, scales, covariances, radii } = scene, range = scene.facts.log_scale_range;
  for (let index = 0; index < count; index++) {
    const [w, x, y, z] = [0, 1, 2, 3].map((part) => rotation[part * count + index]);
    const norm = 2 / (w * w + x * x + y * y + z * z || 1);
    const turn = [
      1 - norm * (y * y + z * z), norm * (x * y - w * z), norm * (x * z + w * y),
      norm * (x * y + w * z), 1 - norm * (x * x + z * z), norm * (y * z - w * x),
      norm * (x * z - w * y), norm * (y * z + w * x), 1 - norm * (x * x + y * y),
    ];
    for (let axis = 0; axis < 3; axis++) {
      const scale = Math.exp(lerp(range, logScale[axis * count + index] / 255));
      scales[3 * index + axis] = scale;
      radii[index] = Math.max(radii[index], scale);
    }
    const variance = [0, 1, 2].map((axis) => scales[3 * index + axis] ** 2);
    const entry = (row, column) =>
      turn[3 * row] * turn[3 * column] * variance[0] +
      turn[3 * row + 1] * turn[3 * column + 1] * variance[1] +
      turn[3 * row + 2] * turn[3 * column + 2] * variance[2];
    covariances.set([entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)], 6 * index);
  }
}

// The frame of the view that shows most Gaussians: a view of much of the scene, and not of a wall.
function mostSeen(views) {
  const counts = views.map(({ share }) => share.reduce((count, one) => count + (one > 0), 0));
  return views[counts.indexOf(Math.max(...counts))]?.frame;
}

// The mean share of the views that each Gaussian fills, and for each stored view its Gaussians with their shares.
function seenShares(scene, visible, bits, shares) {
  const { count, facts } = scene, stride = Math.ceil(count / 8);
  const value = (byte, smallest) => (byte ? smallest * facts.share_step ** (byte - 1) : 0);
  scene.visible = Float32Array.from(visible, (byte) => value(byte, facts.mean_smallest));
  let next = 0;
  scene.views = facts.seen_frames.map((frame, view) => {
    const share = new Float32Array(count);
    for (let index = 0; index < count; index++)
      if (bits[view * stride + (index >> 3)] & (128 >> (index & 7)))
        share[index] = value(shares[next++], facts.share_smallest);
    return { frame, share };
  });
  scene.weights = scene.codeShare.map((share) => scene.visible.map((seen, index) => (seen * share[index]) / 255));
}
