// SPDX-License-Identifier: Apache-2.0
// Assets changed byte by byte, for the tests of their readers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "formats/asset/asset.h"

namespace trocar::test {

using GlbBytes = std::vector<std::uint8_t>;

/// Writes a number of the container or the slice index.
inline void put_number(GlbBytes& glb, std::size_t at, std::size_t value) {
  const auto number = static_cast<std::uint32_t>(value);
  std::memcpy(glb.data() + at, &number, sizeof number);
}

inline std::string json_of(const GlbBytes& glb) {
  std::uint32_t bytes = 0;
  std::memcpy(&bytes, glb.data() + 12, sizeof bytes);
  return {glb.begin() + 20, glb.begin() + 20 + bytes};
}

/// Where the data of the binary chunk begin: its slice index.
inline std::size_t binary_at(const GlbBytes& glb) {
  return 28 + json_of(glb).size();
}

/// The file with another JSON text. The container's sizes are right, those in the index are not.
inline GlbBytes with_json(const GlbBytes& glb, std::string text) {
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto after = glb.begin() + static_cast<std::ptrdiff_t>(binary_at(glb) - 8);
  GlbBytes out(glb.begin(), glb.begin() + 20);
  out.insert(out.end(), text.begin(), text.end());
  out.insert(out.end(), after, glb.end());
  put_number(out, 8, out.size());
  put_number(out, 12, text.size());
  return out;
}

/// The file without a slice index (its magic is changed), as after another tool has rewritten it.
inline GlbBytes without_index(GlbBytes glb) {
  glb[binary_at(glb)] ^= 0xFF;
  return glb;
}

inline bool same_slice(const AssetSlice& a, const AssetSlice& b) {
  return a.index == b.index && a.z_mm == b.z_mm && a.measures_json == b.measures_json &&
         a.T_lps_plane.matrix() == b.T_lps_plane.matrix() && a.pslg.rings == b.pslg.rings &&
         a.mesh.vertices == b.mesh.vertices && a.mesh.triangles == b.mesh.triangles &&
         a.material == b.material && a.hu == b.hu;
}

}  // namespace trocar::test
