// Answers of the whole scene: egosplat/query/relevancy.py and things.py on the palette.

// Relevancy of each palette entry of each level to a phrase: sigmoid(t (s_q - s_c)), of the best canonical phrase; 0 without a feature.
function paletteRelevancy(scene, vector) {
  const { channels, paletteSize, canonical, facts: { query } } = scene;
  return scene.palette.map((entries) => Float32Array.from({ length: paletteSize }, (_, entry) => {
    const feature = entries.subarray(entry * channels, (entry + 1) * channels);
    if (feature.every((value) => value === 0)) return 0;
    const fit = dot(feature, 0, vector) - Math.max(...canonical.map((other) => dot(feature, 0, other)));
    return 1 / (1 + Math.exp(-query.temperature * fit));
  }));
}

function dot(values, from, vector) {
  let sum = 0;
  for (let channel = 0; channel < vector.length; channel++) sum += values[from + channel] * vector[channel];
  return sum;
}

// Relevancy of each Gaussian at each level; 0 where it has no code or no frame shows it.
function gaussianRelevancy(scene, vector, phrase) {
  const told = sizesTell(scene, phrase);
  return paletteRelevancy(scene, vector).map((entries, level) => {
    const weight = scene.weights[level], fit = relevancyAt(scene, entries, level, told);
    return Float32Array.from({ length: scene.count }, (_, one) => (weight[one] > 0 ? fit(one) : 0));
  });
}

// What the size of each instance adds to the log-odds of a phrase, by the longest of its ends with a size: egosplat/query/sizes.py.
function sizesTell(scene, phrase) {
  const words = phrase.toLowerCase().split(/\s+/u);
  const ends = words.map((_, first) => scene.facts.size_words.indexOf(words.slice(first).join(" ")));
  return scene.sizeOdds?.[ends.find((row) => row >= 0)];
}

