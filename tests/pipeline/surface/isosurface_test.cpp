// SPDX-License-Identifier: GPL-3.0-or-later
// The isosurface of noise, of values on the level, of single voxels and of uneven and tilted slices: closed, manifold and free of
// self-intersections (by CGAL), and where linear interpolation puts it. Decimation of surfaces whose best decimation is known,
// and undoing it.
#include "pipeline/surface/isosurface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>

#include "formats/base/disjoint_sets.h"
#include "pipeline/surface/cgal_verification.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;

class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double operator()() {  // 0 to 1
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state_ >> 11U) / 9007199254740992.0;
  }

 private:
  std::uint64_t state_;
};

// Values inside a border that is outside, in slices that a function places.
SurfaceVolume volume_of(std::array<int, 3> size, const std::function<Vector3d(int)>& origin,
                        const std::function<double(int, int, int)>& value) {
  SurfaceVolume out;
  out.size = size;
  out.u_mm = 0.9;
  out.v_mm = 1.1;
  out.T_lps_volume =
      Eigen::Translation3d(-80, 30, 500) * Eigen::AngleAxisd(0.4, Vector3d(1, 2, 3).normalized());
  for (int z = 0; z < size[2]; ++z) {
    out.origin_mm.push_back(origin(z));
    for (int y = 0; y < size[1]; ++y) {
      for (int x = 0; x < size[0]; ++x) {
        const bool border =
            x % (size[0] - 1) == 0 || y % (size[1] - 1) == 0 || z % (size[2] - 1) == 0;
        const auto here = static_cast<float>(value(x, y, z));
        out.values.push_back(border ? -std::abs(here) - 1e-3F : here);
      }
    }
  }
  return out;
}

Vector3d evenly(int z) {
  return {0, 0, static_cast<double>(z)};
}

std::size_t parts_of(const TriangleSurface& surface) {
  DisjointSets sets(surface.vertices.size());
  std::size_t parts = sets.size();
  for (const auto& t : surface.triangles)
    for (std::size_t k = 0; k < 2; ++k)
      if (sets.join(t[k], t[k + 1])) --parts;
  return parts;
}

void expect_proved(const TriangleSurface& surface, const char* name, int i) {
  const auto ok = check_triangle_surface(surface);
  EXPECT_TRUE(ok) << name << " " << i << ": " << ok.error().message;
  const auto bad = self_intersecting_triangles(surface);
  EXPECT_TRUE(bad && bad->empty()) << name << " " << i;
}

TEST(SurfaceVolume, IsTrilinearBetweenItsVoxels) {
  const auto at = [](double x, double y, double z) { return 3 + x - 2 * y + 0.5 * x * y * z; };
  const SurfaceVolume volume = volume_of({9, 8, 7}, evenly, at);
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const double x = 1 + 6 * random(), y = 1 + 5 * random(), z = 1 + 4 * random();
    EXPECT_NEAR(volume.at({0.9 * x, 1.1 * y, z}), at(x, y, z), 1e-4);
  }
}

