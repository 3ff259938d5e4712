// SPDX-License-Identifier: GPL-3.0-or-later
// Borders of label maps: how near they are to the shape that was rasterised; that materials tile,
// before and after simplification; and what ten labels cost.
// Long because all tests of this file share its fixtures.
#include "pipeline/contour/label_borders.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/area_collapse.h"
#include "tests/support/campaign.h"
#include "tests/support/label_border_checks.h"
#include "tests/support/label_maps.h"
#include "tests/support/random_geometry.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/test_lattice.h"
#include "tests/support/uniform.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr PixelGrid kUnitPixels{1.0, 1.0, 0, 0, kLattice};
constexpr double kStepsPerPixel = 256;

const auto kAnyMaterial = [](MaterialNumber m) { return m != kNoMaterial; };

Pslg smooth_outline(const Image& image, const PixelGrid& grid = kUnitPixels) {
  const std::vector<Labels> all{{{}, true}};
  const LabelBorders network = label_borders(material_image(image, all), grid);
  const auto proved = check_label_borders(network);
  EXPECT_TRUE(proved) << proved.error().message;
  return material_outlines(network)[0];
}

Pslg half_way_outline(const Image& image) {
  return contours({image, 0.5F, true}, kUnitPixels, ContourKind::kSubpixel);
}

double outline_area_px(const Pslg& pslg) {
  return 0.5 * static_cast<double>(doubled_area(pslg)) / (kStepsPerPixel * kStepsPerPixel);
}

using trocar::test::uniform;

// Calls visit(x, y, length) for short pieces of the outline, in pixels.
template <typename Visit>
void for_pieces(const Pslg& pslg, const Visit& visit) {
  constexpr int kPieces = 8;
  for (const Ring& ring : pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      const double dx = (b.x - a.x) / kStepsPerPixel, dy = (b.y - a.y) / kStepsPerPixel;
      for (int k = 0; k < kPieces; ++k) {
        const double t = (k + 0.5) / kPieces;
        visit(a.x / kStepsPerPixel + t * dx, a.y / kStepsPerPixel + t * dy,
              std::hypot(dx, dy) / kPieces);
      }
    }
  }
}

struct Deviation {
  double length = 0, squares = 0;
  double rms() const { return std::sqrt(squares / length); }
};

// The perimeter is that of the shape that was rasterised; the chance of where pixel centres lie
// changes the area of a single disc, and its perimeter with it. That is not the method's error, so
// that each single disc is compared with the one of its area.
TEST(LabelBorder, DiscsAreRound) {
  struct Case {
    double radius, mean_rms, worst_rms;
  };
  for (const Case& c : {Case{20, 0.12, 0.14}, Case{5, 0.13, 1}}) {
    std::mt19937_64 rng(7);
    constexpr int kDiscs = 300;
    const int size = static_cast<int>(2 * c.radius) + 8;
    double sum_rms = 0, worst_rms = 0, perimeters = 0, worst_perimeter = 0;
    for (int k = 0; k < kDiscs; ++k) {
      const double cx = c.radius + 3 + uniform(rng), cy = c.radius + 3 + uniform(rng);
      const Image image = image_of(
          size, size, [&](int x, int y) { return std::hypot(x - cx, y - cy) <= c.radius; });
      const auto deviation = [&](const Pslg& outline) {
        Deviation out;
        for_pieces(outline, [&](double x, double y, double length) {
          const double d = std::hypot(x - cx, y - cy) - c.radius;
          out.length += length;
          out.squares += d * d * length;
        });
        return out;
      };
      const Pslg outline = smooth_outline(image), half_way = half_way_outline(image);
      ASSERT_EQ(outline.rings.size(), 1U);
      EXPECT_NEAR(outline_area_px(outline) / outline_area_px(half_way), 1, 1e-3);
      const Deviation found = deviation(outline);
      sum_rms += found.rms();
      worst_rms = std::max(worst_rms, found.rms());
      perimeters += found.length;
      const double of_area = 2 * std::sqrt(std::numbers::pi * outline_area_px(outline));
      worst_perimeter = std::max(worst_perimeter, std::abs(found.length / of_area - 1));
    }
    const double perimeter = perimeters / (kDiscs * 2 * std::numbers::pi * c.radius) - 1;
    EXPECT_LE(sum_rms / kDiscs, c.mean_rms);
    EXPECT_LE(worst_rms, c.worst_rms);
    if (c.radius > 10) {
      EXPECT_LE(std::abs(perimeter), 0.003);
      EXPECT_LE(worst_perimeter, 0.003);
    }
  }
}

