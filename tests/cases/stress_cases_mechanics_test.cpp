// SPDX-License-Identifier: GPL-3.0-or-later
// The stress cases of the sheet's mechanics, tests/corpus/cut: cuts in place and on a copy, the
// contract of the cut, areas compared with clipping, and the spring network of the remaining sheet
// compared with a global solution and with the results in the file.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <vector>

#include "formats/mesh/cut.h"
#include "formats/mesh/triangulation.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "tests/cases/cut_case.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/cut_checks.h"
#include "tests/support/random_geometry.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

using test::CutCase;
using test::ForceCase;

/// Number of components connected by edges.
std::int64_t islands(const SliceMesh& mesh) {
  const auto sheet = make_sheet_mesh(mesh, 0, 0);
  std::vector<std::uint32_t> piece(mesh.triangles.size());
  std::iota(piece.begin(), piece.end(), 0U);
  const auto find = [&piece](std::uint32_t t) {
    while (piece[t] != t)
      t = piece[t] = piece[piece[t]];
    return t;
  };
  auto count = static_cast<std::int64_t>(piece.size());
  for (std::uint32_t t = 0; t < piece.size(); ++t) {
    for (const std::uint32_t u : sheet->across[t]) {
      if (u == kNoSlot || find(u) == find(t)) continue;
      piece[find(u)] = find(t);
      --count;
    }
  }
  return count;
}

class MechanicsStress : public testing::TestWithParam<std::filesystem::path> {
 protected:
  void SetUp() override {
    const auto read = test::parse_cut_case(test::text_of(GetParam()), GetParam().filename());
    ASSERT_TRUE(read) << read.error().message;
    case_ = *read;
    sheet_ = case_.sheet;
    if (case_.has_outline) {
      const auto ok = check_pslg(case_.outline);
      ASSERT_TRUE(ok) << ok.error().message;
      sheet_ = trocar::triangulate(case_.outline)->mesh;
    }
  }

  struct Counts {
    std::int64_t cut = 0, nothing_met = 0, refused = 0;
  };

  // One cut on a copy, with all checks if `closely`; `sheet_` becomes the result.
  void cut_once(const Ring& tool, bool closely, Counts& counts) {
    const auto done = cut(sheet_, tool);
    if (!done) {
      EXPECT_EQ(done.error().code, ExitCode::kRefused) << done.error().message;
      ++counts.refused;
      return;
    }
    EXPECT_EQ(doubled_area(sheet_) - doubled_area(done->mesh), done->doubled_area_removed);
    if (closely) {
      EXPECT_EQ(contract_violation(sheet_, *done), "");
      EXPECT_EQ(outline_violation(*done), "");
      expect_same_in_place(tool, *done);
    }
    if (closely) {
      const SliceMesh parts = trocar::triangulate({{tool}})->mesh;
      Real common = 0;
      for (std::size_t t = 0; t < sheet_.triangles.size(); ++t)
        common += common_area(corners_of(sheet_, t), parts);
      const Real bound = rounding_bound(boundary_rings(sheet_).rings, tool);
      EXPECT_LE(std::abs(common - static_cast<Real>(done->doubled_area_removed)), bound + 0.25L);
    }
    ++(done->outcome == CutOutcome::kCut ? counts.cut : counts.nothing_met);
    sheet_ = done->mesh;
  }

  // A cut in place with enough capacity gives the same result as a cut on a copy.
  void expect_same_in_place(const Ring& tool, const CutResult& copy) const {
    auto mesh = make_sheet_mesh(sheet_, 512, 1024);
    ASSERT_TRUE(mesh);
    const std::size_t slots = mesh->triangles.size();
    CutWorkspace work({slots, mesh->vertices.size() + 512, 3 * slots + 512});
    SheetEdit edit(*mesh);
    const CutReport report = cut_in_place(*mesh, TriangleGrid(*mesh), tool, work, edit);
    EXPECT_EQ(report.outcome, copy.outcome);
    EXPECT_EQ(report.doubled_area_removed, copy.doubled_area_removed);
    const auto ok = check_sheet_mesh(*mesh);
    EXPECT_TRUE(ok) << ok.error().message;
    EXPECT_EQ(triangles_of(to_slice_mesh(*mesh)), triangles_of(copy.mesh));
  }

  static Result<Region> respond(const SheetMesh& sheet, const Ring& tool, const Lattice& lattice,
                                const Membrane& membrane) {
    RegionWorkspace workspace;
    return prepare_region(sheet, find_seeds(sheet, tool), tool, lattice, membrane, {}, workspace);
  }

  // Shape and force compared with the global solution, and properties of every equilibrium.
  static void expect_sound(const Region& region, double tolerance) {
    const auto global = solve_global(region.network, region.mesh.kind);
    ASSERT_TRUE(global) << global.error().message;
    const double scale = std::max(region.solution.stiffness_N_per_m, 1e-300);
    EXPECT_NEAR(global->stiffness_N_per_m / scale, region.solution.stiffness_N_per_m / scale,
                tolerance);
    ASSERT_EQ(global->w.size(), region.solution.w.size());
    for (std::size_t i = 0; i < global->w.size(); ++i) {
      EXPECT_NEAR(region.solution.w[i], global->w[i], tolerance);
      if (region.response.negative_springs == 0) {
        EXPECT_GE(region.solution.w[i], -tolerance);
        EXPECT_LE(region.solution.w[i], 1 + tolerance);
      }
    }
    EXPECT_NEAR(2 * energy_J(region.network, region.solution.w) / scale,
                region.solution.stiffness_N_per_m / scale, tolerance);
  }