TEST(Isosurface, OfNoiseIsProved) {
  Random random(1);
  const std::array<std::pair<const char*, std::function<double()>>, 5> kinds{{
      {"uniform", [&] { return random() - 0.5; }},
      {"mostly near the level", [&] { return std::pow(random() - 0.5, 9) * 256; }},
      {"tiny beside large",
       [&] { return (random() < 0.5 ? 1 : -1) * (random() < 0.5 ? 1e-3 : 1); }},
      {"on the level", [&] { return std::floor(3 * random()) - 1; }},
      {"few voxels", [&] { return (random() < 0.2 ? 1 : -1) * random(); }},
  }};
  std::size_t triangles = 0;
  for (const auto& [name, value] : kinds) {
    for (int i = 0; i < 8; ++i) {
      std::vector<Vector3d> origins;
      origins.reserve(12);
      const double tilt_mm = 0.5 * (i % 3);
      for (int z = 0; z < 12; ++z)
        origins.emplace_back(0, tilt_mm * z, z == 0 ? 0 : origins.back().z() + 0.5 + random());
      const auto surface = isosurface(volume_of(
          {12, 12, 12}, [&](int z) { return origins[static_cast<std::size_t>(z)]; },
          [&value = value](int, int, int) { return value(); }));
      ASSERT_TRUE(surface) << surface.error().message;
      expect_proved(*surface, name, i);
      triangles += surface->triangles.size();
    }
  }
  EXPECT_GT(triangles, 100'000U);
}

// All ways in which the eight corners of one cell can be inside, each alone in a volume.
TEST(Isosurface, OfEveryCellIsProved) {
  Random random(2);
  for (int inside = 1; inside < 256; ++inside) {
    const auto surface = isosurface(volume_of({4, 4, 4}, evenly, [&](int x, int y, int z) {
      const bool is_corner = x > 0 && y > 0 && z > 0 && x < 3 && y < 3 && z < 3;
      const bool in = is_corner && (inside >> ((x - 1) | (y - 1) << 1 | (z - 1) << 2) & 1) != 0;
      return (in ? 1 : -1) * (random() + 1e-6);
    }));
    ASSERT_TRUE(surface) << surface.error().message;
    expect_proved(*surface, "corners", inside);
  }
}

TEST(Isosurface, LiesOnTheLinearInterpolation) {
  const Vector3d normal = Vector3d(1, 2, 3).normalized();
  const auto volume = volume_of(
      {20, 20, 20}, [](int z) { return Vector3d(0, 0.3 * z, 0.7 * z); },
      [&](int x, int y, int z) {
        return 9 - normal.dot(Vector3d(0.9 * x, 1.1 * y + 0.3 * z, 0.7 * z));
      });
  const auto surface = test::take(isosurface(volume));
  expect_proved(surface, "plane", 0);
  const double step_mm = surface.lattice.step_mm();
  EXPECT_LE(step_mm, 0.7 / 64);
  int on_plane = 0;
  for (const SpacePoint& p : surface.vertices) {
    const Vector3d q = volume.T_lps_volume.inverse() * (step_mm * Vector3d(p[0], p[1], p[2]));
    const bool inner = q.x() > 1.8 && q.x() < 15 && q.z() > 1.4 && q.z() < 11 &&
                       q.y() - q.z() * 0.3 / 0.7 > 2.2 && q.y() - q.z() * 0.3 / 0.7 < 18;
    if (!inner) continue;
    // A vertex keeps a 16th of an edge away from the edge's ends.
    EXPECT_LE(std::abs(normal.dot(q) - 9), 1.1 / 16 + 2 * step_mm);
    on_plane += std::abs(normal.dot(q) - 9) <= 2 * step_mm ? 1 : 0;
  }
  EXPECT_GT(on_plane, 100);
}

TEST(Isosurface, JoinsDiagonalVoxelsAsTheContourDoes) {
  // Two voxels at a face's diagonal: joined if their product is the larger one.
  for (const bool joined : {false, true}) {
    const auto surface = isosurface(volume_of({5, 5, 4}, evenly, [&](int x, int y, int z) {
      if (z != 1) return -4.0;
      if ((x == 1 && y == 1) || (x == 2 && y == 2)) return joined ? 2.0 : 0.5;
      return -1.0;
    }));
    ASSERT_TRUE(surface) << surface.error().message;
    expect_proved(*surface, "diagonal", joined ? 1 : 0);
    EXPECT_EQ(parts_of(*surface), joined ? 1U : 2U);
  }
}

TEST(Isosurface, RefusesWhatIsTooFar) {
  SurfaceVolume volume = volume_of({4, 4, 4}, evenly, [](int, int, int) { return 1.0; });
  EXPECT_TRUE(isosurface(volume));
  volume.T_lps_volume = Eigen::Translation3d(1e6, 0, 0);
  const auto far = isosurface(volume);
  ASSERT_FALSE(far);
  EXPECT_NE(far.error().message.find("too far"), std::string::npos);
}

// A cube with edges of 1000 steps, each face divided into n x n squares of two triangles.
TriangleSurface cube(int n) {
  TriangleSurface out;
  std::map<SpacePoint, std::uint32_t> number;
  const auto vertex = [&](int axis, int side, int i, int j) {
    SpacePoint p{};
    const auto at = [&](int k) -> std::int32_t& {
      return p.at(static_cast<std::size_t>((axis + k) % 3));
    };
    at(0) = side * 1000;
    at(1) = i * 1000 / n;
    at(2) = j * 1000 / n;
    const auto [it, is_new] = number.emplace(p, static_cast<std::uint32_t>(out.vertices.size()));
    if (is_new) out.vertices.push_back(p);
    return it->second;
  };
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
          std::array<std::uint32_t, 4> q{vertex(axis, side, i, j), vertex(axis, side, i + 1, j),
                                         vertex(axis, side, i + 1, j + 1),
                                         vertex(axis, side, i, j + 1)};
          if (side == 0) std::swap(q[1], q[3]);
          out.triangles.push_back({q[0], q[1], q[2]});
          out.triangles.push_back({q[0], q[2], q[3]});
        }
      }
    }
  }
  return out;
}

