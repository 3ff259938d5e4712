// SPDX-License-Identifier: GPL-3.0-or-later
// Marching cubes (Lorensen and Cline 1987). Ambiguous faces are decided by the asymptotic decider
// (Nielson and Hamann 1991). The surface is a manifold by construction:
//  - A grid edge between material and outside has one vertex, and every cell at the edge has one
//    polygon that passes through it. The polygons of the four cells form one fan.
//  - A face of a cell depends on its four values only, so both its cells have the same segments
//    on it, in opposite directions.
//  - A polygon is a disc that meets the faces of its cell in its sides only: no diagonal lies on a
//    face. Polygons for which there are no such diagonals get a vertex in the middle.
#include "pipeline/surface/isosurface.h"

#include <cstring>

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;

// Corner c of a cell lies at x = c & 1, y = c >> 1 & 1, z = c >> 2. Edge 4 * axis + k leads from the
// corner that has bit 0 and bit 1 of k on the two other axes, in cyclic order.
constexpr int kEdges = 12;

constexpr std::array<int, 2> edge_corners(int edge) {
  const int axis = edge / 4, k = edge % 4;
  const int low = (k & 1) << ((axis + 1) % 3) | (k >> 1) << ((axis + 2) % 3);
  return {low, low | 1 << axis};
}

// The edge between two corners.
constexpr int edge_between(int a, int b) {
  for (int e = 0; e < kEdges; ++e) {
    const auto [low, high] = edge_corners(e);
    if ((low == a && high == b) || (low == b && high == a)) return e;
  }
  return -1;
}

// The corners of a face, counter-clockwise seen from outside the cell. Face 2 * axis + side.
constexpr std::array<int, 4> face_corners(int face) {
  const int axis = face / 2, side = face % 2;
  const int u = 1 << ((axis + 1) % 3), v = 1 << ((axis + 2) % 3), base = side << axis;
  if (side == 1) return {base, base | u, base | u | v, base | v};
  return {base, base | v, base | u | v, base | u};
}

bool on_one_face(int edge, int other) {
  for (int f = 0; f < 6; ++f) {
    int both = 0;
    const auto corners = face_corners(f);
    for (std::size_t i = 0; i < 4; ++i) {
      const int side = edge_between(corners.at(i), corners.at((i + 1) % 4));
      both += side == edge || side == other ? 1 : 0;
    }
    if (both == 2) return true;
  }
  return false;
}

// The triangles of a cell. A corner below kEdges is the vertex on that edge; kEdges + k is the
// middle of the k-th polygon that has one.
struct CellTriangles {
  std::vector<std::array<std::uint8_t, 3>> triangles;
  std::vector<std::vector<std::uint8_t>> middles;  // the edges around each middle
};

// Splits the polygon from its i-th to its j-th corner by diagonals that lie on no face, as far as
// this is possible: i, j and the corners between them.
bool split(const std::vector<std::uint8_t>& polygon, std::size_t i, std::size_t j,
           std::vector<std::array<std::uint8_t, 3>>& out) {
  if (j - i < 2) return true;
  // The corner in the middle first, which gives compact triangles.
  std::vector<std::size_t> order;
  for (std::size_t k = i + 1; k < j; ++k)
    order.push_back(k);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto off = [&](std::size_t k) {
      const auto twice = static_cast<std::ptrdiff_t>(2 * k) - static_cast<std::ptrdiff_t>(i + j);
      return twice < 0 ? -twice : twice;
    };
    return off(a) < off(b);
  });
  for (const std::size_t k : order) {
    const auto good = [&](std::size_t a, std::size_t b) {
      return b - a == 1 || (a == 0 && b + 1 == polygon.size()) ||
             !on_one_face(polygon[a], polygon[b]);
    };
    if (!good(i, k) || !good(k, j)) continue;
    const std::size_t before = out.size();
    if (split(polygon, i, k, out) && split(polygon, k, j, out)) {
      out.push_back({polygon[i], polygon[j], polygon[k]});
      return true;
    }
    out.resize(before);
  }
  return false;
}

