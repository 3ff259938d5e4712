// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/slice_mesh.h"

#include <map>
#include <utility>

namespace trocar {
namespace {

// Uses a hash table, which is faster than sorting. If points collide too often, they are sorted.
bool has_a_point_twice(const Ring& ring) {
  std::size_t slots = 4;
  while (slots < 2 * ring.size())
    slots *= 2;
  std::vector<std::uint32_t> table(slots, 0);  // index in the ring plus 1; 0: free
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

// Finds the next vertex n along the boundary for each boundary vertex, in one pass without a
// search. Each triangle at a vertex has two further corners, its second and its third. In a valid
// mesh each neighbour is the second corner of one triangle and the third of another, except that n
// is only a second corner and the previous boundary vertex p only a third. So the sums over the
// triangles of second - third and of second^2 - third^2 are n - p and n^2 - p^2, which give n. In
// an invalid mesh, which check_mesh() detects, the result may be any vertex.
std::vector<std::uint32_t> boundary_steps(const SliceMesh& mesh) {
  struct Sums {
    std::uint64_t difference = 0, squares = 0;  // modulo 2^64; indices are below 2^31
  };
  std::vector<Sums> sums(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint64_t second = t[(i + 1) % 3], third = t[(i + 2) % 3];
      sums[t[i]].difference += second - third;
      sums[t[i]].squares += (second - third) * (second + third);
    }
  }
  std::vector<std::uint32_t> next(mesh.vertices.size(), kNotOnBoundary);
  const auto count = static_cast<std::int64_t>(next.size());
  const auto is_within = [](std::int64_t value, std::int64_t bound) {
    return -bound < value && value < bound;
  };
  for (std::size_t v = 0; v < next.size(); ++v) {
    const auto difference = static_cast<std::int64_t>(sums[v].difference);
    const auto squares = static_cast<std::int64_t>(sums[v].squares);
    if (difference == 0 || !is_within(difference, count) || !is_within(squares, count * count))
      continue;
    const std::int64_t twice = squares / difference + difference;
    if (is_within(twice, 2 * count) && twice >= 0) next[v] = static_cast<std::uint32_t>(twice / 2);
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
  std::map<LatticePoint, std::size_t> position;  // index in path
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

// Sums are modulo 2^64, because partial sums may overflow 64 bits although the area does not (a
// spiral over the whole lattice).

std::int64_t doubled_area(const Ring& ring) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0, n = ring.size(); i < n; ++i)
    sum += static_cast<std::uint64_t>(orient2d(ring[0], ring[i], ring[i + 1 == n ? 0 : i + 1]));
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
  return rings_along(mesh, boundary_steps(mesh));
}

Pslg rings_along(const SliceMesh& mesh, std::vector<std::uint32_t> next) {
  Pslg out;
  for (std::uint32_t v = 0; v < next.size(); ++v) {
    if (next[v] == kNotOnBoundary) continue;
    Ring ring;
    for (std::uint32_t u = v; next[u] != kNotOnBoundary;) {
      ring.push_back(mesh.vertices[u]);
      u = std::exchange(next[u], kNotOnBoundary);
    }
    split_at_pinches(ring, out.rings);
  }
  for (Ring& ring : out.rings)
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  std::sort(out.rings.begin(), out.rings.end());
  return out;
}

}  // namespace trocar
