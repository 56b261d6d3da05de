// Answers of the whole scene: egosplat/query/relevancy.py and things.py on the palette.

// Relevancy of each palette entry of each level: sigmoid(t (s_q - max_c s_c)).
function paletteRelevancy(scene, vector) {
  const { channels, paletteSize, facts } = scene;
  scene.canonicalFit ??= scene.palette.map((entries) => bestFits(entries, scene.canonical, channels, paletteSize));
  return scene.palette.map((entries, level) =>
    Float32Array.from({ length: paletteSize }, (_, entry) => {
      if (Number.isNaN(scene.canonicalFit[level][entry])) return 0;
      const fit = dot(entries, entry * channels, vector) - scene.canonicalFit[level][entry];
      return 1 / (1 + Math.exp(-facts.query.temperature * fit));
    }));
}

// NaN for an entry without a feature.
function bestFits(entries, vectors, channels, size) {
  return Float64Array.from({ length: size }, (_, entry) => {
    const feature = entries.subarray(entry * channels, (entry + 1) * channels);
    return feature.some((value) => value !== 0) ? Math.max(...vectors.map((vector) => dot(feature, 0, vector))) : NaN;
  });
}

function dot(values, from, vector) {
  let sum = 0;
  for (let channel = 0; channel < vector.length; channel++) sum += values[from + channel] * vector[channel];
  return sum;
}

// Relevancy of each Gaussian at each level; 0 where it has no code or no frame shows it.
function gaussianRelevancy(scene, ofEntries) {
  return ofEntries.map((relevancy, level) => {
    const index = scene.codeIndex[level], weight = scene.weights[level];
    return Float32Array.from({ length: scene.count }, (_, one) => (weight[one] > 0 ? relevancy[index[one]] : 0));
  });
}

// The things that match best, by decreasing score.
function findThings(scene, neighbors, relevancy, most) {
  const found = relevancy.flatMap((values, level) =>
    parts(scene, neighbors, values, level).map((members) => measured(scene, values, members, level)));
  found.sort((one, other) => other.score - one.score);
  const kept = [];
  for (const thing of found) {
    if (kept.length === most) break;
    if (!kept.some((other) => areSame(scene, thing, other))) kept.push(thing);
  }
  return kept;
}

// Connected sets of Gaussians whose averaged relevancy, normalized over the level, is above the threshold.
function parts(scene, neighbors, values, level) {
  const { count, weights } = scene, weight = weights[level], { nearest, segmentation_threshold, least } = scene.facts.query;
  const smooth = new Float32Array(count);
  let lowest = Infinity, peak = -Infinity;
  for (let one = 0; one < count; one++) {
    let sum = 0, total = 0;
    for (let place = one * nearest; place < (one + 1) * nearest; place++) {
      const other = neighbors[place];
      if (other >= count) continue;
      sum += weight[other] * values[other];
      total += weight[other];
    }
    smooth[one] = total > 0 ? sum / total : 0;
    if (weight[one] > 0) {
      lowest = Math.min(lowest, smooth[one]);
      peak = Math.max(peak, smooth[one]);
    }
  }
  const isMember = (one) => weight[one] > 0 && smooth[one] - lowest > segmentation_threshold * (peak - lowest);
  const members = [];
  for (let one = 0; one < count; one++) if (isMember(one)) members.push(one);
  return components(members, neighbors, nearest, count).filter((part) => part.length >= least);
}

function components(members, neighbors, nearest, count) {
  const parent = new Int32Array(count).fill(-1);
  for (const one of members) parent[one] = one;
  const root = (one) => {
    while (parent[one] !== one) one = parent[one] = parent[parent[one]];
    return one;
  };
  for (const one of members)
    for (let place = one * nearest; place < (one + 1) * nearest; place++) {
      const other = neighbors[place];
      if (other < count && parent[other] >= 0) parent[root(one)] = root(other);
    }
  const groups = new Map();
  for (const one of members) {
    const group = root(one);
    if (!groups.has(group)) groups.set(group, []);
    groups.get(group).push(one);
  }
  return [...groups.values()];
}

function measured(scene, values, members, level) {
  const weight = scene.weights[level], center = [0, 0, 0];
  let total = 0, fit = 0;
  for (const one of members) {
    total += weight[one];
    fit += weight[one] * values[one];
    for (let axis = 0; axis < 3; axis++) center[axis] += weight[one] * scene.means[3 * one + axis];
  }
  const shown = scene.views.map(({ share }) => members.reduce((sum, one) => sum + share[one], 0));
  const view = shown.indexOf(Math.max(...shown));
  const box = scene.facts.query.box_filter ** 2;
  return {
    members, level,
    relevancy: fit / total,
    share: shown[view],
    score: ((fit / total) * shown[view]) / (shown[view] + box),
    frame: scene.views[view].frame,
    center: center.map((sum) => sum / total),
    size: [0, 1, 2].map((axis) => extent(scene, weight, members, axis)),
  };
}