// The triangles of the cell whose inside corners are the bits of `inside`. Bit f of `joined` tells
// that the inside corners of the ambiguous face f are connected on it.
CellTriangles triangles_of_cell(int inside, int joined) {
  const auto in = [inside](int corner) { return (inside >> corner & 1) != 0; };
  // The edge at which the segment of a face ends that begins at each edge, or -1.
  std::array<int, kEdges> next{};
  next.fill(-1);
  for (int f = 0; f < 6; ++f) {
    const auto corners = face_corners(f);
    for (std::size_t i = 0; i < 4; ++i) {
      const int a = corners.at(i), b = corners.at((i + 1) % 4);
      if (!in(a) || in(b)) continue;
      // Around the outside corners if the inside ones are joined, else back around the inside ones.
      std::size_t k = i;
      const bool around_outside = (joined >> f & 1) != 0;
      do {
        k = (k + (around_outside ? 1 : 3)) % 4;
      } while (in(corners.at(k)) || !in(corners.at((k + 1) % 4)));
      next.at(static_cast<std::size_t>(edge_between(a, b))) =
          edge_between(corners.at(k), corners.at((k + 1) % 4));
    }
  }
  CellTriangles out;
  for (int first = 0; first < kEdges; ++first) {
    std::vector<std::uint8_t> polygon;
    for (int e = first; next.at(static_cast<std::size_t>(e)) >= 0;
         e = std::exchange(next.at(static_cast<std::size_t>(e)), -1))
      polygon.push_back(static_cast<std::uint8_t>(e));
    if (polygon.empty()) continue;
    if (split(polygon, 0, polygon.size() - 1, out.triangles)) continue;
    const auto middle = static_cast<std::uint8_t>(kEdges + static_cast<int>(out.middles.size()));
    for (std::size_t i = 0; i < polygon.size(); ++i)
      out.triangles.push_back({middle, polygon[(i + 1) % polygon.size()], polygon[i]});
    out.middles.push_back(std::move(polygon));
  }
  return out;
}

int ambiguous_faces(int inside) {
  int out = 0;
  for (int f = 0; f < 6; ++f) {
    const auto c = face_corners(f);
    const auto in = [&](std::size_t i) { return (inside >> c.at(i) & 1) != 0; };
    if (in(0) == in(2) && in(1) == in(3) && in(0) != in(1)) out |= 1 << f;
  }
  return out;
}

// The slice below and the slice above a layer of cells, and what is known of their vertices.
class MarchingCubes {
 public:
  MarchingCubes(const SurfaceVolume& volume, const Lattice& lattice)
      : volume_(volume),
        width_(static_cast<std::size_t>(volume.size[0])),
        slice_(width_ * static_cast<std::size_t>(volume.size[1])),
        to_steps_(Eigen::Scaling(1 / lattice.step_mm()) * volume.T_lps_volume),
        u_(to_steps_.linear().col(0) * volume.u_mm),
        v_(to_steps_.linear().col(1) * volume.v_mm),
        variants_(std::size_t{256} * 64) {
    surface_.lattice = lattice;
    for (std::size_t inside = 0; inside < ambiguous_.size(); ++inside)
      ambiguous_.at(inside) = ambiguous_faces(static_cast<int>(inside));
    for (auto& vertices : vertices_)
      vertices.resize(slice_);
    for (int c = 0; c < 8; ++c)
      corner_offset_.at(static_cast<std::size_t>(c)) =
          (c & 1) + ((c >> 1) & 1) * width_ + (c >> 2) * slice_;
  }

