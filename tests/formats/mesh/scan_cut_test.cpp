// SPDX-License-Identifier: GPL-3.0-or-later
// Series of random cuts in the slices of real scans. The cut itself proves every hole; here the
// sheet is checked as a whole, its area is compared with the sum of the cuts, patches with CGAL's
// constrained Delaunay triangulation, and replicas with the sheets that they follow.
//
// TROCAR_ASSETS names the folder of sample.glb, l3.glb and head.glb.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <numbers>

#include "formats/asset/asset.h"
#include "formats/mesh/cut.h"
#include "formats/mesh/local_refinement.h"
#include "tests/support/campaign.h"
#include "tests/support/cgal_sheets.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/cut_checks.h"
#include "tests/support/random_geometry.h"
#include "tests/support/same_sheet_mesh.h"
#include "tests/support/take.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

// --- tools -----------------------------------------------------------------------------------

// A tool around the origin.
Ring shape(Random& random, double radius) {
  const LatticePoint origin{};
  const int n = random.between(0, 4);
  if (n == 0) return star(random, origin, 0.3 * radius, radius, random.between(5, 32));
  if (n == 1 && radius < 1e6)
    return any_tool(random, origin, std::max(3, static_cast<int>(radius)));
  // A regular hexagon, tilted up to 45 degrees: longer along one direction.
  const double stretch = n == 2 ? 1 : 1 / std::cos(random.unit() * std::numbers::pi / 4);
  const double turn = random.unit(), along = random.unit() * std::numbers::pi;
  const double c = std::cos(along), s = std::sin(along);
  Ring ring;
  for (int i = 0; i < 6; ++i) {
    const double angle = turn + i * std::numbers::pi / 3;
    const double u = stretch * radius * std::cos(angle), v = radius * std::sin(angle);
    ring.push_back({static_cast<std::int32_t>(std::lround(u * c - v * s)),
                    static_cast<std::int32_t>(std::lround(u * s + v * c))});
  }
  return is_tool(ring) ? ring : star(random, origin, 0.3 * radius + 2, radius + 3, 6);
}

Ring moved(const Ring& ring, LatticePoint by) {
  Ring out = ring;
  for (LatticePoint& p : out)
    p = {p.x + by.x, p.y + by.y};
  return out;
}

// --- CGAL --------------------------------------------------------------------------------------

// Empty, or how the patch differs from CGAL's triangulation of the same points and boundary.
std::string differs_from_cgal(const Overlay& overlay, const Patch& patch) {
  Cdt cdt;
  std::vector<Cdt::Vertex_handle> vertex;
  for (std::uint32_t i = 0; i < overlay.points.size(); ++i) {
    vertex.push_back(cdt.insert({overlay.points[i].x, overlay.points[i].y}));
    vertex.back()->info() = i;
  }
  for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (patch.across[t][i] == kNoSlot) {
        cdt.insert_constraint(vertex[patch.triangles[t][i]],
                              vertex[patch.triangles[t][(i + 1) % 3]]);
      }
    }
  }
  if (cdt.number_of_vertices() != overlay.points.size()) return "CGAL has other points";
  // The patch's boundary separates inside from outside.
  if (faces_inside(cdt).size() != patch.triangles.size())
    return "CGAL has another number of triangles";
  for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t u = patch.across[t][i];
      if (u == kNoSlot || u < t) continue;
      const Triangle& own = patch.triangles[t];
      if (!cdt.is_edge(vertex[own[i]], vertex[own[(i + 1) % 3]]) &&
          !is_tie(overlay.points, own, patch.triangles[u]))
        return "an edge that is neither CGAL's nor a tie";
    }
  }
  return {};
}

// --- sheets --------------------------------------------------------------------------------------

using trocar::test::same;

// A slice to be cut, with its replica.
struct Subject {
  SheetMesh mesh, replica;
  TriangleGrid grid, replica_grid;
  SheetEdit edit;
  std::int64_t doubled_area, doubled_area_at_first;
  std::vector<Ring> rings;  ///< rings of the sheet before the first cut
  double edge = 0;          ///< length of a typical one

  explicit Subject(const SliceMesh& slice)
      : mesh(*make_sheet_mesh(slice, 3000, 6000)),
        replica(mesh),
        grid(mesh),
        replica_grid(mesh),
        edit(mesh),
        doubled_area(trocar::doubled_area(slice)),
        doubled_area_at_first(doubled_area),
        rings(boundary_rings(slice).rings) {
    edge = std::sqrt(2.3 * static_cast<double>(doubled_area) / 2 /
                     static_cast<double>(slice.triangles.size()));
  }
};

