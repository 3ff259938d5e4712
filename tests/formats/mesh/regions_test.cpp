// SPDX-License-Identifier: GPL-3.0-or-later
// Regions that share borders: their meshes leave no gap and do not overlap.
// Long because all tests of this file share its fixtures.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/shared_borders.h"
#include "tests/support/rings_of_edges.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
using trocar::test::rings_of;
using Regions = std::vector<Pslg>;
using Edge = std::pair<LatticePoint, LatticePoint>;
using Edges = trocar::test::DirectedEdges;

// ---- generators ----

struct LabelMap {
  int size;
  std::vector<int> labels;  // 0 is void
  int at(int x, int y) const {
    return x < 0 || y < 0 || x >= size || y >= size
               ? 0
               : labels[static_cast<std::size_t>(y) * static_cast<std::size_t>(size) +
                        static_cast<std::size_t>(x)];
  }
};

// Cells around random centres, void outside a disc, and a share of pixels with any label.
LabelMap random_cells(int size, int count, double salt, std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  const auto random = [&rng] { return static_cast<double>(rng() >> 11) * 0x1p-53; };
  std::vector<std::pair<double, double>> centres;
  for (int k = 0; k < count; ++k) {
    const double x = random() * size, y = random() * size;
    centres.emplace_back(x, y);
  }
  LabelMap map{size, {}};
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      int best = 0;
      double least = 1e300;
      for (int k = 0; k < count; ++k) {
        const auto [cx, cy] = centres[static_cast<std::size_t>(k)];
        const double d = std::hypot(x - cx, y - cy);
        if (d < least) least = d, best = k + 1;
      }
      if (std::hypot(x - 0.5 * size, y - 0.5 * size) > 0.45 * size) best = 0;
      if (random() < salt) best = static_cast<int>(rng() % static_cast<std::uint64_t>(count + 1));
      map.labels.push_back(best);
    }
  }
  return map;
}

// The labels' outlines along the pixels' edges; `place(x, y)` is where a pixel's corner lies.
Regions outlines_of(const LabelMap& map, int count,
                    const std::function<LatticePoint(int, int)>& place) {
  std::vector<Edges> edges(static_cast<std::size_t>(count));
  const auto add = [&](int label, int other, LatticePoint from, LatticePoint to) {
    if (label != 0 && label != other)
      edges[static_cast<std::size_t>(label - 1)].push_back({from, to});
  };
  for (int y = 0; y < map.size; ++y) {
    for (int x = 0; x < map.size; ++x) {
      const int here = map.at(x, y);
      const LatticePoint p = place(x, y), q = place(x + 1, y), r = place(x + 1, y + 1),
                         s = place(x, y + 1);
      add(here, map.at(x, y - 1), p, q);
      add(here, map.at(x + 1, y), q, r);
      add(here, map.at(x, y + 1), r, s);
      add(here, map.at(x - 1, y), s, p);
    }
  }
  Regions out;
  for (const Edges& e : edges)
    out.push_back(rings_of(e));
  return out;
}

Regions pixel_outlines(const LabelMap& map, int count, int step) {
  return outlines_of(map, count, [step](int x, int y) { return LatticePoint{x * step, y * step}; });
}

// Moves every corner by up to 0.3 pixels in x and y: pixels stay convex, so nothing crosses.
Regions slanted_outlines(const LabelMap& map, int count, int step, std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  std::map<std::pair<int, int>, LatticePoint> places;
  return outlines_of(map, count, [&](int x, int y) {
    const int most = 3 * step / 10;
    const auto moved = [&](int c) {
      return c * step + static_cast<int>(rng() % static_cast<std::uint64_t>(2 * most + 1)) - most;
    };
    const LatticePoint fresh{moved(x), moved(y)};
    return places.emplace(std::pair{x, y}, fresh).first->second;
  });
}