// Two such surfaces, apart by `shift` steps along x.
TriangleSurface with_second(TriangleSurface out, std::int32_t shift) {
  const TriangleSurface one = out;
  const auto first = static_cast<std::uint32_t>(one.vertices.size());
  for (const SpacePoint& p : one.vertices)
    out.vertices.push_back({p[0] + shift, p[1], p[2]});
  for (const auto& t : one.triangles)
    out.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  return out;
}

TEST(Decimation, OfACubeIsTheCube) {
  const TriangleSurface fine = cube(16);
  ASSERT_TRUE(check_triangle_surface(fine));
  Decimation decimation(fine);
  const TriangleSurface coarse = decimation.decimated(12);
  EXPECT_TRUE(check_triangle_surface(coarse));
  EXPECT_EQ(coarse.triangles.size(), 12U);
  EXPECT_EQ(enclosed_volume(coarse), 1e9);
}

TEST(Decimation, GivesTheWantedNumberAndStaysNear) {
  // A ball: the cube's vertices on a sphere of 2000 steps.
  TriangleSurface fine = cube(40);
  for (SpacePoint& p : fine.vertices) {
    const Eigen::Vector3d d(p[0] - 500, p[1] - 500, p[2] - 500);
    for (std::size_t k = 0; k < 3; ++k)
      p.at(k) =
          static_cast<std::int32_t>(std::lround(d[static_cast<Eigen::Index>(k)] * 2000 / d.norm()));
  }
  ASSERT_TRUE(check_triangle_surface(fine));
  Decimation decimation(fine);
  double last = 0;
  for (const std::size_t wanted : {9600U, 4000U, 1000U, 200U}) {
    const TriangleSurface coarse = decimation.decimated(wanted);
    EXPECT_TRUE(check_triangle_surface(coarse));
    const auto bad = self_intersecting_triangles(coarse);
    EXPECT_TRUE(bad && bad->empty());
    EXPECT_LE(coarse.triangles.size(), wanted);
    EXPECT_GE(coarse.triangles.size(), wanted - 1);
    // A triangle of area A in a sphere of radius r has a sagitta of about A / (2.6 r) at best.
    double farthest = 0;
    for (const auto& t : coarse.triangles) {
      Eigen::Vector3d middle = Eigen::Vector3d::Zero();
      for (const std::uint32_t v : t)
        middle +=
            Eigen::Vector3d(coarse.vertices[v][0], coarse.vertices[v][1], coarse.vertices[v][2]) /
            3;
      farthest = std::max(farthest, 2000 - middle.norm());
    }
    const double area = 4 * 3.14159265358979 * 2000 * 2000 / static_cast<double>(wanted);
    EXPECT_LT(farthest, 4 * area / (2.6 * 2000) + 2) << wanted;
    EXPECT_GT(farthest, last);
    last = farthest;
  }
}

TEST(Decimation, IsTheSameEachTimeAndAfterFewerTriangles) {
  const TriangleSurface fine = cube(12);
  Decimation one(fine), two(fine);
  const TriangleSurface direct = one.decimated(100);
  two.decimated(20);
  EXPECT_EQ(direct.triangles, two.decimated(100).triangles);
  EXPECT_EQ(direct.vertices, Decimation(fine).decimated(100).vertices);
}

TEST(Decimation, UndoesCollapsesUntilNoneIsLeft) {
  const TriangleSurface fine = with_second(cube(8), 3000);
  Decimation decimation(fine);
  std::size_t left = 0;
  TriangleSurface coarse = decimation.decimated(24);
  EXPECT_EQ(coarse.triangles.size(), 24U);
  for (int round = 0; round < 100; ++round) {
    // All triangles of the first cube are called bad.
    std::vector<std::size_t> bad;
    for (std::size_t t = 0; t < coarse.triangles.size(); ++t)
      if (coarse.vertices[coarse.triangles[t][0]][0] <= 1000) bad.push_back(t);
    left = bad.size();
    if (!decimation.undo(bad, std::size_t{1} << std::min(round, 30))) break;
    coarse = decimation.decimated(24);
    EXPECT_TRUE(check_triangle_surface(coarse));
  }
  EXPECT_EQ(left, fine.triangles.size() / 2);
}

TEST(Decimation, StopsEarly) {
  const TriangleSurface fine = cube(8);
  const std::atomic<bool> stop = true;
  EXPECT_EQ(Decimation(fine, &stop).decimated(12).triangles.size(), fine.triangles.size());
}

}  // namespace
}  // namespace trocar::pipeline
