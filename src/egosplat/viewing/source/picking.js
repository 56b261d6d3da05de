// What a pixel shows: the Gaussians along its ray with their weights, computed as the shader draws them.

// x, y in pixels of an image of size (width, height); no Gaussians where nothing is drawn.
function pick(scene, camera, focal, [width, height], x, y) {
  const { count, means, radii, opacities, facts } = scene, raster = facts.raster, hits = [];
  const { right, down, forward, eye } = camera;
  const across = x - width / 2, below = y - height / 2;
  for (let one = 0; one < count; one++) {
    const dx = means[3 * one] - eye[0], dy = means[3 * one + 1] - eye[1], dz = means[3 * one + 2] - eye[2];
    const z = dx * forward[0] + dy * forward[1] + dz * forward[2];
    if (z < facts.near) continue;
    const u = (focal * (dx * right[0] + dy * right[1] + dz * right[2])) / z;
    const v = (focal * (dx * down[0] + dy * down[1] + dz * down[2])) / z;
    // No Gaussian reaches farther than this: 3.33 standard deviations, stretched towards the border.
    const reach = 2 + ((3.4 * radii[one] * focal) / z) * (1 + Math.max(width, height) / focal);
    if (Math.abs(u - across) > reach || Math.abs(v - below) > reach) continue;
    const alpha = alphaAt(scene, camera, focal, [width, height], one, [u, v, z], across, below, raster);
    if (alpha >= raster.least_alpha) hits.push({ one, z, alpha });
  }
  hits.sort((a, b) => a.z - b.z);
  let left = 1, depth = 0;
  for (const hit of hits) {
    hit.weight = left * hit.alpha;
    left *= 1 - hit.alpha;
    depth += hit.weight * hit.z;
  }
  if (left > 0.5) return null;
  depth /= 1 - left;
  const ray = plus(plus(forward.map((value) => value), right, across / focal), down, below / focal);
  return { hits, depth, point: plus(eye, ray, depth) };
}

function alphaAt(scene, camera, focal, [width, height], one, [u, v, z], x, y, raster) {
  const c = scene.covariances.subarray(6 * one, 6 * one + 6);
  const times = (a) => [c[0] * a[0] + c[1] * a[1] + c[2] * a[2], c[1] * a[0] + c[3] * a[1] + c[4] * a[2], c[2] * a[0] + c[4] * a[1] + c[5] * a[2]];
  const clamp = (value, most) => Math.max(-most, Math.min(most, value));
  const slopeX = clamp(u / focal, ((0.5 * width) / focal) * (1 + raster.margin));
  const slopeY = clamp(v / focal, ((0.5 * height) / focal) * (1 + raster.margin));
  const rowU = plus(camera.right, camera.forward, -slopeX).map((value) => (value * focal) / z);
  const rowV = plus(camera.down, camera.forward, -slopeY).map((value) => (value * focal) / z);
  let uu = inner(rowU, times(rowU)), vv = inner(rowV, times(rowV));
  const uv = inner(rowU, times(rowV));
  uu += raster.blur;
  vv += raster.blur;
  const area = uu * vv - uv * uv, dx = x - u, dy = y - v;
  const sigma = (0.5 * (vv * dx * dx + uu * dy * dy) - uv * dx * dy) / area;
  return Math.min(scene.opacities[one] * Math.exp(-sigma), raster.most_alpha);
}

// Relevancy of a Gaussian to a word of the page's list, for each level; that of the palette is computed once.
function wordRelevancy(scene, number) {
  return paletteOfWord(scene, number).map((entries, level) => relevancyAt(scene, entries, level, sizesTell(scene, scene.facts.words[number])));
}

function paletteOfWord(scene, number) {
  scene.paletteOfWord ??= [];
  return (scene.paletteOfWord[number] ??= paletteRelevancy(scene, scene.wordVectors[number]));
}

// The words that fit what a pixel shows, best first, each at the level where it fits best; and its instances.
function describe(scene, found) {
  const best = scene.facts.words.map((word, number) => ({ word, ...bestLevel(scene, found.hits, wordRelevancy(scene, number)) }));
  best.sort((one, other) => other.score - one.score);
  return { words: best, instances: instancesAt(scene, found.hits), point: found.point };
}

function bestLevel(scene, hits, relevancy) {
  const fits = relevancy.map((of, level) => {
    let fit = 0, total = 0;
    for (const { one, weight } of hits) {
      const share = (weight * scene.codeShare[level][one]) / 255;
      fit += share * of(one);
      total += share;
    }
    return total > 0 ? fit / total : 0;
  });
  const score = Math.max(...fits);
  return { score, level: fits.indexOf(score) };
}

// The instance with the largest weight at each level; null for none.
function instancesAt(scene, hits) {
  if (!scene.instance) return null;
  return scene.instance.map((numbers) => {
    const weights = new Map();
    for (const { one, weight } of hits) weights.set(numbers[one], (weights.get(numbers[one]) ?? 0) + weight);
    const [number] = [...weights].sort((a, b) => b[1] - a[1])[0] ?? [0];
    return number ? number - 1 : null;
  });
}
