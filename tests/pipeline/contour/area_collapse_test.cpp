// SPDX-License-Identifier: GPL-3.0-or-later
// Simplification by both methods: validity and distance of 10,000 random slices; of the one that
// keeps areas also the areas, as stored after refinement, of scans too.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "sample_ct/render.h"
#include "tests/support/memory_stack.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr double kStep_mm = 1.0 / 256;
#ifdef TROCAR_SANITIZED
constexpr std::uint64_t kNoiseSlices = 500;
#else
constexpr std::uint64_t kNoiseSlices = 10'000;
#endif

SimplificationOptions area_to(double tolerance_mm) {
  return {tolerance_mm, SimplificationMethod::kArea};
}

// A ring's edges, each with the reciprocal of its squared length: most of the test's time would be
// divisions.
class Edges {
 public:
  explicit Edges(const Ring& ring) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      const double dx = b.x - a.x, dy = b.y - a.y;
      edges_.push_back(
          {static_cast<double>(a.x), static_cast<double>(a.y), dx, dy, 1 / (dx * dx + dy * dy)});
    }
  }
  double distance(double x, double y) const {
    double best2 = std::numeric_limits<double>::max();
    for (const Edge& e : edges_) {
      const double px = x - e.x, py = y - e.y;
      const double t = std::clamp((px * e.dx + py * e.dy) * e.per_length2, 0.0, 1.0);
      const double off_x = px - t * e.dx, off_y = py - t * e.dy;
      best2 = std::min(best2, off_x * off_x + off_y * off_y);
    }
    return std::sqrt(best2);
  }

 private:
  struct Edge {
    double x, y, dx, dy, per_length2;
  };
  std::vector<Edge> edges_;
};

// The largest distance in steps from samples of one ring, at most 8 steps apart, to another.
double sampled_distance(const Ring& from, const Ring& to_ring) {
  const Edges to(to_ring);
  double worst = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const LatticePoint a = from[i], b = from[(i + 1) % from.size()];
    const int n = 1 + static_cast<int>(std::sqrt(static_cast<double>(distance2(a, b))) / 8);
    for (int k = 0; k < n; ++k) {
      const double t = (k + 0.5) / n;
      worst = std::max(worst, to.distance(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)));
    }
    worst = std::max(worst, to.distance(a.x, a.y));
  }
  return worst;
}

double area_mm2(std::int64_t doubled) {
  return 0.5 * static_cast<double>(doubled) * kStep_mm * kStep_mm;
}

double longest_edge(const Ring& ring) {
  std::int64_t longest2 = 0;
  for (std::size_t i = 0; i < ring.size(); ++i)
    longest2 = std::max(longest2, distance2(ring[i], ring[(i + 1) % ring.size()]));
  return std::sqrt(static_cast<double>(longest2));
}

// Validity by check_pslg() (crossings, collapses, nesting) and orientation; the distance as
// hausdorff_mm() finds it, and that this is no less than samples show.
void expect_sound(const Pslg& full, const Pslg& simple, double bound_mm, bool by_samples,
                  const std::string& what) {
  const auto valid = check_pslg(simple);
  ASSERT_TRUE(valid) << what << ": " << valid.error().message;
  ASSERT_EQ(simple.rings.size(), full.rings.size()) << what;
  const double reported_mm = hausdorff_mm(full, simple, kLattice);
  ASSERT_LE(reported_mm, bound_mm) << what;
  for (std::size_t r = 0; r < full.rings.size(); ++r) {
    ASSERT_EQ(doubled_area(simple.rings[r]) > 0, doubled_area(full.rings[r]) > 0) << what;
    if (!by_samples) continue;
    const double worst = std::max(sampled_distance(full.rings[r], simple.rings[r]),
                                  sampled_distance(simple.rings[r], full.rings[r]));
    ASSERT_LE(worst * kStep_mm, reported_mm + 1e-9) << what;
  }
}

constexpr double kTolerances_px[] = {0.1, 0.3, 0.5, 1.0, 2.0, 3.0};
const PixelGrid kHalfPixels{0.5, 0.5, 0, 0, kLattice};

// Calls visit(contours, tolerance in mm, seed), also for fields with one-pixel necks and values on
// the iso-value.
template <typename Visit>
void for_random_slices(std::uint64_t count, std::uint64_t first_seed, const Visit& visit) {
  constexpr int kPasses[] = {0, 1, 2, 3, 5, 8, 13, 21};
  for (std::uint64_t seed = 0; seed < count && !testing::Test::HasFatalFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const ContourKind kind = seed / 48 % 3 == 0 ? ContourKind::kPixel : ContourKind::kSubpixel;
    const Pslg full = contours(noise_field(24 + static_cast<int>(seed % 17), kPasses[seed % 8],
                                           first_seed + seed, seed % 5 == 0),
                               kHalfPixels, kind);
    ASSERT_TRUE(check_pslg(full));
    visit(full, kTolerances_px[seed / 8 % 6] * kHalfPixels.spacing_u_mm, seed);
  }
}