LatticePoint random_corner(Random& random, const Subject& subject) {
  while (true) {
    const auto t = static_cast<std::uint32_t>(
        random.between(0, static_cast<int>(subject.mesh.triangles.size()) - 1));
    if (subject.mesh.in_use(t)) return subject.mesh.vertices[subject.mesh.triangles[t][0]];
  }
}

// A tool over the sheet: anywhere, at its boundary, around an island or a hole, or the last one
// moved by a step.
Ring next_tool(Random& random, const Subject& subject, const Ring& last) {
  const int where = random.between(0, 9);
  if (where < 3 && !last.empty()) return moved(last, random.point(-1, 1));
  const double quarter = std::sqrt(static_cast<double>(subject.doubled_area_at_first) / 8 / 2.6);
  const double smallest = std::max(3.0, 0.1 * subject.edge);
  double radius = smallest * std::pow(std::max(1.0, quarter / smallest), random.unit());
  if (random.between(0, 2) > 0) radius = std::min(radius, 3 * subject.edge);
  LatticePoint at = random_corner(random, subject);
  if (where < 6) {
    const Ring& ring = random.pick(subject.rings);
    at = random.pick(ring);
    if (where == 5) {
      const LatticeBox box = box_around(ring);
      const double half = 0.5 * std::hypot(box.high.x - box.low.x, box.high.y - box.low.y);
      if (half < quarter) {
        at = {(box.low.x + box.high.x) / 2, (box.low.y + box.high.y) / 2};
        radius = half * (0.9 + 0.4 * random.unit());
      }
    }
  }
  const int jitter = static_cast<int>(subject.edge);
  const LatticePoint by =
      random.between(0, 3) == 0 ? LatticePoint{} : random.point(-jitter, jitter);
  return moved(shape(random, radius), {at.x + by.x, at.y + by.y});
}

// Twice the area that sheet and tool have in common, of the triangles near the tool.
Real common_area(const Subject& subject, const Ring& tool) {
  const SliceMesh parts = mesh_of({tool}, {});
  Real sum = 0;
  subject.grid.for_each(subject.mesh, box_around(tool), [&](std::uint32_t t) {
    sum += runtime::common_area(corners(subject.mesh, t), parts);
  });
  return sum;
}

// Checks the whole sheet.
void check_whole(const Subject& subject, Random& random) {
  test::take(check_sheet_mesh(subject.mesh));
  const SliceMesh mesh = to_slice_mesh(subject.mesh);
  ASSERT_TRUE(is_constrained_delaunay(mesh));
  ASSERT_EQ(doubled_area(mesh), subject.doubled_area);
  ASSERT_TRUE(same(subject.mesh, subject.replica));
  std::vector<std::uint32_t> found, in_replica;
  const LatticeBox all{{-kMaxCoordinate, -kMaxCoordinate}, {kMaxCoordinate, kMaxCoordinate}};
  subject.grid.for_each(subject.mesh, all, [&](std::uint32_t t) { found.push_back(t); });
  subject.replica_grid.for_each(subject.replica, all,
                                [&](std::uint32_t t) { in_replica.push_back(t); });
  ASSERT_EQ(found, in_replica);
  ASSERT_EQ(found.size(), mesh.triangles.size());
  // The boundary winds around every point at most once, so nothing overlaps.
  const std::vector<Ring> rings = boundary_rings(mesh).rings;
  for (int i = 0; i < 5 && !mesh.vertices.empty(); ++i) {
    const LatticePoint near = random_corner(random, subject);
    const Real x = near.x + random.unit() - 0.5L, y = near.y + random.unit() - 0.5L;
    if (nearest_edge(x, y, rings) < 1e-9L) continue;
    const int w = winding(x, y, rings);
    ASSERT_TRUE(w == 0 || w == 1) << w;
  }
}

class Cutter {
 public:
  explicit Cutter(std::uint64_t seed) : random_(seed) {}