using Edge = std::pair<LatticePoint, LatticePoint>;

// How often the outline winds around a point off the lattice.
int winding(const Pslg& pslg, double x, double y) {
  return runtime::winding(x, y, pslg.rings);
}

// Everything that makes a tiling, without check_label_borders() where that is possible.
void expect_tiling(const LabelBorders& network, const std::string& what) {
  const auto proved = check_label_borders(network);
  ASSERT_TRUE(proved) << what << ": " << proved.error().message;
  const std::vector<Pslg> outlines = material_outlines(network);
  const Pslg all = outline_of(network, kAnyMaterial);
  std::int64_t sum = 0;
  std::map<Edge, int> edges;  // and how many materials have them on their left
  LatticePoint low{INT32_MAX, INT32_MAX}, high{INT32_MIN, INT32_MIN};
  for (const Pslg& outline : outlines) {
    const auto valid = check_pslg(outline);
    ASSERT_TRUE(valid) << what << ": " << valid.error().message;
    sum += doubled_area(outline);
    for (const Ring& ring : outline.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        ++edges[{ring[i], ring[(i + 1) % ring.size()]}];
        low = {std::min(low.x, ring[i].x), std::min(low.y, ring[i].y)};
        high = {std::max(high.x, ring[i].x), std::max(high.y, ring[i].y)};
      }
    }
  }
  ASSERT_EQ(sum, doubled_area(all)) << what;
  std::map<Edge, int> outer;
  for (const Ring& ring : all.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      ++outer[{ring[i], ring[(i + 1) % ring.size()]}];
  }
  std::size_t unmatched = 0;
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1) << what;
    if (edges.contains({edge.second, edge.first})) continue;
    ++unmatched;
    ASSERT_TRUE(outer.contains(edge)) << what;
  }
  ASSERT_EQ(unmatched, outer.size()) << what;
  if (edges.empty()) return;
  // Rasterised, between the lattice's lines.
  std::mt19937_64 rng(9);
  for (int k = 0; k < 2000; ++k) {
    const double x = low.x + std::floor(uniform(rng) * (high.x - low.x)) + 0.37,
                 y = low.y + std::floor(uniform(rng) * (high.y - low.y)) + 0.41;
    int materials = 0;
    for (const Pslg& outline : outlines) {
      const int w = winding(outline, x, y);
      ASSERT_TRUE(w == 0 || w == 1) << what;
      materials += w;
    }
    ASSERT_EQ(materials, winding(all, x, y)) << what;
  }
}

TEST(LabelBorders, TenMapsAreTiledAndKeepEveryPixel) {
  for (const LabelMap& map : ten_label_maps()) {
    for (const PixelGrid& grid : {kUnitPixels, PixelGrid{0.7, 0.45, 13, 5, kLattice},
                                  PixelGrid{8.0, 8.0, 0, 0, Lattice{0}}}) {
      const MaterialImage image = material_image(map.image, each_label());
      const LabelBorders network = label_borders(image, grid);
      expect_tiling(network, map.name);
      if (HasFatalFailure()) return;
      // Each pixel's centre is in its own material: with rings that cross nothing, this is the
      // pixels' topology.
      const std::vector<Pslg> outlines = material_outlines(network);
      for (int y = 0; y < image.height; y += 7) {
        for (int x = 0; x < image.width; ++x) {
          for (std::size_t m = 0; m < outlines.size(); ++m) {
            const double u = grid.lattice.snap_mm((x + grid.offset_x) * grid.spacing_u_mm),
                         v = grid.lattice.snap_mm((y + grid.offset_y) * grid.spacing_v_mm);
            ASSERT_EQ(winding(outlines[m], u + 1e-3, v + 1e-3), image.at(x, y) == m + 1 ? 1 : 0)
                << map.name << " " << x << " " << y;
          }
        }
      }
    }
  }
}

