// SPDX-License-Identifier: Apache-2.0
// The console's binary container (protocol.md). Runs in a worker and in node, too.

/// Returns {json, floats([offset, count]), uints(..), doubles(..), shorts(..), bytes(..)}; throws if a length does not fit.
export function parse_container(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const of = (Type) => ([offset, count]) => new Type(buffer, 4 + size + offset, count);
  return { json, floats: of(Float32Array), uints: of(Uint32Array), doubles: of(Float64Array), shorts: of(Int16Array), bytes: of(Uint8Array) };
}
