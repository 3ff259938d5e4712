// SPDX-License-Identifier: Apache-2.0
// The contract of formats/mesh/local_refinement.h. Inserting points into sheets and removing them
// again: the sheet stays valid and constrained Delaunay, and is the same as before.
#include "formats/mesh/local_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/support/campaign.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/delaunay_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

/// Wanted length of edges, in lattice steps. It grows linearly with the distance from a disc.
struct GradedSize {
  LatticePoint centre;                                         ///< centre of the disc
  double radius = 0;                                           ///< radius of the disc, steps
  double at_radius = std::numeric_limits<double>::infinity();  ///< wanted length in the disc
  double growth = 0;  ///< increase of the wanted length per step of distance from the disc
  double largest = std::numeric_limits<double>::infinity();  ///< largest wanted length
  double operator()(double x, double y) const noexcept {
    const double dx = x - centre.x, dy = y - centre.y;
    const double beyond = std::sqrt(dx * dx + dy * dy) - radius;
    return std::min(at_radius + growth * std::max(beyond, 0.0), largest);
  }
};

// ---- measures that do not use the code under test ----

double angle_deg(LatticePoint at, LatticePoint p, LatticePoint q) {
  const double px = p.x - at.x, py = p.y - at.y, qx = q.x - at.x, qy = q.y - at.y;
  return std::abs(std::atan2(px * qy - py * qx, px * qx + py * qy)) * 180 / std::numbers::pi;
}

double smallest_angle_deg(const std::array<LatticePoint, 3>& v) {
  return std::min(
      {angle_deg(v[0], v[1], v[2]), angle_deg(v[1], v[2], v[0]), angle_deg(v[2], v[0], v[1])});
}

struct BoundaryEdge {
  LatticePoint from, to, apex;
  bool is_obtuse() const { return diametral_dot(from, to, apex) < 0; }
};

std::vector<BoundaryEdge> boundary(const SheetMesh& mesh) {
  std::vector<BoundaryEdge> out;
  for (const std::uint32_t t : all_triangles(mesh)) {
    const std::array<LatticePoint, 3> v = corners(mesh, t);
    for (std::size_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] == kNoSlot) out.push_back({v[i], v[(i + 1) % 3], v[(i + 2) % 3]});
    }
  }
  return out;
}

bool lies_on(LatticePoint p, const BoundaryEdge& s) {
  return orient2d(s.from, s.to, p) == 0 && diametral_dot(s.from, s.to, p) <= 0;
}

struct Counts {
  std::uint32_t triangles = 0, sharp = 0, surely_sharp = 0, obtuse = 0;
};

Counts counts(const SheetMesh& mesh, double min_angle_deg) {
  Counts out;
  for (const std::uint32_t t : all_triangles(mesh)) {
    const double angle = smallest_angle_deg(corners(mesh, t));
    ++out.triangles;
    out.sharp += angle < min_angle_deg + 1e-6 ? 1 : 0;
    out.surely_sharp += angle < min_angle_deg - 1e-6 ? 1 : 0;
  }
  for (const BoundaryEdge& s : boundary(mesh))
    out.obtuse += s.is_obtuse() ? 1 : 0;
  return out;
}

