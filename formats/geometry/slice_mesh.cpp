// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/slice_mesh.h"

#include <algorithm>
#include <map>
#include <utility>

namespace trocar {
namespace {

// By a hash table, which for the rings of meshes takes a fifth of the time of sorting. Points that
// collide in it too often are sorted.
bool has_a_point_twice(const Ring& ring) {
  std::size_t slots = 4;
  while (slots < 2 * ring.size())
    slots *= 2;
  std::vector<std::uint32_t> table(slots, 0);  // index in the ring, from 1
  std::size_t probes = 16 * ring.size();
  for (std::uint32_t i = 0; i < ring.size(); ++i) {
    const std::uint64_t xy = std::uint64_t{static_cast<std::uint32_t>(ring[i].x)} << 32U |
                             static_cast<std::uint32_t>(ring[i].y);
    std::size_t at = ((xy * 0x9E3779B97F4A7C15U) >> 32U) & (slots - 1);
    for (; table[at] != 0; at = (at + 1) & (slots - 1)) {
      if (ring[table[at] - 1] == ring[i]) return true;
      if (--probes == 0) {
        Ring sorted = ring;
        std::sort(sorted.begin(), sorted.end());
        return std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end();
      }
    }
    table[at] = i + 1;
  }
  return false;
}

// The next vertex along the boundary, of each vertex on it: an edge without its opposite is
// boundary. O(n): edges are put at their lower vertex, and there count for one direction and
// against the other.
constexpr std::uint32_t kNone = 0xffffffff;
std::vector<std::uint32_t> boundary_steps(const SliceMesh& mesh) {
  struct HalfEdge {
    std::uint32_t high;
    std::int32_t direction;  // 1 from the lower vertex to the higher, else -1
  };
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  const auto for_each = [&mesh](auto f) {
    for (const Triangle& t : mesh.triangles) {
      f(t[0], t[1]);
      f(t[1], t[2]);
      f(t[2], t[0]);
    }
  };
  for_each([&first](std::uint32_t a, std::uint32_t b) { ++first[std::min(a, b)]; });
  std::uint32_t sum = 0;
  for (std::uint32_t& count : first)
    count = (sum += count);  // the end of its edges, which filling them makes the start
  std::vector<HalfEdge> edges(mesh.triangles.size() * 3);
  for_each([&](std::uint32_t a, std::uint32_t b) {
    edges[--first[std::min(a, b)]] = {std::max(a, b), a < b ? 1 : -1};
  });
  std::vector<std::uint32_t> next(mesh.vertices.size(), kNone);
  std::vector<std::int32_t> balance(mesh.vertices.size(), 0);
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    for (std::uint32_t i = first[v]; i < first[v + 1]; ++i)
      balance[edges[i].high] += edges[i].direction;
    for (std::uint32_t i = first[v]; i < first[v + 1]; ++i) {
      const std::int32_t left = std::exchange(balance[edges[i].high], 0);
      if (left > 0) next[v] = edges[i].high;
      if (left < 0) next[edges[i].high] = v;
    }
  }
  return next;
}

}  // namespace

void split_at_pinches(const Ring& ring, std::vector<Ring>& out) {
  if (!has_a_point_twice(ring)) {
    out.push_back(ring);
    return;
  }
  Ring path;
  std::map<LatticePoint, std::size_t> position;  // in path
  for (const LatticePoint p : ring) {
    if (const auto it = position.find(p); it != position.end()) {
      const auto first = path.begin() + static_cast<std::ptrdiff_t>(it->second);
      out.emplace_back(first, path.end());
      for (const LatticePoint q : out.back())
        position.erase(q);
      path.erase(first, path.end());
    }
    position[p] = path.size();
    path.push_back(p);
  }
  out.push_back(std::move(path));
}

// The sums are modulo 2^64: partial sums of a ring's area may leave the range of 64 bits although
// the whole does not (a spiral over the whole lattice).

std::int64_t doubled_area(const Ring& ring) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0, n = ring.size(); i < n; ++i) {
    sum += static_cast<std::uint64_t>(orient2d(ring[0], ring[i], ring[i + 1 == n ? 0 : i + 1]));
  }
  return static_cast<std::int64_t>(sum);
}

std::int64_t doubled_area(const Pslg& pslg) {
  std::uint64_t sum = 0;
  for (const Ring& ring : pslg.rings)
    sum += static_cast<std::uint64_t>(doubled_area(ring));
  return static_cast<std::int64_t>(sum);
}

std::int64_t doubled_area(const SliceMesh& mesh) {
  std::uint64_t sum = 0;
  for (const Triangle& t : mesh.triangles) {
    sum += static_cast<std::uint64_t>(
        orient2d(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
  }
  return static_cast<std::int64_t>(sum);
}

Pslg boundary_rings(const SliceMesh& mesh) {
  std::vector<std::uint32_t> next = boundary_steps(mesh);
  Pslg out;
  for (std::uint32_t v = 0; v < next.size(); ++v) {
    if (next[v] == kNone) continue;
    Ring ring;
    for (std::uint32_t u = v; next[u] != kNone;) {
      ring.push_back(mesh.vertices[u]);
      const std::uint32_t w = next[u];
      next[u] = kNone;
      u = w;
    }
    split_at_pinches(ring, out.rings);
  }
  for (Ring& ring : out.rings) {
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  }
  std::sort(out.rings.begin(), out.rings.end());
  return out;
}

}  // namespace trocar