TEST(DouglasPeucker, TenThousandRandomSlices) {
  for_random_slices(10'000, 50'000, [](const Pslg& full, double tolerance_mm, std::uint64_t seed) {
    const Pslg simple =
        simplify(full, kLattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker});
    expect_sound(full, simple, tolerance_mm * (1 + 1e-12), seed % 20 == 0, "");
  });
}

// Each slice is simplified, triangulated and refined; what is stored is compared with the contour.
TEST(AreaCollapse, TenThousandRandomSlices) {
  std::size_t vertices = 0, vertices_dp = 0, rings = 0, kept = 0;
  for_random_slices(
      kNoiseSlices, 90'000, [&](const Pslg& full, double tolerance_mm, std::uint64_t seed) {
        const Pslg simple = simplify(full, kLattice, area_to(tolerance_mm));
        ASSERT_NO_FATAL_FAILURE(expect_sound(full, simple, tolerance_mm, seed % 20 == 0, "simple"));
        for (std::size_t r = 0; r < full.rings.size(); ++r) {
          const std::int64_t off = doubled_area(simple.rings[r]) - doubled_area(full.rings[r]);
          kept += std::abs(static_cast<double>(off)) <= longest_edge(simple.rings[r]) ? 1U : 0U;
          ++rings;
          vertices += simple.rings[r].size();
        }
        for (const Ring& ring :
             simplify(full, kLattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker}).rings)
          vertices_dp += ring.size();
        RefinementOptions options;
        options.keep_area = true;
        options.max_distance_steps = std::min(
            options.max_distance_steps, left_for_refinement_steps(kLattice, area_to(tolerance_mm)));
        const Refined refined = refine(*triangulate(simple), kLattice, options);
        const Pslg stored = refined_rings(refined, simple);
        test::take(check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh)));
        ASSERT_TRUE(is_constrained_delaunay(refined.mesh));
        ASSERT_EQ(doubled_area(stored), doubled_area(refined.mesh));
        expect_sound(full, stored, tolerance_mm, seed % 20 == 0, "stored");
      });
  if (HasFatalFailure()) return;
  std::printf(
      "  %zu rings, %.2f %% within half a step times the longest edge; %zu vertices, %zu by dp\n",
      rings, 100.0 * static_cast<double>(kept) / static_cast<double>(rings), vertices, vertices_dp);
  EXPECT_GE(static_cast<double>(kept), 0.99 * static_cast<double>(rings));
  EXPECT_LT(vertices, vertices_dp);
}

// A slice's contours and the outline that its mesh stores.
struct Slice {
  Pslg full, stored;
};

class Scans : public testing::Test {
 protected:
  // Calls visit(slice) for the slices of the phantom and of each scan that there is.
  template <typename Visit>
  void for_slices(const MeshOptions& options, const Visit& visit) {
    const sample::PhantomOptions phantom;
    const sample::ScanGeometry geometry = *sample::sample_geometry(512, 35);
    const SampleStack sample(phantom, geometry);
    visit_slices("phantom", sample, options, visit);
    // NOLINTNEXTLINE(concurrency-mt-unsafe): nothing sets the environment
    const char* const folder = std::getenv("TROCAR_REAL_CT");
    // NOLINTNEXTLINE(concurrency-mt-unsafe)
    const char* const head = std::getenv("TROCAR_HEAD_CT");
    std::vector<std::string> scans;
    if (folder != nullptr) scans.push_back(std::string(folder) + "/l3/sub-ct_label-22_ct.nii.gz");
    if (head != nullptr) scans.emplace_back(head);
    for (const std::string& scan : scans) {
      if (!std::filesystem::exists(scan)) continue;
      const auto stack = test::take(open_stack({scan}, {}));
      visit_slices(scan, *stack, options, visit);
    }
  }

 private:
  // Renders its slices when they are read.
  class SampleStack final : public MemoryStack {
   public:
    SampleStack(const sample::PhantomOptions& phantom, const sample::ScanGeometry& geometry)
        : phantom_(phantom), geometry_(geometry) {
      planes.assign(35, axial_plane(geometry.pixel_mm, 0));
    }
    int size() const override { return 35; }
    int width() const override { return geometry_.columns; }
    int height() const override { return geometry_.rows; }
    Result<Image> read(int slice) const override {
      const auto noise = sample::noise_slice(geometry_, 7, 12, slice);
      const auto values = sample::render_slice(phantom_, geometry_, slice);
      return image_of(width(), height(), [&, i = std::size_t{0}](int, int) mutable {
        const double hu = std::rint(values[i] + noise[i]);
        ++i;
        return hu;
      });
    }

   private:
    const sample::PhantomOptions& phantom_;
    const sample::ScanGeometry& geometry_;
  };

