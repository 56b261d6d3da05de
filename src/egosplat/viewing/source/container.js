// Read what egosplat/viewing/html.py packs.

async function unpackScene(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const raw = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(raw.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(raw.subarray(4, 4 + length)));
  const arrays = {};
  let place = 4 + length;
  for (const [name, about] of Object.entries(header.arrays)) {
    const size = about.shape.reduce((product, side) => product * side, 1);
    const width = { uint8: 1, int8: 1, uint16: 2, float16: 2, float32: 4 }[about.dtype];
    arrays[name] = { shape: about.shape, values: numbers(raw.subarray(place, place + size * width), about.dtype, size) };
    place += size * width;
  }
  return { facts: header.facts, arrays };
}

// The bytes hold the first byte of all numbers, then the second of all.
function numbers(planes, dtype, size) {
  if (dtype === "uint8") return planes;
  if (dtype === "int8") return new Int8Array(planes.buffer, planes.byteOffset, size);
  const width = planes.length / Math.max(size, 1);
  const bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++)
    for (let index = 0; index < size; index++) bytes[index * width + plane] = planes[plane * size + index];
  if (dtype === "float32") return new Float32Array(bytes.buffer);
  const halves = new Uint16Array(bytes.buffer);
  return dtype === "uint16" ? halves : fromHalves(halves);
}

function fromHalves(halves) {
  const values = new Float32Array(halves.length);
  for (let index = 0; index < halves.length; index++) {
    const half = halves[index];
    const exponent = (half >> 10) & 31, fraction = half & 1023;
    const size = exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : fraction * 2 ** -24;
    values[index] = half & 0x8000 ? -size : size;
  }
  return values;
}