// A disc of n sectors with the given angles, which sum to at most 360 degrees.
Regions sectors(const std::vector<double>& degrees, double radius, double start_deg = 7) {
  Regions out;
  double from = start_deg;
  const auto rim = [radius](double deg) {
    const double t = deg * std::numbers::pi / 180;
    return LatticePoint{static_cast<std::int32_t>(std::lrint(radius * std::cos(t))),
                        static_cast<std::int32_t>(std::lrint(radius * std::sin(t)))};
  };
  for (const double angle : degrees) {
    Ring ring{{0, 0}};
    const int parts = std::max(1, static_cast<int>(angle / 8));
    for (int k = 0; k <= parts; ++k)
      ring.push_back(rim(from + angle * k / parts));
    out.push_back({{ring}});
    from += angle;
    if (from > start_deg + 360 - 1e-9) {
      out.back().rings[0].back() = rim(start_deg);  // as the first sector rounds it
    }
  }
  return out;
}

// The triangles of a triangulation of random points, with random labels: acute nodes everywhere.
Regions random_triangles(int points, int labels, int extent, std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  const auto random = [&] {
    return static_cast<std::int32_t>(rng() % static_cast<std::uint64_t>(extent));
  };
  // Random quadrilaterals around random points, as holes that nothing fills, would be void; a chain
  // of points that is monotone in x gives a triangulation of all without void.
  std::set<std::int32_t> columns;
  while (static_cast<int>(columns.size()) < points)
    columns.insert(random());
  Ring ring{{-200, -extent}, {extent + 200, -extent}};
  for (auto x = columns.rbegin(); x != columns.rend(); ++x)
    ring.push_back({*x, random() / 2});
  const auto cdt = triangulate({{ring}});
  std::vector<Edges> edges(static_cast<std::size_t>(labels));
  if (!cdt) return {};
  const SliceMesh& mesh = cdt->mesh;
  std::vector<std::size_t> label;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    label.push_back(rng() % static_cast<std::uint64_t>(labels));
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const EdgeId beyond = cdt->beyond[t][i];
      if (beyond != kNoEdge && label[triangle_of(beyond)] == label[t]) continue;
      edges[label[t]].push_back(
          {mesh.vertices[mesh.triangles[t][i]], mesh.vertices[mesh.triangles[t][(i + 1) % 3]]});
    }
  }
  Regions out;
  for (const Edges& e : edges)
    out.push_back(rings_of(e));
  return out;
}

// ---- what must hold ----

struct Meshed {
  std::vector<Refined> refined;
  Regions stored;
};

Edges boundary_edges(const SliceMesh& mesh) {
  std::set<Edge> edges;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i)
      edges.insert({mesh.vertices[t[i]], mesh.vertices[t[(i + 1) % 3]]});
  }
  Edges out;
  for (const Edge& e : edges) {
    if (!edges.contains({e.second, e.first})) out.push_back(e);
  }
  return out;
}

// In plain sets, without the code under test: how many edges of the regions' boundaries have their
// reverse in exactly one other region, how often an edge occurs twice in one direction, and how
// many edges that lie on a shared input segment have no reverse.
struct Pairing {
  std::size_t paired = 0, doubled = 0, open = 0;
};
Pairing pairing(const Regions& regions, const std::vector<Refined>& refined) {
  std::set<Edge> input;
  for (const Pslg& region : regions) {
    for (const Ring& ring : region.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i)
        input.insert({ring[i], ring[(i + 1) % ring.size()]});
    }
  }
  std::set<Edge> all;
  Pairing out;
  for (const Refined& r : refined) {
    for (const Edge& e : boundary_edges(r.mesh))
      out.doubled += all.insert(e).second ? 0 : 1;
  }
  for (const Refined& r : refined) {
    std::map<Edge, std::int32_t> segment_of_ends;
    std::map<LatticePoint, std::set<std::int32_t>> on;
    for (std::size_t s = 0; s < r.segments.size(); ++s) {
      on[r.mesh.vertices[r.segments[s].from]].insert(static_cast<std::int32_t>(s));
      on[r.mesh.vertices[r.segments[s].to]].insert(static_cast<std::int32_t>(s));
    }
    for (std::size_t v = 0; v < r.origins.size(); ++v) {
      if (r.origins[v].segment >= 0) on[r.mesh.vertices[v]] = {r.origins[v].segment};
    }
    for (const Edge& e : boundary_edges(r.mesh)) {
      const bool has_reverse = all.contains({e.second, e.first});
      out.paired += has_reverse ? 1 : 0;
      for (const std::int32_t s : on[e.first]) {
        if (!on[e.second].contains(s)) continue;
        const Refined::Segment& segment = r.segments[static_cast<std::size_t>(s)];
        const LatticePoint from = r.mesh.vertices[segment.from], to = r.mesh.vertices[segment.to];
        // Two segments can join the same two corners only in a ring of two, which there is not.
        if (input.contains({to, from}) && !has_reverse) ++out.open;
      }
    }
  }
  return out;
}