// Side of the box that leaves out the outermost 2 % of the weight at both ends.
function extent(scene, weight, members, axis) {
  const sorted = members.map((one) => [scene.means[3 * one + axis], weight[one]]).sort((a, b) => a[0] - b[0]);
  const total = sorted.reduce((sum, [, share]) => sum + share, 0);
  const at = (quantile) => {
    let below = 0;
    return (sorted.find(([, share]) => (below += share) >= quantile * total) ?? sorted[sorted.length - 1])[0];
  };
  return at(0.98) - at(0.02);
}

// Whether two things are one: they share Gaussians, the box of one holds the middle of the other, or both are of one instance.
function areSame(scene, one, other) {
  const apart = one.center.map((value, axis) => 2 * Math.abs(value - other.center[axis]));
  if ([one, other].some(({ size }) => size.every((side, axis) => apart[axis] <= side))) return true;
  const own = instanceOf(scene, one);
  if (own && own === instanceOf(scene, other)) return true;
  const weight = (members) =>
    members.reduce((sum, member) => sum + Math.max(...scene.weights.map((level) => level[member])), 0);
  const mine = new Set(one.members);
  const common = weight(other.members.filter((member) => mine.has(member)));
  return common > scene.facts.query.same * Math.min(weight(one.members), weight(other.members));
}

// The instance of the coarsest level that has more than half of a thing; 0 for none.
function instanceOf(scene, { members }) {
  const shares = new Map(), numbers = scene.instance?.at(-1);
  if (!numbers) return 0;
  let total = 0;
  for (const one of members) {
    const weight = Math.max(...scene.weights.map((level) => level[one]));
    shares.set(numbers[one], (shares.get(numbers[one]) ?? 0) + weight);
    total += weight;
  }
  return [...shares].find(([, share]) => share > 0.5 * total)?.[0] ?? 0;
}

// Which words of the list name something else than a phrase: no synonym, no kind of it nor what it is a kind of, and no part of these.
function otherMeanings(scene, phrase, vector) {
  const { words, query } = scene.facts, isKind = (one, word) => ` ${one}`.endsWith(` ${word}`);
  phrase = phrase.normalize("NFKC").toLowerCase();
  const alike = [phrase, ...words.filter((word, number) =>
    dot(scene.wordVectors[number], 0, vector) >= query.synonym || isKind(phrase, word) || isKind(word, phrase))];
  const parts = Object.entries(query.parts).flatMap(([whole, names]) => (alike.some((one) => isKind(one, whole)) ? names : []));
  return words.map((word) => !alike.includes(word) && !parts.includes(word));
}

// Grades: egosplat/query/grades.py. What a thing is graded by is its probability, or without a calibration its score.
function ratingOf(scene, thing, things, others) {
  const { calibration } = scene.facts.query;
  if (!calibration) return thing.score;
  const fits = others.map((isOther, number) => (isOther ? logOdds(wordFit(scene, thing, number)) : -Infinity));
  const best = Math.max(...fits), fit = logOdds(thing.relevancy);
  const next = Math.max(0, ...things.filter((other) => other !== thing).map((other) => other.score));
  const evidence = { apart: thing.score - next, size: Math.log(Math.max(thing.share, 1e-9)), lead: fit - (best > -Infinity ? best : 0) };
  const sum = Object.entries(calibration.weights).reduce((part, [name, weight]) => part + weight * evidence[name], calibration.intercept);
  return 1 / (1 + Math.exp(-sum));
}

// Mean relevancy of a thing's Gaussians to a word of the page's list.
function wordFit(scene, thing, number) {
  const relevancy = wordRelevancy(scene, number)[thing.level], index = scene.codeIndex[thing.level], weight = scene.weights[thing.level];
  let sum = 0, total = 0;
  for (const one of thing.members) {
    sum += weight[one] * relevancy[index[one]];
    total += weight[one];
  }
  return sum / total;
}

function logOdds(p) {
  const inside = Math.min(Math.max(p, 1e-6), 1 - 1e-6);
  return Math.log(inside / (1 - inside));
}

function gradeOf(scene, rating) {
  const { calibration, min_score, ...limits } = scene.facts.query, { found, guess } = calibration ? limits : { found: min_score, guess: min_score };
  return rating >= found ? "found" : rating >= guess ? "best guess" : "not found";
}

