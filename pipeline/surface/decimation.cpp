// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/decimation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <utility>

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;

Vector3d position_of(const SpacePoint& p) {
  return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

// The corners of the triangles at each vertex are in a circular list: corner 3 * t + k of vertex k
// of triangle t.
class Collapsible {
 public:
  explicit Collapsible(const TriangleSurface& surface)
      : corner_(surface.vertices.size(), kNone),
        mark_(surface.vertices.size(), 0),
        left_(surface.triangles.size()) {
    vertices_.reserve(surface.vertices.size());
    for (const SpacePoint& p : surface.vertices)
      vertices_.push_back({position_of(p), 0});
    triangles_.reserve(surface.triangles.size());
    for (const auto& t : surface.triangles) {
      triangles_.push_back({t, {}});
      for (std::uint32_t k = 0; k < 3; ++k) {
        const auto c = static_cast<std::uint32_t>(3 * (triangles_.size() - 1) + k);
        std::uint32_t& at = corner_[t[k]];
        next(c) = at == kNone ? c : std::exchange(next(at), c);
        at = c;
      }
    }
  }

  std::size_t triangles() const { return left_; }
  bool is_deleted(std::uint32_t v) const { return corner_[v] == kNone; }

  const Vector3d& position(std::uint32_t v) const { return vertices_[v].position; }
  // The error of the vertex where it is.
  double& error(std::uint32_t v) { return vertices_[v].error; }

  // Calls visit(a, b) for each triangle (v, a, b).
  template <typename Visit>
  void each_triangle(std::uint32_t v, const Visit& visit) const {
    const std::uint32_t first = corner_[v];
    std::uint32_t c = first;
    do {
      const TriangleCorners& t = triangles_[c / 3];
      const std::uint32_t k = c % 3;
      visit(t.vertex[k == 2 ? 0 : k + 1], t.vertex[k == 0 ? 2 : k - 1]);
      c = t.next[k];
    } while (c != first);
  }

  // Whether the surface stays closed and manifold and no triangle turns by more than 60 degrees.
  bool can_collapse(std::uint32_t from, std::uint32_t to) {
    constexpr double kCos2 = 0.25, kGentleCos2 = 0.93;
    const Vector3d p = position(from), q = position(to);
    const std::uint32_t stamp = ++stamp_;
    int degree = 0, other_degree = 0, shared = 0;
    bool is_edge = false, turns = false;
    is_gentle_ = true;
    each_triangle(from, [&](std::uint32_t a, std::uint32_t b) {
      ++degree;
      mark_[a] = stamp;
      if (a == to || b == to) {
        is_edge = true;
        return;
      }
      const Vector3d pa = position(a), pb = position(b);
      const Vector3d before = (pa - p).cross(pb - p), after = (pa - q).cross(pb - q);
      const double dot = before.dot(after), product = before.squaredNorm() * after.squaredNorm();
      turns = turns || !(dot > 0 && dot * dot >= kCos2 * product);
      is_gentle_ = is_gentle_ && dot * dot >= kGentleCos2 * product;
    });
    if (!is_edge || turns) return false;
    each_triangle(to, [&](std::uint32_t a, std::uint32_t) {
      ++other_degree;
      shared += mark_[a] == stamp ? 1 : 0;
    });
    return shared == 2 && !(degree == 3 && other_degree == 3);
  }

  // After can_collapse(): whether a triangle of the collapse would intersect another one at its neighbours, or nearly
  // fold onto one.
  bool would_intersect(std::uint32_t from, std::uint32_t to) {
    if (is_gentle_) return false;  // no triangle turns by more than 15 degrees
    made_.clear();
    near_.clear();
    each_triangle(from, [&](std::uint32_t a, std::uint32_t b) {
      if (a != to && b != to) made_.push_back(face({to, a, b}));
    });
    each_triangle(from, [&](std::uint32_t v, std::uint32_t) {
      each_triangle(v, [&](std::uint32_t a, std::uint32_t b) {
        if (a == from || b == from) return;
        // Once, though it may have several of the neighbours.
        if ((mark_[a] == stamp_ && a < v) || (mark_[b] == stamp_ && b < v)) return;
        near_.push_back(face({v, a, b}));
      });
    });
    // If all face the same way, none can meet another.
    Vector3d mean = Vector3d::Zero();
    for (const Face& f : made_)
      mean += f.normal;
    const auto faces_it = [&](const Face& f) { return f.normal.dot(mean) > 0; };
    if (std::all_of(made_.begin(), made_.end(), faces_it) &&
        std::all_of(near_.begin(), near_.end(), faces_it))
      return false;
    for (std::size_t i = 0; i < made_.size(); ++i) {
      for (std::size_t j = i + 1; j < made_.size(); ++j)
        if (intersect(made_[i], made_[j])) return true;
      for (const Face& other : near_)
        if (intersect(made_[i], other)) return true;
    }
    return false;
  }

  void collapse(std::uint32_t from, std::uint32_t to) {
    // Takes the two triangles at the edge out of the lists of their other corners.
    std::array<std::uint32_t, 2> gone{};
    std::size_t count = 0;
    std::uint32_t c = corner_[from];
    do {
      const auto& v = triangles_[c / 3].vertex;
      if (v[0] == to || v[1] == to || v[2] == to) gone.at(count++) = c / 3;
      c = next(c);
    } while (c != corner_[from]);
    for (const std::uint32_t t : gone) {
      for (std::uint32_t k = 0; k < 3; ++k)
        unlink(3 * t + k);
      triangles_[t].vertex[0] = kNone;
    }
    left_ -= 2;
    c = corner_[from];
    do {
      triangles_[c / 3].vertex[c % 3] = to;
      c = next(c);
    } while (c != corner_[from]);
    std::swap(next(corner_[from]), next(corner_[to]));
    corner_[from] = kNone;
  }

  // The triangles that are left, in their order.
  std::vector<std::array<std::uint32_t, 3>> triangles_left() const {
    std::vector<std::array<std::uint32_t, 3>> out;
    out.reserve(left_);
    for (const TriangleCorners& t : triangles_)
      if (t.vertex[0] != kNone) out.push_back(t.vertex);
    return out;
  }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  struct Vertex {
    Vector3d position;
    double error = 0;
  };
  struct TriangleCorners {
    std::array<std::uint32_t, 3> vertex, next;
  };

  std::uint32_t& next(std::uint32_t corner) { return triangles_[corner / 3].next[corner % 3]; }

  void unlink(std::uint32_t corner) {
    std::uint32_t before = corner;
    while (next(before) != corner)
      before = next(before);
    next(before) = next(corner);
    corner_[triangles_[corner / 3].vertex[corner % 3]] = before;
  }

  struct Face {
    std::array<std::uint32_t, 3> v;
    std::array<Vector3d, 3> p;
    Vector3d normal;
  };
  Face face(const std::array<std::uint32_t, 3>& v) const {
    const std::array<Vector3d, 3> p{position(v[0]), position(v[1]), position(v[2])};
    return {v, p, (p[1] - p[0]).cross(p[2] - p[0])};
  }

  // Whether the segment from the first to the second point passes through the triangle.
  static bool passes(const Vector3d& p, const Vector3d& q, const Face& f) {
    const double a = f.normal.dot(p - f.p[0]), b = f.normal.dot(q - f.p[0]);
    if ((a > 0 && b > 0) || (a < 0 && b < 0) || (a == 0 && b == 0)) return false;
    const Vector3d d = q - p;
    int left = 0, right = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double side = d.dot((f.p[k] - p).cross(f.p[(k + 1) % 3] - p));
      left += side >= 0 ? 1 : 0;
      right += side <= 0 ? 1 : 0;
    }
    return left == 3 || right == 3;
  }

  // Two that share an edge intersect if they nearly fold onto each other. Coplanar ones that share
  // less do not count.
  static bool intersect(const Face& f, const Face& g) {
    constexpr double kFold = 0.9;
    std::array<bool, 3> shared_f{}, shared_g{};
    int shared = 0;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        if (f.v[i] == g.v[j]) {
          shared_f[i] = shared_g[j] = true;
          ++shared;
        }
    if (shared >= 2) {
      const double dot = f.normal.dot(g.normal);
      return dot < 0 && dot * dot > kFold * f.normal.squaredNorm() * g.normal.squaredNorm();
    }
    int above = 0, below = 0;
    for (std::size_t j = 0; j < 3; ++j) {
      if (shared_g[j]) continue;
      const double side = f.normal.dot(g.p[j] - f.p[0]);
      above += side > 0 ? 1 : 0;
      below += side < 0 ? 1 : 0;
    }
    if (above + shared == 3 || below + shared == 3) return false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      if (!shared_f[k] && !shared_f[next] && passes(f.p[k], f.p[next], g)) return true;
      if (!shared_g[k] && !shared_g[next] && passes(g.p[k], g.p[next], f)) return true;
    }
    return false;
  }

  std::vector<Vertex> vertices_;
  std::vector<TriangleCorners> triangles_;
  std::vector<Face> made_, near_;
  std::vector<std::uint32_t> corner_, mark_;
  std::uint32_t stamp_ = 0;
  std::size_t left_;
  bool is_gentle_ = false;
};

