// The page's data: JSON, and columns of numbers as steersman.report.pack writes them.

async function unpacked(id) {
  return inflated(document.getElementById(id).textContent.trim());
}

// The bytes of letters of base64 that are compressed.
async function inflated(packed) {
  const letters = atob(packed);
  const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Columns {
  constructor(bytes) {
    this.bytes = bytes;
  }

  // The numbers of a column; gaps become NaN.
  read({ at, n, q, gaps = [] }) {
    const out = new Float64Array(n);
    let place = at;
    let sum = 0;
    for (let i = 0; i < n; i++) {
      let bits = 0;
      let shift = 0;
      let byte;
      do {
        byte = this.bytes[place++];
        bits |= (byte & 127) << shift;
        shift += 7;
      } while (byte > 127);
      // The lowest bit is the sign.
      sum += (bits >>> 1) ^ -(bits & 1);
      out[i] = sum * q;
    }
    for (const [first, behind] of gaps) out.fill(NaN, first, behind);
    return out;
  }
}
