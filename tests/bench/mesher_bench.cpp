// SPDX-License-Identifier: GPL-3.0-or-later
// mesher_bench NAME=SCAN...: outlines to refined meshes on one thread, beside CGAL's
// Delaunay_mesher_2 and, if CMake was given its source, Shewchuk's Triangle, on the same outlines.
// Their simplification beside cv::approxPolyDP, ring by ring.
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_mesh_face_base_2.h>
#include <CGAL/Delaunay_mesh_vertex_base_2.h>
#include <CGAL/Delaunay_mesher_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <set>

#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/parallel_for.h"
#include "tests/bench/bench.h"

#ifdef TROCAR_TRIANGLE
extern "C" {
#define REAL double       // NOLINT(cppcoreguidelines-macro-usage): its header needs both
#define VOID void         // NOLINT(cppcoreguidelines-macro-usage)
#define ANSI_DECLARATORS  // NOLINT(cppcoreguidelines-macro-usage)
#include <triangle.h>
#undef REAL
#undef VOID
}
#endif

namespace trocar::bench {
namespace {

using namespace trocar::pipeline;

constexpr Lattice kLattice{8};
constexpr double kBone_HU = 226, kMinRegion_mm2 = 1, kMinAngle_deg = 30;

// ---- CGAL ----

struct CgalInput {
  std::vector<LatticePoint> points;  ///< each once
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  std::vector<std::array<double, 2>>
      hole_seeds;  ///< a point in each bounded region outside the material
};

struct CgalCounts {
  std::size_t triangles = 0, below_angle = 0;
};

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_2;
using VertexBase = CGAL::Delaunay_mesh_vertex_base_2<Kernel>;
using FaceBase = CGAL::Delaunay_mesh_face_base_2<Kernel>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>>;

// CGAL's Delaunay_mesh_area_criteria_2 ignores its angle bound if there is an area bound. This one
// applies both, in CGAL's order: first too large triangles, then the smallest angle.
class AngleAndArea {
 public:
  struct Quality {
    double sine2 = 1, doubled_area = 0;
    bool large = false;
    bool operator<(const Quality& q) const {
      if (large != q.large) return large;
      return large ? doubled_area > q.doubled_area : sine2 < q.sine2;
    }
  };

  class Is_bad {  // NOLINT(readability-identifier-naming): the concept's name
   public:
    Is_bad(double min_sine2, double max_doubled_area)
        : min_sine2_(min_sine2), max_doubled_area_(max_doubled_area) {}
    CGAL::Mesh_2::Face_badness operator()(const Quality& q) const {
      if (q.large) return CGAL::Mesh_2::IMPERATIVELY_BAD;
      return q.sine2 < min_sine2_ ? CGAL::Mesh_2::BAD : CGAL::Mesh_2::NOT_BAD;
    }
    CGAL::Mesh_2::Face_badness operator()(const Cdt::Face_handle& f, Quality& q) const {
      const Point &a = f->vertex(0)->point(), &b = f->vertex(1)->point(),
                  &c = f->vertex(2)->point();
      const double area2 = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
      const auto length2 = [](const Point& p, const Point& r) {
        return (p.x() - r.x()) * (p.x() - r.x()) + (p.y() - r.y()) * (p.y() - r.y());
      };
      double l = length2(a, b), m = length2(b, c), s = length2(c, a);
      if (l < s) std::swap(l, s);
      if (m < s) std::swap(m, s);  // s is the shortest, opposite the smallest angle
      q.sine2 = area2 * area2 / (l * m);
      q.doubled_area = area2;
      q.large = area2 > max_doubled_area_;
      return operator()(q);
    }

   private:
    double min_sine2_, max_doubled_area_;
  };

  AngleAndArea(double min_sine2, double max_doubled_area)
      : min_sine2_(min_sine2), max_doubled_area_(max_doubled_area) {}
  Is_bad is_bad_object() const { return {min_sine2_, max_doubled_area_}; }

