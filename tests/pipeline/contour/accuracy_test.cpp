// SPDX-License-Identifier: GPL-3.0-or-later
// The pipeline's outlines compared with the phantom's exact cross-sections, the only scan whose
// true outlines are known.
#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/reference/phantom/cross_section.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr double kIso_HU = 226;

class Accuracy : public testing::TestWithParam<int> {};

TEST_P(Accuracy, OutlinesFollowTheExactCrossSection) {
  const int k = GetParam();
  const sample::PhantomOptions phantom;
  const sample::ScanGeometry scan = *sample::sample_geometry(512, 35);
  const double z = sample::pixel_centre_mm(scan, 0, 0, k).z;
  const auto truth = test::take(sample::iso_section(phantom, scan, z, kIso_HU));
  const sample::SectionDistance distance(truth);

  Field field{{scan.columns, scan.rows, {}}, static_cast<float>(kIso_HU)};
  for (const double hu : sample::render_slice(phantom, scan, k))
    field.image.values.push_back(static_cast<float>(hu));
  const PixelGrid grid{scan.pixel_mm, scan.pixel_mm, 0, 0, kLattice};
  const auto from_truth = [&](LatticePoint p) {
    return distance(
        {scan.first_pixel_mm.x + kLattice.to_mm(p.x), scan.first_pixel_mm.y + kLattice.to_mm(p.y)});
  };

  struct Expected {
    ContourKind kind;
    double mean_mm, max_mm, area;  // of the unsimplified contour
  };
  // A pixel is 0.3125 mm: the iso-contour is accurate to a hundredth of a pixel on average and a
  // tenth at worst; the pixel chain lies up to a pixel inside.
  for (const Expected& e : {Expected{ContourKind::kSubpixel, 0.004, 0.032, 0.0005},
                            Expected{ContourKind::kPixel, 0.25, 0.45, 0.15}}) {
    const Pslg full = drop_small_rings(contours(field, grid, e.kind), 1.0, kLattice);
    ASSERT_EQ(full.rings.size(), truth.rings.size());
    double sum = 0, worst = 0;
    std::size_t count = 0;
    for (const Ring& ring : full.rings) {
      for (const LatticePoint p : ring) {
        sum += std::abs(from_truth(p));
        worst = std::max(worst, std::abs(from_truth(p)));
        ++count;
      }
    }
    const double area_mm2 =
        0.5 * static_cast<double>(doubled_area(full)) * kLattice.step_mm() * kLattice.step_mm();
    EXPECT_LT(sum / static_cast<double>(count), e.mean_mm);
    EXPECT_LT(worst, e.max_mm);
    EXPECT_NEAR(area_mm2 / truth.area_mm2, 1.0, e.area);

    const SimplificationOptions options;
    const Pslg simple = simplify(full, kLattice, options);
    for (const Ring& ring : simple.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
        for (int s = 0; s < 8; ++s) {
          const LatticePoint p{a.x + (b.x - a.x) * s / 8, a.y + (b.y - a.y) * s / 8};
          ASSERT_LT(std::abs(from_truth(p)), e.max_mm + options.tolerance_mm);
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Slices, Accuracy, testing::Values(6, 12, 21, 29));

}  // namespace
}  // namespace trocar::pipeline
