// Runs in workers: the order of depths, and the nearest neighbors.

let means = null;

onmessage = ({ data }) => {
  if (data.means) means = data.means;
  if (data.sort) {
    const order = byDepth(data.sort);
    postMessage({ order }, [order.buffer]);
  }
  if (data.neighbors) {
    const { radii, nearest, reach } = data.neighbors, found = findNeighbors(radii, nearest, reach);
    postMessage({ neighbors: found }, [found.buffer]);
  }
};

// Indices from the farthest to the nearest; row is (x, y, z, offset) of the camera's forward axis.
function byDepth([x, y, z, offset]) {
  const count = means.length / 3, depths = new Float32Array(count);
  for (let one = 0; one < count; one++)
    depths[one] = x * means[3 * one] + y * means[3 * one + 1] + z * means[3 * one + 2] + offset;
  const bits = new Uint32Array(depths.buffer);
  // Order-preserving keys of floats, inverted: the farthest has the smallest.
  for (let one = 0; one < count; one++) bits[one] = bits[one] & 0x80000000 ? bits[one] : bits[one] ^ 0x7fffffff;
  let from = Uint32Array.from({ length: count }, (_, one) => one), to = new Uint32Array(count);
  for (const shift of [0, 16]) {
    const starts = new Uint32Array(65537);
    for (let one = 0; one < count; one++) starts[((bits[one] >>> shift) & 65535) + 1]++;
    for (let key = 0; key < 65536; key++) starts[key + 1] += starts[key];
    for (let place = 0; place < count; place++) to[starts[(bits[from[place]] >>> shift) & 65535]++] = from[place];
    [from, to] = [to, from];
  }
  return from;
}

// For each Gaussian its nearest ones, itself first; 0xffffffff for those whose extents do not overlap its own.
function findNeighbors(radii, nearest, reach) {
  const count = means.length / 3, found = new Uint32Array(count * nearest).fill(0xffffffff);
  const order = Uint32Array.from({ length: count }, (_, one) => one), axes = new Uint8Array(count);
  buildTree(order, axes, 0, count);
  const best = new Float64Array(nearest), who = new Uint32Array(nearest);
  for (let one = 0; one < count; one++) {
    best.fill(Infinity);
    searchTree(order, axes, 0, count, one, best, who);
    for (let place = 0; place < nearest; place++)
      if (best[place] < Infinity && Math.sqrt(best[place]) <= reach * (radii[one] + radii[who[place]]))
        found[one * nearest + place] = who[place];
  }
  return found;
}

const LEAF = 12;

// A k-d tree in place: the median of each range splits it along its widest axis.
function buildTree(order, axes, from, to) {
  if (to - from <= LEAF) return;
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let place = from; place < to; place++)
    for (let axis = 0; axis < 3; axis++) {
      const value = means[3 * order[place] + axis];
      if (value < low[axis]) low[axis] = value;
      if (value > high[axis]) high[axis] = value;
    }
  const spans = [0, 1, 2].map((axis) => high[axis] - low[axis]);
  const axis = spans.indexOf(Math.max(...spans)), middle = (from + to) >> 1;
  select(order, axis, from, to - 1, middle);
  axes[middle] = axis;
  buildTree(order, axes, from, middle);
  buildTree(order, axes, middle + 1, to);
}

// Hoare's selection: the element of the given rank at its place, smaller ones before it.
function select(order, axis, left, right, rank) {
  while (left < right) {
    const pivot = means[3 * order[(left + right) >> 1] + axis];
    let low = left, high = right;
    while (low <= high) {
      while (means[3 * order[low] + axis] < pivot) low++;
      while (means[3 * order[high] + axis] > pivot) high--;
      if (low <= high) {
        const swapped = order[low];
        order[low++] = order[high];
        order[high--] = swapped;
      }
    }
    if (rank <= high) right = high;
    else if (rank >= low) left = low;
    else return;
  }
}

function searchTree(order, axes, from, to, one, best, who) {
  if (to - from <= LEAF) {
    for (let place = from; place < to; place++) consider(order[place], one, best, who);
    return;
  }
  const middle = (from + to) >> 1, axis = axes[middle];
  const apart = means[3 * one + axis] - means[3 * order[middle] + axis];
  consider(order[middle], one, best, who);
  const before = apart < 0;
  searchTree(order, axes, before ? from : middle + 1, before ? middle : to, one, best, who);
  if (apart * apart <= best[best.length - 1])
    searchTree(order, axes, before ? middle + 1 : from, before ? to : middle, one, best, who);
}

function consider(other, one, best, who) {
  const x = means[3 * other] - means[3 * one], y = means[3 * other + 1] - means[3 * one + 1], z = means[3 * other + 2] - means[3 * one + 2];
  const distance = x * x + y * y + z * z;
  let place = best.length - 1;
  if (distance >= best[place]) return;
  for (; place > 0 && best[place - 1] > distance; place--) {
    best[place] = best[place - 1];
    who[place] = who[place - 1];
  }
  best[place] = distance;
  who[place] = other;
}