// Can a boundary edge be the reason why triangle v is still sharp: does the point that would remove
// it lie in the diametral circle of such an edge, or beyond one? With a tolerance of a few steps
// for rounding. Triangles with shorter edges are not refined.
bool is_outline_near(const std::array<LatticePoint, 3>& v, double min_angle_deg,
                     const std::vector<BoundaryEdge>& edges) {
  std::size_t k = 0;
  for (std::size_t i = 1; i < 3; ++i) {
    if (distance2(v[i], v[(i + 1) % 3]) < distance2(v[k], v[(k + 1) % 3])) k = i;
  }
  const LatticePoint p = v[k], q = v[(k + 1) % 3], r = v[(k + 2) % 3];
  const auto base = static_cast<double>(length(p, q));
  if (base < 4) return true;  // the lattice is the reason
  const double beta = angle_deg(r, p, q) * std::numbers::pi / 180;
  const double theta = min_angle_deg * std::numbers::pi / 180;
  // The circumcentre sees pq under 2 beta, the off-centre under theta.
  const double high = std::min(0.5 * base / std::tan(beta), 0.5 * base / std::tan(theta / 2));
  const double x = 0.5 * (p.x + q.x) - high / base * (q.y - p.y);
  const double y = 0.5 * (p.y + q.y) + high / base * (q.x - p.x);
  const double cx = (v[0].x + v[1].x + v[2].x) / 3.0, cy = (v[0].y + v[1].y + v[2].y) / 3.0;
  const double slack = 3 + 0.4 * high * std::min(1.0, 4 / base);
  for (const BoundaryEdge& s : edges) {
    const double mx = 0.5 * (s.from.x + s.to.x), my = 0.5 * (s.from.y + s.to.y);
    if (std::hypot(x - mx, y - my) < 0.5 * static_cast<double>(length(s.from, s.to)) + slack)
      return true;
    const auto side_of = [&s](double px, double py) {
      return (s.to.x - s.from.x) * (py - s.from.y) - (s.to.y - s.from.y) * (px - s.from.x);
    };
    const auto ray_of = [&](LatticePoint e) {
      return (x - cx) * (e.y - cy) - (y - cy) * (e.x - cx);
    };
    if (side_of(cx, cy) * side_of(x, y) <= 0 && ray_of(s.from) * ray_of(s.to) <= 0) return true;
  }
  return false;
}

// ---- the contract ----

LocalRefinementResult refine_and_check(SheetMesh& mesh, const std::vector<std::uint32_t>& seeds,
                                       const LocalRefinementOptions& options,
                                       const std::string& where) {
  SCOPED_TRACE(where);
  const SheetMesh before = mesh;
  const bool was_delaunay = is_constrained_delaunay(to_slice_mesh(before));
  SheetEdit edit(mesh);
  edit.begin(mesh);
  LocalRefinementWorkspace workspace(mesh);
  const LocalRefinementResult result = refine_locally(mesh, edit, seeds, options, workspace);

  // 1
  const Result<void> valid = check_sheet_mesh(mesh);
  EXPECT_TRUE(valid) << valid.error().message;
  EXPECT_TRUE(!was_delaunay || is_constrained_delaunay(to_slice_mesh(mesh)));
  // 2
  const std::int64_t lost = doubled_area(to_slice_mesh(before)) - doubled_area(to_slice_mesh(mesh));
  EXPECT_EQ(lost, result.doubled_area_lost);
  EXPECT_GE(lost, 0);
  const std::vector<BoundaryEdge> old_edges = boundary(before);
  if (!options.split_outline) {
    EXPECT_EQ(lost, 0);
    for (const BoundaryEdge& s : boundary(mesh)) {
      // 6
      EXPECT_TRUE(std::any_of(old_edges.begin(), old_edges.end(), [&s](const BoundaryEdge& o) {
        return lies_on(s.from, o) && lies_on(s.to, o) && (o.is_obtuse() || !s.is_obtuse());
      }));
    }
  }
  // 3
  EXPECT_LE(result.vertices_added, options.max_new_vertices);
  EXPECT_EQ(mesh.vertices_in_use() + result.vertices_removed,
            before.vertices_in_use() + result.vertices_added);
  SheetMesh replica = before;
  edit.change().copy_to(mesh, replica);
  EXPECT_TRUE(same(replica, mesh)) << "a slot was written and not listed";
  // 5
  SheetMesh again = before;
  edit.begin(again);
  refine_locally(again, edit, seeds, options, workspace);
  EXPECT_TRUE(same(again, mesh)) << "the second run differs";
  return result;
}

// The same with all triangles as seeds, and the counts.
void refine_all_and_check(SheetMesh& mesh, const LocalRefinementOptions& options,
                          const std::string& where) {
  const LocalRefinementResult result = refine_and_check(mesh, all_triangles(mesh), options, where);
  const Counts now = counts(mesh, options.min_angle_deg);
  EXPECT_EQ(result.inspected, now.triangles) << where;
  EXPECT_LE(result.sharp, now.sharp) << where;
  EXPECT_GE(result.sharp, now.surely_sharp) << where;
  EXPECT_EQ(result.obtuse_edges, now.obtuse) << where;
  EXPECT_TRUE(result.outcome != LocalRefinementOutcome::kDone ||
              result.sharp + result.obtuse_edges == 0)
      << where;
  if (result.outcome != LocalRefinementOutcome::kDone &&
      result.outcome != LocalRefinementOutcome::kLimitedByOutline)
    return;
  // Each sharp triangle that is left has a known reason.
  EXPECT_EQ(result.sharp, result.sharp_at_outline + result.sharp_at_lattice) << where;
  const std::vector<BoundaryEdge> edges = boundary(mesh);
  for (const std::uint32_t t : all_triangles(mesh)) {
    const std::array<LatticePoint, 3> v = corners(mesh, t);
    if (smallest_angle_deg(v) >= options.min_angle_deg - 1e-6) continue;
    EXPECT_TRUE(is_outline_near(v, options.min_angle_deg, edges))
        << where << ": triangle " << t << " at " << v[0].x << ' ' << v[0].y << ", " << v[1].x << ' '
        << v[1].y << ", " << v[2].x << ' ' << v[2].y;
  }
}