// A sum of area times squared distance from planes, as a function of the offset d from a point:
// d' a d + 2 b d and the error at the point. `a` holds xx, yy, zz, xy, yz, zx.
struct Quadric {
  std::array<double, 6> a{};
  Vector3d b = Vector3d::Zero();

  Vector3d times(const Vector3d& d) const {
    return {a[0] * d.x() + a[3] * d.y() + a[5] * d.z(), a[3] * d.x() + a[1] * d.y() + a[4] * d.z(),
            a[5] * d.x() + a[4] * d.y() + a[2] * d.z()};
  }
  double at(const Vector3d& d) const { return d.dot(times(d)) + 2 * b.dot(d); }
  // Adds a quadric whose point has the offset -d from this one's.
  void add(const Quadric& other, const Vector3d& d) {
    for (std::size_t i = 0; i < a.size(); ++i)
      a.at(i) += other.a.at(i);
    b += other.b + other.times(d);
  }
};

// The quadric of each vertex about its position, from the planes of its triangles.
std::vector<Quadric> quadrics_of(const TriangleSurface& surface) {
  std::vector<Quadric> out(surface.vertices.size());
  for (const auto& t : surface.triangles) {
    const Vector3d p = position_of(surface.vertices[t[0]]),
                   n = (position_of(surface.vertices[t[1]]) - p)
                           .cross(position_of(surface.vertices[t[2]]) - p);
    const double twice_area = n.norm();
    const Vector3d m = n / twice_area, w = n / 2;  // w = area * m
    for (const std::uint32_t v : t) {
      std::array<double, 6>& a = out[v].a;
      a[0] += w.x() * m.x();
      a[1] += w.y() * m.y();
      a[2] += w.z() * m.z();
      a[3] += w.x() * m.y();
      a[4] += w.y() * m.z();
      a[5] += w.z() * m.x();
    }
  }
  return out;
}

