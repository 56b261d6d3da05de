// What was carried from where to where: egosplat/query/history.py and histories.py.

// The carries of what a query means, in the order of time.
function historyOf(scene, vector) {
  const { carries, carriedVectors, facts } = scene, { synonym, temperature, together, fits } = facts.query;
  const meant = scene.wordVectors.map((word) => dot(word, 0, vector));
  // What stays is not carried.
  if (!facts.carried[meant.indexOf(Math.max(...meant))]) return [];
  const others = scene.wordVectors.filter((_, number) => facts.carried[number] && meant[number] < synonym);
  const found = carries.map((carry, number) => {
    const feature = carriedVectors[number], own = dot(feature, 0, vector);
    const named = others.every((word) => dot(feature, 0, word) < own);
    const usual = Math.max(...scene.canonical.map((phrase) => dot(feature, 0, phrase)));
    const score = feature.some((value) => value !== 0) ? 1 / (1 + Math.exp(-temperature * (own - usual))) : 0;
    return { ...carry, score, named };
  });
  const kept = [], fitting = found.filter(({ score, named }) => named && score > fits);
  // Where carries are of things that rest, a history is of the one that fits best.
  const { thing } = fitting.reduce((best, one) => (one.score > best.score ? one : best), { score: 0 });
  const own = (one) => one.thing === thing;
  for (const one of fitting.filter(own).sort((one, other) => one.from - one.until - (other.from - other.until))) {
    const same = (other) => Math.min(one.until, other.until) - Math.max(one.from, other.from) >= together * Math.min(one.until - one.from, other.until - other.from);
    if (!kept.some(same)) kept.push(one);
  }
  kept.sort((one, other) => one.from - other.from);
  const apart = facts.query.apart;
  // Where two carries do not meet, one of any name that leads from the first to the second.
  return kept.flatMap((one, place) => {
    const next = kept[place + 1];
    if (!next || meet(one, one.end, next.start, apart)) return [one];
    const between = found.filter((each) => own(each) && one.until <= each.from && each.until <= next.from && each.start && each.end && meet(one, one.end, each.start, apart) && meet(one, each.end, next.start, apart));
    between.sort((each, other) => length(plus(one.end, each.start, -1)) - length(plus(one.end, other.start, -1)));
    return [one, ...between.slice(0, 1)];
  });
}

const length = (vector) => Math.hypot(...vector);
// A place that is not known may be any.
const meet = ({ size }, one, other, apart) => !one || !other || length(plus(one, other, -1)) <= apart * size;

// Where a thing with a history was at a time [s]; point is null while it is carried, where no carry tells it, and between two that do not meet.
function placeAt(history, second, apart) {
  const now = history.find(({ from, until }) => from <= second && second <= until);
  if (now) return { point: null, told: `${now.certain ? "carried" : "not known"} since ${minutes(now.from)}, until ${minutes(now.until)}` };
  const last = history.filter(({ until }) => until < second).reduce((best, one) => (!best || one.until > best.until ? one : best), null);
  const next = history.find(({ from }) => from > second);
  const times = [...(last ? [`since ${minutes(last.until)}`] : []), ...(next ? [`until ${minutes(next.from)}`] : [])].join(", ");
  if (last && next && !meet(last, next.start, last.end, apart)) return { point: null, told: `not known ${times}` };
  // Both carries show the place.
  const places = [last?.end, next?.start].filter(Boolean);
  const point = places.length ? places[0].map((value, axis) => (value + places[places.length - 1][axis]) / 2) : null;
  return { point, told: point ? times : `not known ${times}` };
}

function minutes(second) {
  const whole = Math.floor(second);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}
