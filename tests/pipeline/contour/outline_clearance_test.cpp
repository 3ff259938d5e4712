// SPDX-License-Identifier: GPL-3.0-or-later
// Outlines with features of a few lattice steps: simplification clears them, so that refinement has
// no angle below 30 degrees but at input angles below 60 degrees.
#include "pipeline/contour/outline_clearance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/outline_sweep.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/segment_grid.h"
#include "pipeline/contour/label_borders.h"
#include "pipeline/contour/simplification.h"
#include "tests/cases/pslg_case.h"
#include "tests/support/campaign.h"
#include "tests/support/label_border_checks.h"
#include "tests/support/label_maps.h"
#include "tests/support/motions.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"
#include "tests/support/uniform.h"

namespace trocar::pipeline {
namespace {

using test::kLattice;
using test::uniform;

constexpr double kTolerance_mm = 0.2;
constexpr double kMinAngle_deg = 30;
const SimplificationOptions kByArea{kTolerance_mm, SimplificationMethod::kArea},
    kByDouglasPeucker{kTolerance_mm, SimplificationMethod::kDouglasPeucker};

// The number of tight spots.
std::size_t count_tight_spots(const Pslg& outline, const std::vector<bool>& is_open,
                              double clearance) {
  const std::vector<LatticeSegment> edges = edges_of(outline, is_open);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> spots;
  for_tight_spots(edges, SegmentGrid(edges, margin_of(clearance)), clearance,
                  [&](std::uint32_t i, std::uint32_t j) { spots.emplace_back(i, j); });
  std::sort(spots.begin(), spots.end());
  return static_cast<std::size_t>(std::unique(spots.begin(), spots.end()) - spots.begin());
}

std::int32_t rounded(double x) {
  return static_cast<std::int32_t>(std::lrint(x));
}

// A ring around a centre with waves and, in half of the cases, jagged; then one to six of its
// vertices are doubled, so that edges of 1 to 8 steps in any direction arise.
Ring random_ring(std::mt19937_64& random, Point centre, double radius, double roughness) {
  Ring ring;
  const int vertices = 3 + static_cast<int>(std::pow(10, uniform(random, 0.3, 2.2)));
  std::array<double, 6> phases{}, heights{};
  for (std::size_t k = 0; k < phases.size(); ++k) {
    phases[k] = uniform(random, 0, 2 * std::numbers::pi);
    heights[k] = uniform(random) * roughness / static_cast<double>(k + 1);
  }
  const double jagged = uniform(random) < 0.5 ? 0 : uniform(random, 0, 0.25);
  for (int i = 0; i < vertices; ++i) {
    const double t = 2 * std::numbers::pi * (i + uniform(random, -0.3, 0.3)) / vertices;
    double r = 1;
    for (std::size_t k = 0; k < phases.size(); ++k)
      r += heights[k] * std::sin(static_cast<double>(k + 2) * t + phases[k]);
    r = radius * std::max(0.15, r * (1 + uniform(random, -jagged, jagged)));
    ring.push_back({rounded(centre.x + r * std::cos(t)), rounded(centre.y + r * std::sin(t))});
  }
  const int planted = 1 + static_cast<int>(uniform(random, 0, 6));
  for (int k = 0; k < planted; ++k) {
    const auto at = static_cast<std::ptrdiff_t>(random() % ring.size());
    const LatticePoint p = ring[static_cast<std::size_t>(at)];
    const double length = uniform(random, 1, 8), way = uniform(random, 0, 2 * std::numbers::pi);
    ring.insert(ring.begin() + at + 1,
                {p.x + rounded(length * std::cos(way)), p.y + rounded(length * std::sin(way))});
  }
  return ring;
}

// One ring, perhaps with a hole that may nearly touch it, and perhaps with a second ring.
Pslg random_outline(std::mt19937_64& random) {
  while (true) {
    Pslg out;
    const double radius = std::pow(10, uniform(random, 2.7, 4));  // 2 to 40 mm
    out.rings.push_back(random_ring(random, {0, 0}, radius, uniform(random, 0, 0.4)));
    if (uniform(random) < 0.5) {
      const Point centre{radius * uniform(random, -0.05, 0.05),
                         radius * uniform(random, -0.05, 0.05)};
      Ring hole =
          random_ring(random, centre, radius * uniform(random, 0.1, 0.9), uniform(random, 0, 0.2));
      std::reverse(hole.begin(), hole.end());
      out.rings.push_back(std::move(hole));
    }
    if (uniform(random) < 0.3) {
      const Point centre{radius * uniform(random, 1.5, 3), radius * uniform(random, -0.5, 0.5)};
      out.rings.push_back(
          random_ring(random, centre, radius * uniform(random, 0.2, 0.9), uniform(random, 0, 0.3)));
    }
    if (check_pslg(out)) return out;
  }
}

std::vector<Refined> refined(const std::vector<Pslg>& outlines,
                             const SimplificationOptions& simplification, double max_area_mm2) {
  RefinementOptions options;
  options.max_area_mm2 = max_area_mm2;
  options.min_angle_deg = kMinAngle_deg;
  options.keep_area = simplification.method == SimplificationMethod::kArea;
  options.max_distance_steps =
      std::min(kMaxDistanceFromOutline_steps, left_for_refinement_steps(kLattice, simplification));
  return refine_regions(test::take(triangulate_regions(outlines)), kLattice, options);
}

// Triangles with an angle below 30 degrees that lie at no input angle below 60 degrees.
std::uint32_t free_angles(const std::vector<Pslg>& outlines,
                          const SimplificationOptions& simplification, double max_area_mm2 = 50) {
  std::uint32_t out = 0;
  for (const Refined& region : refined(outlines, simplification, max_area_mm2)) {
    const MeshQuality quality = measure_quality(region, kLattice, kMinAngle_deg);
    out += quality.below_min_angle - quality.below_at_small_input_angle;
  }
  return out;
}

double relative_change(const Pslg& before, const Pslg& after) {
  const auto area = static_cast<double>(doubled_area(before));
  return std::abs(static_cast<double>(doubled_area(after)) - area) / area;
}

void expect_same_topology(const Pslg& before, const Pslg& after, const std::string& name) {
  const auto valid = check_pslg(after);
  ASSERT_TRUE(valid) << name << ": " << valid.error().message;
  ASSERT_EQ(after.rings.size(), before.rings.size()) << name;
  for (std::size_t r = 0; r < before.rings.size(); ++r)
    EXPECT_EQ(doubled_area(before.rings[r]) > 0, doubled_area(after.rings[r]) > 0) << name;
  EXPECT_EQ(enclosing_rings(before.rings), enclosing_rings(after.rings)) << name;
}

SimplifiedOutline unsimplified(const Pslg& outline) {
  SimplifiedOutline out{outline, {}, std::vector<std::int64_t>(outline.rings.size(), 0)};
  for (const Ring& ring : outline.rings) {
    out.positions.emplace_back();
    for (std::uint32_t k = 0; k < ring.size(); ++k)
      out.positions.back().push_back({k, 0});
  }
  return out;
}

Pslg cleared(const Pslg& outline) {
  SimplifiedOutline out = unsimplified(outline);
  clear_outline(outline, {}, kTolerance_mm / kLattice.step_mm(), out);
  return out.outline;
}

TEST(OutlineClearance, RandomOutlinesHaveNoFreeAngles) {
  std::mt19937_64 random(33);
  for (int n = 0; n < test::campaign(1000); ++n) {
    const std::string name = "outline " + std::to_string(n);
    const Pslg outline = random_outline(random);
    for (const SimplificationOptions& options : {kByArea, kByDouglasPeucker}) {
      const Pslg simple = simplify(outline, kLattice, options);
      expect_same_topology(outline, simple, name);
      if (HasFatalFailure()) return;
      EXPECT_LE(hausdorff_mm(outline, simple, kLattice), kTolerance_mm) << name;
      EXPECT_EQ(free_angles({simple}, options), 0U) << name;
      if (options.method == SimplificationMethod::kArea) {
        EXPECT_LE(relative_change(outline, simple), 5e-4) << name;
      }
    }
  }
}

// Counted over all pairs of edges.
TEST(OutlineClearance, CountsTightSpotsAsByBruteForce) {
  std::mt19937_64 random(35);
  for (int n = 0; n < 50; ++n) {
    const Pslg outline = random_outline(random);
    std::vector<std::pair<LatticePoint, LatticePoint>> edges;
    for (const Ring& ring : outline.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i)
        edges.emplace_back(ring[i], ring[(i + 1) % ring.size()]);
    }
    std::size_t spots = 0;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const auto& [a, b] = edges[i];
      if (distance2(a, b) < 144) ++spots;
      for (std::size_t j = 0; j < i; ++j) {
        const auto& [c, d] = edges[j];
        if (a == c || a == d || b == c || b == d) continue;
        const double least = std::min({segment_distance2(point(a), point(b), point(c)),
                                       segment_distance2(point(a), point(b), point(d)),
                                       segment_distance2(point(c), point(d), point(a)),
                                       segment_distance2(point(c), point(d), point(b))});
        if (least < 144) ++spots;
      }
    }
    EXPECT_EQ(count_tight_spots(outline, {}, 12), spots);
  }
}

