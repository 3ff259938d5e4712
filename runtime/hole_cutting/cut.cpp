// SPDX-License-Identifier: Apache-2.0
#include "runtime/hole_cutting/cut.h"

#include "formats/geometry/edge_predicates.h"

namespace trocar::runtime {
namespace {

bool is_tool(Outline tool) {
  const std::size_t n = tool.size();
  if (n < 3 || n > kMaxToolCorners) return false;
  for (std::size_t i = 0; i < n; ++i) {
    if (!is_on_lattice(tool[i])) return false;
    for (std::size_t j = 0; j < i; ++j) {
      if (tool[i] == tool[j]) return false;
    }
  }
  std::int64_t area = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const LatticePoint a = tool[i], b = tool[(i + 1) % n];
    area += orient2d(tool[0], a, b);
    for (std::size_t j = 0; j < i; ++j) {
      if (segments_cross(a, b, tool[j], tool[j + 1])) return false;
    }
  }
  return area > 0;
}

// Computes cavity, overlay and patch. If rounding affects a kept triangle, this is repeated with
// that triangle in the cavity. Each round adds triangles, so the loop terminates.
StageOutcome plan_patch(const SheetMesh& mesh, const TriangleGrid& grid, Outline tool,
                        CutWorkspace& work) noexcept {
  StageOutcome stage = find_cavity(mesh, grid, tool, work.cavity);
  if (work.cavity.triangles.empty()) return stage;
  while (stage == StageOutcome::kDone) {
    trace_boundary(mesh, work.cavity);
    stage = build_overlay(mesh, grid, work.cavity, work.overlay);
    std::span<const std::uint32_t> absorb = work.overlay.absorb;
    if (stage == StageOutcome::kDone) {
      stage = make_patch(work.overlay, work.patch);
      absorb = work.patch.absorb;
    }
    if (stage != StageOutcome::kAgain) return stage;
    stage = enlarge_cavity(absorb, work.cavity);
  }
  return stage;
}

// Returns the report of a stage that failed. `bug`: the reason if the stage ended with kBug.
CutReport failure(StageOutcome stage, const char* bug) noexcept {
  CutReport report;
  report.outcome = stage == StageOutcome::kCapacity ? CutOutcome::kCapacity : CutOutcome::kBug;
  if (report.outcome == CutOutcome::kBug) report.bug = bug;
  return report;
}

}  // namespace

std::string_view to_string(CutOutcome outcome) noexcept {
  switch (outcome) {
    case CutOutcome::kCut:
      return "cut";
    case CutOutcome::kNoOverlap:
      return "no overlap";
    case CutOutcome::kInvalidTool:
      return "invalid tool";
    case CutOutcome::kCapacity:
      return "capacity";
    case CutOutcome::kBug:
      break;
  }
  return "bug";
}

std::uint32_t count_obtuse_boundary_edges(const SheetMesh& mesh, const SheetEdit& edit) noexcept {
  std::uint32_t count = 0;
  for (const SheetEdit::OldTriangle& written : edit.triangles()) {
    if (!mesh.in_use(written.slot)) continue;
    const std::array<LatticePoint, 3> p = corners(mesh, written.slot);
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (mesh.across[written.slot][i] == kNoSlot &&
          encroaches(p[i], p[next_corner(i)], p[previous_corner(i)]))
        ++count;
    }
  }
  return count;
}

CutReport cut_in_place(SheetMesh& mesh, const TriangleGrid& grid, Outline tool, CutWorkspace& work,
                       SheetEdit& edit) noexcept {
  edit.begin(mesh);
  work.hole.points.clear();
  work.hole.ring_end.clear();
  work.stitch.created.clear();
  CutReport report;
  if (!is_tool(tool)) {
    report.outcome = CutOutcome::kInvalidTool;
    return report;
  }
  StageOutcome stage = plan_patch(mesh, grid, tool, work);
  if (stage != StageOutcome::kDone)
    return failure(stage, "the cavity's boundary and the tool are not planar");
  if (work.cavity.triangles.empty()) return report;

  stage = outline_hole(work.cavity, work.overlay, work.patch, work.hole);
  if (stage != StageOutcome::kDone) return failure(stage, "the outline of the hole does not close");
  const Proof proof =
      prove(mesh, grid, work.cavity, work.overlay, work.patch, work.hole, work.proof);
  if (proof.capacity_exceeded) return failure(StageOutcome::kCapacity, nullptr);
  if (proof.bug != nullptr) return failure(StageOutcome::kBug, proof.bug);

  stage = stitch(mesh, work.cavity, work.overlay, work.patch, work.stitch, edit);
  if (stage == StageOutcome::kDone)
    stage = restore_delaunay(mesh, work.stitch.shared_edges, work.flips, edit, report.flips);
  if (stage != StageOutcome::kDone) {
    edit.undo(mesh);
    return failure(stage, nullptr);
  }
  report.outcome = CutOutcome::kCut;
  report.doubled_area_removed = proof.doubled_area_removed;
  report.triangles_removed = static_cast<std::uint32_t>(work.cavity.triangles.size());
  report.triangles_created = static_cast<std::uint32_t>(work.patch.triangles.size());
  report.obtuse_boundary_edges = count_obtuse_boundary_edges(mesh, edit);
  return report;
}

}  // namespace trocar::runtime
