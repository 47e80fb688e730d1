// Reads those of Foxglove's messages that are drawn, from protobuf's wire format. A type lists, by field number, name and type of its
// fields: a scalar, a type, or an array of one for a repeated field. Unknown fields are passed over, as protobuf wants it.

const Vector3 = { 1: ["x", "double"], 2: ["y", "double"], 3: ["z", "double"] };
const Quaternion = { ...Vector3, 4: ["w", "double"] };
const Color = { 1: ["r", "double"], 2: ["g", "double"], 3: ["b", "double"], 4: ["a", "double"] };
const Pose = { 1: ["position", Vector3], 2: ["orientation", Quaternion] };
const Time = { 1: ["seconds", "varint"], 2: ["nanos", "varint"] };

const SceneEntity = {
  1: ["timestamp", Time],
  2: ["frame", "string"],
  3: ["id", "string"],
  4: ["lifetime", Time],
  7: ["arrows", [{ 1: ["pose", Pose], 2: ["shaftLength", "double"], 3: ["shaftDiameter", "double"], 4: ["headLength", "double"], 5: ["headDiameter", "double"], 6: ["color", Color] }]],
  8: ["cubes", [{ 1: ["pose", Pose], 2: ["size", Vector3], 3: ["color", Color] }]],
  11: ["lines", [{ 1: ["type", "varint"], 2: ["pose", Pose], 5: ["points", [Vector3]], 6: ["color", Color] }]],
  12: ["triangles", [{ 1: ["pose", Pose], 2: ["points", [Vector3]], 4: ["colors", [Color]], 5: ["indices", "fixed32s"] }]],
  13: ["texts", [{ 1: ["pose", Pose], 3: ["size", "double"], 5: ["color", Color], 6: ["text", "string"] }]],
};

export const SceneUpdate = { 2: ["entities", [SceneEntity]] };
export const Log = { 2: ["level", "varint"], 3: ["message", "string"], 4: ["name", "string"] };
export const CompressedImage = { 2: ["data", "bytes"], 3: ["format", "string"] };
export const PointCloud = {
  2: ["frame", "string"],
  3: ["pose", Pose],
  4: ["stride", "fixed32"],
  5: ["fields", [{ 1: ["name", "string"], 2: ["offset", "fixed32"] }]],
  6: ["data", "bytes"],
};

const text = new TextDecoder();
// A number that is 0 is not sent.
const absent = { double: 0, varint: 0, fixed32: 0, string: "" };

/** The message of a type in these bytes. Throws where they end too early. */
export function decode(type, bytes) {
  return read(type, new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), 0, bytes.byteLength);
}

function read(type, view, at, end) {
  const message = {};
  for (const [name, kind] of Object.values(type)) {
    if (Array.isArray(kind) || kind === "fixed32s") message[name] = [];
    else if (kind in absent) message[name] = absent[kind];
  }
  while (at < end) {
    let tag, length;
    [tag, at] = varint(view, at);
    const [name, kind] = type[tag >>> 3] ?? [];
    switch (tag & 7) {
      case 0: {
        let value;
        [value, at] = varint(view, at);
        if (kind === "varint") message[name] = value;
        break;
      }
      case 1:
        if (kind === "double") message[name] = view.getFloat64(at, true);
        at += 8;
        break;
      case 5:
        if (kind === "fixed32") message[name] = view.getUint32(at, true);
        at += 4;
        break;
      case 2: {
        [length, at] = varint(view, at);
        if (at + length > end) throw new RangeError("a message ends too early");
        const part = () => new Uint8Array(view.buffer, view.byteOffset + at, length);
        if (kind === "string") message[name] = text.decode(part());
        else if (kind === "bytes") message[name] = part();
        else if (kind === "fixed32s") for (let i = 0; i < length; i += 4) message[name].push(view.getUint32(at + i, true));
        else if (Array.isArray(kind)) message[name].push(read(kind[0], view, at, at + length));
        else if (typeof kind === "object") message[name] = read(kind, view, at, at + length);
        at += length;
        break;
      }
      default:
        throw new RangeError(`wire type ${tag & 7}`);
    }
  }
  return message;
}

function varint(view, at) {
  let value = 0;
  for (let scale = 1; ; scale *= 128) {
    const byte = view.getUint8(at++);
    value += (byte & 127) * scale;
    if (byte < 128) return [value, at];
  }
}
