// Words to a vector: the tokenizer and the text tower of OpenCLIP's CLIP.

class TextTower {
  constructor(facts, arrays) {
    this.facts = facts;
    this.weights = {};
    for (const [name, array] of Object.entries(arrays))
      if (name.startsWith("text/")) this.weights[name.slice(5)] = array;
    const letters = [...LETTERS.values()];
    // The order of OpenCLIP's vocabulary: letters, letters that end a word, merged pairs.
    const tokens = [...letters, ...letters.map((letter) => letter + "</w>"), ...facts.merges.map((pair) => pair.replace(" ", ""))];
    this.tokens = new Map(tokens.map((token, number) => [token, number]));
    this.ranks = new Map(facts.merges.map((pair, rank) => [pair, rank]));
  }

  tokenize(phrase) {
    const text = phrase.trim().replace(/\s+/gu, " ").toLowerCase();
    const words = text.match(/'s|'t|'re|'ve|'m|'ll|'d|\p{L}+|\p{N}|[^\s\p{L}\p{N}]+/gu) ?? [];
    return words.flatMap((word) => this.split(word)).map((token) => this.tokens.get(token));
  }

  // Merge the pair of lowest rank until none is left.
  split(word) {
    const parts = Array.from(new TextEncoder().encode(word), (byte) => LETTERS.get(byte));
    parts[parts.length - 1] += "</w>";
    for (;;) {
      let best = Infinity;
      for (let place = 0; place + 1 < parts.length; place++)
        best = Math.min(best, this.ranks.get(`${parts[place]} ${parts[place + 1]}`) ?? Infinity);
      if (best === Infinity) return parts;
      for (let place = 0; place + 1 < parts.length; place++)
        if (this.ranks.get(`${parts[place]} ${parts[place + 1]}`) === best) parts.splice(place, 2, parts[place] + parts[place + 1]);
    }
  }

  // Unit vector of a list of tokens, without start and end.
  encode(tokens) {
    const { start, end, layers, epsilon } = this.facts, all = [start, ...tokens, end];
    const weight = (name) => this.weights[name].values, width = this.weights["positional_embedding"].shape[1];
    const state = all.map((token, place) =>
      Float64Array.from({ length: width }, (_, channel) =>
        weight("token_embedding.weight")[token * width + channel] + weight("positional_embedding")[place * width + channel]));
    for (let layer = 0; layer < layers; layer++) this.block(`transformer.resblocks.${layer}.`, state);
    // Each token sees only those before it, so the last one alone makes the feature.
    const last = normalized(state[state.length - 1], weight("ln_final.weight"), weight("ln_final.bias"), epsilon);
    const channels = this.weights["text_projection"].shape[1], feature = new Float64Array(channels);
    for (let row = 0; row < width; row++)
      for (let channel = 0; channel < channels; channel++)
        feature[channel] += last[row] * weight("text_projection")[row * channels + channel];
    const norm = Math.hypot(...feature);
    return Float32Array.from(feature, (value) => value / norm);
  }

  block(prefix, state) {
    const get = (name) => this.weights[prefix + name].values, { heads, epsilon, quick_gelu } = this.facts;
    const width = state[0].length, size = width / heads;
    const projected = state.map((row) =>
      linear(normalized(row, get("ln_1.weight"), get("ln_1.bias"), epsilon), get("attn.in_proj_weight"), get("attn.in_proj_bias")));
    const mixed = state.map((_, place) => {
      const result = new Float64Array(width);
      for (let head = 0; head < heads; head++) attend(projected, place, head * size, size, width, result);
      return result;
    });
    for (let place = 0; place < state.length; place++) {
      add(state[place], linear(mixed[place], get("attn.out_proj.weight"), get("attn.out_proj.bias")));
      const hidden = linear(normalized(state[place], get("ln_2.weight"), get("ln_2.bias"), epsilon), get("mlp.c_fc.weight"), get("mlp.c_fc.bias"));
      const active = hidden.map(quick_gelu ? (x) => x / (1 + Math.exp(-1.702 * x)) : gelu);
      add(state[place], linear(active, get("mlp.c_proj.weight"), get("mlp.c_proj.bias")));
    }
  }
}

// One head of causal attention of one token, added to result at the head's channels.
function attend(projected, place, from, size, width, result) {
  const scores = new Float64Array(place + 1);
  for (let other = 0; other <= place; other++)
    for (let channel = from; channel < from + size; channel++)
      scores[other] += (projected[place][channel] * projected[other][width + channel]) / Math.sqrt(size);
  const top = Math.max(...scores), powers = scores.map((score) => Math.exp(score - top));
  const total = powers.reduce((sum, power) => sum + power, 0);
  for (let other = 0; other <= place; other++)
    for (let channel = from; channel < from + size; channel++)
      result[channel] += (powers[other] / total) * projected[other][2 * width + channel];
}

function linear(input, weights, biases) {
  const result = Float64Array.from(biases), width = input.length;
  for (let row = 0; row < result.length; row++)
    for (let column = 0; column < width; column++) result[row] += weights[row * width + column] * input[column];
  return result;
}

function normalized(row, scale, shift, epsilon) {
  const mean = row.reduce((sum, value) => sum + value, 0) / row.length;
  const variance = row.reduce((sum, value) => sum + (value - mean) ** 2, 0) / row.length;
  return row.map((value, channel) => ((value - mean) / Math.sqrt(variance + epsilon)) * scale[channel] + shift[channel]);
}

function add(state, more) {
  for (let channel = 0; channel < state.length; channel++) state[channel] += more[channel];
}

const gelu = (x) => 0.5 * x * (1 + erf(x / Math.SQRT2));

// Error function: its series near 0, its continued fraction elsewhere; both to double precision.
function erf(x) {
  const size = Math.abs(x);
  if (size > 6) return Math.sign(x);
  if (size < 2.5) {
    let term = x, sum = x;
    for (let n = 1; n < 60; n++) {
      term *= (-x * x) / n;
      sum += term / (2 * n + 1);
    }
    return (2 / Math.sqrt(Math.PI)) * sum;
  }
  let fraction = 0;
  for (let n = 60; n > 0; n--) fraction = n / 2 / (size + fraction);
  return Math.sign(x) * (1 - Math.exp(-x * x) / (size + fraction) / Math.sqrt(Math.PI));
}

// A printable letter for each byte, in the order of OpenCLIP's vocabulary (GPT-2's table), which has printable bytes first.
function byteLetters() {
  const range = (first, last) => Array.from({ length: last - first + 1 }, (_, step) => first + step);
  const printable = [...range(33, 126), ...range(161, 172), ...range(174, 255)];
  const table = new Map(printable.map((byte) => [byte, String.fromCharCode(byte)]));
  for (let byte = 0, extra = 0; byte < 256; byte++) if (!table.has(byte)) table.set(byte, String.fromCharCode(256 + extra++));
  return table;
}

const LETTERS = byteLetters();