// Vertices in the order of their keys. A key is a cost as a float without its last bits, so costs
// whose ratio is below 1.5 can be equal; equal ones stay in the order in which they came, which keeps
// neighbours close in memory.
class Queue {
 public:
  explicit Queue(std::size_t vertices) : key_(vertices, kNone), buckets_(kBuckets) {}

  static std::uint32_t key(double cost) {
    const auto bounded = static_cast<float>(cost > 0 ? std::min(cost, 1e30) : 0.0);
    return std::bit_cast<std::uint32_t>(bounded) >> 22U;
  }
  bool contains(std::uint32_t v) const { return key_[v] != kNone; }
  std::uint32_t current() const { return current_; }
  void push(std::uint32_t v, std::uint32_t key) {
    key_[v] = std::max(key, current_);
    buckets_[key_[v]].push_back(v);
  }
  // The first vertex, or false if there is none.
  bool pop(std::uint32_t& v) {
    for (; current_ < kBuckets; ++current_, at_ = 0) {
      std::vector<std::uint32_t>& bucket = buckets_[current_];
      if (at_ < bucket.size()) {
        v = bucket[at_++];
        key_[v] = kNone;
        return true;
      }
      bucket = {};
    }
    return false;
  }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max(),
                                 kBuckets = 1U << 9U;
  std::vector<std::uint32_t> key_;
  std::vector<std::vector<std::uint32_t>> buckets_;
  std::uint32_t current_ = 0;
  std::size_t at_ = 0;
};

void collapse(std::uint32_t from, std::uint32_t to, Collapsible& mesh,
              std::vector<Quadric>& quadrics) {
  const Vector3d d = mesh.position(to) - mesh.position(from);
  mesh.error(to) += mesh.error(from) + quadrics[from].at(d);
  quadrics[to].add(quadrics[from], d);
  mesh.collapse(from, to);
}