// The scan forces what is wider than the clearance, and what the tolerance does not let go.
TEST(OutlineClearance, KeepsWhatTheScanForces) {
  const Pslg wide{
      {{{0, 0}, {3000, 0}, {3000, 2500}, {0, 2000}}, {{1400, 13}, {1000, 900}, {2000, 1000}}}};
  EXPECT_EQ(cleared(wide).rings, wide.rings);
  EXPECT_EQ(free_angles({wide}, kByArea), 0U);
  const Pslg narrow{
      {{{0, 0}, {3000, 0}, {3000, 2500}, {0, 2000}}, {{1400, 3}, {1000, 900}, {2000, 1000}}}};
  SimplifiedOutline out = unsimplified(narrow);
  clear_outline(narrow, {}, 1.5, out);
  EXPECT_EQ(out.outline.rings, narrow.rings);
  for (const SimplificationMethod method :
       {SimplificationMethod::kArea, SimplificationMethod::kDouglasPeucker})
    EXPECT_EQ(simplify(narrow, kLattice, {0, method}).rings, narrow.rings);
}

// The result neither depends on the order of rings nor on where a ring starts, and moves with the
// outline.
TEST(OutlineClearance, MovesWithTheOutline) {
  std::mt19937_64 random(36);
  for (int n = 0; n < 100; ++n) {
    const Pslg outline = random_outline(random);
    const std::vector<Ring> right = test::canonical(cleared(outline).rings);
    for (const test::Motion& motion :
         {test::Motion{1, {12345, -777}}, test::Motion{2, {}}, test::Motion{3, {-5, 99'999'999}}}) {
      Pslg other = motion(outline);
      std::rotate(other.rings[0].begin(), other.rings[0].begin() + 1, other.rings[0].end());
      std::reverse(other.rings.begin(), other.rings.end());
      EXPECT_EQ(test::canonical(cleared(other).rings), test::canonical(motion(Pslg{right}).rings))
          << n;
    }
  }
}

