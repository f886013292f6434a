// Screenshots made small for the docs: a palette of 256 colours, which a page of flat areas and grey text hardly misses.

import { deflateSync, inflateSync } from "node:zlib";

const SIGNATURE = Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]);
const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c >>> 0;
});

function crc(octets) {
  let c = 0xffffffff;
  for (const octet of octets) c = CRC[(c ^ octet) & 0xff] ^ (c >>> 8);
  return (c ^ 0xffffffff) >>> 0;
}

function chunk(type, data) {
  const whole = Buffer.alloc(12 + data.length);
  whole.writeUInt32BE(data.length, 0);
  whole.write(type, 4, "latin1");
  data.copy(whole, 8);
  whole.writeUInt32BE(crc(whole.subarray(4, 8 + data.length)), 8 + data.length);
  return whole;
}

const paeth = (a, b, c) => {
  const [pa, pb, pc] = [Math.abs(b - c), Math.abs(a - c), Math.abs(a + b - 2 * c)];
  return pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
};

/** What a filter foretells of an octet from its neighbours: left, above, above left. */
const FILTERS = [() => 0, (a) => a, (_, b) => b, (a, b) => (a + b) >> 1, paeth];

/** A PNG of eight bits a channel, true colour with or without alpha, with a palette instead. */
export function smaller(png) {
  const parts = [];
  let at = SIGNATURE.length;
  let head = null;
  while (at < png.length) {
    const length = png.readUInt32BE(at);
    const type = png.toString("latin1", at + 4, at + 8);
    if (type === "IHDR") head = png.subarray(at + 8, at + 8 + length);
    if (type === "IDAT") parts.push(png.subarray(at + 8, at + 8 + length));
    at += 12 + length;
  }
  const [width, height, channels] = [head.readUInt32BE(0), head.readUInt32BE(4), head[9] === 6 ? 4 : 3];
  const rows = unfilter(inflateSync(Buffer.concat(parts)), width, height, channels);
  const { palette, indexOf } = choosePalette(rows);
  const lines = rows.map((row) => {
    const out = new Uint8Array(width + 1); // filter 0: indices have no neighbours that foretell them
    for (let x = 0; x < width; x++) out[x + 1] = indexOf((row[3 * x] << 16) | (row[3 * x + 1] << 8) | row[3 * x + 2]);
    return out;
  });
  const header = Buffer.from(head);
  header[9] = 3;
  const colours = Buffer.from(palette.flatMap((rgb) => [rgb >> 16, (rgb >> 8) & 255, rgb & 255]));
  const data = deflateSync(Buffer.concat(lines), { level: 9, memLevel: 9 });
  return Buffer.concat([SIGNATURE, chunk("IHDR", header), chunk("PLTE", colours), chunk("IDAT", data), chunk("IEND", Buffer.alloc(0))]);
}

const distance = (a, b) => 3 * ((a >> 16) - (b >> 16)) ** 2 + 4 * (((a >> 8) & 255) - ((b >> 8) & 255)) ** 2 + 2 * ((a & 255) - (b & 255)) ** 2;

/** The most frequent colours that are not almost the same; any other becomes the nearest of them. */
function choosePalette(rows) {
  const counts = new Map();
  for (const row of rows) {
    for (let i = 0; i < row.length; i += 3) {
      const rgb = (row[i] << 16) | (row[i + 1] << 8) | row[i + 2];
      counts.set(rgb, (counts.get(rgb) ?? 0) + 1);
    }
  }
  const frequent = [...counts].sort((a, b) => b[1] - a[1]).map(([rgb]) => rgb);
  const palette = [];
  for (const least of [60, 12, 0]) {
    for (const rgb of frequent) {
      if (palette.length === 256) break;
      if (palette.every((other) => distance(rgb, other) > least)) palette.push(rgb);
    }
  }
  const known = new Map(palette.map((rgb, i) => [rgb, i]));
  const indexOf = (rgb) => {
    let index = known.get(rgb);
    if (index === undefined) {
      index = palette.reduce((best, other, i) => (distance(rgb, other) < distance(rgb, palette[best]) ? i : best), 0);
      known.set(rgb, index);
    }
    return index;
  };
  return { palette, indexOf };
}

function unfilter(raw, width, height, channels) {
  const line = width * channels;
  let above = new Uint8Array(line);
  return Array.from({ length: height }, (_, y) => {
    const foretell = FILTERS[raw[y * (line + 1)]];
    const row = new Uint8Array(line);
    for (let i = 0; i < line; i++) {
      const [a, c] = i < channels ? [0, 0] : [row[i - channels], above[i - channels]];
      row[i] = raw[y * (line + 1) + 1 + i] + foretell(a, above[i], c);
    }
    above = row;
    return channels === 3 ? row : row.filter((_, i) => i % 4 !== 3);
  });
}
