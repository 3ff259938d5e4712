// SPDX-License-Identifier: Apache-2.0
// The sweep against what compares every edge with every other, and how many tests it makes.
#include "formats/mesh/outline_sweep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/random_geometry.h"
#include "tests/support/rings_of_edges.h"

namespace trocar {
namespace {

using runtime::Random;

std::string text(LatticePoint p) {
  std::string out = "(";
  return out.append(std::to_string(p.x)).append(", ").append(std::to_string(p.y)).append(")");
}

using Edge = std::pair<LatticePoint, LatticePoint>;

std::vector<Edge> edges_of(const Pslg& pslg) {
  std::vector<Edge> out;
  for (const Ring& ring : pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out.emplace_back(ring[i], ring[(i + 1) % ring.size()]);
  }
  return out;
}

// The message of the first edge, by least x and ends, that crosses one before it; or nothing.
std::string crossing_by_pairs(const Pslg& pslg) {
  std::vector<Edge> edges = edges_of(pslg);
  std::sort(edges.begin(), edges.end(), [](const Edge& e, const Edge& f) {
    return std::tuple{std::min(e.first.x, e.second.x), e} <
           std::tuple{std::min(f.first.x, f.second.x), f};
  });
  for (std::size_t i = 0; i < edges.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (segments_cross(edges[i].first, edges[i].second, edges[j].first, edges[j].second))
        return "outline edges cross near lattice point " + text(edges[i].first);
    }
  }
  return {};
}

// How often the rings wind around the points just right of the edge; nothing crosses.
int right_of(const Pslg& pslg, std::size_t ring, std::size_t i) {
  const Ring& own = pslg.rings[ring];
  const LatticePoint a = own[i], b = own[(i + 1) % own.size()];
  int out = doubled_area(own) > 0 ? 0 : -1;
  for (std::size_t q = 0; q < pslg.rings.size(); ++q) {
    if (q != ring &&
        is_inside_ring(std::int64_t{a.x} + b.x, std::int64_t{a.y} + b.y, pslg.rings[q]))
      out += doubled_area(pslg.rings[q]) > 0 ? 1 : -1;
  }
  return out;
}

// The expected message of check_pslg(), or nothing.
std::string by_pairs(const Pslg& pslg) {
  for (const Ring& ring : pslg.rings) {
    if (ring.size() < 3) return "a ring of fewer than three vertices";
    for (const LatticePoint p : ring)
      if (!is_on_lattice(p))
        return "outline outside the lattice's range at lattice point " + text(p);
    Ring sorted = ring;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) return "a ring with a vertex twice at lattice point " + text(*twice);
  }
  if (std::string crossing = crossing_by_pairs(pslg); !crossing.empty()) return crossing;
  for (std::size_t r = 0; r < pslg.rings.size(); ++r) {
    if (right_of(pslg, r, 0) == 0) continue;
    return (doubled_area(pslg.rings[r]) > 0 ? "an outer ring inside material at lattice point "
                                            : "a hole outside material at lattice point ") +
           text(pslg.rings[r][0]);
  }
  for (std::size_t r = 0; r < pslg.rings.size(); ++r) {
    for (std::size_t i = 0; i < pslg.rings[r].size(); ++i) {
      if (right_of(pslg, r, i) != 0)
        return "rings that touch and overlap, near an edge at lattice point " +
               text(pslg.rings[r][i]);
    }
  }
  return {};
}

std::string said(const Pslg& pslg) {
  const auto ok = check_pslg(pslg);
  return ok ? std::string() : ok.error().message;
}

// Counts of what the random outlines below were found to be.
using Tally = std::map<std::string, int>;

void compare(const Pslg& pslg, Tally& tally) {
  const std::string wanted = by_pairs(pslg);
  ASSERT_EQ(said(pslg), wanted);
  ++tally[wanted.substr(0, wanted.find(" near lattice")).substr(0, wanted.find(" at lattice"))];
}

void rotate_anyhow(Ring& ring, Random& random) {
  std::rotate(ring.begin(),
              ring.begin() + random.between(0, static_cast<std::int32_t>(ring.size()) - 1),
              ring.end());
}