double distance_to_line(double x, double y, const BorderChain& line) {
  double best2 = 1e300;
  const std::size_t n = line.points.size();
  for (std::size_t i = 0; i + (line.is_closed ? 0 : 1) < n; ++i) {
    const LatticePoint a = line.points[i], b = line.points[(i + 1) % n];
    const double dx = b.x - a.x, dy = b.y - a.y, px = x - a.x, py = y - a.y;
    const double length2 = dx * dx + dy * dy;
    const double t = length2 > 0 ? std::clamp((px * dx + py * dy) / length2, 0.0, 1.0) : 0.0;
    best2 = std::min(best2, (px - t * dx) * (px - t * dx) + (py - t * dy) * (py - t * dy));
  }
  return std::sqrt(best2);
}

double farthest(const BorderChain& from, const BorderChain& to) {
  double worst = 0;
  const std::size_t n = from.points.size();
  for (std::size_t i = 0; i + (from.is_closed ? 0 : 1) < n; ++i) {
    const LatticePoint a = from.points[i], b = from.points[(i + 1) % n];
    const int pieces = 1 + static_cast<int>(std::sqrt(static_cast<double>(distance2(a, b))) / 16);
    for (int k = 0; k <= pieces; ++k) {
      const double t = static_cast<double>(k) / pieces;
      worst = std::max(worst, distance_to_line(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), to));
    }
  }
  return worst;
}

double longest_edge(const BorderChain& chain) {
  std::int64_t longest2 = 0;
  for (std::size_t i = 0; i < chain.points.size(); ++i)
    longest2 =
        std::max(longest2, distance2(chain.points[i], chain.points[(i + 1) % chain.points.size()]));
  return std::sqrt(static_cast<double>(longest2));
}

// The distance is measured here in another way; areas are kept but where lattice or borders forbid.
TEST(LabelBorders, SimplifiedMapsKeepAreasWithinTheTolerance) {
  const PixelGrid grid{0.5, 0.5, 3, 7, kLattice};
  for (const auto method : {SimplificationMethod::kArea, SimplificationMethod::kDouglasPeucker}) {
    std::size_t chains = 0, kept = 0;
    for (const LabelMap& map : ten_label_maps()) {
      const LabelBorders full = label_borders(material_image(map.image, each_label()), grid);
      for (const double tolerance_px : {0.0, 0.2, 0.5, 1.0, 3.0}) {
        const double tolerance_mm = tolerance_px * grid.spacing_u_mm;
        const LabelBorders simple = simplify(full, kLattice, {tolerance_mm, method});
        ASSERT_EQ(simple.chains.size(), full.chains.size());
        double worst = 0;
        for (std::size_t c = 0; c < full.chains.size(); ++c) {
          const BorderChain &before = full.chains[c], &after = simple.chains[c];
          worst = std::max({worst, farthest(before, after), farthest(after, before)});
          const std::int64_t off = doubled_area(after.points) - doubled_area(before.points);
          ++chains;
          kept += std::abs(static_cast<double>(off)) <= longest_edge(after) ? 1U : 0U;
        }
        ASSERT_LE(worst * kLattice.step_mm(), tolerance_mm * (1 + 1e-12) + 1e-9) << map.name;
        const double stated = hausdorff_mm(full, simple, kLattice);
        ASSERT_GE(stated, worst * kLattice.step_mm() - 1e-9) << map.name;
      }
    }
    if (method == SimplificationMethod::kArea) {
      EXPECT_GE(static_cast<double>(kept), 0.99 * static_cast<double>(chains));
    }
  }
}

