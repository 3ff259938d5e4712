// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/cgal_mesher.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_mesh_face_base_2.h>
#include <CGAL/Delaunay_mesh_vertex_base_2.h>
#include <CGAL/Delaunay_mesher_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace trocar::bench {
namespace {

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

}  // namespace

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

std::size_t cgal_triangulate(const CgalInput& input) {
  Cdt cdt;
  if (!input.points.empty()) insert(input, cdt);
  return cdt.number_of_faces();
}

}  // namespace trocar::bench