// Borders between materials stay the same from both sides.
TEST(OutlineClearance, ClearsSharedBorders) {
  std::size_t before = 0, after = 0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const Image image = salted(organs(96, seed), seed % 2 == 0 ? 0 : 0.02, seed);
    const PixelGrid grid{0.3, 0.25, 0, 0, kLattice};
    const LabelBorders full = label_borders(material_image(image, each_label()), grid);
    for (const SimplificationOptions& options : {kByArea, kByDouglasPeucker}) {
      const LabelBorders simple = simplify(full, kLattice, options);
      test::take(check_label_borders(simple));
      EXPECT_LE(hausdorff_mm(full, simple, kLattice), kTolerance_mm);
      EXPECT_EQ(free_angles(material_outlines(simple), options), 0U) << seed;
      const auto count = [](const LabelBorders& borders) {
        Pslg lines;
        std::vector<bool> is_open;
        for (const BorderChain& chain : borders.chains) {
          lines.rings.push_back(chain.points);
          is_open.push_back(!chain.is_closed);
        }
        return count_tight_spots(lines, is_open, kClearance_steps);
      };
      before += count(full);
      after += count(simple);
    }
  }
  EXPECT_GT(before, 0U);
  EXPECT_LT(after, before / 10 + 1);
}

bool is_symmetric(const Pslg& outline) {
  CentroidOffset offset;
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      offset.add(p);
  }
  return offset.x() == 0 && offset.y() == 0;
}

// The outlines of tests/corpus/pslg, needles and slits included: their sharp corners stay.
TEST(OutlineClearance, TheCorpusHasNoFreeAngles) {
  int outlines = 0;
  for (const auto& file : test::case_files(TROCAR_CORPUS "/pslg")) {
    const auto read = test::take(test::parse_pslg_case(test::text_of(file), file.filename()));
    if (read.picture || !check_pslg(read.outline) || read.outline.rings.empty()) continue;
    if (read.lattice.bits != kLattice.bits) continue;
    // Needles of less than 0.03 degrees, whose sides are nearer than the clearance over most of
    // their length, are sharp corners that the input forces.
    if (file.stem() == "needles_in_one_corner") continue;
    ++outlines;
    for (const SimplificationOptions& options : {kByArea, kByDouglasPeucker}) {
      const Pslg simple = simplify(read.outline, kLattice, options);
      expect_same_topology(read.outline, simple, file.filename());
      // Not reached: Douglas-Peucker's outlines that a rotation maps to themselves are not cleared.
      if (options.method == SimplificationMethod::kDouglasPeucker && is_symmetric(read.outline))
        continue;
      EXPECT_EQ(free_angles({simple}, options, read.max_area_mm2), 0U) << file.filename();
    }
  }
  EXPECT_GT(outlines, 15);
}

}  // namespace
}  // namespace trocar::pipeline