// If the regions are too fine for the lattice, angles and stiffness are not checked.
Meshed expect_conforming(const Regions& regions, const RefinementOptions& options,
                         const std::string& what, bool is_too_fine = false) {
  Meshed out;
  auto outline = check_shared_borders(regions, regions);
  EXPECT_TRUE(outline) << what << ", input: " << outline.error().message;
  const auto cdt = triangulate_regions(regions);
  EXPECT_TRUE(cdt) << what << ": " << cdt.error().message;
  if (!outline || !cdt) return out;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    const auto ok = check_mesh_against_pslg((*cdt)[k].mesh, regions[k]);
    EXPECT_TRUE(ok) << what << ", region " << k << ": " << ok.error().message;
  }
  out.refined = refine_regions(*cdt, kLattice, options);
  std::int64_t area = 0;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    const Refined& refined = out.refined[k];
    const std::string where = what + ", region " + std::to_string(k);
    out.stored.push_back(refined_rings(refined, regions[k]));
    const auto ok = check_mesh_against_pslg(refined.mesh, out.stored.back());
    EXPECT_TRUE(ok) << where << ": " << ok.error().message;
    EXPECT_TRUE(is_constrained_delaunay(refined.mesh)) << where;
    EXPECT_NE(refined.outcome, RefinementOutcome::kVertexBudget) << where;
    const MeshQuality quality = measure_quality(refined, kLattice, options.min_angle_deg);
    if (!is_too_fine) {
      EXPECT_EQ(quality.below_unexplained, 0U) << where;
      EXPECT_EQ(quality.below_min_angle, quality.below_at_small_input_angle) << where;
    }
    // Input angles of a few degrees may leave no other lattice point, as without shared borders.
    double smallest_deg = 360;
    for (const Refined::Segment& segment : refined.segments)
      smallest_deg = std::min(smallest_deg, segment.angle_at_from_deg);
    EXPECT_TRUE(is_too_fine || quality.negative_stiffness_edges == 0 || smallest_deg < 7)
        << where << ": " << quality.negative_stiffness_edges << ' ' << smallest_deg;
    EXPECT_LE(quality.max_area_mm2, options.max_area_mm2) << where;
    area += doubled_area(refined.mesh);
    for (std::size_t v = 0; v < refined.mesh.vertices.size(); ++v) {
      const std::int32_t s = refined.origins[v].segment;
      if (s < 0) continue;
      const Refined::Segment& segment = refined.segments[static_cast<std::size_t>(s)];
      const LatticePoint a = refined.mesh.vertices[segment.from],
                         b = refined.mesh.vertices[segment.to];
      EXPECT_LT(std::abs(static_cast<double>(orient2d(a, b, refined.mesh.vertices[v]))),
                3 * std::sqrt(static_cast<double>(distance2(a, b))))
          << where;
    }
  }
  outline = check_shared_borders(regions, out.stored);
  EXPECT_TRUE(outline) << what << ": " << outline.error().message;
  if (outline) {
    EXPECT_EQ(doubled_area(*outline), area) << what;
  }
  const Pairing pairs = pairing(regions, out.refined);
  EXPECT_EQ(pairs.doubled, 0U) << what;
  EXPECT_EQ(pairs.open, 0U) << what;
  return out;
}

Ring box(std::int32_t x0, std::int32_t y0, std::int32_t x1, std::int32_t y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}
Ring hole(Ring ring) {
  std::reverse(ring.begin(), ring.end());
  return ring;
}

