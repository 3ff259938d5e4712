// SPDX-License-Identifier: Apache-2.0
// cut_bench [Google Benchmark's options] [--out=ROWS.json]: a cut of a tool that overlaps about 30
// triangles, in sheets of 10,000 and 200,000 vertices, stage by stage in the thread's CPU time;
// compared with CGAL's constrained Delaunay triangulation of the whole slice with the hole, and of
// the cavity alone, in the same run. Ends with a table of quantiles and ratios.
//
// A thread's CPU time includes interrupts and stalls of a virtual machine's host. To separate them,
// the same sequence of cuts is made kPasses times from the same state: the median of a cut's times
// contains cold caches and difficult places, which recur, but not stalls, which do not. For
// comparison the table has the stalls of plain arithmetic that takes as long as a cut.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <utility>

#include "runtime/hole_cutting/cut.h"
#include "runtime/local_refinement/local_refinement.h"
#include "tests/bench/synthetic_sheet.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;

constexpr int kSpacing = 512;        // steps: 2 mm
constexpr double kToolRadius = 900;  // steps; overlaps about 30 triangles
constexpr double kMinAngle_deg = 20;
constexpr int kPasses = 3, kCutsPerPass = 20'000;

double thread_us() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
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

// CPU times of one stage, in us.
struct Samples {
  std::vector<double> us;
  double at(double share) {
    if (us.empty()) return std::nan("");
    const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(us.size() - 1));
    std::nth_element(us.begin(), us.begin() + k, us.end());
    return us[static_cast<std::size_t>(k)];
  }
};

// The machine's stalls: pieces of arithmetic, each about as long as a cut.
Samples plain_arithmetic(double length_us) {
  std::uint64_t value = 1;
  const auto work = [&value](int rounds) {
    for (int i = 0; i < rounds; ++i) {
      value = value * 6364136223846793005U + 1442695040888963407U;
      benchmark::DoNotOptimize(value);
    }
  };
  constexpr int kMany = 1'000'000;
  const double before = thread_us();
  work(kMany);
  const int rounds = static_cast<int>(kMany * length_us / (thread_us() - before));
  Samples samples;
  for (int i = 0; i < kPasses * kCutsPerPass; ++i) {
    const double start = thread_us();
    work(rounds);
    samples.us.push_back(thread_us() - start);
  }
  return samples;
}

// A sheet and its replica, as in the remesher.
class Subject {
 public:
  explicit Subject(int vertices)
      : sheet(jittered_sheet(vertices, kSpacing, 7)),
        pristine_(*make_sheet_mesh(sheet, 4096, 8192)),
        pristine_grid_(pristine_),
        edit_(pristine_),
        work_(capacity_for(pristine_.vertices.size(), pristine_.triangles.size())),
        refinement_(pristine_) {
    for (const LatticePoint p : sheet.vertices)
      extent_ = {std::max(extent_.x, p.x), std::max(extent_.y, p.y)};
    cuts_to_reset_ = std::min(vertices / 200, 300);
    reset();
  }

  Ring random_tool() {
    const auto unit = [this] { return static_cast<double>(random_() >> 11U) * 0x1p-53; };
    const double margin = 2 * kToolRadius;
    return hexagon(margin + unit() * (extent_.x - 2 * margin),
                   margin + unit() * (extent_.y - 2 * margin), unit());
  }

