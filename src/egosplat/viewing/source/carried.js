// What was carried from where to where: egosplat/query/history.py and histories.py.

// The carries of what a query means, in the order of time.
function historyOf(scene, vector) {
  const { carries, carriedVectors, facts } = scene, { synonym, temperature, together } = facts.query;
  const others = scene.wordVectors.filter((word) => dot(word, 0, vector) < synonym);
  const found = carries.map((carry, number) => {
    const feature = carriedVectors[number], own = dot(feature, 0, vector);
    const named = others.every((word) => dot(feature, 0, word) < own);
    const usual = Math.max(...scene.canonical.map((phrase) => dot(feature, 0, phrase)));
    const score = feature.some((value) => value !== 0) ? 1 / (1 + Math.exp(-temperature * (own - usual))) : 0;
    return { ...carry, score, named };
  }).filter(({ score, named }) => named && score > 0.5);
  found.sort((one, other) => other.score - one.score);
  const kept = [];
  for (const one of found) {
    const same = (other) => Math.min(one.until, other.until) - Math.max(one.from, other.from) >= together * Math.min(one.until - one.from, other.until - other.from);
    if (!kept.some(same)) kept.push(one);
  }
  return kept.sort((one, other) => one.from - other.from);
}

// Where a thing with a history was at a time [s]; point is null while it is carried.
function placeAt(history, second) {
  const now = history.find(({ from, until }) => from <= second && second <= until);
  if (now) return { point: null, told: `carried since ${minutes(now.from)}, until ${minutes(now.until)}` };
  const before = history.filter(({ until }) => until < second), after = history.filter(({ from }) => from > second);
  const next = after.length ? Math.min(...after.map(({ from }) => from)) : null;
  const until = next === null ? [] : [`until ${minutes(next)}`];
  if (!before.length) return { point: after.find(({ from }) => from === next).start, told: until.join("") };
  const last = before.reduce((best, one) => (one.until > best.until ? one : best));
  return { point: last.end, told: [`since ${minutes(last.until)}`, ...until].join(", ") };
}

function minutes(second) {
  const whole = Math.floor(second);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}