TEST(Regions, SectorsOfADisc) {
  for (const std::vector<double>& angles :
       std::vector<std::vector<double>>{{120, 120, 120},
                                        {200, 100, 60},
                                        {10, 170, 180},
                                        {25, 25, 25, 25, 25, 25, 25, 25, 25, 25, 25, 85},
                                        {45, 45, 45, 45, 45, 45, 45, 45},
                                        {5, 75, 5, 75, 5, 75, 5, 115},
                                        {1, 2, 3, 4, 350},
                                        {29, 61, 29, 61},
                                        {20, 20, 20}}) {
    for (const double radius : {900.0, 6000.0, 30'000.0})
      expect_conforming(sectors(angles, radius), {},
                        std::to_string(angles.size()) + " sectors, the first of " +
                            std::to_string(angles[0]) + ", radius " + std::to_string(radius));
  }
}

TEST(Regions, LabelMaps) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    for (const double salt : {0.0, 0.02, 0.2}) {
      const std::string what =
          "cells, seed " + std::to_string(seed) + " salt " + std::to_string(salt);
      const LabelMap map = random_cells(40, 10, salt, seed);
      RefinementOptions options;
      options.keep_area = seed % 2 == 1;
      if (seed % 3 == 2) options.max_area_mm2 = 0.1;
      expect_conforming(pixel_outlines(map, 10, 128), options, what);
      expect_conforming(slanted_outlines(map, 10, 128, seed), options, "slanted " + what);
    }
  }
}

TEST(Regions, TrianglesWithAcuteNodes) {
  for (std::uint64_t seed = 0; seed < 20; ++seed)
    expect_conforming(random_triangles(30, 4, 12'000, seed), {},
                      "triangles, seed " + std::to_string(seed));
}

TEST(Regions, StayValidWhereTheLatticeIsTooCoarse) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    expect_conforming(random_triangles(60, 8, 3000, seed), {}, "seed " + std::to_string(seed),
                      true);
    expect_conforming(slanted_outlines(random_cells(20, 5, 0.2, seed), 5, 12, seed), {},
                      "slanted, seed " + std::to_string(seed), true);
  }
}

// The border of a seven-cornered material in another: its points are rounded to either side, so
// that the area within stays but for one rounding.
TEST(Regions, KeepTheAreaWithinSharedBorders) {
  Ring ring;
  for (int k = 0; k < 7; ++k) {
    const double t = 2 * std::numbers::pi * (k + 0.3) / 7;
    ring.push_back({static_cast<std::int32_t>(std::lrint(5000 + 4001 * std::cos(t))),
                    static_cast<std::int32_t>(std::lrint(5000 + 3777 * std::sin(t)))});
  }
  const Regions regions = {{{box(0, 0, 10'000, 10'000), hole(ring)}}, {{ring}}};
  for (const bool keep_area : {false, true}) {
    RefinementOptions options;
    options.max_area_mm2 = 0.3;
    options.keep_area = keep_area;
    const Meshed meshed = expect_conforming(regions, options, "border");
    ASSERT_EQ(meshed.refined.size(), 2U);
    EXPECT_GT(pairing(regions, meshed.refined).paired, 200U);
    const std::int64_t lost = doubled_area(regions[1]) - doubled_area(meshed.refined[1].mesh);
    EXPECT_LE(std::abs(lost), 600) << "half squared steps; an edge has about 100 to 1000 steps";
  }
}

// If the outlines move and rotate, the meshes move and rotate with them, as those of refine() do.
TEST(Regions, MoveAndRotateWithTheirOutlines) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const Regions regions = slanted_outlines(random_cells(20, 5, 0.05, seed), 5, 128, seed);
    const auto meshes = [](const Regions& r) {
      std::vector<SliceMesh> out;
      for (Refined& refined : refine_regions(*triangulate_regions(r), kLattice, {}))
        out.push_back(std::move(refined.mesh));
      return out;
    };
    const std::vector<SliceMesh> before = meshes(regions);
    for (int quarters = 0; quarters < 4; ++quarters) {
      const auto moved = [quarters](LatticePoint p) {
        for (int q = 0; q < quarters; ++q)
          p = {-p.y, p.x};
        return LatticePoint{p.x + 12'345, p.y - 6789};
      };
      Regions rotated = regions;
      for (Pslg& pslg : rotated) {
        for (Ring& ring : pslg.rings)
          std::transform(ring.begin(), ring.end(), ring.begin(), moved);
      }
      const std::vector<SliceMesh> after = meshes(rotated);
      for (std::size_t k = 0; k < before.size(); ++k) {
        std::vector<LatticePoint> expected;
        for (const LatticePoint p : before[k].vertices)
          expected.push_back(moved(p));
        EXPECT_EQ(after[k].vertices, expected) << seed << ' ' << quarters;
        EXPECT_EQ(after[k].triangles, before[k].triangles) << seed << ' ' << quarters;
      }
    }
  }
}

