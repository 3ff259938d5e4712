// SPDX-License-Identifier: GPL-3.0-or-later
// Simplification by both methods: validity and distance of random slices; of the one that
// keeps areas also the areas, as stored after refinement.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/support/campaign.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr double kStep_mm = 1.0 / 256;
const auto kNoiseSlices = static_cast<std::uint64_t>(test::campaign(500));

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

TEST(DouglasPeucker, RandomSlices) {
  for_random_slices(
      kNoiseSlices, 50'000, [](const Pslg& full, double tolerance_mm, std::uint64_t seed) {
        const Pslg simple =
            simplify(full, kLattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker});
        expect_sound(full, simple, tolerance_mm * (1 + 1e-12), seed % 20 == 0, "");
      });
}

// Each slice is simplified, triangulated and refined; what is stored is compared with the contour.
TEST(AreaCollapse, RandomSlices) {
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
  EXPECT_GE(static_cast<double>(kept), 0.99 * static_cast<double>(rings));
  EXPECT_LT(vertices, vertices_dp);
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
