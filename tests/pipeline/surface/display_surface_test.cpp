// SPDX-License-Identifier: GPL-3.0-or-later
// Surfaces for display against shapes whose surface is known: balls, labels.
#include "pipeline/surface/display_surface.h"
#include "pipeline/surface/cgal_verification.h"
#include "pipeline/surface/isosurface.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;

// A stack in memory; its slices may be tilted (their origins move by `shear_mm` a slice) and
// unevenly spaced.
class Synthetic : public MemoryStack {
 public:
  Synthetic(std::array<int, 3> size, const Vector3d& spacing_mm, double shear_mm,
            const std::function<double(const Vector3d&)>& hu) {
    for (int k = 0; k < size[2]; ++k) {
      SlicePlane plane{spacing_mm.x(), spacing_mm.y(), Eigen::Affine3d::Identity(), 0};
      plane.z_mm = (k + 0.2 * (k % 2)) * spacing_mm.z();
      plane.T_lps_plane.linear() =
          Eigen::AngleAxisd(0.4, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
      plane.T_lps_plane.translation() =
          Vector3d(-80, 30, 500) +
          plane.T_lps_plane.linear() * Vector3d(0, shear_mm * k, plane.z_mm);
      planes.push_back(plane);
      images.push_back(image_of(size[0], size[1], [&](int x, int y) {
        return hu(plane.T_lps_plane * Vector3d(x * spacing_mm.x(), y * spacing_mm.y(), 0));
      }));
    }
  }
};

// HU 1000 a mm below the surfaces of balls, about 226 at them.
std::function<double(const Vector3d&)> balls(const std::vector<std::pair<Vector3d, double>>& all) {
  return [all](const Vector3d& p) {
    double least = 1e3;
    for (const auto& [centre, radius] : all)
      least = std::min(least, (p - centre).norm() - radius);
    return 226 - std::clamp(least, -5.0, 5.0) * 100;
  };
}

Vector3d place(const TriangleSurface& s, std::uint32_t v) {
  const SpacePoint& p = s.vertices[v];
  return {s.lattice.to_mm(p[0]), s.lattice.to_mm(p[1]), s.lattice.to_mm(p[2])};
}

// Corners and middles of all triangles.
std::vector<Vector3d> samples(const TriangleSurface& s) {
  std::vector<Vector3d> out;
  for (const auto& t : s.triangles) {
    out.emplace_back(place(s, t[0]));
    out.emplace_back((place(s, t[0]) + place(s, t[1]) + place(s, t[2])) / 3);
    out.emplace_back((place(s, t[0]) + place(s, t[1])) / 2);
  }
  return out;
}

double percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

void expect_proved(const TriangleSurface& surface) {
  const auto ok = check_triangle_surface(surface);
  EXPECT_TRUE(ok) << ok.error().message;
  const auto bad = self_intersecting_triangles(surface);
  EXPECT_TRUE(bad && bad->empty());
}

Result<DisplaySurface> surface_of(const SliceStack& stack, const MaterialOptions& options,
                                  int triangles) {
  const auto volume = read_surface_volume(stack, 0, stack.size() - 1, options);
  if (!volume) return volume.error();
  return make_display_surface(*volume, {triangles});
}

// Closed and free of self-intersections.
DisplaySurface proved_surface(const SliceStack& stack, const MaterialOptions& options,
                              int triangles) {
  auto made = surface_of(stack, options, triangles);
  if (!made) throw std::runtime_error(made.error().message);
  expect_proved(made->surface);
  return std::move(*made);
}

TEST(DisplaySurface, OfATiltedStackIsWhereTheBallsAre) {
  // 24 balls apart, of 2.2 to 4.5 voxels' radius.
  std::vector<std::pair<Vector3d, double>> all;
  const Synthetic frame({1, 1, 60}, {0.8, 0.8, 0.9}, 0.2, [](const Vector3d&) { return 0.0; });
  for (int i = 0; i < 24; ++i) {
    const SlicePlane& plane = frame.plane(10 + 14 * (i % 4));
    const int column = i / 4 % 3, row = i / 12;
    all.emplace_back(plane.T_lps_plane * Vector3d(9 + 11 * column, 9 + 13 * row, 0),
                     1.8 + 0.08 * i);
  }
  const Synthetic stack({50, 48, 60}, {0.8, 0.8, 0.9}, 0.2, balls(all));
  const DisplaySurface made = proved_surface(stack, {}, 20'000);
  EXPECT_EQ(made.parts, all.size());
  EXPECT_LE(made.surface.triangles.size(), 20'000U);
  std::vector<double> off;
  for (const Vector3d& p : samples(made.surface)) {
    double least = 1e3;
    for (const auto& [centre, radius] : all)
      least = std::min(least, std::abs((p - centre).norm() - radius));
    off.push_back(least);
  }
  EXPECT_LT(percentile(off, 0.99), made.bound_mm);
  EXPECT_LT(percentile(off, 1), 0.9);
  EXPECT_LT(made.distance.p99_mm, made.bound_mm);
  double expected = 0;
  for (const auto& [centre, radius] : all)
    expected += 4.0 / 3 * 3.14159265358979 * std::pow(radius, 3);
  const double volume = enclosed_volume(made.surface) * std::pow(made.surface.lattice.step_mm(), 3);
  EXPECT_NEAR(volume / expected, 1, 0.07);  // corners on the balls, triangles within them
}

TEST(DisplaySurface, IsClosedWhereTheScanEnds) {
  const Synthetic stack({30, 30, 20}, {1, 1, 1}, 0, [](const Vector3d&) { return 500.0; });
  const DisplaySurface made = proved_surface(stack, {}, 5000);
  EXPECT_EQ(made.parts, 1U);
}

TEST(DisplaySurface, HasThinWalls) {
  // A shell of 0.8 voxels, and one voxel between two halves of a ball.
  const Synthetic frame({1, 1, 60}, {1, 1, 1}, 0, [](const Vector3d&) { return 0.0; });
  const Eigen::Affine3d back = frame.plane(0).T_lps_plane.inverse();
  const auto hu = [&](const Vector3d& p) {
    const Vector3d q = back * p;
    const double shell = std::abs((q - Vector3d(20, 20, 24)).norm() - 15) - 0.4,
                 ball = std::max((q - Vector3d(20, 20, 24)).norm() - 9, 0.5 - std::abs(q.x() - 20));
    return 226 - std::clamp(std::min(shell, ball), -2.0, 2.0) * 200;
  };
  const Synthetic stack({41, 41, 44}, {1, 1, 1}, 0, hu);
  const DisplaySurface made = proved_surface(stack, {}, 50'000);
  EXPECT_LT(made.distance.p99_mm, made.bound_mm);
  EXPECT_LT(made.left_out.p99_mm, made.bound_mm);
}

TEST(DisplaySurface, HasMoreTrianglesWhereItsBoundNeedsThem) {
  const Synthetic frame({1, 1, 1}, {1, 1, 1}, 0, [](const Vector3d&) { return 0.0; });
  const Synthetic stack({34, 34, 28}, {1, 1, 1}, 0,
                        balls({{frame.plane(0).T_lps_plane * Vector3d(16, 16, 15), 12}}));
  const auto volume = test::take(read_surface_volume(stack, 0, stack.size() - 1, {}));
  const auto few = make_display_surface(volume, {40, true}),
             enough = make_display_surface(volume, {40, false});
  ASSERT_TRUE(few && enough);
  EXPECT_LE(few->surface.triangles.size(), 40U);
  EXPECT_FALSE(few->is_within_bound());
  EXPECT_GT(enough->surface.triangles.size(), 40U);
  EXPECT_LT(enough->surface.triangles.size(), enough->mesher_triangles);
  EXPECT_TRUE(enough->is_within_bound());
}

// Also if the scan ends within the block of voxels that are averaged.
TEST(DisplaySurface, OfAveragedVoxelsIsClosedWhereTheScanEnds) {
  for (const int factor : {4, 8}) {
    for (int n = 2 * factor + 1; n <= 3 * factor; ++n) {
      const Synthetic stack({n, n, 12}, {1, 1, 1}, 0, [](const Vector3d&) { return 1000.0; });
      const auto volume = test::take(read_surface_volume(stack, 0, stack.size() - 1, {}));
      const auto surface = test::take(isosurface(coarser(volume, {factor, factor, 1})));
      const Eigen::Affine3d back = stack.plane(0).T_lps_plane.inverse();
      Vector3d low = Vector3d::Constant(1e3), high = -low;
      for (const Vector3d& p : samples(surface)) {
        low = low.cwiseMin(back * p);
        high = high.cwiseMax(back * p);
      }
      for (const int axis : {0, 1}) {
        EXPECT_NEAR(low[axis], -0.5, 0.05) << n << " voxels, " << factor << " averaged";
        EXPECT_NEAR(high[axis], n - 0.5, 0.1 * factor) << n << " voxels, " << factor << " averaged";
      }
    }
  }
}

// Blocks in which the material does not reach the scan's end are plain means.
TEST(DisplaySurface, AveragedVoxelsAreMeans) {
  const Synthetic stack({11, 10, 12}, {1, 1, 1}, 0, [i = 0](const Vector3d&) mutable {
    const int x = i % 11, y = i / 11 % 10;
    ++i;
    return x < 10 && y < 9 ? 1000.0 + 8 * x + 16 * y : 200.0 - x - y;
  });
  const auto volume = test::take(read_surface_volume(stack, 0, stack.size() - 1, {}));
  ASSERT_EQ(volume.size, (std::array<int, 3>{13, 12, 14}));
  const SurfaceVolume means = coarser(volume, {4, 4, 1});
  ASSERT_EQ(means.size, (std::array<int, 3>{5, 5, 14}));
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 3; ++x) {
      double sum = 0, count = 0;
      for (int b = 4 * y; b < std::min(4 * y + 4, 10); ++b)
        for (int a = 4 * x; a < std::min(4 * x + 4, 11); ++a)
          sum += static_cast<double>(volume.value(a + 1, b + 1, 5)), count += 1;
      EXPECT_EQ(means.value(x + 1, y + 1, 5), static_cast<float>(sum / count)) << x << ", " << y;
    }
    EXPECT_EQ(means.value(4, y + 1, 5), -std::abs(means.value(3, y + 1, 5))) << y;
    EXPECT_EQ(means.value(y + 1, 4, 5), -std::abs(means.value(y + 1, 3, 5))) << y;
  }
}

TEST(DisplaySurface, SaysWhatIsTooSmall) {
  const Synthetic stack({20, 20, 20}, {1, 1, 2}, 0, [i = 0](const Vector3d&) mutable {
    const int x = i % 20, y = i / 20 % 20, z = i / 400;
    ++i;
    const bool ball = std::hypot(x - 10, y - 10, z - 10) < 6;
    const bool hole = x == 10 && y == 10 && (z == 10 || z == 11);
    const bool speck = x == 1 && y >= 1 && y <= 3 && z == 1;
    return (ball && !hole) || speck ? 500.0 : 0.0;
  });
  const auto volume = test::take(read_surface_volume(stack, 0, 19, {}));
  EXPECT_EQ(volume.dropped.specks, 1U);
  EXPECT_EQ(volume.dropped.holes, 1U);
  EXPECT_NEAR(volume.dropped.largest_mm3, 6, 0.4);  // slices are unevenly spaced
  const auto none = test::take(read_surface_volume(stack, 0, 3, {}));
  EXPECT_TRUE(none.empty());
  EXPECT_EQ(none.dropped.specks, 1U);
}

TEST(DisplaySurface, OfNoiseIsProvedToo) {
  std::uint64_t state = 7;
  const Synthetic stack({16, 16, 12}, {1, 1, 1.5}, 0.1, [&state](const Vector3d&) {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state >> 54) - 200;
  });
  const DisplaySurface made = proved_surface(stack, {}, 4000);
}

TEST(DisplaySurface, OfLabelsStaysWithinHalfAVoxel) {
  // A ball and a plate two voxels thick.
  const auto inside = [](const Vector3d& q) {
    return (q - Vector3d(14, 14, 14)).norm() < 9 || (q.x() >= 28 && q.x() < 30);
  };
  const Synthetic frame({1, 1, 1}, {1, 1, 1}, 0, [](const Vector3d&) { return 0.0; });
  const Eigen::Affine3d back = frame.plane(0).T_lps_plane.inverse();
  const Synthetic stack({40, 30, 30}, {1, 1, 1}, 0,
                        [&](const Vector3d& p) { return inside(back * p) ? 5.0 : 0.0; });
  MaterialOptions options;
  options.segmentation = Labels{{5}};
  const DisplaySurface made = proved_surface(stack, options, 20'000);
  EXPECT_EQ(made.parts, 2U);
  std::vector<double> ball;
  for (const Vector3d& p : samples(made.surface)) {
    const Vector3d q = back * p;
    if (q.x() < 25) ball.push_back(std::abs((q - Vector3d(14, 14, 14)).norm() - 9));
  }
  EXPECT_LT(percentile(ball, 0.99), 0.75);  // half a voxel and half a voxel of the mask's steps
}

// CGAL leaves such a triangle out, so that nothing would be proved of it.
TEST(SurfaceProof, RefusesTrianglesThatAreNoManifold) {
  TriangleSurface s;
  s.vertices = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}, {0, -10, 0}};
  s.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  ASSERT_TRUE(self_intersecting_triangles(s));
  s.triangles.insert(s.triangles.begin() + 2, {0, 1, 4});  // a third one at the edge from 0 to 1
  const auto refused = self_intersecting_triangles(s);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kRefused);
  EXPECT_EQ(refused.error().message,
            "triangle 2 does not fit together with those before it as a manifold");
}