  template <typename Visit>
  static void visit_slices(const std::string& name, const SliceStack& stack,
                           const MeshOptions& options, const Visit& visit) {
    for (int k = 0; k < stack.size(); ++k) {
      const auto meshed = test::take(mesh_slice(stack, k, options));
      visit(name + " slice " + std::to_string(k), meshed.materials[0]);
      if (HasFatalFailure()) return;
    }
  }
};

TEST_F(Scans, KeepTheirAreasAndTheToleranceAsStored) {
  MeshOptions options;
  double worst_slice = 0, worst_ring = 0, worst_mm = 0;
  std::size_t rings = 0;
  for_slices(options, [&](const std::string& what, const MeshedMaterial& slice) {
    const Pslg stored = refined_rings(slice.refined, slice.pslg);
    EXPECT_EQ(doubled_area(stored), doubled_area(slice.refined.mesh)) << what;
    EXPECT_LE(slice.simplification_error_mm, options.simplification.tolerance_mm) << what;
    EXPECT_EQ(slice.simplification_error_mm, hausdorff_mm(slice.contours, stored, kLattice));
    worst_mm = std::max(worst_mm, slice.simplification_error_mm);
    if (slice.contours.rings.empty()) return;
    const double full_mm2 = area_mm2(doubled_area(slice.contours));
    const double off = std::abs(area_mm2(doubled_area(stored)) / full_mm2 - 1);
    EXPECT_LE(off, 0.0005) << what << " of " << full_mm2 << " mm^2";
    worst_slice = std::max(worst_slice, off);
    for (std::size_t r = 0; r < stored.rings.size(); ++r) {
      const double ring_mm2 = area_mm2(doubled_area(slice.contours.rings[r]));
      if (std::abs(ring_mm2) <= 10) continue;
      ++rings;
      const double ring_off = std::abs(area_mm2(doubled_area(stored.rings[r])) / ring_mm2 - 1);
      EXPECT_LE(ring_off, 0.001) << what << ", a ring of " << ring_mm2 << " mm^2, simplified "
                                 << area_mm2(doubled_area(slice.pslg.rings[r])) << ", stored "
                                 << area_mm2(doubled_area(stored.rings[r])) << ", vertices "
                                 << slice.pslg.rings[r].size() << ", " << stored.rings[r].size();
      worst_ring = std::max(worst_ring, ring_off);
    }
  });
  std::printf("  worst slice %.4f %%, worst of %zu rings %.4f %%, farthest %.4f mm\n",
              100 * worst_slice, rings, 100 * worst_ring, worst_mm);
}

// A ring is simplified part by part; all of it is, and alike.
TEST(AreaCollapse, SimplifiesLongRingsThroughout) {
  constexpr std::size_t kVertices = 32'768, kSectors = 16;
  constexpr double kRadius = 400'000, kTolerance_mm = 0.2;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> rough(-30, 30);
  Ring ring;
  for (std::size_t k = 0; k < kVertices; ++k) {
    const double turn = 2 * std::numbers::pi * static_cast<double>(k) / kVertices,
                 radius = kRadius + 60 * std::sin(3'000 * turn) + rough(random);
    ring.push_back({static_cast<std::int32_t>(std::lround(radius * std::cos(turn))),
                    static_cast<std::int32_t>(std::lround(radius * std::sin(turn)))});
  }
  const Pslg simple = simplify({{ring}}, kLattice, area_to(kTolerance_mm));
  ASSERT_TRUE(check_pslg(simple));
  std::array<int, kSectors> in_sector{};
  for (const LatticePoint p : simple.rings[0]) {
    const double turns = std::atan2(p.y, p.x) / (2 * std::numbers::pi) + 0.5;
    ++in_sector[std::min(kSectors - 1, static_cast<std::size_t>(turns * kSectors))];
  }
  const auto [least, most] = std::minmax_element(in_sector.begin(), in_sector.end());
  EXPECT_LT(*most, 1.1 * *least) << simple.rings[0].size() << " vertices";
}

// The farthest point of the long upper edge from the notched contour lies within the edge: at its
// middle, equally far from both flanks of the notch.
TEST(HausdorffMm, IsFoundWithinEdges) {
  const Ring notched{{0, 0}, {4000, 0}, {4000, 1000}, {2000, 100}, {0, 1000}};
  const Ring straight{{0, 0}, {4000, 0}, {4000, 1000}, {0, 1000}};
  const double to_flank = 900 * 2000 / std::hypot(2000, 900);
  // The other way, from the notch's corner to the lower edge, it is less.
  EXPECT_NEAR(hausdorff_mm({{notched}}, {{straight}}, kLattice), to_flank * kStep_mm, 1e-9);
  EXPECT_NEAR(hausdorff_mm({{straight}}, {{notched}}, kLattice), to_flank * kStep_mm, 1e-9);
}

}  // namespace
}  // namespace trocar::pipeline