// Points under one of several maps that keep lines: rotated, sheared, large, or in one thin strip.
Pslg mapped(Pslg pslg, Random& random) {
  const std::int32_t kind = random.between(0, 5), shear = random.between(-3, 3);
  for (Ring& ring : pslg.rings) {
    for (LatticePoint& p : ring) {
      if (kind == 1) p = {-p.y, p.x};
      if (kind == 2) p = {p.x + shear * p.y, p.y};
      if (kind == 3) p = {p.x, p.y + shear * p.x};
      if (kind == 4) p = {p.x * 1'000'000, p.y * 1'000'000};
      if (kind == 5) p = {2 * p.x + p.y, 100'000 * p.x - p.y};
    }
  }
  return pslg;
}

// The boundary of the cells of a random image: rings that touch in many vertices.
Pslg random_cells(std::int32_t size, int density, Random& random) {
  const auto width = static_cast<std::size_t>(size);
  std::vector<char> cell(width * width);
  for (char& c : cell)
    c = random.between(0, 99) < density ? 1 : 0;
  const auto is_in = [&](std::int32_t x, std::int32_t y) {
    return x >= 0 && y >= 0 && x < size && y < size &&
           cell[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] != 0;
  };
  test::DirectedEdges edges;
  for (std::int32_t y = 0; y < size; ++y) {
    for (std::int32_t x = 0; x < size; ++x) {
      if (!is_in(x, y)) continue;
      if (!is_in(x, y - 1)) edges.push_back({{x, y}, {x + 1, y}});
      if (!is_in(x + 1, y)) edges.push_back({{x + 1, y}, {x + 1, y + 1}});
      if (!is_in(x, y + 1)) edges.push_back({{x + 1, y + 1}, {x, y + 1}});
      if (!is_in(x - 1, y)) edges.push_back({{x, y + 1}, {x, y}});
    }
  }
  Pslg rings = test::rings_of(edges);
  for (Ring& ring : rings.rings) {
    for (LatticePoint& p : ring)
      p = {4 * p.x, 4 * p.y};
    rotate_anyhow(ring, random);
  }
  std::shuffle(rings.rings.begin(), rings.rings.end(), random.bits());
  return rings;
}

Pslg random_rings(std::int32_t rings, std::int32_t corners, std::int32_t size, Random& random) {
  Pslg out;
  for (std::int32_t r = 0; r < rings; ++r) {
    Ring& ring = out.rings.emplace_back();
    for (std::int32_t i = 0; i < corners; ++i)
      ring.push_back({random.between(0, size), random.between(0, size)});
  }
  return out;
}

TEST(OutlineSweep, SaysOfFewRandomRingsWhatPairsOfEdgesSay) {
  Random random(11);
  Tally tally;
  for (int i = 0; i < 60'000 && !HasFatalFailure(); ++i) {
    const std::int32_t rings = random.between(1, 4), corners = random.between(3, 5);
    compare(mapped(random_rings(rings, corners, random.between(2, 9), random), random), tally);
  }
  EXPECT_GT(tally[""], 1'000);
  EXPECT_GT(tally["outline edges cross"], 10'000);
  EXPECT_GT(tally["a ring with a vertex twice"], 1'000);
  EXPECT_GT(tally["an outer ring inside material"], 2);
  EXPECT_GT(tally["a hole outside material"], 1'000);
}

TEST(OutlineSweep, SaysOfTouchingRingsWhatPairsOfEdgesSay) {
  Random random(12);
  Tally tally;
  for (int i = 0; i < 4'000 && !HasFatalFailure(); ++i) {
    Pslg cells = random_cells(random.between(2, 9), random.between(20, 80), random);
    if (cells.rings.empty()) continue;
    compare(mapped(cells, random), tally);
    // One vertex moved, one ring turned, or one given twice.
    Ring& ring = random.pick(cells.rings);
    const std::int32_t how = random.between(0, 5);
    if (how <= 3) {
      LatticePoint& p = random.pick(ring);
      p = {p.x + random.between(-5, 5), p.y + random.between(-5, 5)};
    } else if (how == 4) {
      std::reverse(ring.begin(), ring.end());
    } else {
      cells.rings.push_back(Ring(ring));
    }
    compare(mapped(cells, random), tally);
  }
  EXPECT_GT(tally[""], 4'000);
  EXPECT_GT(tally["outline edges cross"], 1'000);
  EXPECT_GT(tally["a ring with a vertex twice"], 50);
}

TEST(OutlineSweep, RefusesRingsThatPassIntoEachOtherInVertices) {
  // No two edges cross, and the first edge of each lies outside the other.
  const Pslg two{{{{0, 0}, {4, 0}, {4, 2}, {4, 4}, {2, 4}, {0, 4}},
                  {{4, 2}, {6, 2}, {6, 6}, {2, 6}, {2, 4}, {2, 2}}}};
  EXPECT_EQ(crossing_by_pairs(two), "");
  EXPECT_EQ(right_of(two, 0, 0), 0);
  EXPECT_EQ(right_of(two, 1, 0), 0);
  EXPECT_EQ(said(two), "rings that touch and overlap, near an edge at lattice point (4, 2)");
  EXPECT_EQ(said(two), by_pairs(two));
  // Random ones: the corners of boxes on a coarse grid, with all its points on their edges.
  Random random(13);
  Tally tally;
  for (int i = 0; i < 20'000 && !HasFatalFailure(); ++i) {
    Pslg boxes;
    for (std::int32_t k = random.between(2, 3); k > 0; --k) {
      const LatticePoint low{random.between(0, 3), random.between(0, 3)},
          high{low.x + random.between(1, 3), low.y + random.between(1, 3)};
      Ring ring;
      for (std::int32_t x = low.x; x < high.x; ++x)
        ring.push_back({x, low.y});
      for (std::int32_t y = low.y; y < high.y; ++y)
        ring.push_back({high.x, y});
      for (std::int32_t x = high.x; x > low.x; --x)
        ring.push_back({x, high.y});
      for (std::int32_t y = high.y; y > low.y; --y)
        ring.push_back({low.x, y});
      if (random.between(0, 3) == 0) std::reverse(ring.begin(), ring.end());
      rotate_anyhow(ring, random);
      boxes.rings.push_back(ring);
    }
    compare(mapped(boxes, random), tally);
  }
  EXPECT_GT(tally["rings that touch and overlap, near an edge"], 30);
}

TEST(OutlineSweep, CountsWindingsOfEveryEdge) {
  Random random(14);
  int deep = 0;
  for (int i = 0; i < 2'000; ++i) {
    Pslg pslg = random_rings(random.between(1, 5), 3, 12, random);
    for (std::int32_t h = 20; h < 20 + 3 * (i % 4); h += 3) {  // around these
      pslg.rings.push_back({{-h, -h}, {h, -h}, {h, h}, {-h, h}});
      Ring& ring = pslg.rings.back();
      if (random.between(0, 1) == 0) std::reverse(ring.begin(), ring.end());
    }
    pslg = mapped(pslg, random);
    const std::string why = by_pairs(pslg);
    if (why.starts_with("outline edges") || why.starts_with("a ring")) continue;
    EdgeLoops loops;
    for (const Ring& ring : pslg.rings)
      loops.add(ring);
    std::vector<std::int32_t> windings;
    ASSERT_FALSE(sweep(loops, in_sweep_order(loops.points), {}, &windings).crosses);
    std::size_t at = 0;
    for (std::size_t r = 0; r < pslg.rings.size(); ++r) {
      for (std::size_t k = 0; k < pslg.rings[r].size(); ++k, ++at) {
        ASSERT_EQ(windings[at], right_of(pslg, r, k)) << i;
        deep += std::abs(windings[at]) > 1 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(deep, 100);
}

TEST(RingsAround, AreThoseInWhichTheRingLies) {
  Random random(17);
  int around = 0;
  for (int i = 0; i < 3'000; ++i) {
    Pslg pslg = i % 2 == 0 ? random_cells(random.between(2, 12), random.between(30, 80), random)
                           : random_rings(random.between(1, 5), 3, 12, random);
    if (i % 2 == 1 && !crossing_by_pairs(pslg).empty()) continue;
    if (by_pairs(pslg).starts_with("a ring")) continue;
    for (Ring& ring : pslg.rings)
      if (random.between(0, 3) == 0) std::reverse(ring.begin(), ring.end());
    const auto found = enclosing_rings(pslg.rings);
    const auto is_in = [&](std::size_t q, std::size_t r) {
      const Ring& ring = pslg.rings[q];
      return q != r && is_inside_ring(std::int64_t{ring[0].x} + ring[1].x,
                                      std::int64_t{ring[0].y} + ring[1].y, pslg.rings[r]);
    };
    ASSERT_TRUE(found || i % 2 == 1) << i;
    for (std::size_t q = 0; found && q < pslg.rings.size(); ++q) {
      for (std::size_t r = 0; r < pslg.rings.size(); ++r) {
        bool is_found = false;
        for (std::uint32_t k = (*found)[q]; k != kNoRing; k = (*found)[k])
          is_found = is_found || k == r;
        ASSERT_EQ(is_found, is_in(q, r)) << i << ' ' << q << ' ' << r;
        around += is_found ? 1 : 0;
      }
    }
  }
  EXPECT_GT(around, 1'000);
}

// Shapes of n vertices or somewhat more, in which a line of the sweep meets up to n edges.

// Long teeth; `tall` turns them against the sweep.
Pslg comb(std::int32_t n, bool tall) {
  Ring ring;
  const std::int32_t teeth = n / 2, length = kMaxCoordinate / 2;
  for (std::int32_t k = 0; k < teeth; ++k) {
    ring.push_back({0, 8 * k});
    ring.push_back({length - 3 * (k % 5), 8 * k + 3});
  }
  ring.push_back({0, 8 * teeth});
  ring.push_back({-10, 4 * teeth});
  if (tall) {
    for (LatticePoint& p : ring)
      p = {-p.y, p.x};
  }
  return {{ring}};
}

Pslg spiral(std::int32_t n) {
  const std::int32_t turns = n / 8;
  Ring outer, inner;
  for (std::int32_t turn = 0; turn < turns; ++turn) {
    const std::int32_t r = 8 * (turns - turn) + 8;
    for (const auto& [ring, h] : {std::pair(&outer, r), std::pair(&inner, r - 4)}) {
      ring->push_back({-h + (turn == 0 ? 0 : 8), -h});
      ring->push_back({h, -h});
      ring->push_back({h, h});
      ring->push_back({-h, h});
      ring->push_back({-h, -h + 8});
    }
  }
  outer.insert(outer.end(), inner.rbegin(), inner.rend());
  return {{outer}};
}

// Squares in squares.
Pslg nested(std::int32_t n) {
  Pslg out;
  for (std::int32_t k = 0; k < n / 4; ++k) {
    const std::int32_t h = 4 * (n / 4 - k);
    Ring ring{{-h, -h}, {h, -h}, {h, h}, {-h, h}};
    if (k % 2 == 1) std::reverse(ring.begin(), ring.end());
    out.rings.push_back(std::move(ring));
  }
  return out;
}

// Many small holes in one ring that has as many vertices as they.
Pslg sieve(std::int32_t n) {
  constexpr std::int32_t kPitch = 1000;
  const auto side = static_cast<std::int32_t>(std::sqrt(n / 8)) + 1;
  const std::int32_t far = kPitch * side + 10;
  Pslg out;
  for (std::int32_t y = 0; y < side; ++y) {
    for (std::int32_t x = 0; x < side; ++x) {
      const LatticePoint p{kPitch * x, kPitch * y};
      out.rings.push_back({p, {p.x, p.y + 50}, {p.x + 50, p.y}});
    }
  }
  Ring ring;
  for (std::int32_t i = 0; i < n / 2; ++i)
    ring.push_back({far + i % 2, static_cast<std::int32_t>(std::int64_t{far} * i / (n / 2))});
  for (const LatticePoint p : {LatticePoint{far, far}, {-10, far}, {-10, -10}, {far, -10}})
    ring.push_back(p);
  out.rings.push_back(std::move(ring));
  return out;
}

Pslg cells_of_about(std::int32_t n) {
  Random random(15);
  return random_cells(static_cast<std::int32_t>(std::sqrt(n)), 50, random);
}

struct Shape {
  const char* name;
  Pslg (*of)(std::int32_t n);
};
constexpr Shape kShapes[] = {{"comb", [](std::int32_t n) { return comb(n, false); }},
                             {"tall comb", [](std::int32_t n) { return comb(n, true); }},
                             {"spiral", spiral},
                             {"nested", nested},
                             {"sieve", sieve},
                             {"cells", cells_of_about}};

TEST(OutlineSweep, AgreesOnShapesWithLongEdges) {
  Random random(16);
  for (const Shape& shape : kShapes) {
    Tally tally;
    const Pslg valid = shape.of(160);
    ASSERT_EQ(said(valid), "") << shape.name;
    compare(valid, tally);
    for (int i = 0; i < 60 && !HasFatalFailure(); ++i) {
      Pslg moved = valid;
      for (std::int32_t k = random.between(1, 2); k > 0; --k) {
        Ring& ring = random.pick(moved.rings);
        LatticePoint& p = random.pick(ring);
        const std::int32_t far = random.between(0, 1) == 0 ? 6 : 200;
        p = {p.x + random.between(-far, far), p.y + random.between(-far, far)};
      }
      compare(moved, tally);
    }
    EXPECT_GT(tally["outline edges cross"], 5) << shape.name;
  }
}

TEST(OutlineSweep, TestsAreAtMostTenAndThreeLogarithmsAnEdge) {
  for (const Shape& shape : kShapes) {
    for (const std::int32_t n : {1 << 8, 1 << 12, 1 << 16}) {
      const Pslg pslg = shape.of(n);
      EdgeLoops loops;
      for (const Ring& ring : pslg.rings)
        loops.add(ring);
      const SweepResult swept = sweep(loops, in_sweep_order(loops.points));
      EXPECT_FALSE(swept.crosses) << shape.name;
      EXPECT_TRUE(swept.winds_once) << shape.name;
      const auto edges = static_cast<double>(loops.points.size());
      EXPECT_LT(static_cast<double>(swept.tests), edges * (10 + 3 * std::log2(edges)))
          << shape.name << ' ' << n;
      EXPECT_GE(edges, 0.7 * n) << shape.name;
    }
  }
}

}  // namespace
}  // namespace trocar
