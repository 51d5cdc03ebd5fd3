// The part of msgpack that the protocol needs: maps, arrays, strings, binary, numbers, true, false, nil.

export function encode(value) {
  const bytes = [];
  write(value, bytes);
  return new Uint8Array(bytes);
}

function write(value, out) {
  if (value === null || value === undefined) out.push(0xc0);
  else if (typeof value === "boolean") out.push(value ? 0xc3 : 0xc2);
  else if (typeof value === "number") writeNumber(value, out);
  else if (typeof value === "string") {
    const utf8 = new TextEncoder().encode(value);
    writeHead(0xdb, utf8.length, out);
    for (const byte of utf8) out.push(byte);
  } else if (Array.isArray(value)) {
    writeHead(0xdd, value.length, out);
    for (const item of value) write(item, out);
  } else {
    const entries = Object.entries(value);
    writeHead(0xdf, entries.length, out);
    for (const [key, item] of entries) { write(key, out); write(item, out); }
  }
}

function writeHead(code, length, out) {
  out.push(code, length >>> 24, (length >>> 16) & 255, (length >>> 8) & 255, length & 255);
}

function writeNumber(value, out) {
  const view = new DataView(new ArrayBuffer(9));
  if (Number.isSafeInteger(value) && !Object.is(value, -0)) {
    view.setUint8(0, 0xd3);
    view.setBigInt64(1, BigInt(value));
  } else {
    view.setUint8(0, 0xcb);
    view.setFloat64(1, value);
  }
  for (let i = 0; i < 9; i++) out.push(view.getUint8(i));
}

export function decode(buffer) {
  return new Reader(buffer).value();
}

class Reader {
  constructor(buffer) { this.view = new DataView(buffer); this.at = 0; }

  unsigned(size) {
    const at = this.at;
    this.at += size;
    if (size === 1) return this.view.getUint8(at);
    if (size === 2) return this.view.getUint16(at);
    if (size === 4) return this.view.getUint32(at);
    return Number(this.view.getBigUint64(at));
  }

  signed(size) {
    const at = this.at;
    this.at += size;
    if (size === 1) return this.view.getInt8(at);
    if (size === 2) return this.view.getInt16(at);
    if (size === 4) return this.view.getInt32(at);
    return Number(this.view.getBigInt64(at));
  }

  bytes(length) {
    const part = new Uint8Array(this.view.buffer, this.at, length); // raises RangeError beyond the end
    this.at += length;
    return part;
  }

  text(length) { return new TextDecoder().decode(this.bytes(length)); }

  array(length) { return Array.from({ length }, () => this.value()); }

  map(length) {
    const fields = {};
    for (let i = 0; i < length; i++) { const key = this.value(); fields[key] = this.value(); }
    return fields;
  }

  value() {
    const code = this.unsigned(1);
    if (code < 0x80) return code;
    if (code < 0x90) return this.map(code & 15);
    if (code < 0xa0) return this.array(code & 15);
    if (code < 0xc0) return this.text(code & 31);
    if (code >= 0xe0) return code - 256;
    switch (code) {
      case 0xc0: return null;
      case 0xc2: return false;
      case 0xc3: return true;
      case 0xc4: case 0xc5: case 0xc6: return this.bytes(this.unsigned(1 << (code - 0xc4)));
      case 0xca: this.at += 4; return this.view.getFloat32(this.at - 4);
      case 0xcb: this.at += 8; return this.view.getFloat64(this.at - 8);
      case 0xcc: case 0xcd: case 0xce: case 0xcf: return this.unsigned(1 << (code - 0xcc));
      case 0xd0: case 0xd1: case 0xd2: case 0xd3: return this.signed(1 << (code - 0xd0));
      case 0xd9: case 0xda: case 0xdb: return this.text(this.unsigned(1 << (code - 0xd9)));
      case 0xdc: case 0xdd: return this.array(this.unsigned(2 << (code - 0xdc)));
      case 0xde: case 0xdf: return this.map(this.unsigned(2 << (code - 0xde)));
      default: throw new Error(`msgpack: byte ${code}: expected a type of the protocol`);
    }
  }
}
