// SPDX-License-Identifier: GPL-3.0-or-later
// A sheet and a sequence of cuts: after each the sheet is valid, its area exact, and a cut in place
// equals one on a copy; with too little capacity the sheet is unchanged. Then the force law
// `network` on the remaining sheet. In: a stress case (tests/corpus/cut), or bytes that encode a
// sheet and tools.
#include <algorithm>
#include <cmath>
#include <string>

#include "formats/mesh/cut.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/triangulation.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "tests/cases/cut_case.h"
#include "tests/fuzz/harness.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/cut_checks.h"
#include "tests/support/same_sheet_mesh.h"
#include "tests/support/whole_cut.h"

namespace {

using namespace trocar;           // NOLINT(google-build-using-namespace): a program of one file
using namespace trocar::runtime;  // NOLINT(google-build-using-namespace)
using fuzz::fail;

constexpr std::size_t kMaxTriangles = 6000, kMaxCutsEach = 12, kMaxCuts = 60, kMaxForces = 2;

using trocar::test::same;

// Cuts in place, with this spare capacity.
CutReport cut_with(std::size_t capacity, const SliceMesh& sheet, const Ring& tool,
                   SheetMesh& mesh) {
  mesh = *make_sheet_mesh(sheet, capacity, 2 * capacity);
  const SheetMesh before = mesh;
  const std::size_t slots = mesh.triangles.size();
  CutWorkspace work({slots, mesh.vertices.size() + capacity, 3 * slots + capacity});
  SheetEdit edit(mesh);
  const CutReport report = cut_in_place(mesh, TriangleGrid(mesh), tool, work, edit);
  if (report.outcome == CutOutcome::kBug) fail(std::string("cut in place: ") + report.bug);
  if (report.outcome != CutOutcome::kCut && !same(mesh, before))
    fail("a cut without effect changed the sheet");
  if (const auto ok = check_sheet_mesh(mesh); !ok) fail("in place: " + ok.error().message);
  return report;
}

// Cuts `sheet`. False if the tool is refused.
bool cut_and_check(SliceMesh& sheet, const Ring& tool, std::size_t little) {
  const auto done = cut(sheet, tool);
  SheetMesh in_place;
  if (!done) {
    fuzz::expect_refusal(done.error());
    if (cut_with(64, sheet, tool, in_place).outcome != CutOutcome::kInvalidTool)
      fail("a tool is refused by one kind of cut only");
    return false;
  }
  if (const std::string law = contract_violation(sheet, *done); !law.empty()) fail(law);
  const CutReport tight = cut_with(little, sheet, tool, in_place);
  if (tight.outcome != CutOutcome::kCapacity && tight.outcome != done->outcome)
    fail("another outcome with little capacity");
  const CutReport report = cut_with(512, sheet, tool, in_place);
  if (report.outcome != done->outcome ||
      report.doubled_area_removed != done->doubled_area_removed ||
      triangles_of(to_slice_mesh(in_place)) != triangles_of(done->mesh))
    fail("a cut in place differs from one on a copy");
  sheet = done->mesh;
  return true;
}

// `tolerance`: rounding times the network's condition number.
void expect_equilibrium(const SliceMesh& sheet, const Ring& tool, const Lattice& lattice,
                        const Membrane& membrane, double tolerance) {
  const auto mesh = make_sheet_mesh(sheet, 0, 0);
  if (!mesh) fail("force: " + mesh.error().message);
  RegionWorkspace workspace;
  const auto region =
      prepare_region(*mesh, find_seeds(*mesh, tool), tool, lattice, membrane, {}, workspace);
  if (!region) fail("force: " + region.error().message);
  const RegionResponse& r = region->response;
  if (!std::isfinite(r.stiffness_N_per_m) || r.stiffness_N_per_m < 0 || !r.centre_steps.allFinite())
    fail("force: not a stiffness");
  for (const double w : region->solution.w) {
    if (!std::isfinite(w)) fail("force: a displacement that is not finite");
    if (r.negative_springs == 0 && !(w > -tolerance && w < 1 + tolerance))
      fail("force: a displacement outside 0..1");
  }
  const auto global = solve_global(region->network, region->mesh.kind);
  if (!global) fail("force: " + global.error().message);
  const double scale = std::max(global->stiffness_N_per_m, 1e-300);
  const double off = std::abs(global->stiffness_N_per_m - region->solution.stiffness_N_per_m);
  if (!(off <= tolerance * scale)) fail("force: differs from the global solution");
}

// The stiffness, reach and tool of the case on the remaining sheet.
void check_force(const SliceMesh& sheet, const test::ForceCase& force, const Lattice& lattice) {
  Grading none;
  none.graded = false;  // the exact constants, without calibration on a dozen regions
  for (const double K : force.stiffness_N_per_m) {
    const auto calibration = calibrate(K, force.reach_mm * 1e-3, force.tool, lattice, none);
    if (!calibration) {
      fuzz::expect_refusal(calibration.error());
      continue;
    }
    const double cells = force.reach_mm / lattice.step_mm();
    expect_equilibrium(sheet, force.tool, lattice, calibration->membrane,
                       std::clamp(1e-15 * cells * cells, 1e-6, 0.1));
  }
}

void check_case(SliceMesh sheet, const std::vector<Ring>& cuts, const Lattice& lattice,
                const std::vector<test::ForceCase>& forces) {
  if (const auto ok = check_mesh(sheet); !ok) return fuzz::expect_refusal(ok.error());
  if (sheet.triangles.size() > kMaxTriangles) return;
  const Ring* last = nullptr;
  for (std::size_t i = 0; i < std::min(cuts.size(), kMaxCutsEach); ++i) {
    if (cut_and_check(sheet, cuts[i], 5 * i)) last = &cuts[i];
  }
  // The remaining cuts of a long sequence on a copy only.
  for (std::size_t i = kMaxCutsEach; i < std::min(cuts.size(), kMaxCuts); ++i) {
    auto done = cut(sheet, cuts[i]);
    if (!done) {
      fuzz::expect_refusal(done.error());
      continue;
    }
    if (doubled_area(sheet) - doubled_area(done->mesh) != done->doubled_area_removed)
      fail("a cut's area");
    sheet = std::move(done->mesh);
  }
  if (cuts.size() > kMaxCutsEach) {
    if (const auto ok = check_mesh(sheet); !ok) fail("after many cuts: " + ok.error().message);
  }
  for (std::size_t i = 0; i < std::min(forces.size(), kMaxForces); ++i)
    check_force(sheet, forces[i], lattice);
  if (last == nullptr) return;
  Ring beside = *last;
  for (LatticePoint& p : beside)
    p = {p.x + 300, p.y + 100};
  expect_equilibrium(sheet, beside, lattice, {20, 1e6}, 1e-6);
}

void check_bytes(fuzz::Bytes bytes) {
  const int cells = 1 + bytes.below(8);
  const int cell = 2 + 8 * bytes.next();
  const std::int32_t low = -cells * cell / 2;
  const SliceMesh sheet = test::square_mesh({low, low}, cell, cells);
  const int scale = 1 + bytes.below(40);
  std::vector<Ring> cuts;
  while (!bytes.empty() && cuts.size() < kMaxCutsEach) {
    Ring tool;
    const LatticePoint at{bytes.small() * scale, bytes.small() * scale};
    for (int n = 3 + bytes.below(8); n > 0; --n)
      tool.push_back({at.x + bytes.small() * scale / 4, at.y + bytes.small() * scale / 4});
    if (doubled_area(tool) < 0) std::reverse(tool.begin(), tool.end());
    cuts.push_back(tool);
  }
  check_case(sheet, cuts, {}, {});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  if (data[0] != '{') {
    check_bytes({data, size});
    return 0;
  }
  const auto read = test::parse_cut_case({reinterpret_cast<const char*>(data), size}, "input.json");
  if (!read) return 0;
  SliceMesh sheet = read->sheet;
  if (read->has_outline) {
    if (const auto ok = check_pslg(read->outline); !ok) return 0;
    const auto cdt = trocar::triangulate(read->outline);
    if (!cdt) fail("triangulation: " + cdt.error().message);
    sheet = cdt->mesh;
  }
  check_case(std::move(sheet), read->cuts, read->lattice, read->forces);
  return 0;
}