// The verdict on a phrase that is not on the page's list, where no server judges it: egosplat/query/grades.py on the page's data.
function judge(scene, neighbors, relevancy, phrase, vector) {
  const things = findThings(scene, neighbors, relevancy, 3), [best] = things, others = otherMeanings(scene, phrase, vector);
  for (const thing of things) thing.rating = ratingOf(scene, thing, things, others);
  const grade = best ? gradeOf(scene, best.rating) : "not found", { min_score, calibration } = scene.facts.query;
  const shown = grade === "not found" ? [] : things.filter((thing) => gradeOf(scene, thing.rating) === grade);
  const below = calibration ? "not found: nothing here looks like it" : `not found: the best match is below ${[min_score.toFixed(2), String(min_score)].sort((a, b) => b.length - a.length)[0]}`;
  const coded = scene.codeShare.some((share) => share.some((value) => value > 0));
  const nothing = coded ? "not found: nothing here looks like it" : "no Gaussian of the scene has a code";
  return { things: shown, grade, level: best?.level, score: best?.score ?? 0, rating: best?.rating ?? 0, why: shown.length ? null : best ? below : nothing };
}

// Letters of the longest text that is worth splitting or sending.
const LONGEST = 2000;

// A phrase without characters that nobody sees, and with single spaces.
const cleanPhrase = (phrase) => phrase.replace(/\s+/gu, " ").replace(/[\p{Cc}\p{Cf}]/gu, "").trim();

// A number with two decimals, for which the verdict is the same.
function shownFigure(value, verdict) {
  const near = [0, -0.01, 0.01].map((step) => Number((Number(value.toFixed(2)) + step).toFixed(2)));
  return (near.find((one) => verdict(one) === verdict(value)) ?? value).toFixed(2);
}

// A phrase without what asks for it, or the reason why it is not answered here: egosplat/query/reading.py reads by the same patterns.
function readPhrase({ reading, taught }, phrase) {
  const matches = (name, text) => new RegExp(reading[name], "iu").test(text);
  const without = (name, text) => text.replace(new RegExp(reading[name], "iu"), "").trim() || text;
  if (/^["\u201c].+["\u201d]$/u.test(phrase)) return { phrase: phrase.slice(1, -1) };
  const parts = phrase.split(new RegExp(reading.list, "iu")).filter(Boolean);
  if (parts.length > 1 && !matches("relation", phrase) && !matches("look", parts[0])) return { why: `several things: ask for one at a time, such as ${shortened(parts[0])}` };
  for (let before = ""; phrase !== before;) {
    before = phrase;
    phrase = without("trail", phrase);
    if (phrase === before) phrase = without("lead", phrase);
  }
  if (matches("relation", phrase) || matches("anything", phrase)) return { why: "egosplat view answers where things stand, and what is there; this page answers names of things" };
  const singular = (word) => reading.plurals.map(([end, own]) => word.replace(new RegExp(end, "iu"), own)).find((one) => one !== word && taught.includes(one.toLowerCase()));
  if (taught) phrase = phrase.replace(/[\p{L}\p{N}]+/gu, (word) => (taught.includes(word.toLowerCase()) || matches("pairs", word) ? word : singular(word) ?? word));
  return { phrase };
}

// The vector of a clean phrase with its verdict, if it is known, or the reason why it has none; and how it was read, if otherwise.
async function encodePhrase(scene, tower, phrase) {
  const { words, answers, taught } = scene.facts, { asking } = document.documentElement.dataset;
  if (!phrase) return { why: "Type the name of a thing." };
  if (!/[\p{L}\p{N}]/u.test(phrase)) return { why: "The query holds no word." };
  // As in Python, where ftfy makes wide letters plain.
  phrase = phrase.normalize("NFKC");
  const known = words.indexOf(phrase.toLowerCase());
  if (known >= 0) return { vector: scene.wordVectors[known], answer: answers[known] };
  if (phrase.length > LONGEST) return { why: "too long: shorten it" };
  if (asking) return askServer(asking, phrase);
  const { phrase: read, why } = readPhrase(scene.facts, phrase);
  if (why) return { why };
  if (read !== phrase) return { ...(await encodePhrase(scene, tower, read)), read };
  if (!tower) return { why: `not on the page's list of ${words.length} words; egosplat view answers any words` };
  const tokens = tower.tokenize(phrase), limit = tower.facts.context - 2;
  if (tokens.length > limit) return { why: `too long: the model reads ${limit} tokens; shorten it` };
  const untaught = taught ? (phrase.toLowerCase().match(/[\p{L}\p{N}]+/gu) ?? []).filter((word) => !taught.includes(word)) : [];
  if (untaught.length) {
    const named = [...new Set(untaught)].map((word) => `"${word}"`);
    return { why: `The models here were never taught the word${named.length > 1 ? "s" : ""} ${named.join(", ")}.` };
  }
  return { vector: tower.encode(tokens) };
}

// The server that the page came from has the scene.
async function askServer(address, phrase) {
  try {
    const { vector, answer, why, read } = await (await fetch(address + encodeURIComponent(phrase))).json();
    return why ? { why, read } : { vector: Float32Array.from(vector), answer, read };
  } catch {
    return { why: "egosplat view, which answers words, does not answer: is it still running?" };
  }
}