// Small maps of smoothed noise, at tolerances of up to eight pixels, where every border blocks
// another.
TEST(LabelBorders, RandomMapsAreTiledWhenSimplified) {
  const auto kMaps = static_cast<std::uint64_t>(test::campaign(100));
  constexpr double kTolerances_px[] = {0.0, 0.3, 1.0, 2.0, 4.0, 8.0};
  for (std::uint64_t seed = 0; seed < kMaps; ++seed) {
    const int size = 12 + static_cast<int>(seed % 17), labels = 1 + static_cast<int>(seed % 4);
    std::vector<Field> noise;
    for (int k = 0; k <= labels; ++k)
      noise.push_back(noise_field(size, static_cast<int>(seed / 4 % 4), 10 * seed + k));
    const Image image = image_of(size, size, [&](int x, int y) {
      int best = 0;
      for (int k = 1; k <= labels; ++k) {
        if (noise[k].image.at(x, y) > noise[best].image.at(x, y)) best = k;
      }
      return best;
    });
    // Every other lattice is so coarse that points often coincide.
    const PixelGrid grid = seed % 2 == 0 ? kUnitPixels : PixelGrid{8.0, 8.0, 0, 0, Lattice{0}};
    const LabelBorders full = label_borders(material_image(image, each_label(labels)), grid);
    const double tolerance_mm = kTolerances_px[seed % 6] * grid.spacing_u_mm;
    for (const auto method : {SimplificationMethod::kArea, SimplificationMethod::kDouglasPeucker}) {
      const LabelBorders simple = simplify(full, grid.lattice, {tolerance_mm, method});
      const auto proved = check_label_borders(simple);
      ASSERT_TRUE(proved) << seed << ": " << proved.error().message;
      ASSERT_LE(hausdorff_mm(full, simple, grid.lattice), tolerance_mm * (1 + 1e-12)) << seed;
      const std::vector<Pslg> before = material_outlines(full), after = material_outlines(simple);
      for (std::size_t m = 0; m < after.size(); ++m)
        ASSERT_EQ(after[m].rings.size(), before[m].rings.size()) << seed;
      ASSERT_EQ(simple.chains.size(), full.chains.size());
      for (std::size_t c = 0; c < full.chains.size(); ++c) {
        const BorderChain &was = full.chains[c], &is = simple.chains[c];
        ASSERT_EQ(is.left, was.left);
        ASSERT_EQ(is.right, was.right);
        if (!was.is_closed) {
          ASSERT_EQ(is.points.front(), was.points.front()) << seed;
          ASSERT_EQ(is.points.back(), was.points.back()) << seed;
        }
        const std::int64_t off = doubled_area(is.points) - doubled_area(was.points);
        if (tolerance_mm == 0) {
          ASSERT_EQ(off, 0) << seed;
        }
      }
      if (seed % 10 == 0) expect_tiling(simple, std::to_string(seed));
      if (HasFatalFailure()) return;
    }
  }
}

// The points that would replace the first line's middle edge are ends of other lines, at which no
// line starts.
TEST(LabelBorders, NoPointIsPutOnANode) {
  const Ring roof{{0, 0}, {60, 90}, {120, 90}, {180, 0}};
  const LatticePoint left{80, 120}, right{100, 120};
  Pslg lines{{roof}};
  EXPECT_EQ(collapse_segments(lines, 100, {true}).outline.rings[0].size(), 3U);
  for (const LatticePoint node : {left, right}) {
    for (const std::int32_t dx : {-5, 0, 5})
      lines.rings.push_back({{node.x + dx, 300}, node});
  }
  EXPECT_EQ(collapse_segments(lines, 100, std::vector<bool>(7, true)).outline.rings[0], roof);
}

MaterialImage drawn(const std::vector<std::string>& rows) {
  MaterialImage out{static_cast<int>(rows[0].size()), static_cast<int>(rows.size()), {}, {}};
  out.labels.resize(9);
  for (const std::string& row : rows) {
    for (const char c : row)
      out.values.push_back(c == '.' ? kNoMaterial : static_cast<MaterialNumber>(c - '0'));
  }
  return out;
}

