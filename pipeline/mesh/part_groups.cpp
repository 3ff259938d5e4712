// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh/part_groups.h"

#include <numeric>
#include <utility>

#include "formats/base/disjoint_sets.h"

namespace trocar::pipeline {
namespace {

// By vertex: the least vertex of its connected part.
std::vector<std::uint32_t> parts_of(const SliceMesh& mesh) {
  DisjointSets parts(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    parts.join(t[0], t[1]);
    parts.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> out(parts.size());
  for (std::uint32_t v = 0; v < out.size(); ++v)
    out[v] = parts.root(v);
  return out;
}

}  // namespace

template <typename GroupOf>
PartGroups::List PartGroups::listed(std::size_t count, std::size_t groups,
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

PartGroups::PartGroups(const SliceMesh& mesh)
    : mesh_(mesh), part_(parts_of(mesh)), number_(mesh.vertices.size()) {
  // By the least vertex of the part.
  std::vector<std::uint32_t> size(part_.size(), 0), group(part_.size(), 0);
  for (const std::uint32_t part : part_)
    ++size[part];
  std::uint32_t filled = 0, last = 0;
  for (const std::uint32_t part : part_) {
    if (size[part] == 0) continue;
    if (filled != 0 && filled + size[part] > kVertices) ++last, filled = 0;
    group[part] = last;
    filled += std::exchange(size[part], 0);
  }
  const auto group_of = [&](std::uint32_t v) { return group[part_[v]]; };
  vertices_ = listed(part_.size(), last + 1, group_of);
  triangles_ = listed(mesh.triangles.size(), last + 1,
                      [&](std::uint32_t t) { return group_of(mesh.triangles[t][0]); });
}

const PartGroups::Group& PartGroups::group(std::size_t g) {
  group_.vertices = vertices_.of(g);
  group_.triangles = triangles_.of(g);
  group_.mesh.vertices.clear();
  group_.mesh.triangles.clear();
  group_.part.clear();
  for (const std::uint32_t v : group_.vertices) {
    number_[v] = static_cast<std::uint32_t>(group_.mesh.vertices.size());
    group_.mesh.vertices.push_back(mesh_.vertices[v]);
  }
  for (const std::uint32_t v : group_.vertices)
    group_.part.push_back(number_[part_[v]]);
  for (const std::uint32_t t : group_.triangles) {
    const Triangle& v = mesh_.triangles[t];
    group_.mesh.triangles.push_back({number_[v[0]], number_[v[1]], number_[v[2]]});
  }
  return group_;
}

}  // namespace trocar::pipeline