// Nothing to measure is not the same as a distance of 0.
TEST(SurfaceDistance, OfNothingIsInfinite) {
  const Synthetic stack({20, 20, 20}, {1, 1, 1}, 0, balls({{Vector3d(-80, 30, 500), 5}}));
  const auto volume = test::take(read_surface_volume(stack, 0, stack.size() - 1, {}));
  const TriangleSurface none{};
  for (const SurfaceDistance& distance :
       {SurfaceDistance{}, distance_from(none, volume), distance_to(none, volume, {}),
        distance_to(none, volume, {Vector3d::Zero()})}) {
    EXPECT_TRUE(std::isinf(distance.p50_mm));
    EXPECT_TRUE(std::isinf(distance.p99_mm));
    EXPECT_TRUE(std::isinf(distance.max_mm));
  }
  EXPECT_FALSE(DisplaySurface{}.is_within_bound());
}

TEST(TriangleSurface, NamesWhatIsWrong) {
  TriangleSurface s;
  s.vertices = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}};
  s.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  ASSERT_TRUE(check_triangle_surface(s));
  EXPECT_NEAR(enclosed_volume(s), 1000.0 / 6, 1e-9);
  EXPECT_NEAR(vertex_normals(s)[1].norm(), 1, 1e-6);
  const std::pair<void (*)(TriangleSurface&), const char*> damages[] = {
      {[](TriangleSurface& b) { b.triangles.pop_back(); }, "not closed"},
      {[](TriangleSurface& b) { std::swap(b.triangles[0][0], b.triangles[0][1]); },
       "same direction"},
      {[](TriangleSurface& b) {
         for (auto& t : b.triangles)
           std::swap(t[0], t[1]);
       },
       "inside out"},
      {[](TriangleSurface& b) {
         b.vertices.emplace_back(SpacePoint{5, 5, 5});
       },
       "no triangle"},
      {[](TriangleSurface& b) { b.triangles[0][0] = 9; }, "no such vertex"},
      {[](TriangleSurface& b) {
         b.vertices[0] = SpacePoint{5, 5, 0};
       },
       "no area"},
      {[](TriangleSurface& b) { b.vertices[0][0] = 1 << 25; }, "range"},
      {[](TriangleSurface& b) {  // two that meet in a vertex
         b.vertices.insert(b.vertices.end(), {{-10, 0, 0}, {0, -10, 0}, {0, 0, -10}});
         for (const auto& t : std::vector(b.triangles)) {
           const auto other = [](std::uint32_t v) { return v == 0 ? 0 : v + 3; };
           b.triangles.push_back({other(t[0]), other(t[2]), other(t[1])});
         }
       },
       "fan"},
      {[](TriangleSurface& b) { b.triangles.clear(); }, "no triangles"}};
  for (const auto& [damage, reason] : damages) {
    TriangleSurface bad = s;
    damage(bad);
    const auto ok = check_triangle_surface(bad);
    ASSERT_FALSE(ok) << reason;
    EXPECT_NE(ok.error().message.find(reason), std::string::npos) << ok.error().message;
  }
}

}  // namespace
}  // namespace trocar::pipeline
