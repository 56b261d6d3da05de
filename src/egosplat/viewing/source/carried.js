// What was carried from where to where: egosplat/histories/told.py and egosplat/query/grades.py.

// The carries of the thing that fits a query best, in the order of time.
function historyOf(scene, phrase, vector) {
  const { carriedThings, carriedVectors, facts } = scene, { temperature, fits } = facts.query, isOther = otherMeanings(scene, phrase, vector);
  const meant = scene.wordVectors.map((word) => dot(word, 0, vector));
  // What stays is not carried.
  if (!facts.carried[meant.indexOf(Math.max(...meant))]) return [];
  const others = scene.wordVectors.filter((_, number) => facts.carried[number] && isOther[number]);
  const scores = carriedVectors.map((feature) => {
    const own = dot(feature, 0, vector), usual = Math.max(...scene.canonical.map((phrase) => dot(feature, 0, phrase)));
    const named = feature.some((value) => value !== 0) && others.every((word) => dot(feature, 0, word) < own);
    return named ? 1 / (1 + Math.exp(-temperature * (own - usual))) : 0;
  });
  const best = Math.max(...scores);
  return best > fits ? carriedThings[scores.indexOf(best)] : [];
}

const length = (vector) => Math.hypot(...vector);
// A place that is not known may be any.
const meet = ({ size }, one, other, apart) => !one || !other || length(plus(one, other, -1)) <= apart * size;

// Where a thing with a history was at a time [s]; point is null while it is carried, where no carry tells it, and between two that do not meet.
function placeAt(history, second, apart) {
  const now = history.find(({ from, until }) => from <= second && second <= until);
  if (now) return { point: null, told: toldPlace(now.certain ? "carried" : "place unknown", now.from, now.until) };
  const last = history.filter(({ until }) => until < second).reduce((best, one) => (!best || one.until > best.until ? one : best), null);
  const next = history.find(({ from }) => from > second);
  const times = [last?.until, next?.from];
  if (last && next && !meet(last, next.start, last.end, apart)) return { point: null, told: toldPlace("place unknown", ...times) };
  // Both carries show the place.
  const places = [last?.end, next?.start].filter(Boolean);
  const point = places.length ? places[0].map((value, axis) => (value + places[places.length - 1][axis]) / 2) : null;
  return { point, told: toldPlace(point ? "here" : "place unknown", ...times) };
}

// What a thing was, and when, such as "here from 0:07 to 0:16".
function toldPlace(what, since, until) {
  if (since === undefined) return until === undefined ? what : `${what} until ${minutes(until)}`;
  return `${what} from ${minutes(since)} ${until === undefined ? "on" : `to ${minutes(until)}`}`;
}

function minutes(second) {
  const whole = Math.floor(second);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}
