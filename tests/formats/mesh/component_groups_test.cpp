// SPDX-License-Identifier: GPL-3.0-or-later
// Groups of connected components, compared with a walk from triangle to triangle.
#include "formats/mesh/regions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace trocar::pipeline {
namespace {

// Strips of triangles, of these lengths, as vertices and triangles in any order.
SliceMesh strips(const std::vector<std::uint32_t>& lengths, unsigned seed) {
  SliceMesh mesh;
  for (const std::uint32_t length : lengths) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const auto strip = static_cast<std::int32_t>(mesh.triangles.size());
    for (std::uint32_t i = 0; i < length + 2; ++i)
      mesh.vertices.push_back({strip, static_cast<std::int32_t>(i)});
    for (std::uint32_t i = 0; i < length; ++i)
      mesh.triangles.push_back({first + i, first + i + 1, first + i + 2});
  }
  std::mt19937 random(seed);
  std::vector<std::uint32_t> number(mesh.vertices.size());
  for (std::uint32_t v = 0; v < number.size(); ++v)
    number[v] = v;
  std::shuffle(number.begin(), number.end(), random);
  std::vector<LatticePoint> vertices(mesh.vertices.size());
  for (std::uint32_t v = 0; v < number.size(); ++v)
    vertices[number[v]] = mesh.vertices[v];
  mesh.vertices = std::move(vertices);
  for (Triangle& t : mesh.triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
  }
  std::shuffle(mesh.triangles.begin(), mesh.triangles.end(), random);
  return mesh;
}

// Finds the least vertex that is connected with each vertex.
std::vector<std::uint32_t> least_connected(const SliceMesh& mesh) {
  std::vector<std::vector<std::uint32_t>> beside(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      beside[t[i]].push_back(t[(i + 1) % 3]);
      beside[t[(i + 1) % 3]].push_back(t[i]);
    }
  }
  constexpr std::uint32_t kNot = 0xffffffff;
  std::vector<std::uint32_t> out(mesh.vertices.size(), kNot);
  for (std::uint32_t start = 0; start < out.size(); ++start) {
    if (out[start] != kNot) continue;
    std::vector<std::uint32_t> left{start};
    out[start] = start;
    while (!left.empty()) {
      const std::uint32_t v = left.back();
      left.pop_back();
      for (const std::uint32_t w : beside[v]) {
        if (out[w] != kNot) continue;
        out[w] = start;
        left.push_back(w);
      }
    }
  }
  return out;
}

void expect_groups_of_components(const SliceMesh& mesh, std::size_t groups_at_least) {
  const std::vector<std::uint32_t> expected = least_connected(mesh);
  ComponentGroups groups(mesh);
  EXPECT_GE(groups.count(), groups_at_least);
  std::vector<int> seen_vertex(mesh.vertices.size(), 0), seen_triangle(mesh.triangles.size(), 0);
  std::vector<std::size_t> group_of_component(mesh.vertices.size(), groups.count());
  std::size_t previous = 0;
  for (std::size_t g = 0; g < groups.count(); ++g) {
    const ComponentGroups::Group& group = groups.group(g);
    ASSERT_EQ(group.mesh.vertices.size(), group.vertices.size());
    ASSERT_EQ(group.mesh.triangles.size(), group.triangles.size());
    ASSERT_EQ(group.component.size(), group.vertices.size());
    EXPECT_TRUE(std::is_sorted(group.vertices.begin(), group.vertices.end()));
    EXPECT_TRUE(std::is_sorted(group.triangles.begin(), group.triangles.end()));
    std::vector<std::uint32_t> components;
    for (std::size_t i = 0; i < group.vertices.size(); ++i) {
      const std::uint32_t v = group.vertices[i], component = expected[v];
      EXPECT_EQ(++seen_vertex[v], 1);
      EXPECT_EQ(group.mesh.vertices[i], mesh.vertices[v]);
      EXPECT_EQ(group.vertices[group.component[i]], component);
      if (group_of_component[component] == groups.count()) group_of_component[component] = g;
      EXPECT_EQ(group_of_component[component], g);
      components.push_back(component);
    }
    for (std::size_t i = 0; i < group.triangles.size(); ++i) {
      EXPECT_EQ(++seen_triangle[group.triangles[i]], 1);
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(group.vertices[group.mesh.triangles[i][k]],
                  mesh.triangles[group.triangles[i]][k]);
      }
    }
    std::sort(components.begin(), components.end());
    const bool is_one_component = components.front() == components.back();
    EXPECT_TRUE(is_one_component || components.size() <= ComponentGroups::kMaxVertices);
    // The component that opened this group did not fit into the one before.
    const auto opened =
        std::count(components.begin(), components.end(), expected[group.vertices[0]]);
    if (g > 0) {
      EXPECT_GT(previous + static_cast<std::size_t>(opened),
                std::size_t{ComponentGroups::kMaxVertices});
    }
    previous = components.size();
  }
  EXPECT_EQ(std::count(seen_vertex.begin(), seen_vertex.end(), 1), std::ssize(seen_vertex));
  EXPECT_EQ(std::count(seen_triangle.begin(), seen_triangle.end(), 1), std::ssize(seen_triangle));
}

TEST(ComponentGroups, SmallMeshesAreOneGroup) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const SliceMesh mesh = strips({1, 5, 1, 30, 2, 2, 7}, seed);
    expect_groups_of_components(mesh, 1);
    EXPECT_EQ(ComponentGroups(mesh).count(), 1U);
  }
}

TEST(ComponentGroups, ManyPartsAndLargeOnes) {
  std::vector<std::uint32_t> lengths(30'000, 2);
  expect_groups_of_components(strips(lengths, 1), 4);
  lengths.push_back(2 * ComponentGroups::kMaxVertices);
  lengths.push_back(3 * ComponentGroups::kMaxVertices);
  expect_groups_of_components(strips(lengths, 2), 6);
}

// A vertex of no triangle is a component.
TEST(ComponentGroups, VerticesAlone) {
  SliceMesh mesh;
  mesh.vertices.assign(ComponentGroups::kMaxVertices + 1, {3, 4});
  expect_groups_of_components(mesh, 2);
}

}  // namespace
}  // namespace trocar::pipeline