TEST(LocalRefinement, ContractHoldsOnRandomSheets) {
  for (int seed = 1; seed <= test::campaign(250) && !testing::Test::HasFailure(); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    for (const bool split_outline : {false, true}) {
      SheetMesh mesh = random_sheet(random, 400, 800);
      GradedSize size;
      size.centre = random.point(-1000, 1000);
      size.radius = random.between(0, 500);
      size.at_radius = random.between(5, 300);
      size.growth = random.unit();
      LocalRefinementOptions options;
      options.split_outline = split_outline;
      options.min_angle_deg = random.between(0, 30);
      options.max_new_vertices = 300;
      if (random.between(0, 2) == 0) options.size = size;
      refine_all_and_check(mesh, options, "seed " + std::to_string(seed));
    }
  }
}

TEST(LocalRefinement, WritesOnlyTheNeighbourhoodOfTheSeeds) {
  // The same hole in a small and in a large sheet takes the same work.
  std::array<std::uint32_t, 2> added{};
  std::array<std::size_t, 2> written{};
  for (const std::size_t i : {0U, 1U}) {
    const int cells = i == 0 ? 10 : 60;
    const Result<CutResult> hole = cut(test::square_mesh({-100 * cells, -100 * cells}, 200, cells),
                                       hexagon({20, 31}, 330, 0.1));
    ASSERT_TRUE(hole);
    SheetMesh mesh = *make_sheet_mesh(hole->mesh, 300, 600);
    flip_all(mesh);
    std::vector<std::uint32_t> seeds;
    for (const std::uint32_t t : all_triangles(mesh)) {
      const std::array<LatticePoint, 3> v = corners(mesh, t);
      if (std::all_of(v.begin(), v.end(),
                      [](LatticePoint p) { return std::hypot(p.x, p.y) < 700; }))
        seeds.push_back(t);
    }
    SheetEdit edit(mesh);
    edit.begin(mesh);
    LocalRefinementWorkspace workspace(mesh);
    LocalRefinementOptions options;
    options.split_outline = true;
    options.min_angle_deg = 25;
    added[i] = refine_locally(mesh, edit, seeds, options, workspace).vertices_added;
    written[i] = edit.triangles().size();
    ASSERT_TRUE(check_sheet_mesh(mesh));
  }
  EXPECT_GT(added[0], 3U);
  EXPECT_EQ(added[0], added[1]);
  EXPECT_EQ(written[0], written[1]);
}

// ---- a graded region around a hole ----

// ---- stress cases ----

TEST(LocalRefinement, EndsOnFansOfNeedles) {
  // Seven needles around one point.
  for (const double needle_deg : {2.0, 5.0, 12.0, 25.0}) {
    for (const bool split_outline : {false, true}) {
      SliceMesh mesh{{{0, 0}}, {}};
      for (int i = 0; i < 7; ++i) {
        const double from = i * 50 * std::numbers::pi / 180,
                     to = from + needle_deg * std::numbers::pi / 180;
        const auto v = static_cast<std::uint32_t>(mesh.vertices.size());
        // Each has its own vertex at the common point: a pinch.
        mesh.vertices.push_back({0, 0});
        for (const double angle : {from, to})
          mesh.vertices.push_back({static_cast<int>(std::lround(3000 * std::cos(angle))),
                                   static_cast<int>(std::lround(3000 * std::sin(angle)))});
        mesh.triangles.push_back({v, v + 1, v + 2});
      }
      mesh.vertices.erase(mesh.vertices.begin());
      for (Triangle& t : mesh.triangles) {
        for (std::uint32_t& c : t)
          --c;
      }
      SheetMesh sheet = *make_sheet_mesh(mesh, 2000, 4000);
      LocalRefinementOptions options;
      options.split_outline = split_outline;
      options.max_new_vertices = 2000;
      const std::string where =
          std::to_string(needle_deg) + " degrees, " + (split_outline ? "split" : "whole");
      refine_all_and_check(sheet, options, where);
      EXPECT_LT(sheet.vertices_in_use(), 1500U) << where << ": did not end by itself";
    }
  }
}