TEST(MergeSmallPieces, GivesEachToItsLongestBorder) {
  struct Case {
    std::vector<std::string> before;
    double min_pixels;
    std::vector<std::string> after;
  };
  const std::vector<Case> cases{
      // An island, a hole, a piece of one material within another.
      {{".........", ".2..11111", "....11.11", "....11111", "....11311", "....11111"},
       3,
       {".........", "....11111", "....11111", "....11111", "....11111", "....11111"}},
      // Three sides of one material and one of another.
      {{"1122", "1132", "1122"}, 2, {"1122", "1122", "1122"}},
      // Half of the border each: the material named first, and none last.
      {{"1112", "1132", "1122"}, 2, {"1112", "1112", "1122"}},
      {{"...2", "..32", "..22"}, 2, {"...2", "..22", "..22"}},
      // Connected over a corner: one component of three and a half pixels.
      {{"......", ".11...", "...11.", "......"}, 3.5, {"......", ".11...", "...11.", "......"}},
      {{"......", ".11...", "...11.", "......"}, 3.6, {"......", "......", "......", "......"}},
      // Empty pixels do not count as connected over a corner: the hole is filled.
      {{"11111", "1.111", "11...", "11..."}, 2, {"11111", "11111", "11...", "11..."}},
      // Each is small, together they are not.
      {{"....", ".12.", ".34.", "...."}, 3, {"....", "....", "....", "...."}},
      {{"11", "11"}, 100, {"..", ".."}},
      // A single pixel has half a pixel's area.
      {{"...", ".1.", "..."}, 0.5, {"...", ".1.", "..."}},
      {{"...", ".1.", "..."}, 0.6, {"...", "...", "..."}},
      {{"1", "1"}, 1.5, {"1", "1"}},
      {{"1", "1"}, 1.6, {".", "."}},
  };
  for (std::size_t k = 0; k < cases.size(); ++k) {
    MaterialImage image = drawn(cases[k].before);
    merge_small_components(image, cases[k].min_pixels);
    EXPECT_EQ(image.values, drawn(cases[k].after).values) << "case " << k;
  }
}

TEST(MergeSmallPieces, LeavesNoSmallPieceAndATiling) {
  for (const LabelMap& map : ten_label_maps()) {
    MaterialImage image = material_image(map.image, each_label());
    merge_small_components(image, 5);
    expect_tiling(label_borders(image, kUnitPixels), map.name);
    if (HasFatalFailure()) return;
    // But for an eighth of a pixel where pieces met that were merged.
    MaterialImage again = image;
    merge_small_components(again, 4.5);
    EXPECT_EQ(again.values, image.values) << map.name;
    for (const Pslg& outline : material_outlines(label_borders(image, kUnitPixels))) {
      for (const Ring& ring : outline.rings)
        EXPECT_GE(std::abs(outline_area_px({{ring}})), 4.3) << map.name;
    }
  }
}

// Processor time of this thread; others may be busy.
double now_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

struct BordersCost {
  std::vector<double> slice_ms;  // one for each round

  void measure(const Image& image, const std::vector<Labels>& materials) {
    const PixelGrid grid{0.5, 0.5, 0, 0, kLattice};
    const double start = now_ms();
    MaterialImage pixels = material_image(image, materials);
    merge_small_components(pixels, 4);
    const LabelBorders full = label_borders(pixels, grid);
    const LabelBorders simple = simplify(full, kLattice, {0.25, SimplificationMethod::kArea});
    EXPECT_TRUE(check_label_borders(simple));
    EXPECT_LE(hausdorff_mm(full, simple, kLattice), 0.25);
    for (const Pslg& outline : material_outlines(simple)) {
      const Refined refined = refine(*triangulate(outline), kLattice, {});
      EXPECT_TRUE(check_mesh(refined.mesh));
      EXPECT_TRUE(is_constrained_delaunay(refined.mesh));
    }
    slice_ms.push_back(now_ms() - start);
  }
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

// Ten labels that fill their union have more than twice its border. Each is meshed on its own.
TEST(LabelBorders, TenLabelsCostAtMostTwiceTheirUnion) {
#ifdef TROCAR_SANITIZED
  GTEST_SKIP() << "times mean nothing here";
#endif
  constexpr int kRounds = 15;
  const std::vector<Labels> all{{{}, true}};
  double ratios = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Image image = salted(organs(512, seed), 0.001, seed);
    BordersCost ten, one;
    for (int round = 0; round < kRounds; ++round) {
      ten.measure(image, each_label());
      one.measure(image, all);
    }
    ratios += median(ten.slice_ms) / median(one.slice_ms) / 3;
  }
  EXPECT_LE(ratios, 2);
}

}  // namespace
}  // namespace trocar::pipeline