TEST(Regions, OneIsRefinedAsByItself) {
  const Regions regions = slanted_outlines(random_cells(40, 1, 0.1, 5), 1, 128, 5);
  const auto cdt = test::take(triangulate_regions(regions));
  for (const bool keep_area : {false, true}) {
    RefinementOptions options;
    options.keep_area = keep_area;
    const Refined alone = refine(cdt[0], kLattice, options);
    const Refined with = refine_regions(cdt, kLattice, options)[0];
    EXPECT_EQ(with.mesh.vertices, alone.mesh.vertices);
    EXPECT_EQ(with.mesh.triangles, alone.mesh.triangles);
    EXPECT_EQ(refined_rings(with, regions[0]).rings, refined_rings(alone, regions[0]).rings);
    EXPECT_EQ(with.outcome, alone.outcome);
    EXPECT_EQ(with.angle_deg, alone.angle_deg);
    EXPECT_EQ(measure_quality(with, kLattice, 30).below_min_angle,
              measure_quality(alone, kLattice, 30).below_min_angle);
  }
  EXPECT_TRUE(refine_regions({}, kLattice, {}).empty());
  const auto none = test::take(triangulate_regions(Regions(2)));
  EXPECT_EQ(refine_regions(none, kLattice, {}).size(), 2U);
}

// If the vertex budget is too small, the meshes conform and the outcome says that they are
// incomplete.
TEST(Regions, StopAtTheirVertexBudget) {
  const Regions regions = pixel_outlines(random_cells(20, 5, 0, 1), 5, 128);
  RefinementOptions options;
  options.max_area_mm2 = 0.02;
  options.max_vertices = 1500;
  const auto refined = refine_regions(*triangulate_regions(regions), kLattice, options);
  Regions stored;
  std::size_t vertices = 0;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    EXPECT_EQ(refined[k].outcome, RefinementOutcome::kVertexBudget);
    vertices += refined[k].mesh.vertices.size();
    stored.push_back(refined_rings(refined[k], regions[k]));
    EXPECT_TRUE(check_mesh_against_pslg(refined[k].mesh, stored[k]));
  }
  EXPECT_GE(vertices, options.max_vertices);
  EXPECT_LE(vertices, options.max_vertices + 1);
  EXPECT_TRUE(check_shared_borders(regions, stored));
}

// Ten regions in one run with their union. Time is in proportion to the triangles, of which regions
// with long borders have more.
TEST(Regions, CostNoMoreThanTwiceTheirUnionForATriangle) {
  const LabelMap map = random_cells(200, 10, 0, 3);
  LabelMap whole = map;
  for (int& label : whole.labels)
    label = label == 0 ? 0 : 1;
  const Regions ten = pixel_outlines(map, 10, 128), one = pixel_outlines(whole, 1, 128);
  RefinementOptions options;
  options.max_area_mm2 = 5;
  const auto time_for_a_triangle = [&options](const Regions& regions) {
    const std::clock_t start = std::clock();
    std::size_t triangles = 0;
    for (const Refined& r : refine_regions(*triangulate_regions(regions), kLattice, options))
      triangles += r.mesh.triangles.size();
    return static_cast<double>(std::clock() - start) / static_cast<double>(triangles);
  };
  double for_ten = 1e300, for_one = 1e300;
  for (int run = 0; run < 9; ++run) {
    for_ten = std::min(for_ten, time_for_a_triangle(ten));
    for_one = std::min(for_one, time_for_a_triangle(one));
  }
  EXPECT_LE(for_ten, 2 * for_one);
  RecordProperty("ratio", std::to_string(for_ten / for_one));
}

}  // namespace
}  // namespace trocar::pipeline
