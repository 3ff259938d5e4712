// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/edge_table.h"

#include <algorithm>
#include <tuple>

namespace trocar {

EdgeTable edge_table(const SliceMesh& mesh) {
  EdgeTable out;
  out.first.assign(mesh.vertices.size() + 1, 0);
  const auto for_each = [&mesh](const auto& f) {
    std::uint32_t edge = 0;
    for (const Triangle& t : mesh.triangles) {
      for (std::size_t i = 0; i < 3; ++i, ++edge)
        f(std::min(t[i], t[(i + 1) % 3]), EdgeTable::Entry{std::max(t[i], t[(i + 1) % 3]), edge});
    }
  };
  for_each([&out](std::uint32_t low, EdgeTable::Entry) { ++out.first[low + 1]; });
  for (std::size_t v = 1; v < out.first.size(); ++v)
    out.first[v] += out.first[v - 1];
  out.entries.resize(mesh.triangles.size() * 3);
  std::vector<std::uint32_t> next(out.first.begin(), out.first.end() - 1);
  for_each([&](std::uint32_t low, EdgeTable::Entry e) { out.entries[next[low]++] = e; });
  for (std::size_t v = 0; v + 1 < out.first.size(); ++v) {
    std::sort(out.entries.begin() + out.first[v], out.entries.begin() + out.first[v + 1],
              [](const EdgeTable::Entry& a, const EdgeTable::Entry& b) {
                return std::tie(a.high, a.edge) < std::tie(b.high, b.edge);
              });
  }
  return out;
}

}  // namespace trocar