  TriangleSurface run() {
    std::vector<std::uint8_t> below(slice_), above(slice_), columns(width_ + 8);
    const auto flags = [&](int z, std::vector<std::uint8_t>& out) {
      const float* values = &volume_.values[static_cast<std::size_t>(z) * slice_];
      for (std::size_t i = 0; i < slice_; ++i)
        out[i] = values[i] >= 0 ? 1 : 0;
    };
    flags(0, below);
    for (int z = 0; z + 1 < volume_.size[2]; ++z) {
      flags(z + 1, above);
      low_ = to_steps_ * volume_.origin_mm[static_cast<std::size_t>(z)];
      up_ = to_steps_ * volume_.origin_mm[static_cast<std::size_t>(z) + 1] - low_;
      for (int y = 0; y + 1 < volume_.size[1]; ++y) {
        // The four corners that the cells before and after a column share, in bits 0, 2, 4, 6.
        const std::size_t row = static_cast<std::size_t>(y) * width_;
        for (std::size_t x = 0; x < width_; ++x)
          columns[x] =
              static_cast<std::uint8_t>(below[row + x] | below[row + width_ + x] << 2 |
                                        above[row + x] << 4 | above[row + width_ + x] << 6);
        for (std::size_t x = 0; x + 1 < width_; ++x) {
          std::uint64_t eight = 0;
          std::memcpy(&eight, &columns[x], sizeof eight);
          if (eight == 0 || eight == 0x5555555555555555) {
            x += 6;  // seven cells between eight columns
            continue;
          }
          const int inside = columns[x] | columns[x + 1] << 1;
          if (inside != 0 && inside != 0xff) cell(static_cast<int>(x), y, z, inside);
        }
      }
      std::swap(below, above);
      std::swap(vertices_[kXBelow], vertices_[kXAbove]);
      std::swap(vertices_[kYBelow], vertices_[kYAbove]);
    }
    return std::move(surface_);
  }

 private:
  enum : std::size_t { kXBelow, kXAbove, kYBelow, kYAbove, kUpward, kVertexArrays };

  // The vertex on an edge of the cell whose first corner is that voxel of the slice below.
  std::uint32_t& vertex(int edge, std::size_t at) {
    const auto corner = static_cast<std::size_t>(edge_corners(edge)[0]);
    const std::size_t in_slice = at + (corner & 1) + (corner >> 1 & 1) * width_;
    if (edge >= 8) return vertices_[kUpward][in_slice];
    return vertices_.at((edge < 4 ? kXBelow : kYBelow) + (corner >> 2))[in_slice];
  }

  // Rounded to the lattice.
  void add_vertex(const Vector3d& p) {
    surface_.vertices.push_back({static_cast<std::int32_t>(std::nearbyint(p.x())),
                                 static_cast<std::int32_t>(std::nearbyint(p.y())),
                                 static_cast<std::int32_t>(std::nearbyint(p.z()))});
  }

  void cell(int x, int y, int z, int inside) {
    constexpr double kMargin = 1.0 / 16;
    const std::size_t at = static_cast<std::size_t>(y) * width_ + static_cast<std::size_t>(x);
    const float* values = &volume_.values[static_cast<std::size_t>(z) * slice_ + at];
    const auto value = [&](int corner) {
      return static_cast<double>(values[corner_offset_.at(static_cast<std::size_t>(corner))]);
    };
    // The border is outside. So among the cells at a crossed edge, the one that comes first is the
    // one in which it lies last on both other axes.
    for (int axis = 0; axis < 3; ++axis) {
      const int edge = 4 * axis + 3;
      const auto [a, b] = edge_corners(edge);
      if (((inside >> a ^ inside >> b) & 1) == 0) continue;
      const double zero = value(a) / (value(a) - value(b));
      const double t =
          std::min(std::max(kMargin, zero), 1 - kMargin);  // also if it is not a number
      const auto along = [&](int k) { return k == axis ? t : 1.0; };
      vertex(edge, at) = static_cast<std::uint32_t>(surface_.vertices.size());
      add_vertex(low_ + (x + along(0)) * u_ + (y + along(1)) * v_ + along(2) * up_);
    }
    int joined = 0;
    for (int f = 0; f < 6; ++f) {
      if ((ambiguous_.at(static_cast<std::size_t>(inside)) >> f & 1) == 0) continue;
      const auto c = face_corners(f);
      const double even = value(c[0]) * value(c[2]), odd = value(c[1]) * value(c[3]);
      const bool even_inside = (inside >> c[0] & 1) != 0;
      if (even_inside ? even > odd : odd > even) joined |= 1 << f;
    }
    auto& variant =
        variants_[static_cast<std::size_t>(inside) << 6 | static_cast<std::size_t>(joined)];
    if (!variant) variant = triangles_of_cell(inside, joined);
    const auto first_middle = static_cast<std::uint32_t>(surface_.vertices.size());
    for (const auto& polygon : variant->middles) {
      Vector3d sum = Vector3d::Zero();
      for (const std::uint8_t edge : polygon) {
        const SpacePoint& p = surface_.vertices[vertex(edge, at)];
        sum += Vector3d(p[0], p[1], p[2]);
      }
      add_vertex(sum / static_cast<double>(polygon.size()));
    }
    for (const auto& t : variant->triangles) {
      const auto corner = [&](std::uint8_t e) {
        return e < kEdges ? vertex(e, at) : first_middle + (e - kEdges);
      };
      surface_.triangles.push_back({corner(t[0]), corner(t[1]), corner(t[2])});
    }
  }