  // One cut as in the remesher. Returns the time until the hand-over in us.
  double cut() {
    if (++cuts_ % cuts_to_reset_ == 0) reset();
    const Ring tool = random_tool();
    const double start = thread_us();
    const CutReport report = cut_in_place(mesh_, grid_, tool, work_, edit_);
    const double is_cut = thread_us();
    LocalRefinementOptions options;
    options.min_angle_deg = kMinAngle_deg;
    const LocalRefinementResult refined =
        refine_locally(mesh_, edit_, work_.stitch.created, options, refinement_);
    const double is_refined = thread_us();
    grid_.update(edit_.change(), mesh_);
    const double ready = thread_us();
    edit_.change().copy_to(mesh_, replica_);
    replica_grid_.update(edit_.change(), replica_);
    const double is_copied = thread_us();
    if (report.outcome != CutOutcome::kCut) std::abort();
    cut_us.us.push_back(is_cut - start);
    refine_us.us.push_back(is_refined - is_cut);
    cut_refine_us.us.push_back(is_refined - start);
    grid_us.us.push_back(ready - is_refined);
    replica_us.us.push_back(is_copied - ready);
    all_us.us.push_back(ready - start);
    triangles.us.push_back(report.triangles_removed);
    added.us.push_back(refined.vertices_added);
    return is_cut - start;
  }

  // CGAL on the local PSLG of a cut that is not made.
  double cgal_cavity() {
    if (++cuts_ % cuts_to_reset_ == 0) reset();
    cut_in_place(mesh_, grid_, random_tool(), work_, edit_);
    edit_.undo(mesh_);
    const CgalPslg input = local_pslg(work_.overlay);
    const double start = thread_us();
    benchmark::DoNotOptimize(cgal_cdt(input));
    cavity_us.us.push_back(thread_us() - start);
    return cavity_us.us.back();
  }

  // The same cuts kPasses times: the median of each one's times.
  Samples medians_of_repeated_cuts() {
    std::vector<std::array<double, kPasses>> of(kCutsPerPass);
    for (std::size_t pass = 0; pass < kPasses; ++pass) {
      random_.seed(11);
      cuts_ = 0;
      reset();
      for (auto& times : of)
        times[pass] = cut();
    }
    Samples own;
    for (auto& times : of) {
      std::nth_element(times.begin(), times.begin() + kPasses / 2, times.end());
      own.us.push_back(times[kPasses / 2]);
    }
    return own;
  }

  double cgal_slice() {
    const CgalPslg input = slice_with_hole(sheet, random_tool());
    const double start = thread_us();
    benchmark::DoNotOptimize(cgal_cdt(input));
    slice_us.us.push_back(thread_us() - start);
    return slice_us.us.back();
  }

  SliceMesh sheet;
  Samples own_us, machine_us;  // medians_of_repeated_cuts(), plain_arithmetic()
  Samples cut_us, refine_us, cut_refine_us, grid_us, replica_us, all_us, triangles, added,
      cavity_us, slice_us;

 private:
  void reset() {
    mesh_ = pristine_;
    replica_ = pristine_;
    grid_ = pristine_grid_;
    replica_grid_ = pristine_grid_;
  }

  SheetMesh pristine_, mesh_, replica_;
  TriangleGrid pristine_grid_, grid_, replica_grid_;
  SheetEdit edit_;
  CutWorkspace work_;
  LocalRefinementWorkspace refinement_;
  LatticePoint extent_{};
  std::mt19937_64 random_{11};
  int cuts_ = 0, cuts_to_reset_ = 1;
};

void print_row(const char* what, Samples& samples) {
  std::printf("  %-36s %8.2f %8.2f %8.2f %8.2f %8zu\n", what, samples.at(0.5), samples.at(0.99),
              samples.at(0.999), samples.at(1), samples.us.size());
}

struct Row {
  const char* what;
  Samples* samples;
};

std::vector<Row> rows_of(Subject& subject) {
  return {{"cut and re-triangulation, proved", &subject.cut_us},
          {"each cut's median of three passes", &subject.own_us},
          {"plain arithmetic of a cut's length", &subject.machine_us},
          {"quality pass, 20 degrees", &subject.refine_us},
          {"cut and quality pass", &subject.cut_refine_us},
          {"grid", &subject.grid_us},
          {"ready to hand over", &subject.all_us},
          {"replica, after the hand-over", &subject.replica_us},
          {"CGAL: the cavity", &subject.cavity_us},
          {"CGAL: the slice with the hole", &subject.slice_us}};
}

