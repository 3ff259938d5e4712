// SPDX-License-Identifier: GPL-3.0-or-later
// Decimation of surfaces whose best decimation is known, and undoing it.
#include "pipeline/surface/cgal_verification.h"
#include "pipeline/surface/isosurface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

namespace trocar::pipeline {
namespace {

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
