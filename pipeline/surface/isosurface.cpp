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

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

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

}  // namespace

Result<TriangleSurface> isosurface(const SurfaceVolume& volume) {
  const Lattice lattice = lattice_for(volume);
  if (!is_in_range(volume, lattice))
    return refused("--surface: the scan lies too far from the patient's origin");
  return MarchingCubes(volume, lattice).run();
}

}  // namespace trocar::pipeline