TEST(LocalRefinement, AcuteCornersTakeFewPoints) {
  // Two long edges of different lengths meet; their pieces must not keep encroaching upon each
  // other.
  for (const double corner_deg : {22.0, 30.0, 40.0, 50.0, 58.0, 65.0}) {
    for (const double ratio : {0.55, 0.7, 0.9}) {
      const double angle = corner_deg * std::numbers::pi / 180, leg = 40'000;
      const SliceMesh mesh{{{0, 0},
                            {static_cast<int>(leg), 0},
                            {static_cast<int>(std::lround(ratio * leg * std::cos(angle))),
                             static_cast<int>(std::lround(ratio * leg * std::sin(angle)))}},
                           {{0, 1, 2}}};
      SheetMesh sheet = *make_sheet_mesh(mesh, 500, 1000);
      LocalRefinementOptions options;
      options.split_outline = true;
      const std::string where = std::to_string(corner_deg) + " degrees, " + std::to_string(ratio);
      refine_all_and_check(sheet, options, where);
      EXPECT_EQ(counts(sheet, 20).obtuse, 0U) << where;
      EXPECT_EQ(counts(sheet, 20).sharp, 0U) << where;
      EXPECT_LE(sheet.vertices_in_use(), 12U) << where;
    }
  }
}

TEST(LocalRefinement, KeptEdgesStay) {
  for (int seed = 1; seed <= test::campaign(60); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    SheetMesh mesh = random_sheet(random, 400, 800);
    // About every third boundary edge of the start.
    std::set<std::array<std::uint32_t, 2>> kept;
    for (const std::uint32_t t : all_triangles(mesh)) {
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (mesh.across[t][i] == kNoSlot && random.between(0, 2) == 0)
          kept.insert({mesh.triangles[t][i], mesh.triangles[t][(i + 1) % 3]});
      }
    }
    const auto keep = [&kept](std::uint32_t from, std::uint32_t to) {
      return kept.contains({from, to});
    };
    GradedSize size;
    size.at_radius = 60;
    LocalRefinementOptions options;
    options.split_outline = true;
    options.min_angle_deg = 25;
    options.size = size;
    options.keep_edge = keep;
    const LocalRefinementResult result =
        refine_and_check(mesh, all_triangles(mesh), options, "seed " + std::to_string(seed));
    std::size_t there = 0, obtuse = 0;
    for (const std::uint32_t t : all_triangles(mesh)) {
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1) % 3];
        if (mesh.across[t][i] != kNoSlot) continue;
        const LatticePoint apex = mesh.vertices[mesh.triangles[t][(i + 2) % 3]];
        const bool is_kept = kept.contains({from, to});
        there += is_kept ? 1 : 0;
        obtuse +=
            !is_kept && diametral_dot(mesh.vertices[from], mesh.vertices[to], apex) < 0 ? 1 : 0;
      }
    }
    EXPECT_EQ(there, kept.size()) << "seed " << seed;
    EXPECT_EQ(obtuse, result.obtuse_edges) << "seed " << seed;
  }
}

