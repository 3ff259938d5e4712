// SPDX-License-Identifier: GPL-3.0-or-later
// Simplification of 10,000 random slices, and of a real head CT, at tolerances from 0.1 to 3
// pixels. No ring crosses another, collapses, reverses its orientation or changes its nesting, and
// the tolerance is kept.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>

#include "formats/mesh/mesh_validity.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr double kTolerances_px[] = {0.1, 0.3, 0.5, 1.0, 2.0, 3.0};

// Time in simplify() alone, over all slices of a test.
struct Cost {
  double ms = 0;
  std::size_t slices = 0, rings = 0;
};

void expect_sound(const Pslg& full, double tolerance_mm, Cost& cost, const std::string& what) {
  const auto sound = check_pslg(full);
  ASSERT_TRUE(sound) << what << ", before: " << sound.error().message;
  const auto start = std::chrono::steady_clock::now();
  const Pslg simple =
      simplify(full, kLattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker});
  cost.ms +=
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  ++cost.slices;
  cost.rings += full.rings.size();
  const auto ok = check_pslg(simple);  // crossings, collapses, nesting
  ASSERT_TRUE(ok) << what << ": " << ok.error().message;
  ASSERT_EQ(simple.rings.size(), full.rings.size()) << what;
  for (std::size_t r = 0; r < full.rings.size(); ++r) {
    ASSERT_EQ(doubled_area(simple.rings[r]) > 0, doubled_area(full.rings[r]) > 0) << what;
  }
  ASSERT_LE(hausdorff_mm(full, simple, kLattice), tolerance_mm * (1 + 1e-12)) << what;
}

void report(const Cost& cost) {
  const double each = cost.ms / static_cast<double>(cost.slices);
  testing::Test::RecordProperty("ms_a_slice", std::to_string(each));
  std::printf("  %zu slices, %zu rings: %.4f ms a slice\n", cost.slices, cost.rings, each);
}

TEST(SimplificationAtScale, TenThousandRandomSlices) {
  const PixelGrid grid{0.5, 0.5, 0, 0, kLattice};
  constexpr int kPasses[] = {0, 1, 2, 3, 5, 8, 13, 21};
  Cost cost;
  for (std::uint64_t seed = 0; seed < 10'000; ++seed) {
    const int passes = kPasses[seed % 8];
    const double tolerance_px = kTolerances_px[seed / 8 % 6];
    const ContourKind kind = seed / 48 % 3 == 0 ? ContourKind::kPixel : ContourKind::kSubpixel;
    const Field field =
        noise_field(24 + static_cast<int>(seed % 17), passes, 50'000 + seed, seed % 5 == 0);
    expect_sound(contours(field, grid, kind), tolerance_px * grid.spacing_u_mm, cost,
                 "seed " + std::to_string(seed));
    if (HasFatalFailure()) return;
  }
  report(cost);
}

TEST(SimplificationAtScale, RealHeadCt) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nothing sets environment variables
  const char* const path = std::getenv("TROCAR_HEAD_CT");
  if (path == nullptr || *path == '\0') GTEST_SKIP() << "TROCAR_HEAD_CT is not set";
  const auto stack = open_stack({path}, {});
  ASSERT_TRUE(stack) << stack.error().message;
  Cost cost;
  for (int k = 0; k < (*stack)->size(); ++k) {
    const SlicePlane& plane = (*stack)->plane(k);
    const PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, kLattice};
    auto image = (*stack)->read(k);
    ASSERT_TRUE(image) << image.error().message;
    const Field field = segment(std::move(*image), (*stack)->pixel_unit(), Threshold{});
    for (const ContourKind kind : {ContourKind::kSubpixel, ContourKind::kPixel}) {
      const Pslg full = contours(field, grid, kind);  // small rings included
      for (const double tolerance_px : kTolerances_px) {
        expect_sound(full, tolerance_px * plane.spacing_u_mm, cost,
                     (*stack)->name(k) + " at " + std::to_string(tolerance_px) + " px");
        if (HasFatalFailure()) return;
      }
    }
  }
  report(cost);
}

}  // namespace
}  // namespace trocar::pipeline