// Collapses vertices that are not locked until this number of triangles is left, and appends the
// collapses. A vertex is evaluated when its turn comes: its key is a lower bound of its cost for
// most vertices, because quadrics only grow.
void collapse_to(std::size_t triangles, const std::vector<bool>& locked,
                 const std::atomic<bool>* stop, Collapsible& mesh, std::vector<Quadric>& quadrics,
                 std::vector<Decimation::Collapse>& collapses) {
  constexpr double kEdgeLength = 1e-5;
  Queue queue(quadrics.size());
  std::vector<std::pair<double, std::uint32_t>> targets;  // with their costs
  const auto find_targets = [&](std::uint32_t from) {
    targets.clear();
    const Quadric& here = quadrics[from];
    const Vector3d p = mesh.position(from);
    mesh.each_triangle(from, [&](std::uint32_t to, std::uint32_t) {
      const Vector3d d = mesh.position(to) - p;
      const double length2 = d.squaredNorm();
      targets.emplace_back(
          mesh.error(from) + here.at(d) + mesh.error(to) + kEdgeLength * length2 * length2, to);
    });
    std::sort(targets.begin(), targets.end());
  };
  for (std::uint32_t v = 0; v < quadrics.size(); ++v) {
    if (mesh.is_deleted(v) || locked[v]) continue;
    find_targets(v);
    queue.push(v, Queue::key(targets.front().first));
  }
  for (std::uint32_t from = 0; mesh.triangles() > triangles && queue.pop(from);) {
    if (stop != nullptr && stop->load(std::memory_order_relaxed)) return;
    if (mesh.is_deleted(from)) continue;
    find_targets(from);
    const auto target = std::find_if(targets.begin(), targets.end(), [&](const auto& t) {
      return Queue::key(t.first) > queue.current() ||
             (mesh.can_collapse(from, t.second) && !mesh.would_intersect(from, t.second));
    });
    if (target == targets.end()) continue;  // until one of its neighbours collapses
    if (Queue::key(target->first) > queue.current()) {
      queue.push(from, Queue::key(target->first));
      continue;
    }
    const std::uint32_t to = target->second;
    collapse(from, to, mesh, quadrics);
    collapses.push_back({from, to});
    const auto changed = [&](std::uint32_t v) {
      if (!locked[v] && !queue.contains(v)) queue.push(v, queue.current());
    };
    changed(to);
    mesh.each_triangle(to, [&](std::uint32_t a, std::uint32_t) { changed(a); });
  }
}

}  // namespace

Decimation::Decimation(const TriangleSurface& fine, const std::atomic<bool>* stop)
    : fine_(fine), stop_(stop), locked_(fine.vertices.size(), false) {}

TriangleSurface Decimation::decimated(std::size_t triangles) {
  Collapsible mesh(fine_);
  std::vector<Quadric> quadrics = quadrics_of(fine_);
  std::erase_if(collapses_, [&](const Collapse& c) {
    const bool can = mesh.triangles() > triangles && !mesh.is_deleted(c.from) &&
                     !mesh.is_deleted(c.to) && mesh.can_collapse(c.from, c.to);
    if (!can) return true;
    collapse(c.from, c.to, mesh, quadrics);
    return false;
  });
  collapse_to(triangles, locked_, stop_, mesh, quadrics, collapses_);

  triangles_ = mesh.triangles_left();
  std::vector<bool> used(fine_.vertices.size(), false);
  for (const auto& t : triangles_)
    used[t[0]] = used[t[1]] = used[t[2]] = true;
  TriangleSurface out;
  out.lattice = fine_.lattice;
  std::vector<std::uint32_t> number(fine_.vertices.size());
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (!used[v]) continue;
    number[v] = static_cast<std::uint32_t>(out.vertices.size());
    out.vertices.push_back(fine_.vertices[v]);
  }
  for (const auto& t : triangles_)
    out.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
  return out;
}

bool Decimation::undo(const std::vector<std::size_t>& triangles, std::size_t most) {
  // The vertex of the result to which each fine vertex led.
  std::vector<std::uint32_t> result(fine_.vertices.size());
  for (std::uint32_t v = 0; v < result.size(); ++v)
    result[v] = v;
  for (auto c = collapses_.rbegin(); c != collapses_.rend(); ++c)
    result[c->from] = result[c->to];
  std::vector<std::size_t> undo(fine_.vertices.size(), 0);
  for (const std::size_t t : triangles)
    for (const std::uint32_t v : triangles_[t])
      undo[v] = most;
  const std::size_t before = collapses_.size();
  std::vector<Collapse> kept;
  for (auto c = collapses_.rbegin(); c != collapses_.rend(); ++c) {
    std::size_t& here = undo[result[c->from]];
    if (here == 0) {
      kept.push_back(*c);
    } else {
      --here;
      locked_[c->from] = true;
    }
  }
  collapses_.assign(kept.rbegin(), kept.rend());
  return kept.size() < before;
}

}  // namespace trocar::pipeline