 private:
  double min_sine2_, max_doubled_area_;
};

void insert(const CgalInput& input, Cdt& cdt) {
  std::vector<Point> points;
  points.reserve(input.points.size());
  for (const LatticePoint p : input.points)
    points.emplace_back(p.x, p.y);
  cdt.insert_constraints(points.begin(), points.end(), input.edges.begin(), input.edges.end());
}

/// Not timed: finds the seeds by flooding a triangulation.
CgalInput prepare(const Pslg& pslg) {
  CgalInput out;
  if (pslg.rings.empty()) return out;
  std::map<LatticePoint, std::size_t> index;
  for (const Ring& ring : pslg.rings) {
    for (const LatticePoint p : ring) {
      if (index.emplace(p, out.points.size()).second) out.points.push_back(p);
    }
    for (std::size_t i = 0; i < ring.size(); ++i)
      out.edges.emplace_back(index.at(ring[i]), index.at(ring[(i + 1) % ring.size()]));
  }
  Cdt cdt;
  insert(out, cdt);
  // Floods region after region from the outside in; crossing a constraint switches between inside
  // and outside. The largest face of a region outside the material gives its seed.
  std::map<Cdt::Face_handle, bool> in_material;
  std::vector<std::pair<Cdt::Face_handle, bool>> starts{{cdt.infinite_face(), false}};
  for (std::size_t k = 0; k < starts.size(); ++k) {
    const auto [start, material] = starts[k];
    if (!in_material.emplace(start, material).second) continue;
    std::vector<Cdt::Face_handle> stack{start};
    Cdt::Face_handle largest = start;
    double largest_area = -1;
    while (!stack.empty()) {
      const Cdt::Face_handle f = stack.back();
      stack.pop_back();
      if (!cdt.is_infinite(f) && cdt.triangle(f).area() > largest_area)
        largest_area = cdt.triangle(f).area(), largest = f;
      for (int i = 0; i < 3; ++i) {
        if (f->is_constrained(i)) {
          starts.emplace_back(f->neighbor(i), !material);
        } else if (in_material.emplace(f->neighbor(i), material).second) {
          stack.push_back(f->neighbor(i));
        }
      }
    }
    if (k > 0 && !material) {
      const Point c = CGAL::centroid(cdt.triangle(largest));
      out.hole_seeds.push_back({c.x(), c.y()});
    }
  }
  return out;
}

/// Triangulates and refines to an angle and an area in squared lattice steps; counts triangles.
CgalCounts cgal_mesh(const CgalInput& input, double min_angle_deg, double max_area_steps2) {
  CgalCounts out;
  if (input.points.empty()) return out;
  Cdt cdt;
  insert(input, cdt);
  std::vector<Point> seeds;
  seeds.reserve(input.hole_seeds.size());
  for (const auto& s : input.hole_seeds)
    seeds.emplace_back(s[0], s[1]);
  const double sine = std::sin(min_angle_deg * std::numbers::pi / 180);
  const AngleAndArea criteria(sine * sine, 2 * max_area_steps2);
  CGAL::Delaunay_mesher_2<Cdt, AngleAndArea> mesher(cdt, criteria);
  mesher.set_seeds(seeds.begin(), seeds.end(), false);
  mesher.refine_mesh();
  const AngleAndArea::Is_bad is_bad = criteria.is_bad_object();
  for (const Cdt::Face_handle f : cdt.finite_face_handles()) {
    if (!f->is_in_domain()) continue;
    ++out.triangles;
    AngleAndArea::Quality q;
    if (is_bad(f, q) != CGAL::Mesh_2::NOT_BAD) ++out.below_angle;
  }
  return out;
}

/// The triangulation alone: number of faces.
std::size_t cgal_triangulate(const CgalInput& input) {
  Cdt cdt;
  if (!input.points.empty()) insert(input, cdt);
  return cdt.number_of_faces();
}

// ---- outlines ----

/// The outlines of all slices of a scan, as trocar-mesh makes them.
struct Outlines {
  std::string name;
  double pixel_mm = 1;
  std::vector<Pslg> full, simple;
  std::vector<CgalInput> for_peers;
};
using Shared = std::shared_ptr<const Outlines>;

Shared outlines_of(const Input& input) {
  auto out = std::make_shared<Outlines>();
  out->name = input.name;
  const auto stack = take(open_stack({input.file}, {}));
  for (int k = 0; k < stack->size(); ++k) {
    const SlicePlane& plane = stack->plane(k);
    out->pixel_mm = plane.spacing_u_mm;
    const PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, kLattice};
    const Field field = segment(take(stack->read(k)), stack->pixel_unit(), Threshold{kBone_HU});
    Pslg full =
        drop_small_rings(contours(field, grid, ContourKind::kSubpixel), kMinRegion_mm2, kLattice);
    if (full.rings.empty()) continue;
    out->simple.push_back(simplify(full, kLattice, SimplificationOptions{}));
    out->full.push_back(std::move(full));
  }
  for (const Pslg& pslg : out->simple)
    out->for_peers.push_back(prepare(pslg));
  return out;
}

double vertices_of(const std::vector<Pslg>& outlines) {
  double sum = 0;
  for (const Pslg& pslg : outlines)
    for (const Ring& ring : pslg.rings)
      sum += static_cast<double>(ring.size());
  return sum;
}

// ---- Triangle ----

#ifdef TROCAR_TRIANGLE
/// An outline in Triangle's own arrays.
struct TriangleInput {
  std::vector<double> points, holes;
  std::vector<int> segments;

