// SPDX-License-Identifier: GPL-3.0-or-later
// cut_bench: cuts of a hexagon that overlaps about 30 triangles, in synthetic sheets of 10,000 and
// 200,000 vertices, in the thread's CPU time; beside CGAL's constrained Delaunay triangulation of
// the cavity alone, and of the whole slice with the hole. Every cut is proved as in a session.
#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <functional>
#include <random>

#include "formats/mesh/cut.h"
#include "formats/mesh/local_refinement.h"
#include "formats/mesh/slice_mesh.h"
#include "tests/bench/bench.h"
#include "tests/support/cgal_sheets.h"
#include "tests/support/whole_cut.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;
constexpr int kSpacing = 512;        // steps: 2 mm
constexpr double kToolRadius = 900;  // steps
constexpr double kMinAngle_deg = 20;

double thread_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

Ring hexagon(double x, double y, double turn_rad) {
  Ring ring;
  for (int i = 0; i < 6; ++i) {
    const double angle = turn_rad + i * 1.0471975511965976;
    ring.push_back({static_cast<std::int32_t>(std::lround(x + kToolRadius * std::cos(angle))),
                    static_cast<std::int32_t>(std::lround(y + kToolRadius * std::sin(angle)))});
  }
  return ring;
}

/// A square Delaunay sheet of about `vertices` vertices: a hexagonal grid of `spacing` steps with
/// random offsets, numbered in the order of CGAL's spatial sort.
SliceMesh jittered_sheet(int vertices, int spacing, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const int columns = static_cast<int>(std::lround(std::sqrt(vertices * 0.866)));
  const int rows = vertices / columns;
  std::vector<Kernel::Point_2> points;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const bool rim = i == 0 || j == 0 || i + 1 == columns || j + 1 == rows;
      const auto jitter = [&] {
        return rim ? 0 : static_cast<int>(random() % 1024) * spacing / 2560 - spacing / 5;
      };
      const bool shifted = j % 2 == 1 && i > 0 && i + 1 < columns;
      const int x = i * spacing + (shifted ? spacing / 2 : 0) + jitter();
      points.emplace_back(x, std::lround(j * spacing * 0.866) + jitter());
    }
  }
  Cdt cdt;
  cdt.insert(points.begin(), points.end());
  SliceMesh mesh;
  for (auto v = cdt.finite_vertices_begin(); v != cdt.finite_vertices_end(); ++v) {
    v->info() = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back(
        {static_cast<std::int32_t>(v->point().x()), static_cast<std::int32_t>(v->point().y())});
  }
  for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f)
    mesh.triangles.push_back({f->vertex(0)->info(), f->vertex(1)->info(), f->vertex(2)->info()});
  return mesh;
}

/// CGAL's input: points, and segments between them that do not cross.
struct CgalPslg {
  std::vector<std::array<double, 2>> points;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> segments;
};

/// The sheet's vertices and boundary, and the tool's outline.
CgalPslg slice_with_hole(const SliceMesh& sheet, const Ring& tool) {
  CgalPslg out;
  const auto add = [&out](const Ring& ring) {
    const auto first = static_cast<std::uint32_t>(out.points.size());
    const auto n = static_cast<std::uint32_t>(ring.size());
    for (std::uint32_t i = 0; i < n; ++i) {
      out.points.push_back({double(ring[i].x), double(ring[i].y)});
      out.segments.push_back({first + i, first + (i + 1) % n});
    }
  };
  for (const Ring& ring : boundary_rings(sheet).rings)
    add(ring);
  add(tool);
  for (const LatticePoint p : sheet.vertices)
    out.points.push_back({double(p.x), double(p.y)});
  return out;
}

CgalPslg local_pslg(const Overlay& overlay) {
  CgalPslg out;
  for (const LatticePoint p : overlay.points)
    out.points.push_back({double(p.x), double(p.y)});
  for (const Strand& strand : overlay.strands) {
    if (!strand.gone) out.segments.push_back({strand.a, strand.b});
  }
  return out;
}

std::size_t cgal_cdt(const CgalPslg& input) {
  std::vector<Kernel::Point_2> points;
  points.reserve(input.points.size());
  for (const auto& [x, y] : input.points)
    points.emplace_back(x, y);
  Cdt cdt;
  cdt.insert_constraints(points.begin(), points.end(), input.segments.begin(),
                         input.segments.end());
  return cdt.number_of_faces();
}