  void force_is_right(const ForceCase& force) const {
    const auto sheet = make_sheet_mesh(sheet_, 0, 0);
    ASSERT_TRUE(sheet) << sheet.error().message;
    std::optional<double> first;
    // The network's condition number is about the square of the reach over the size of a triangle,
    // some tenths of a millimetre here.
    const double tolerance = std::max(1e-9, 1e-15 * std::pow(force.reach_mm / 0.5, 2));
    for (const double K : force.stiffness_N_per_m) {
      const auto calibration = calibrate(K, force.reach_mm * 1e-3, force.tool, case_.lattice);
      if (!force.refused.empty()) {
        ASSERT_FALSE(calibration) << "not refused: " << K << " N/m, " << force.reach_mm << " mm";
        EXPECT_EQ(calibration.error().code, ExitCode::kRefused);
        EXPECT_NE(calibration.error().message.find(force.refused), std::string::npos)
            << calibration.error().message;
        continue;
      }
      ASSERT_TRUE(calibration) << calibration.error().message;
      const auto region = respond(*sheet, force.tool, case_.lattice, calibration->membrane);
      ASSERT_TRUE(region) << region.error().message;
      expect_sound(*region, tolerance);
      const RegionResponse& r = region->response;
      const double over_K = r.stiffness_N_per_m / K;
      ASSERT_TRUE(std::isfinite(over_K));
      if (!first) first = over_K;
      EXPECT_NEAR(over_K, *first, tolerance * *first) << "not proportional to the stiffness";
      EXPECT_GE(over_K, force.over_K_min.value_or(0));
      EXPECT_LE(over_K, force.over_K_max.value_or(1e300));
      const double step_m = case_.lattice.step_m();
      const double foundation_N_per_m = calibration->membrane.foundation_N_per_m3 * 0.5 *
                                        static_cast<double>(doubled_area(sheet_)) * step_m * step_m;
      EXPECT_GE(r.stiffness_N_per_m, force.over_bed_min.value_or(0) * foundation_N_per_m);
      EXPECT_LE(r.stiffness_N_per_m, force.over_bed_max.value_or(1e300) * foundation_N_per_m);
      expect_propagation_sound(*region, force.propagated_max);
    }
  }

  // The paper's propagation converges to the same: with full damping from above, falling with every
  // tick, to within `most` after a thousand sweeps; the solution is a fixed point.
  static void expect_propagation_sound(const Region& region, double most) {
    const PropagationPlan plan =
        plan_propagation(region.network, region.mesh.kind, {1'000'000, 50, 1.0});
    PropagationState state = make_propagation_state(region.network, plan);
    const double right = region.solution.stiffness_N_per_m;
    double last = propagate(region.network, plan, 1, state);
    const double first_excess = last - right;
    for (int tick = 1; tick < 20; ++tick) {
      const double next = propagate(region.network, plan, 1, state);
      ASSERT_LE(next, last * (1 + 1e-9)) << "the force of a propagation falls with time";
      last = next;
      for (const double w : state.w_m)
        ASSERT_TRUE(std::isfinite(w));
    }
    EXPECT_GE(last, right * (1 - 1e-6));
    EXPECT_LE(last, right * most);
    EXPECT_LE(last - right, 0.9 * first_excess + 1e-9 * right);
    PropagationState torques_are_zero = make_propagation_state(region.network, plan);
    torques_are_zero.w_m = region.solution.w;
    EXPECT_NEAR(propagate(region.network, plan, 1, torques_are_zero), right, 1e-6 * right);
  }

  CutCase case_;
  SliceMesh sheet_;
};

TEST_P(MechanicsStress, IsRight) {
  SCOPED_TRACE(GetParam().filename().string() + ": correct is: " + case_.right);
  const auto valid = check_mesh(sheet_);
  ASSERT_EQ(static_cast<bool>(valid), case_.valid_sheet)
      << (valid ? "not refused" : valid.error().message);
  if (!valid) {
    EXPECT_NE(valid.error().message.find(case_.because), std::string::npos)
        << valid.error().message;
    return;
  }
  Counts counts;
  for (std::size_t i = 0; i < case_.cuts.size(); ++i) {
    cut_once(case_.cuts[i], i < 50 || i % 100 == 99, counts);
    if (HasFailure()) return;
  }
  EXPECT_EQ(counts.cut, case_.cut);
  EXPECT_EQ(counts.nothing_met, case_.nothing_met);
  EXPECT_EQ(counts.refused, case_.refused);
  const Pslg left = boundary_rings(sheet_);
  const auto holes = std::count_if(left.rings.begin(), left.rings.end(),
                                   [](const Ring& r) { return doubled_area(r) < 0; });
  const auto expect_is = [](const char* what, std::int64_t is, std::optional<std::int64_t> right) {
    EXPECT_EQ(is, right.value_or(is)) << what;
  };
  expect_is("doubled area left", doubled_area(sheet_), case_.doubled_area_left);
  expect_is("triangles left", static_cast<std::int64_t>(sheet_.triangles.size()),
            case_.triangles_left);
  expect_is("islands", islands(sheet_), case_.islands);
  expect_is("holes", holes, case_.holes);
  for (const ForceCase& force : case_.forces)
    force_is_right(force);
}

INSTANTIATE_TEST_SUITE_P(Mechanics, MechanicsStress,
                         testing::ValuesIn(test::case_files(TROCAR_CORPUS "/cut")),
                         [](const auto& at) { return test::test_name(at.param); });

}  // namespace
}  // namespace trocar::runtime
