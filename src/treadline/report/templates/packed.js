"use strict";
// Arrays of a page: 16-bit numbers in base64, with the scale of each column.

const NOT_A_NUMBER = -32768, LARGEST = 32767;

function bytesOf(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

/** Return a packed array as 32-bit numbers, row after row. */
function unpack(value) {
  const codes = new Int16Array(bytesOf(value.data).buffer), k = value.columns;
  const out = new Float32Array(codes.length);
  for (let i = 0; i < codes.length; i++) {
    const j = i % k;
    out[i] = codes[i] === NOT_A_NUMBER ? NaN : value.low[j] + value.step[j] * (codes[i] + LARGEST);
  }
  return out;
}

function unpackIndices(text) { return new Uint16Array(bytesOf(text).buffer); }