  explicit TriangleInput(const CgalInput& input) {
    for (const LatticePoint p : input.points)
      points.insert(points.end(), {double(p.x), double(p.y)});
    for (const auto& [from, to] : input.edges)
      segments.insert(segments.end(), {static_cast<int>(from), static_cast<int>(to)});
    for (const auto& seed : input.hole_seeds)
      holes.insert(holes.end(), seed.begin(), seed.end());
  }

  /// Refines to an angle and an area if the angle is not 0; the number of triangles.
  std::size_t mesh(double min_angle_deg, double max_area_steps2) {
    triangulateio in{}, out{};
    in.pointlist = points.data();
    in.numberofpoints = static_cast<int>(points.size() / 2);
    in.segmentlist = segments.data();
    in.numberofsegments = static_cast<int>(segments.size() / 2);
    in.holelist = holes.data();
    in.numberofholes = static_cast<int>(holes.size() / 2);
    // p: of segments; z: numbered from 0; Q: quiet; B, P: no markers and segments; q, a: bounds.
    std::array<char, 80> switches{"pzQBP"};
    if (min_angle_deg > 0)
      std::snprintf(switches.data(), switches.size(), "pzQBPq%.6fa%.6f", min_angle_deg,
                    max_area_steps2);
    ::triangulate(switches.data(), &in, &out, nullptr);
    trifree(out.pointlist);
    trifree(out.trianglelist);
    return static_cast<std::size_t>(out.numberoftriangles);
  }
};

void add_triangle(const Shared& outlines, const std::string& stage, const std::string& setting,
                  double min_angle_deg, double max_area_steps2) {
  auto inputs = std::make_shared<std::vector<TriangleInput>>();
  for (const CgalInput& input : outlines->for_peers)
    inputs->emplace_back(input);
  const auto mesh = [inputs, min_angle_deg, max_area_steps2] {
    double triangles = 0;
    for (TriangleInput& input : *inputs)
      triangles += static_cast<double>(input.mesh(min_angle_deg, max_area_steps2));
    return triangles;
  };
  add(stage + "/" + outlines->name + "/peer-Triangle" + setting, benchmark::kMillisecond, mesh,
      [mesh] {
        return Counters{{"triangles", mesh()}};
      });
}
#else
void add_triangle(const Shared& /*outlines*/, const std::string& /*stage*/,
                  const std::string& /*setting*/, double /*angle*/, double /*area*/) {}
#endif

// ---- triangulation and refinement ----

void add_triangulation(const Shared& outlines) {
  add(
      "triangulate/" + outlines->name + "/trocar", benchmark::kMillisecond,
      [outlines] {
        for (const Pslg& pslg : outlines->simple)
          benchmark::DoNotOptimize(triangulate(pslg));
      },
      [outlines] {
        return Counters{{"vertices", vertices_of(outlines->simple)}};
      });
  add("triangulate/" + outlines->name + "/peer-CGAL", benchmark::kMillisecond, [outlines] {
    for (const CgalInput& input : outlines->for_peers)
      benchmark::DoNotOptimize(cgal_triangulate(input));
  });
  add_triangle(outlines, "triangulate", "", 0, 0);
}

RefinementOptions options_for(double max_area_mm2) {
  RefinementOptions out;
  out.min_angle_deg = kMinAngle_deg;
  out.max_area_mm2 = max_area_mm2;
  out.keep_area = true;
  out.max_distance_steps = std::min(kMaxDistanceFromOutline_steps,
                                    left_for_refinement_steps(kLattice, SimplificationOptions{}));
  return out;
}

/// Triangles and the share below the angle. Every one must be explained by the outline.
Counters quality_of(const Outlines& outlines, const RefinementOptions& options) {
  double triangles = 0, below = 0, area = 0, area_error = 0;
  for (const Pslg& pslg : outlines.simple) {
    const Refined refined = refine(take(triangulate(pslg)), kLattice, options);
    const MeshQuality quality = measure_quality(refined, kLattice, options.min_angle_deg);
    triangles += static_cast<double>(refined.mesh.triangles.size());
    below += quality.below_min_angle;
    area += static_cast<double>(doubled_area(pslg));
    area_error += std::abs(static_cast<double>(doubled_area(refined.mesh) - doubled_area(pslg)));
    check(check_mesh(refined.mesh) && is_constrained_delaunay(refined.mesh),
          outlines.name + ": a mesh is not constrained Delaunay");
    check(quality.below_min_angle == quality.below_at_small_input_angle &&
              quality.below_unexplained == 0,
          outlines.name + ": a triangle below 30 degrees lies at no small input angle");
    check(refined.outcome == RefinementOutcome::kRefined &&
              quality.max_area_mm2 <= options.max_area_mm2,
          outlines.name + ": refinement stopped early");
  }
  return {{"error_below_angle", below / triangles},
          {"triangles", triangles},
          {"area_change", area_error / area}};
}

void add_refinement(const Shared& outlines, double max_area_mm2) {
  const RefinementOptions options = options_for(max_area_mm2);
  const double area_steps2 = std::ldexp(max_area_mm2, 2 * kLattice.bits);
  const std::string setting = "/" + short_text(max_area_mm2) + "mm2";
  add(
      "refine/" + outlines->name + "/trocar" + setting, benchmark::kMillisecond,
      [outlines, options] {
        for (const Pslg& pslg : outlines->simple)
          benchmark::DoNotOptimize(refine(take(triangulate(pslg)), kLattice, options));
      },
      [outlines, options] { return quality_of(*outlines, options); });
  const auto by_cgal = [outlines, area_steps2] {
    CgalCounts sum;
    for (const CgalInput& input : outlines->for_peers) {
      const CgalCounts one = cgal_mesh(input, kMinAngle_deg, area_steps2);
      sum.triangles += one.triangles;
      sum.below_angle += one.below_angle;
    }
    return sum;
  };
  add("refine/" + outlines->name + "/peer-CGAL" + setting, benchmark::kMillisecond, by_cgal,
      [by_cgal] {
        const CgalCounts sum = by_cgal();
        const auto triangles = static_cast<double>(sum.triangles);
        return Counters{{"error_below_angle", static_cast<double>(sum.below_angle) / triangles},
                        {"triangles", triangles}};
      });
  add_triangle(outlines, "refine", setting, kMinAngle_deg, area_steps2);
}

// ---- simplification ----

/// Rings that collapsed or turned over, and rings with an edge that meets another edge elsewhere
/// than in a shared vertex; exact.
double broken_rings(const Pslg& full, const Pslg& simple) {
  struct Edge {
    LatticePoint a, b;
    std::size_t ring;
  };
  std::vector<Edge> edges;
  std::set<std::size_t> broken;
  for (std::size_t r = 0; r < simple.rings.size(); ++r) {
    const Ring& ring = simple.rings[r];
    const std::int64_t area = ring.size() < 3 ? 0 : doubled_area(ring);
    if (area == 0 || (area > 0) != (doubled_area(full.rings[r]) > 0)) {
      broken.insert(r);
      continue;
    }
    for (std::size_t i = 0; i < ring.size(); ++i)
      edges.push_back({ring[i], ring[(i + 1) % ring.size()], r});
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& e, const Edge& f) {
    return std::min(e.a.x, e.b.x) < std::min(f.a.x, f.b.x);
  });
  std::vector<const Edge*> active;
  for (const Edge& e : edges) {
    const std::int32_t x = std::min(e.a.x, e.b.x);
    std::erase_if(active, [x](const Edge* o) { return std::max(o->a.x, o->b.x) < x; });
    for (const Edge* o : active)
      if (segments_cross(e.a, e.b, o->a, o->b)) broken.insert({e.ring, o->ring});
    active.push_back(&e);
  }
  return static_cast<double>(broken.size());
}

