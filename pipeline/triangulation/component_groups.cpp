// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/component_groups.h"

#include <numeric>
#include <utility>

#include "formats/base/disjoint_sets.h"

namespace trocar::pipeline {
namespace {

// Finds the least vertex of the connected component of each vertex.
std::vector<std::uint32_t> components_of(const SliceMesh& mesh) {
  DisjointSets components(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    components.join(t[0], t[1]);
    components.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> out(components.size());
  for (std::uint32_t v = 0; v < out.size(); ++v)
    out[v] = components.root(v);
  return out;
}

}  // namespace

template <typename GroupOf>
ComponentGroups::List ComponentGroups::listed(std::size_t count, std::size_t groups,
                                              const GroupOf& group_of) {
  List out;
  out.first.assign(groups + 1, 0);
  out.items.resize(count);
  for (std::uint32_t i = 0; i < count; ++i)
    ++out.first[group_of(i) + 1];
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  std::vector<std::uint32_t> end(out.first.begin(), out.first.end() - 1);
  for (std::uint32_t i = 0; i < count; ++i)
    out.items[end[group_of(i)]++] = i;
  return out;
}

ComponentGroups::ComponentGroups(const SliceMesh& mesh)
    : mesh_(mesh), component_(components_of(mesh)), number_(mesh.vertices.size()) {
  // Both are indexed by the least vertex of the component.
  std::vector<std::uint32_t> size(component_.size(), 0), group(component_.size(), 0);
  for (const std::uint32_t component : component_)
    ++size[component];
  std::uint32_t filled = 0, last = 0;
  for (const std::uint32_t component : component_) {
    if (size[component] == 0) continue;
    if (filled != 0 && filled + size[component] > kMaxVertices) ++last, filled = 0;
    group[component] = last;
    filled += std::exchange(size[component], 0);
  }
  const auto group_of = [&](std::uint32_t v) { return group[component_[v]]; };
  vertices_ = listed(component_.size(), last + 1, group_of);
  triangles_ = listed(mesh.triangles.size(), last + 1,
                      [&](std::uint32_t t) { return group_of(mesh.triangles[t][0]); });
}

const ComponentGroups::Group& ComponentGroups::group(std::size_t g) {
  group_.vertices = vertices_.of(g);
  group_.triangles = triangles_.of(g);
  group_.mesh.vertices.clear();
  group_.mesh.triangles.clear();
  group_.component.clear();
  for (const std::uint32_t v : group_.vertices) {
    number_[v] = static_cast<std::uint32_t>(group_.mesh.vertices.size());
    group_.mesh.vertices.push_back(mesh_.vertices[v]);
  }
  for (const std::uint32_t v : group_.vertices)
    group_.component.push_back(number_[component_[v]]);
  for (const std::uint32_t t : group_.triangles) {
    const Triangle& v = mesh_.triangles[t];
    group_.mesh.triangles.push_back({number_[v[0]], number_[v[1]], number_[v[2]]});
  }
  return group_;
}

}  // namespace trocar::pipeline
