// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/cut.h"

#include <numeric>

namespace trocar {
namespace {

constexpr std::uint32_t kPlanned = kNoSlot - 1;  // the group gets a new vertex

// Lists the run around v to which the kept triangle belongs.
bool list_run(const SheetMesh& mesh, const Cavity& cavity, std::uint32_t v, std::uint32_t triangle,
              StitchSpace& space) {
  StitchSpace::Run run{v, static_cast<std::uint32_t>(space.corners.size()), 0};
  const auto number = static_cast<std::uint32_t>(space.runs.size());
  for (const bool counter_clockwise : {true, false}) {
    std::uint32_t t = triangle, last = triangle;
    do {
      const std::uint32_t i = corner_of(mesh.triangles[t], v);
      if ((t != triangle || counter_clockwise) && !push_within(space.corners, {t, i})) return false;
      last = t;
      t = mesh.across[t][counter_clockwise ? previous_corner(i) : i];
    } while (t != kNoSlot && t != triangle && !cavity.contains(t));
    // Only the ends of a run are adjacent to the cavity.
    if (space.run_at.insert(pair_key(last, v), number) == nullptr) return false;
  }
  run.end = static_cast<std::uint32_t>(space.corners.size());
  return push_within(space.runs, run);
}

// Lists the runs of kept triangles around the vertices of shared edges.
bool list_runs(const SheetMesh& mesh, const Cavity& cavity, StitchSpace& space) {
  space.corners.clear();
  space.runs.clear();
  space.run_at.clear();
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept == kNoSlot) continue;
    for (const std::uint32_t v :
         {cavity.boundary_vertices[e.from], cavity.boundary_vertices[e.to]}) {
      if (space.run_at.contains(pair_key(e.kept, v))) continue;
      if (!list_run(mesh, cavity, v, e.kept, space)) return false;
    }
  }
  return true;
}

std::uint32_t find(StitchSpace& space, std::uint32_t i) {
  std::vector<std::uint32_t>& parent = space.parent;
  while (parent[i] != i)
    i = parent[i] = parent[parent[i]];
  return i;
}

void join(StitchSpace& space, std::uint32_t a, std::uint32_t b) {
  a = find(space, a);
  b = find(space, b);
  if (a != b) space.parent[std::max(a, b)] = std::min(a, b);
}

std::uint32_t node(const StitchSpace& space, std::uint32_t t, std::uint32_t i) {
  return static_cast<std::uint32_t>(space.runs.size()) + 3 * t + i;
}

// Groups the corners that are the same vertex because they meet at an edge.
bool group_corners(const SheetMesh& mesh, const Overlay& overlay, const Patch& patch,
                   StitchSpace& space) {
  const std::size_t nodes = space.runs.size() + 3 * patch.triangles.size();
  if (nodes > space.parent.capacity()) return false;
  space.parent.resize(nodes);
  std::iota(space.parent.begin(), space.parent.end(), 0U);
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t j = next_corner(i);
      if (const std::uint32_t u = patch.across[t][i]; u != kNoSlot) {
        if (u < t) continue;  // these two are already joined
        const Triangle& beyond = patch.triangles[u];
        join(space, node(space, t, i), node(space, u, corner_of(beyond, patch.triangles[t][i])));
        join(space, node(space, t, j), node(space, u, corner_of(beyond, patch.triangles[t][j])));
      } else if (const std::uint32_t k = patch.kept[t][i]; k != kNoSlot) {
        for (const std::uint32_t c : {i, j}) {
          const LatticePoint p = overlay.points[patch.triangles[t][c]];
          for (const std::uint32_t v : mesh.triangles[k]) {
            if (mesh.vertices[v] == p)
              join(space, node(space, t, c), space.run_at.find(pair_key(k, v)));
          }
        }
      }
    }
  }
  return true;
}