  // A series of cuts in one slice.
  void series(const SliceMesh& slice, int wanted) {
    Subject subject(slice);
    CutWorkspace work(capacity_for(subject.mesh.vertices.size(), subject.mesh.triangles.size()));
    LocalRefinementWorkspace refinement(subject.mesh);
    Ring last;
    for (int k = 0; k < wanted; ++k) {
      if (subject.doubled_area < subject.doubled_area_at_first / 3) break;
      SCOPED_TRACE(testing::Message() << "cut " << k);
      const Ring tool = next_tool(random_, subject, last);
      last = tool;
      ASSERT_NO_FATAL_FAILURE(cut(subject, tool, work, refinement));
      if (cuts % 100 == 0) {
        ASSERT_NO_FATAL_FAILURE(whole(subject));
      }
    }
    whole(subject);
  }

  int cuts = 0, inside = 0;

 private:
  void whole(const Subject& subject) {
    if (subject.mesh.triangles_in_use() > 0) check_whole(subject, random_);
  }

  void cut(Subject& subject, const Ring& tool, CutWorkspace& work,
           LocalRefinementWorkspace& refinement) {
    const bool look_at_area = random_.between(0, 49) == 0;
    const Real common = look_at_area ? common_area(subject, tool) : 0;
    const CutReport report = cut_in_place(subject.mesh, subject.grid, tool, work, subject.edit);
    ++cuts;
    if (report.outcome == CutOutcome::kCapacity) {
      // The slots are used up: nothing has changed.
      ASSERT_LT(subject.mesh.free_triangles.size(), 6000U);
      ASSERT_TRUE(same(subject.mesh, subject.replica));
      return;
    }
    if (report.outcome == CutOutcome::kNoOverlap) {
      ASSERT_TRUE(subject.edit.triangles().empty());
      ASSERT_LT(static_cast<double>(common), 1.0);
      return;
    }
    ASSERT_EQ(report.outcome, CutOutcome::kCut)
        << to_string(report.outcome) << ": " << (report.bug != nullptr ? report.bug : "");
    if (work.hole.rings() == 1 && to_rings(work.hole)[0] == from_smallest(tool)) {
      ++inside;
      ASSERT_EQ(report.doubled_area_removed, trocar::doubled_area(tool));
    }
    if (look_at_area) {
      // The most that bends may move: a diagonal of the lattice along every edge of the cavity's
      // outline.
      Real bound = 1;
      for (const Strand& s : work.overlay.strands)
        bound += s.gone ? 3 * length(s.first, s.second) : 0;
      ASSERT_NEAR(
          static_cast<double>(report.doubled_area_removed), static_cast<double>(common),
          static_cast<double>(bound) + 1e-9 * static_cast<double>(trocar::doubled_area(tool)));
    }
    if (random_.between(0, 49) == 0) {
      ASSERT_EQ(differs_from_cgal(work.overlay, work.patch), "");
    }
    subject.doubled_area -= report.doubled_area_removed;
    if (random_.between(0, 1) == 0) {
      refine_locally(subject.mesh, subject.edit, work.stitch.created, {}, refinement);
    }
    subject.grid.update(subject.edit.change(), subject.mesh);
    subject.edit.change().copy_to(subject.mesh, subject.replica);
    subject.replica_grid.update(subject.edit.change(), subject.replica);
  }

  Random random_;
};

TEST(ScanCuts, EveryCutIsValidAndExact) {
  const char* const folder = std::getenv("TROCAR_ASSETS");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  const int wanted = test::campaign(30'000);
  for (const char* const name : {"sample", "l3", "head"}) {
    const std::filesystem::path file = std::filesystem::path(folder) / (std::string(name) + ".glb");
    if (!std::filesystem::exists(file)) {
      EXPECT_STRNE(name, "sample") << "the tests always make this asset";
      continue;
    }
    const Result<Asset> asset = read_asset(file);
    ASSERT_TRUE(asset) << asset.error().message;
    std::vector<const SliceMesh*> slices;
    for (const AssetSlice& slice : asset->slices) {
      if (!slice.mesh.triangles.empty()) slices.push_back(&slice.mesh);
    }
    Cutter cutter(1);
    Random random(78);
    for (int series = 0; cutter.cuts < wanted / 3; ++series) {
      const auto which =
          static_cast<std::size_t>(random.between(0, static_cast<int>(slices.size()) - 1));
      SCOPED_TRACE(testing::Message() << name << ", series " << series << ", slice " << which);
      ASSERT_NO_FATAL_FAILURE(
          cutter.series(*slices[which], std::min(random.between(5, 300), wanted)));
    }
    EXPECT_GT(cutter.inside * 20, cutter.cuts);
  }
}

}  // namespace
}  // namespace trocar::runtime