TEST(LocalRefinement, ContractHoldsOnTinyAndExtremeTriangles) {
  const std::vector<std::vector<LatticePoint>> shapes{
      {{0, 0}, {1, 0}, {0, 1}},
      {{0, 0}, {2, 0}, {0, 2}},
      {{0, 0}, {1000, 1}, {0, 2}},
      {{0, 0}, {1000, 0}, {999, 1}},
      {{0, 0}, {64, 0}, {32, 1}},
      {{0, 0}, {4000, 0}, {2000, 30}},
      {{0, 0}, {3, 1}, {1, 3}},
      {{0, 0}, {16, 0}, {8, 7}},
      {{0, 0}, {4001, 3}, {17, 2900}},
      {{-(1 << 29), -(1 << 29)}, {1 << 29, -(1 << 29)}, {0, 1 << 29}},
  };
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    for (const bool split_outline : {false, true}) {
      for (const double at_radius : {1.0, 3.0, std::numeric_limits<double>::infinity()}) {
        SheetMesh sheet = *make_sheet_mesh({shapes[i], {{0, 1, 2}}}, 200, 400);
        GradedSize size;
        size.at_radius = at_radius;
        LocalRefinementOptions options;
        options.split_outline = split_outline;
        options.max_new_vertices = 150;
        options.size = size;
        refine_all_and_check(sheet, options, "shape " + std::to_string(i));
      }
    }
  }
}

TEST(LocalRefinement, WithoutBudgetOrCapacityNothingChanges) {
  Random random(17);
  int stopped = 0;
  for (int round = 0; round < 30; ++round) {
    SheetMesh mesh = random_sheet(random, 0, 0);
    const SheetMesh before = mesh;
    LocalRefinementOptions options;
    options.min_angle_deg = 30;
    options.split_outline = true;
    options.max_new_vertices = 0;
    LocalRefinementResult result =
        refine_and_check(mesh, all_triangles(mesh), options, "no budget");
    EXPECT_TRUE(same(mesh, before));
    EXPECT_TRUE(result.outcome == LocalRefinementOutcome::kBudget ||
                result.outcome == LocalRefinementOutcome::kDone);

    // Every small number of free slots.
    for (std::size_t spare = 0; spare < 12; ++spare) {
      SheetMesh small = *make_sheet_mesh(to_slice_mesh(before), spare / 2, spare);
      options.max_new_vertices = 100;
      result = refine_and_check(small, all_triangles(small), options, "few free slots");
      stopped += result.outcome == LocalRefinementOutcome::kCapacity ? 1 : 0;
    }

    SheetEdit edit(mesh);
    edit.begin(mesh);
    const std::size_t vertices = mesh.vertices.size(), triangles = mesh.triangles.size();
    for (const auto& [v, t] : {std::array{vertices - 1, triangles}, {vertices, triangles - 1}}) {
      LocalRefinementWorkspace too_small(v, t);
      result = refine_locally(mesh, edit, all_triangles(mesh), options, too_small);
      EXPECT_EQ(result.outcome, LocalRefinementOutcome::kCapacity);
      EXPECT_TRUE(same(mesh, before));
    }
  }
  EXPECT_GT(stopped, 100);
}

TEST(LocalRefinement, ContractHoldsForInvalidSeedsAndOptions) {
  Random random(23);
  for (int round = 0; round < 20; ++round) {
    SheetMesh mesh = random_sheet(random, 300, 600);
    std::vector<std::uint32_t> seeds = all_triangles(mesh);
    seeds.insert(seeds.end(), seeds.begin(), seeds.end());  // twice
    seeds.push_back(kNoSlot);
    seeds.push_back(static_cast<std::uint32_t>(mesh.triangles.size()));
    seeds.push_back(mesh.free_triangles.front());
    for (const double value : {-1.0, 0.0, 1e300, std::numeric_limits<double>::quiet_NaN()}) {
      const auto size = [value](double, double) { return value; };
      LocalRefinementOptions options;
      options.split_outline = round % 2 == 0;
      options.max_new_vertices = 60;
      options.size = size;
      SheetMesh copy = mesh;
      refine_and_check(copy, seeds, options, "size " + std::to_string(value));
      options.size = {};
      options.min_angle_deg = value;
      copy = mesh;
      refine_and_check(copy, seeds, options, "angle " + std::to_string(value));
    }
  }
  SheetMesh empty = *make_sheet_mesh({}, 4, 4);
  EXPECT_EQ(refine_and_check(empty, {}, {}, "empty").outcome, LocalRefinementOutcome::kDone);
}