void add_simplification(const Shared& outlines, double tolerance_px) {
  const double tolerance_mm = tolerance_px * outlines->pixel_mm;
  const auto ours = [outlines, tolerance_mm] {
    std::vector<Pslg> out;
    for (const Pslg& pslg : outlines->full)
      out.push_back(
          simplify(pslg, kLattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker}));
    return out;
  };
  auto chains = std::make_shared<std::vector<std::vector<std::vector<cv::Point>>>>();
  for (const Pslg& pslg : outlines->full) {
    auto& slice = chains->emplace_back();
    for (const Ring& ring : pslg.rings) {
      auto& chain = slice.emplace_back();
      for (const LatticePoint p : ring)
        chain.emplace_back(p.x, p.y);
    }
  }
  const auto theirs = [chains, tolerance_mm] {
    std::vector<Pslg> out;
    std::vector<cv::Point> simple;
    for (const auto& slice : *chains) {
      Pslg& pslg = out.emplace_back();
      for (const auto& chain : slice) {
        cv::approxPolyDP(chain, simple, tolerance_mm / kLattice.step_mm(), true);
        Ring& ring = pslg.rings.emplace_back();
        for (const cv::Point p : simple)
          ring.push_back({p.x, p.y});
      }
    }
    return out;
  };
  const auto counters = [outlines](const std::vector<Pslg>& simple) {
    double broken = 0, rings = 0;
    for (std::size_t k = 0; k < simple.size(); ++k) {
      broken += broken_rings(outlines->full[k], simple[k]);
      rings += static_cast<double>(simple[k].rings.size());
    }
    return Counters{{"error_broken_rings", broken / rings}, {"vertices", vertices_of(simple)}};
  };
  const std::string setting = "/" + short_text(tolerance_px) + "px";
  add("simplify/" + outlines->name + "/trocar" + setting, benchmark::kMillisecond, ours,
      [ours, counters, outlines] {
        Counters out = counters(ours());
        check(out["error_broken_rings"] == 0, outlines->name + ": simplification broke a ring");
        return out;
      });
  add("simplify/" + outlines->name + "/peer-approxPolyDP" + setting, benchmark::kMillisecond,
      theirs, [theirs, counters] { return counters(theirs()); });
}

void add_all(const std::vector<Input>& inputs) {
  keep_freed_memory();  // or else Triangle would get fresh pages from the system for each outline
  for (const Input& input : inputs) {
    const Shared outlines = outlines_of(input);
    add_triangulation(outlines);
    for (const double max_area_mm2 : {50.0, 5.0, 1.0})
      add_refinement(outlines, max_area_mm2);
    for (const double tolerance_px : {0.25, 0.5, 1.0, 2.0})
      add_simplification(outlines, tolerance_px);
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