/// A sheet and its replica, as in the remesher.
class Subject {
 public:
  explicit Subject(int vertices)
      : sheet_(jittered_sheet(vertices, kSpacing, 7)),
        pristine_(*make_sheet_mesh(sheet_, 4096, 8192)),
        pristine_grid_(pristine_),
        edit_(pristine_),
        work_(capacity_for(pristine_.vertices.size(), pristine_.triangles.size())),
        refinement_(pristine_) {
    for (const LatticePoint p : sheet_.vertices)
      extent_ = {std::max(extent_.x, p.x), std::max(extent_.y, p.y)};
    cuts_to_reset_ = std::min(vertices / 200, 300);
  }

  /// One cut; its time in s, and that of cut, refinement and grid: what the hand-over waits for.
  std::pair<double, double> cut() {
    const Ring tool = next_tool();
    const double start = thread_s();
    const CutReport report = cut_in_place(mesh_, grid_, tool, work_, edit_);
    const double is_cut = thread_s();
    LocalRefinementOptions options;
    options.min_angle_deg = kMinAngle_deg;
    refine_locally(mesh_, edit_, work_.stitch.created, options, refinement_);
    grid_.update(edit_.change(), mesh_);
    const double is_ready = thread_s();
    edit_.change().copy_to(mesh_, replica_);
    replica_grid_.update(edit_.change(), replica_);
    check(report.outcome == CutOutcome::kCut, "a cut failed");
    const std::int64_t hole = doubled_area(Pslg{to_rings(work_.hole)});
    area_error_ = std::max(area_error_, std::abs(double(report.doubled_area_removed - hole)));
    removed_ += report.triangles_removed;
    ++cuts_made_;
    return {is_cut - start, is_ready - start};
  }
  double cgal_cavity() {
    cut_in_place(mesh_, grid_, next_tool(), work_, edit_);
    edit_.undo(mesh_);
    return time_of(local_pslg(work_.overlay));
  }
  double cgal_slice() { return time_of(slice_with_hole(sheet_, next_tool())); }

  /// Of all cuts. The area lost is that of the hole.
  Counters counters() const {
    check(area_error_ == 0, "a cut removed more or less than the hole");
    return {{"error_area_steps2", area_error_}, {"triangles_removed", removed_ / cuts_made_}};
  }

 private:
  static double time_of(const CgalPslg& input) {
    const double start = thread_s();
    benchmark::DoNotOptimize(cgal_cdt(input));
    return thread_s() - start;
  }
  Ring next_tool() {
    if (cuts_++ % cuts_to_reset_ == 0) {
      mesh_ = replica_ = pristine_;
      grid_ = replica_grid_ = pristine_grid_;
    }
    const auto unit = [this] { return static_cast<double>(random_() >> 11U) * 0x1p-53; };
    const double margin = 2 * kToolRadius;
    const double x = margin + unit() * (extent_.x - 2 * margin),
                 y = margin + unit() * (extent_.y - 2 * margin);
    return hexagon(x, y, unit());
  }

  SliceMesh sheet_;
  SheetMesh pristine_, mesh_, replica_;
  TriangleGrid pristine_grid_, grid_, replica_grid_;
  SheetEdit edit_;
  CutWorkspace work_;
  LocalRefinementWorkspace refinement_;
  LatticePoint extent_{};
  std::mt19937_64 random_{11};
  int cuts_ = 0, cuts_to_reset_ = 1;
  double area_error_ = 0, removed_ = 0, cuts_made_ = 0;
};

/// Times by the thread's clock, with the largest of each 100 in p99_us.
void add_timed(const std::string& name, const std::function<double()>& time_s,
               const std::function<Counters()>& count) {
  benchmark::RegisterBenchmark(name.c_str(),
                               [time_s, count](benchmark::State& state) {
                                 std::vector<double> all;
                                 for (auto _ : state) {
                                   all.push_back(time_s());
                                   state.SetIterationTime(all.back());
                                 }
                                 std::sort(all.begin(), all.end());
                                 if (!all.empty())
                                   state.counters["p99_us"] = 1e6 * all[all.size() * 99 / 100];
                                 for (const auto& [key, value] : count())
                                   state.counters[key] = value;
                               })
      ->UseManualTime()
      ->Unit(benchmark::kMicrosecond);
}

void add_all(const std::vector<Input>& /*inputs*/) {
  for (const int vertices : {10'000, 200'000}) {
    const auto subject = std::make_shared<Subject>(vertices);
    const std::string stage = "cut/" + std::to_string(vertices) + "-vertices/";
    const auto none = [] { return Counters(); };
    const auto counters = [subject] { return subject->counters(); };
    add_timed(
        stage + "trocar", [subject] { return subject->cut().first; }, counters);
    add_timed(
        stage + "trocar-ready", [subject] { return subject->cut().second; }, counters);
    add_timed(
        stage + "peer-CGAL-cavity", [subject] { return subject->cgal_cavity(); }, none);
    add_timed(
        stage + "peer-CGAL-slice", [subject] { return subject->cgal_slice(); }, none);
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