TEST(LocalRefinement, ASheetThatIsNotDelaunayStaysValid) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Random random(seed);
    SliceMesh mesh = test::square_mesh({0, 0}, 300, 5);
    for (LatticePoint& p : mesh.vertices) {
      const bool is_inner = p.x > 0 && p.y > 0 && p.x < 1500 && p.y < 1500;
      if (is_inner) p = {p.x + random.between(-70, 70), p.y + random.between(-70, 70)};
    }
    ASSERT_TRUE(check_mesh(mesh));
    SheetMesh sheet = *make_sheet_mesh(mesh, 500, 1000);
    GradedSize size;
    size.at_radius = 60;
    size.growth = 0.2;
    LocalRefinementOptions options;
    options.size = size;
    options.min_angle_deg = 30;
    options.split_outline = seed % 2 == 0;
    refine_and_check(sheet, all_triangles(sheet), options, "seed " + std::to_string(seed));
  }
}

TEST(LocalRefinement, DoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  Random random(29);
  std::uint32_t added = 0;
  for (int round = 0; round < 30; ++round) {
    SheetMesh mesh = random_sheet(random, 300, 600);
    const std::vector<std::uint32_t> seeds = all_triangles(mesh);
    SheetEdit edit(mesh);
    edit.begin(mesh);
    LocalRefinementWorkspace workspace(mesh);
    LocalRefinementOptions options;
    options.split_outline = round % 2 == 0;
    EXPECT_EQ(allocations_of([&] {
                added += refine_locally(mesh, edit, seeds, options, workspace).vertices_added;
              }),
              0U);
  }
  EXPECT_GT(added, 300U);
}

// ---- after cuts in real slices ----

// Four points on a circle have several Delaunay triangulations.
bool is_unique(const SheetMesh& mesh) {
  for (const std::uint32_t t : all_triangles(mesh)) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNoSlot) continue;
      const auto [a, b, c] = corners(mesh, t);
      for (const LatticePoint d : corners(mesh, u)) {
        if (d != a && d != b && d != c && in_circle(a, b, c, d) == 0) return false;
      }
    }
  }
  return true;
}

LatticePoint inside(Random& random, const SheetMesh& mesh, std::uint32_t t) {
  const auto [a, b, c] = corners(mesh, t);
  const double u = random.unit(), v = random.unit() * (1 - u);
  return {static_cast<std::int32_t>(std::lround(a.x + u * (b.x - a.x) + v * (c.x - a.x))),
          static_cast<std::int32_t>(std::lround(a.y + u * (b.y - a.y) + v * (c.y - a.y)))};
}

bool is_inside(const SheetMesh& mesh, std::uint32_t t, LatticePoint p) {
  const auto [a, b, c] = corners(mesh, t);
  return orient2d(a, b, p) > 0 && orient2d(b, c, p) > 0 && orient2d(c, a, p) > 0;
}

TEST(PointInsertion, InsertionAndRemovalRestoreTheSheet) {
  int inserted = 0, compared = 0;
  for (int seed = 1; seed <= test::campaign(300); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    SheetMesh mesh = random_sheet(random, 40, 80);
    SheetEdit edit(mesh);
    PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
    VertexRemoval removal;
    for (int round = 0; round < 10; ++round) {
      const std::vector<std::uint32_t> slots = all_triangles(mesh);
      const std::uint32_t t = random.pick(slots);
      const LatticePoint p = inside(random, mesh, t);
      if (!is_inside(mesh, t, p)) continue;
      const std::vector<Points> before = points_of(mesh);
      const bool was_unique = is_unique(mesh);
      const std::int64_t area = doubled_area(to_slice_mesh(mesh));

      edit.begin(mesh);
      ASSERT_TRUE(insertion.find(mesh, t, p));
      ASSERT_EQ(insertion.insert(mesh, edit, p, kNoSlot), InsertionOutcome::kDone)
          << "seed " << seed;
      ++inserted;
      ASSERT_TRUE(check_sheet_mesh(mesh)) << "seed " << seed;
      ASSERT_TRUE(is_constrained_delaunay(to_slice_mesh(mesh))) << "seed " << seed;
      ASSERT_EQ(doubled_area(to_slice_mesh(mesh)), area);
      ASSERT_EQ(mesh.vertices[insertion.vertex()], p);
      for (const std::uint32_t s : insertion.star())
        ASSERT_EQ(mesh.triangles[s][2], insertion.vertex());

      if (random.between(0, 1) == 0) continue;
      if (!removal.plan(mesh, insertion.star()[0], 2)) continue;
      removal.remove(mesh, edit);
      ASSERT_TRUE(check_sheet_mesh(mesh)) << "seed " << seed;
      ASSERT_TRUE(is_constrained_delaunay(to_slice_mesh(mesh))) << "seed " << seed;
      if (!was_unique) continue;
      ASSERT_EQ(points_of(mesh), before) << "seed " << seed;
      ++compared;
    }
  }
  EXPECT_GT(inserted, test::campaign(300) / 2);
  EXPECT_GT(compared, test::campaign(300) / 10);
}

