// Arrays of the page: the inverse of arrays.py, whose docstring has the form.

const STORED_MISSING = -(2 ** 31);

function bytesOf(text) {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The whole numbers of a stored array, its columns one after another. */
async function wholeNumbers(stored) {
  const planes = await inflated(bytesOf(stored.data));
  const count = planes.length / 4;
  const found = new Int32Array(count);
  let last = 0;
  for (let i = 0; i < count; i++) {
    const zigzag = planes[i] | (planes[count + i] << 8) | (planes[2 * count + i] << 16) | (planes[3 * count + i] << 24);
    last = (last + ((zigzag >>> 1) ^ -(zigzag & 1))) | 0;
    found[i] = last;
  }
  return found;
}

/** A stored array as numbers, its columns one after another; NaN where there is no value. */
async function numbers(stored) {
  const whole = await wholeNumbers(stored);
  const found = new Float32Array(whole.length);
  for (let i = 0; i < whole.length; i++) found[i] = whole[i] === STORED_MISSING ? NaN : whole[i] * stored.step;
  return found;
}