// Plans one vertex for each group: the sheet's own vertex if no other group has it, otherwise
// a new one.
bool plan_vertices(const SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                   const Patch& patch, StitchSpace& space) {
  space.vertex.assign(space.parent.size(), kNoSlot);
  space.taken.clear();
  space.fresh.clear();
  bool fits = true;
  const auto plan = [&](std::uint32_t group, LatticePoint p) {
    space.vertex[group] = kPlanned;
    fits = fits && push_within(space.fresh, {group, p});
  };
  for (std::uint32_t r = 0; r < space.runs.size(); ++r) {
    const std::uint32_t group = find(space, r), v = space.runs[r].vertex;
    if (space.vertex[group] != kNoSlot) continue;
    if (space.taken.contains(v)) {
      plan(group, mesh.vertices[v]);
    } else {
      fits = fits && space.taken.insert(v, 1) != nullptr;
      space.vertex[group] = v;
    }
  }
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t group = find(space, node(space, t, i));
      if (space.vertex[group] == kNoSlot) plan(group, overlay.points[patch.triangles[t][i]]);
    }
  }
  const std::size_t released =
      cavity.boundary_vertices.size() + cavity.inner.size() - space.taken.size();
  return fits && space.fresh.size() <= mesh.free_vertices.size() + released &&
         patch.triangles.size() <= mesh.free_triangles.size() + cavity.triangles.size();
}

void release(SheetMesh& mesh, const Cavity& cavity, const StitchSpace& space, SheetEdit& edit) {
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept == kNoSlot) continue;
    edit.touch_triangle(mesh, e.kept);
    mesh.across[e.kept][e.kept_edge] = kNoSlot;
  }
  // Release in descending order, so that the lowest slots are reused first.
  for (std::size_t i = cavity.triangles.size(); i-- > 0;)
    edit.release_triangle(mesh, cavity.triangles[i]);
  for (std::size_t i = cavity.inner.size(); i-- > 0;)
    edit.release_vertex(mesh, cavity.inner[i]);
  for (std::size_t i = cavity.boundary_vertices.size(); i-- > 0;) {
    if (!space.taken.contains(cavity.boundary_vertices[i]))
      edit.release_vertex(mesh, cavity.boundary_vertices[i]);
  }
}

void number_vertices(SheetMesh& mesh, StitchSpace& space, SheetEdit& edit) {
  for (const StitchSpace::NewVertex& v : space.fresh)
    space.vertex[v.group] = edit.take_vertex(mesh, v.point);
  for (std::uint32_t r = 0; r < space.runs.size(); ++r) {
    const StitchSpace::Run& run = space.runs[r];
    const std::uint32_t v = space.vertex[find(space, r)];
    if (v == run.vertex) continue;
    for (std::uint32_t k = run.first; k < run.end; ++k) {
      const auto [t, c] = space.corners[k];
      edit.touch_triangle(mesh, t);
      mesh.triangles[t][c] = v;
    }
  }
}

void put_in(SheetMesh& mesh, const Patch& patch, StitchSpace& space, SheetEdit& edit) {
  space.created.clear();
  space.shared_edges.clear();
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    Triangle v{};
    for (std::uint32_t i = 0; i < 3; ++i)
      v[i] = space.vertex[find(space, node(space, t, i))];
    space.created.push_back(edit.take_triangle(mesh, v));
  }
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    const std::uint32_t slot = space.created[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (patch.across[t][i] != kNoSlot) {
        mesh.across[slot][i] = space.created[patch.across[t][i]];
      } else if (const std::uint32_t k = patch.kept[t][i]; k != kNoSlot) {
        mesh.across[slot][i] = k;
        space.shared_edges.push_back({slot, i});
        const std::uint32_t to = mesh.triangles[slot][next_corner(i)];
        mesh.across[k][corner_of(mesh.triangles[k], to)] = slot;
      }
    }
  }
}

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

void StitchSpace::allocate(std::size_t max_triangles, std::size_t max_points) {
  const std::size_t max_corners = 6 * max_triangles, max_created = 2 * (max_points + 4);
  reserve_touched(corners, max_corners);
  reserve_touched(runs, 3 * max_triangles);
  run_at.allocate(max_corners);
  reserve_touched(parent, 3 * max_triangles + 3 * max_created);
  reserve_touched(vertex, 3 * max_triangles + 3 * max_created);
  taken.allocate(3 * max_triangles);
  reserve_touched(fresh, 3 * max_created);
  reserve_touched(created, max_created);
  reserve_touched(shared_edges, 3 * max_created);
}

StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept {
  if (!list_runs(mesh, cavity, space) || !group_corners(mesh, overlay, patch, space) ||
      !plan_vertices(mesh, cavity, overlay, patch, space))
    return StageOutcome::kCapacity;
  release(mesh, cavity, space, edit);
  number_vertices(mesh, space, edit);
  put_in(mesh, patch, space, edit);
  return StageOutcome::kDone;
}

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

}  // namespace trocar