TEST(PointInsertion, TakesItsSlotsFromTheCavityAndTheFreeOnes) {
  for (const auto& [vertices, triangles] : {std::pair{0, 9}, {9, 1}, {1, 2}}) {
    SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 100, 2), vertices, triangles);
    SheetEdit edit(mesh);
    edit.begin(mesh);
    PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
    ASSERT_TRUE(insertion.find(mesh, 0, {60, 20}));
    EXPECT_EQ(insertion.insert(mesh, edit, {60, 20}, kNoSlot), vertices >= 1 && triangles >= 2
                                                                   ? InsertionOutcome::kDone
                                                                   : InsertionOutcome::kCapacity);
  }
}

TEST(PointInsertion, PointsOnOrBeyondTheOutlineAreNotVisible) {
  SheetMesh mesh = *make_sheet_mesh({{{0, 0}, {100, 0}, {50, 30}}, {{0, 1, 2}}}, 3, 3);
  const SheetMesh before = mesh;
  SheetEdit edit(mesh);
  edit.begin(mesh);
  PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
  EXPECT_FALSE(insertion.find(mesh, 0, {50, 40})) << "not in the circumcircle";
  ASSERT_TRUE(insertion.find(mesh, 0, {50, -10}));
  EXPECT_EQ(insertion.insert(mesh, edit, {50, -10}, kNoSlot), InsertionOutcome::kNotVisible);
  ASSERT_TRUE(insertion.find(mesh, 0, {50, 0}));
  EXPECT_EQ(insertion.insert(mesh, edit, {50, 0}, kNoSlot), InsertionOutcome::kNotVisible);
  EXPECT_TRUE(same(mesh, before));
  // But the edge can be split there.
  ASSERT_EQ(insertion.boundary()[0].from, 0U);
  EXPECT_EQ(insertion.insert(mesh, edit, {50, 0}, 0), InsertionOutcome::kDone);
  EXPECT_TRUE(check_sheet_mesh(mesh));
  EXPECT_EQ(mesh.triangles_in_use(), 2U);
}

TEST(VertexRemoval, RefusesVerticesOnTheOutline) {
  SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 100, 2), 0, 0);
  VertexRemoval removal;
  int inner = 0;
  for (const std::uint32_t t : all_triangles(mesh)) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const bool is_inner = mesh.vertices[mesh.triangles[t][i]] == LatticePoint{100, 100};
      EXPECT_EQ(removal.plan(mesh, t, i), is_inner);
      inner += is_inner ? 1 : 0;
    }
  }
  EXPECT_GT(inner, 0);
}

TEST(TriangleQueue, GivesTheLeastKeyAfterAnyChange) {
  Random random(9);
  constexpr int kSlots = 60;
  TriangleQueue queue(kSlots);
  std::vector<std::int64_t> keys(kSlots, -1);  // -1: not in the queue
  for (int round = 0; round < 20'000; ++round) {
    const auto slot = static_cast<std::size_t>(random.between(0, kSlots - 1));
    if (random.between(0, 2) == 0) {
      queue.remove(static_cast<std::uint32_t>(slot));
      keys[slot] = -1;
    } else {
      keys[slot] = random.between(0, 40);
      queue.put(static_cast<std::uint32_t>(slot), keys[slot]);
    }
    if (round % 1000 == 999) {
      queue.clear();
      std::fill(keys.begin(), keys.end(), -1);
    }
    std::size_t least = kSlots;
    for (std::size_t s = 0; s < kSlots; ++s) {
      if (keys[s] >= 0 && (least == kSlots || keys[s] < keys[least])) least = s;
    }
    ASSERT_EQ(queue.empty(), least == kSlots);
    if (queue.empty()) continue;
    ASSERT_EQ(queue.top(), least);
    ASSERT_EQ(queue.top_key(), keys[least]);
  }
}

}  // namespace
}  // namespace trocar::runtime