// The relevancy of a Gaussian at a level, of those of the palette's entries, and what sizes tell.
function relevancyAt(scene, entries, level, told) {
  const index = scene.codeIndex[level], instance = scene.instance?.[level];
  if (!told) return (one) => entries[index[one]];
  return (one) => {
    const fit = entries[index[one]];
    return fit > 0 ? fit / (fit + (1 - fit) * Math.exp(-told[instance[one]])) : 0;
  };
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
function ratingOf(scene, thing, things, asked) {
  const { calibration } = scene.facts.query;
  if (!calibration) return thing.score;
  const next = Math.max(0, ...things.filter((other) => other !== thing).map((other) => other.score));
  const evidence = { apart: thing.score - next, level: (thing.level + 1) / scene.facts.levels.length, fit: logOdds(thing.score), lead: leadOf(scene, thing, asked) };
  const sum = Object.entries(calibration.weights).reduce((part, [name, weight]) => part + weight * evidence[name], calibration.intercept);
  return 1 / (1 + Math.exp(-sum));
}

// By how much the log-odds of a phrase are above those of words of other meanings, and of canonical phrases, at some of a thing's Gaussians.
function leadOf(scene, { members, level }, { isOther, palette }) {
  const index = scene.codeIndex[level], most = Math.min(members.length, 256);
  const few = Array.from({ length: most }, (_, row) => members[Math.round((row * (members.length - 1)) / Math.max(1, most - 1))]);
  const mean = (entries) => few.reduce((sum, one) => sum + logOdds(entries[index[one]]), 0) / most;
  const others = scene.facts.words.map((_, number) => (isOther[number] ? mean(paletteOfWord(scene, number)[level]) : 0));
  return mean(palette[level]) - Math.max(0, ...others);
}

function logOdds(p) {
  const inside = Math.min(Math.max(p, 1e-6), 1 - 1e-6);
  return Math.log(inside / (1 - inside));
}

function gradeOf(scene, rating) {
  const { found, guess } = scene.facts.query;
  return rating >= found ? "found" : rating >= guess ? "best guess" : "not found";
}

// The verdict on a phrase that is not on the page's list, where no server judges it: egosplat/query/grades.py on the page's data.
function judge(scene, neighbors, relevancy, phrase, vector) {
  const things = findThings(scene, neighbors, relevancy, 3), [best] = things;
  const asked = { isOther: otherMeanings(scene, phrase, vector), palette: paletteRelevancy(scene, vector) };
  for (const thing of things) thing.rating = ratingOf(scene, thing, things, asked);
  const grade = best ? gradeOf(scene, best.rating) : "not found";
  const shown = grade === "not found" ? [] : things.filter((thing) => gradeOf(scene, thing.rating) === grade);
  const coded = scene.codeShare.some((share) => share.some((value) => value > 0));
  const nothing = coded ? "not found: nothing here looks like it" : "no Gaussian of the scene has a code";
  return { things: shown, grade, level: best?.level, score: best?.score ?? 0, rating: best?.rating ?? 0, why: shown.length ? null : best ? scene.facts.query.below : nothing };
}

// What asks for the things that look like one that was clicked.
const ALIKE = "more like this";

// Letters of the longest text that is worth splitting or sending.
const LONGEST = 2000;

// A phrase without characters that nobody sees, and with single spaces.
const cleanPhrase = (phrase) => phrase.replace(/\ufeff|(?!\s)[\p{Cc}\p{Cf}]/gu, "").replace(/\s+/gu, " ").trim();

// A number with two decimals, for which the verdict is the same.
function shownFigure(value, verdict) {
  const near = [0, -0.01, 0.01].map((step) => Number((Number(value.toFixed(2)) + step).toFixed(2)));
  return (near.find((one) => verdict(one) === verdict(value)) ?? value).toFixed(2);
}

const matches = (pattern, text) => new RegExp(pattern, "iu").test(text);

// A relevancy of each Gaussian at each level by which the instances of things are colored; null without any.
function ofInstances(scene, things) {
  const chosen = things.filter(({ instance }) => instance != null);
  if (!chosen.length || !scene.instance) return null;
  return scene.instance.map((numbers, level) => {
    const rated = new Map(chosen.filter((thing) => thing.level === level).map(({ instance, rating }) => [instance + 1, rating]));
    return Float32Array.from({ length: scene.count }, (_, one) => rated.get(numbers[one]) ?? 0);
  });
}

// Words of a phrase that the model was not trained on; none for a model that knows every word.
const untaughtWords = ({ taught }, phrase) => (taught ? (phrase.toLowerCase().match(/[\p{L}\p{N}]+/gu) ?? []).filter((word) => !taught.includes(word)) : []);

// The questions that a clean text asks, each with the name that it is read as: egosplat/query/reading.py reads by the same patterns. One that
// tells where a thing stands is told by its relation alone.
function readQuestions(facts, typed) {
  const { reading, words } = facts, names = words.map((word) => word.toLowerCase());
  if (names.includes(typed.toLowerCase())) return [{ name: typed }];
  if (matches(reading.quoted, typed)) return [{ name: typed.slice(1, -1) }];
  const plain = typed.normalize("NFKC"), parts = splitList(reading, withoutAsking(reading, plain));
  const questions = parts.map((part) => readQuestion(facts, names, part));
  if (!parts.length || (parts.length === 1 && parts[0] === plain && !questions[0].relation && (questions[0].name === plain || !questions[0].name))) return [{ name: typed }];
  for (let row = questions.length - 1; row > 0; row--) {
    const [before, last] = [questions[row - 1], questions[row]];
    if (last.relation && !before.relation && typed.includes(`${parts[row - 1]} and ${parts[row]}`)) Object.assign(before, { relation: last.relation, stand: last.stand });
  }
  return questions;
}

// A list's parts, but neither "between a and b" nor "black and white".
function splitList(reading, text) {
  const held = text.replace(/(\bbetween\b.+?)\s+and\s+/giu, "$1 \0 "), found = [];
  let before = "";
  for (const part of held.split(new RegExp(reading.list, "iu")).filter(Boolean)) {
    if (matches(reading.look, part)) before += `${part} and `;
    else found.push(before + part), (before = "");
  }
  return before ? [...found, before.replace(/ and $/, "")] : found;
}

function withoutAsking(reading, text) {
  const without = (name, phrase) => phrase.replace(new RegExp(reading[name], "iu"), "") || phrase;
  let rest = text.trim();
  for (let before = ""; rest !== before;) {
    before = rest;
    rest = without("trail", rest);
    if (rest === before) rest = without("lead", rest);
  }
  return rest;
}

function readQuestion(facts, names, text) {
  const { reading, taught } = facts;
  if (matches(reading.quoted, text)) return { name: text.slice(1, -1) };
  const thing = names.includes(text.toLowerCase()) ? text : withoutAsking(reading, text);
  const isKnown = names.includes(thing.toLowerCase()) || (taught && !untaughtWords(facts, thing).length);
  const said = isKnown ? null : new RegExp(reading.relation, "iu").exec(thing);
  const rest = said ? thing.slice(said.index + said[0].length).split("\0") : [];
  if (!said || rest.every((other) => matches(reading.look, withoutAsking(reading, other)))) return { name: readName(facts, thing) };
  const phrase = withoutAsking(reading, thing.slice(0, said.index));
  return { name: phrase && readName(facts, phrase), relation: said[0].trim(), stand: thing.slice(said.index).trim().replaceAll("\0", "and") };
}

// A name, by a singular that is known where the plural is not; empty for anything.
function readName(facts, phrase) {
  const { reading, taught, words, tower } = facts, known = taught ?? (tower ? null : words);
  if (matches(reading.anything, phrase)) return "";
  if (matches(reading.anyone, phrase)) return "person";
  const isKnown = (word) => known.includes(word.toLowerCase());
  const singular = (word) => reading.plurals.filter(([end]) => matches(end, word)).map(([end, own]) => word.toLowerCase().replace(new RegExp(end, "iu"), own)).find(isKnown);
  return known ? phrase.replace(/[\p{L}\p{N}]+/gu, (word) => (isKnown(word) || matches(reading.pairs, word) ? word : singular(word) ?? word)) : phrase;
}

// The answers of the page alone to a clean text. Each has the ``name`` that it was asked by, and either things or why there are none.
async function answerAlone(scene, tower, neighbors, typed) {
  if (!/[\p{L}\p{N}]/u.test(typed)) return [refused(typed, "The query has no word.")];
  if (typed.length > LONGEST) return [refused(typed, "too long: shorten it")];
  const answers = [], every = readQuestions(scene.facts, typed);
  // Each once.
  const isFirst = ({ name, stand }, row) => row === every.findIndex((one) => one.name === name && one.stand === stand);
  for (const question of every.filter(isFirst)) {
    if (question.relation) {
      const asked = [question.name || "what", question.stand].join(" ");
      answers.push(refused(asked, `not asked: this file has no relations. Ask by ${command(scene, asked)}`));
    } else if (!question.name) answers.push(...(scene.facts.catalog.length ? scene.facts.catalog : [refused("anything", "this file knows no word for what is here")]));
    else answers.push(await answerName(scene, tower, neighbors, question.name));
  }
  return answers;
}

async function answerName(scene, tower, neighbors, name) {
  const { words, answers } = scene.facts, phrase = name.normalize("NFKC"), known = words.indexOf(phrase.toLowerCase());
  if (known >= 0) return { ...answers[known], name, vector: scene.wordVectors[known] };
  if (!tower) return refused(name, `not on this file's list of ${words.length} words. Ask by ${command(scene, name)}. ${suggest(scene.facts, phrase, [phrase.toLowerCase()])}`.trim());
  const tokens = tower.tokenize(phrase), limit = tower.facts.context - 2;
  if (tokens.length > limit) return refused(name, `has ${tokens.length} tokens, the model reads ${limit}; shorten it`);
  const untaught = untaughtWords(scene.facts, phrase);
  if (untaught.length) {
    const named = [...new Set(untaught)].map((word) => `"${word}"`);
    return refused(name, `The models here were never taught the word${named.length > 1 ? "s" : ""} ${named.join(", ")}. ${suggest(scene.facts, phrase, untaught)}`.trim());
  }
  const vector = tower.encode(tokens), relevancy = gaussianRelevancy(scene, vector, phrase);
  scene.heated = performance.now();
  return { ...judge(scene, await neighbors, relevancy, phrase, vector), name, vector, relevancy, history: historyOf(scene, phrase, vector) };
}

// An answer as Python has it, in the terms of the page: levels by number, and what it is graded by.
function readAnswer({ levels }, { asked, refusal, untaught, level, things, history, ...rest }) {
  const rated = (one) => ({ ...one, rating: one.probability ?? one.score });
  return {
    ...rated(rest), ...(untaught.length ? { rating: null } : {}), name: asked, why: refusal, history: readHistory(history),
    level: level === null ? null : levels.indexOf(level),
    things: things.map((thing) => ({ ...rated(thing), level: levels.indexOf(thing.level) })),
  };
}

const readHistory = (history) => history.map(({ from_s, until_s, ...rest }) => ({ ...rest, from: from_s, until: until_s }));

const refused = (name, why) => ({ name, why, grade: "not asked", things: [], history: [] });

// What answers a text of which the page alone cannot.
function command({ facts }, asked) {
  const folder = /^[a-z0-9_]+\/[\w-]+$/.test(facts.title) ? `results/${facts.title}` : "FOLDER";
  return `egosplat query ${folder} '${shortened(asked).replaceAll("'", "'\\''")}'`;
}

// Whether the nearest words that are known are meant; empty where a word has no near one.
function suggest({ words, taught }, phrase, untaught) {
  const known = [...words, ...(taught ?? [])];
  let meant = phrase.toLowerCase();
  for (const word of untaught) {
    const near = known.map((one) => [likeness(one, word), one]).filter(([like]) => like >= 0.75);
    if (!near.length) return "";
    const best = near.reduce((one, other) => (other[0] > one[0] || (other[0] === one[0] && other[1] > one[1]) ? other : one));
    meant = meant.replaceAll(new RegExp(`(?<![\\p{L}\\p{N}_])${word.replace(/[^\p{L}\p{N}]/gu, "\\$&")}(?![\\p{L}\\p{N}_])`, "gu"), best[1]);
  }
  return `Did you mean "${meant}"?`;
}

// Twice the letters of both texts that lie in common runs, as a share of all: the ratio of Python's difflib.
function likeness(one, other) {
  const common = (a, b) => {
    let [size, from, at] = [0, 0, 0];
    for (let i = 0; i < a.length; i++)
      for (let j = 0; j < b.length; j++) {
        let run = 0;
        while (i + run < a.length && a[i + run] === b[j + run]) run++;
        if (run > size) [size, from, at] = [run, i, j];
      }
    return size ? size + common(a.slice(0, from), b.slice(0, at)) + common(a.slice(from + size), b.slice(at + size)) : 0;
  };
  return (2 * common([...one], [...other])) / Math.max(1, [...one].length + [...other].length);
}

// What the server answers that the page came from, which has the scene: to a phrase, or to an instance that gets a name or is compared.
async function askServer(scene, address, asked) {
  const { words } = scene.facts, name = asked.name ?? asked.phrase ?? ALIKE;
  const vectorOf = ({ name, vector }) => (vector ? Float32Array.from(vector) : scene.wordVectors[words.indexOf(name)]);
  try {
    const reply = await fetch(address + new URLSearchParams(asked), { method: "name" in asked ? "POST" : "GET" });
    const { why, answers } = await reply.json();
    return why ? [refused(name, why)] : answers.map((answer) => readAnswer(scene.facts, answer)).map((answer) => ({ ...answer, vector: vectorOf(answer) }));
  } catch {
    return [refused(name, "egosplat view, which answers here, does not: is it still running?")];
  }
}
