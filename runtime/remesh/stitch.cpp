// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <numeric>

#include "runtime/remesh/patch.h"

namespace trocar::runtime {
namespace {

// A corner of a triangle of the sheet.
struct Corner {
  std::uint32_t triangle;
  std::uint32_t corner;
};

// Kept triangles that follow each other around a vertex of the cavity's rim.
struct Run {
  std::uint32_t vertex;
  std::vector<Corner> corners;
};

std::uint32_t corner_of(const Triangle& t, std::uint32_t v) {
  return t[0] == v ? 0 : t[1] == v ? 1 : 2;
}

// The run around v that the kept triangle belongs to.
Run run_around(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity,
               std::uint32_t v, std::uint32_t triangle) {
  Run run{v, {}};
  auto stays = [&cavity](std::uint32_t t) { return t != kNone && cavity.contains[t] == 0; };
  for (const std::uint32_t turn : {2U, 0U}) {  // counter-clockwise, then clockwise
    std::uint32_t t = triangle;
    do {
      const std::uint32_t i = corner_of(sheet.triangles[t], v);
      if (t != triangle || turn == 2) run.corners.push_back({t, i});
      t = neighbours[t][(i + turn) % 3];
    } while (stays(t) && t != triangle);
  }
  return run;
}

class Groups {
 public:
  explicit Groups(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i)
      i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    if (a != b) parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// Drops vertices without a triangle; the others keep their order.
void compact(SliceMesh& mesh) {
  std::vector<std::uint32_t> number(mesh.vertices.size(), kNone);
  for (const Triangle& t : mesh.triangles) {
    for (std::uint32_t v : t)
      number[v] = 0;
  }
  std::uint32_t used = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    mesh.vertices[used] = mesh.vertices[v];
    number[v] = used++;
  }
  mesh.vertices.resize(used);
  for (Triangle& t : mesh.triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
  }
}

}  // namespace

SliceMesh stitch(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity,
                 const Patch& patch) {
  // Runs of kept triangles around the vertices of shared edges.
  std::vector<Run> runs;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> run_of;  // (triangle, vertex)
  for (const RimEdge& e : cavity.rim) {
    if (e.kept == kNone) continue;
    for (const std::uint32_t v : {e.from, e.to}) {
      if (run_of.contains({e.kept, v})) continue;
      Run run = run_around(sheet, neighbours, cavity, v, e.kept);
      for (const Corner& c : run.corners) {
        run_of[{c.triangle, v}] = static_cast<std::uint32_t>(runs.size());
      }
      runs.push_back(std::move(run));
    }
  }

  // Corners that meet across a side are the same vertex: groups of runs (first)
  // and of the patch's corners.
  const auto n_runs = static_cast<std::uint32_t>(runs.size());
  const auto n_new = static_cast<std::uint32_t>(patch.triangles.size());
  Groups groups(n_runs + std::size_t{3} * n_new);
  auto node = [n_runs](std::uint32_t t, std::uint32_t i) { return n_runs + 3 * t + i; };
  for (std::uint32_t t = 0; t < n_new; ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t j = (i + 1) % 3;
      if (const std::uint32_t u = patch.across[t][i]; u != kNone) {
        const Triangle& beyond = patch.triangles[u];
        groups.join(node(t, i), node(u, corner_of(beyond, patch.triangles[t][i])));
        groups.join(node(t, j), node(u, corner_of(beyond, patch.triangles[t][j])));
      } else if (const std::uint32_t k = patch.kept[t][i]; k != kNone) {
        for (const std::uint32_t c : {i, j}) {
          const LatticePoint p = patch.points[patch.triangles[t][c]];
          for (const std::uint32_t v : sheet.triangles[k]) {
            if (sheet.vertices[v] == p) groups.join(node(t, c), run_of.at({k, v}));
          }
        }
      }
    }
  }

  // A vertex a group: the sheet's own if it is still free, else a new one.
  SliceMesh out;
  out.vertices = sheet.vertices;
  std::vector<std::uint32_t> vertex_of(n_runs + std::size_t{3} * n_new, kNone);
  std::map<std::uint32_t, bool> taken;
  auto add_vertex = [&out](LatticePoint p) {
    out.vertices.push_back(p);
    return static_cast<std::uint32_t>(out.vertices.size() - 1);
  };
  for (std::uint32_t r = 0; r < n_runs; ++r) {
    std::uint32_t& v = vertex_of[groups.find(r)];
    if (v != kNone) continue;
    bool& is_taken = taken[runs[r].vertex];
    v = is_taken ? add_vertex(sheet.vertices[runs[r].vertex]) : runs[r].vertex;
    is_taken = true;
  }
  for (std::uint32_t t = 0; t < n_new; ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      std::uint32_t& v = vertex_of[groups.find(node(t, i))];
      if (v == kNone) v = add_vertex(patch.points[patch.triangles[t][i]]);
    }
  }

  std::vector<std::uint32_t> place(sheet.triangles.size(), kNone);
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    if (cavity.contains[t] != 0) continue;
    place[t] = static_cast<std::uint32_t>(out.triangles.size());
    out.triangles.push_back(sheet.triangles[t]);
  }
  for (std::uint32_t r = 0; r < n_runs; ++r) {
    for (const Corner& c : runs[r].corners) {
      out.triangles[place[c.triangle]][c.corner] = vertex_of[groups.find(r)];
    }
  }
  for (std::uint32_t t = 0; t < n_new; ++t) {
    out.triangles.push_back({vertex_of[groups.find(node(t, 0))], vertex_of[groups.find(node(t, 1))],
                             vertex_of[groups.find(node(t, 2))]});
  }
  compact(out);
  return out;
}

}  // namespace trocar::runtime