nlohmann::json describe(int vertices, Subject& subject) {
  nlohmann::json rows = nlohmann::json::array();
  const double cut_us = subject.cut_us.at(0.5);
  for (const auto& [what, samples] : rows_of(subject)) {
    rows.push_back({{"id", std::to_string(vertices) + " vertices/" + what},
                    {"vertices", vertices},
                    {"what", what},
                    {"samples", samples->us.size()},
                    {"median_us", samples->at(0.5)},
                    {"p99_us", samples->at(0.99)},
                    {"max_us", samples->at(1)},
                    {"to_cut_ratio", samples->at(0.5) / cut_us}});
  }
  return rows;
}

// The table as JSON, for scripts/report.
void write_rows(const std::string& file, const std::map<int, std::unique_ptr<Subject>>& subjects) {
  nlohmann::json rows = nlohmann::json::array();
  nlohmann::json sheets = nlohmann::json::array();
  for (const auto& [vertices, subject] : subjects) {
    const nlohmann::json part = describe(vertices, *subject);
    rows.insert(rows.end(), part.begin(), part.end());
    sheets.push_back({{"id", std::to_string(vertices) + " vertices"},
                      {"vertices", subject->sheet.vertices.size()},
                      {"triangles", subject->sheet.triangles.size()},
                      {"triangles_removed_median", subject->triangles.at(0.5)},
                      {"vertices_added_median", subject->added.at(0.5)}});
  }
  std::ofstream(file) << nlohmann::json{{"rows", rows}, {"sheets", sheets}}.dump(1) << '\n';
}

int run(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  std::string out;
  for (int i = 1; i < argc; ++i) {
    if (const std::string argument = argv[i]; argument.rfind("--out=", 0) == 0)
      out = argument.substr(6);
  }
  std::map<int, std::unique_ptr<Subject>> subjects;
  for (const int vertices : {10'000, 200'000}) {
    Subject& subject = *(subjects[vertices] = std::make_unique<Subject>(vertices));
    const auto add = [&](const std::string& name, double (Subject::*one)()) {
      return benchmark::RegisterBenchmark((name + "/" + std::to_string(vertices)).c_str(),
                                          [&subject, one](benchmark::State& state) {
                                            for (auto _ : state)
                                              state.SetIterationTime((subject.*one)() * 1e-6);
                                          })
          ->UseManualTime()
          ->Unit(benchmark::kMicrosecond);
    };
    add("cut", &Subject::cut);
    add("cgal_cavity", &Subject::cgal_cavity);
    add("cgal_slice", &Subject::cgal_slice)->Iterations(vertices > 100'000 ? 3 : 30);
  }
  benchmark::RunSpecifiedBenchmarks();

  for (auto& [vertices, subject] : subjects) {
    subject->own_us = subject->medians_of_repeated_cuts();
    subject->machine_us = plain_arithmetic(subject->own_us.at(0.5));
    std::printf(
        "\n%zu vertices, %zu triangles; a cut replaces %.0f, the quality pass adds %.1f "
        "vertices\n  %-36s %8s %8s %8s %8s %8s\n",
        subject->sheet.vertices.size(), subject->sheet.triangles.size(), subject->triangles.at(0.5),
        subject->added.at(0.5), "CPU time in us", "p50", "p99", "p99.9", "max", "samples");
    for (const auto& [what, samples] : rows_of(*subject))
      print_row(what, *samples);
    const double own = subject->cut_us.at(0.5);
    std::printf("  cut against CGAL: cavity x %.1f, slice x %.0f\n",
                subject->cavity_us.at(0.5) / own, subject->slice_us.at(0.5) / own);
  }
  if (!out.empty()) write_rows(out, subjects);
  Subject &small = *subjects[10'000], &large = *subjects[200'000];
  std::printf("\n200,000 against 10,000 vertices: cut x %.2f, ready to hand over x %.2f\n",
              large.cut_us.at(0.5) / small.cut_us.at(0.5),
              large.all_us.at(0.5) / small.all_us.at(0.5));
  return 0;
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::run(argc, argv);
}