  const SurfaceVolume& volume_;
  std::size_t width_, slice_;
  Eigen::Affine3d to_steps_;
  Vector3d u_, v_, low_, up_;  // steps
  std::array<std::size_t, 8> corner_offset_{};
  std::array<int, 256> ambiguous_{};
  std::vector<std::optional<CellTriangles>> variants_;
  std::array<std::vector<std::uint32_t>, kVertexArrays> vertices_;
  TriangleSurface surface_;
};

Lattice lattice_for(const SurfaceVolume& volume) {
  constexpr int kFinest = 14;
  double shortest = std::min(volume.u_mm, volume.v_mm);
  for (std::size_t k = 1; k < volume.origin_mm.size(); ++k)
    shortest = std::min(shortest, volume.origin_mm[k].z() - volume.origin_mm[k - 1].z());
  Lattice out{0};
  while (out.bits < kFinest && out.step_mm() > shortest / 64)
    ++out.bits;
  return out;
}

bool is_in_range(const SurfaceVolume& volume, const Lattice& lattice) {
  for (int z = 0; z < volume.size[2]; ++z) {
    for (int corner = 0; corner < 4; ++corner) {
      const Vector3d p =
          volume.T_lps_volume * volume.position((corner & 1) * (volume.size[0] - 1),
                                                (corner >> 1) * (volume.size[1] - 1), z);
      if (!(p.cwiseAbs().maxCoeff() / lattice.step_mm() < kMaxSpaceCoordinate)) return false;
    }
  }
  return true;
}

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

void collapse_edge(std::uint32_t from, std::uint32_t to, Collapsible& mesh,
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
    collapse_edge(from, to, mesh, quadrics);
    collapses.push_back({from, to});
    const auto changed = [&](std::uint32_t v) {
      if (!locked[v] && !queue.contains(v)) queue.push(v, queue.current());
    };
    changed(to);
    mesh.each_triangle(to, [&](std::uint32_t a, std::uint32_t) { changed(a); });
  }
}

}  // namespace

Result<TriangleSurface> isosurface(const SurfaceVolume& volume) {
  const Lattice lattice = lattice_for(volume);
  if (!is_in_range(volume, lattice))
    return refused("--surface: the scan lies too far from the patient's origin");
  return MarchingCubes(volume, lattice).run();
}

Decimation::Decimation(const TriangleSurface& fine, const std::atomic<bool>* stop)
    : fine_(fine), stop_(stop), locked_(fine.vertices.size(), false) {}

TriangleSurface Decimation::decimated(std::size_t triangles) {
  Collapsible mesh(fine_);
  std::vector<Quadric> quadrics = quadrics_of(fine_);
  std::erase_if(collapses_, [&](const Collapse& c) {
    const bool can = mesh.triangles() > triangles && !mesh.is_deleted(c.from) &&
                     !mesh.is_deleted(c.to) && mesh.can_collapse(c.from, c.to);
    if (!can) return true;
    collapse_edge(c.from, c.to, mesh, quadrics);
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
