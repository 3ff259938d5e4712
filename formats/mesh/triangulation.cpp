// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/triangulation.h"

#include <numeric>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/edge_table.h"

namespace trocar {

Neighbours neighbours(const SliceMesh& mesh) {
  Neighbours out(mesh.triangles.size(), {kNoEdge, kNoEdge, kNoEdge});
  edge_table(mesh).for_each_pair([&out](std::uint32_t, std::uint32_t, const auto& edges) {
    if (edges.size() != 2) return true;
    const std::uint32_t a = edges[0].edge, b = edges[1].edge;
    out[a / 3][a % 3] = edge_id(b / 3, b % 3);
    out[b / 3][b % 3] = edge_id(a / 3, a % 3);
    return true;
  });
  return out;
}

// A plane sweep triangulates the material (Hertel and Mehlhorn, 1983), then flips make it
// constrained Delaunay (Lawson, 1977). The outside is not triangulated, no constraints have to be
// recovered, and both steps decide in exact integers only.
namespace {

constexpr std::uint32_t kNone = kNoEdge;
// An edge on a diagonal whose triangles have not been made yet is this flag and the diagonal's
// number, in place of an EdgeId.
constexpr std::uint32_t kDiagonal = 0x80000000;

// Sweeps over the points in lexicographic order (left to right, and upwards on a vertical). The
// status lists the outline's edges that the sweep line cuts, from the lowest up. For each edge that
// has material above it, the status keeps a chain: the right border of the part of that material
// that can be triangulated without points to the right. The chain runs from the left end of the
// edge below to that of the edge above and is convex to the right. From a new point to the right of
// it, exactly the part of the chain that faces the point is visible, and nothing else has to be
// checked.
class Sweep {
 public:
  // The sweep and its result are in the rotated plane.
  Sweep(const Pslg& pslg, CanonicalRotation rotate) : pslg_(pslg), rotate_(rotate) {}

  Result<Triangulation> run() {
    sort_points();
    sort_edges();
    const auto n = static_cast<std::uint32_t>(points_.size());
    mesh_.triangles.reserve(n + n / 4);
    beyond_.reserve(n + n / 4);
    nodes_.reserve(2 * n);
    for (std::uint32_t p = 0; p < n; ++p) {
      if (!add(p)) return bug("triangulation: the outline crosses itself");
    }
    if (!status_.empty()) return bug("triangulation: the outline does not close");
    mesh_.vertices = std::move(points_);
    return Triangulation{std::move(mesh_), std::move(beyond_)};
  }

  // After run(): do rings touch?
  bool has_pinches() const { return has_pinches_; }

 private:
  // An edge of the outline from its left end to its right end.
  struct Edge {
    std::uint32_t left, right;
    bool material_above;
  };
  // A point on a chain, and the triangle's edge that joins it to the next one, or kNone if that
  // edge is on the outline.
  struct Node {
    std::uint32_t point;
    EdgeId edge = kNone;
    std::uint32_t previous = kNone, next = kNone;
  };
  struct Active {
    std::uint32_t left = 0, right = 0;
    LatticePoint a, b;
    std::uint32_t front = kNone, back = kNone;  // ends of the chain above the edge
    bool material_above = false;
  };

  void sort_points() {
    std::size_t total = 0;
    for (const Ring& ring : pslg_.rings)
      total += ring.size();
    struct Item {
      std::uint64_t key;
      std::uint32_t corner;
    };
    const auto key = [](LatticePoint p) {
      return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(p.x) ^ 0x80000000U) << 32) |
             (static_cast<std::uint32_t>(p.y) ^ 0x80000000U);
    };
    std::vector<Item> items;
    items.reserve(total);
    std::uint32_t corner = 0;
    for (const Ring& ring : pslg_.rings) {
      for (const LatticePoint p : ring)
        items.push_back({key(rotate_(p)), corner++});
    }
    std::sort(items.begin(), items.end(),
              [](const Item& a, const Item& b) { return a.key < b.key; });
    vertex_of_corner_.resize(total);
    points_.reserve(total);
    for (std::size_t i = 0; i < total; ++i) {
      if (i == 0 || items[i].key != items[i - 1].key) {
        points_.push_back(
            {static_cast<std::int32_t>(static_cast<std::uint32_t>(items[i].key >> 32) ^
                                       0x80000000U),
             static_cast<std::int32_t>(static_cast<std::uint32_t>(items[i].key) ^ 0x80000000U)});
      }
      vertex_of_corner_[items[i].corner] = static_cast<std::uint32_t>(points_.size() - 1);
    }
    has_pinches_ = points_.size() != total;
  }

  // Groups the edges by their left ends and sorts those of one point from the lowest up.
  void sort_edges() {
    first_edge_.assign(points_.size() + 1, 0);
    const std::size_t total = vertex_of_corner_.size();
    std::vector<Edge> unsorted;
    unsorted.reserve(total);
    std::size_t start = 0;
    for (const Ring& ring : pslg_.rings) {
      std::uint32_t a = vertex_of_corner_[start + ring.size() - 1];
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const std::uint32_t b = vertex_of_corner_[start + i];
        unsorted.push_back(a < b ? Edge{a, b, true} : Edge{b, a, false});
        ++first_edge_[std::min(a, b) + 1];
        a = b;
      }
      start += ring.size();
    }
    std::partial_sum(first_edge_.begin(), first_edge_.end(), first_edge_.begin());
    edges_.resize(total);
    std::vector<std::uint32_t> at(first_edge_.begin(), first_edge_.end() - 1);
    for (const Edge& e : unsorted)
      edges_[at[e.left]++] = e;
    for (std::uint32_t v = 0; v < points_.size(); ++v) {
      if (first_edge_[v + 1] - first_edge_[v] < 2) continue;
      std::sort(edges_.begin() + first_edge_[v], edges_.begin() + first_edge_[v + 1],
                [&](const Edge& e, const Edge& f) {
                  return orient2d(points_[v], points_[e.right], points_[f.right]) > 0;
                });
    }
  }

  std::uint32_t add_node(std::uint32_t point) {
    nodes_.push_back({point});
    return static_cast<std::uint32_t>(nodes_.size() - 1);
  }
  void join(std::uint32_t node, std::uint32_t next, EdgeId edge) {
    nodes_[node].next = next;
    nodes_[node].edge = edge;
    nodes_[next].previous = node;
  }

  // Adds the triangle (p, b, a) of the point p, the chain's node a and the next one b. Its edges
  // are pb, ba, ap; `edge_ap` and `edge_pb` are the edges beyond them, where known.
  std::uint32_t emit(std::uint32_t a, std::uint32_t p, std::uint32_t b, EdgeId edge_ap,
                     EdgeId edge_pb) {
    const auto t = static_cast<std::uint32_t>(mesh_.triangles.size());
    mesh_.triangles.push_back({p, nodes_[b].point, nodes_[a].point});
    beyond_.push_back({kNone, kNone, kNone});
    link(edge_id(t, 1), nodes_[a].edge);
    link(edge_id(t, 2), edge_ap);
    link(edge_id(t, 0), edge_pb);
    return t;
  }
  void link(EdgeId edge, EdgeId beyond) {
    if (beyond == kNone) return;
    if ((beyond & kDiagonal) != 0) {
      const EdgeId other = std::exchange(diagonals_[beyond ^ kDiagonal], edge);
      if (other == kNone) return;
      beyond = other;
    }
    beyond_[triangle_of(edge)][index_of(edge)] = beyond;
    beyond_[triangle_of(beyond)][index_of(beyond)] = edge;
  }
  bool sees(std::uint32_t a, std::uint32_t b, std::uint32_t p) const {
    return orient2d(points_[nodes_[a].point], points_[p], points_[nodes_[b].point]) > 0;
  }

  // Joins p to the chain's upper end: makes the triangles with the edges visible from p, starting
  // at that end, and p becomes the upper end.
  void close_back(std::uint32_t& front, std::uint32_t& back, std::uint32_t p, EdgeId edge = kNone) {
    while (back != front && sees(nodes_[back].previous, back, p)) {
      const std::uint32_t a = nodes_[back].previous;
      edge = edge_id(emit(a, p, back, kNone, edge), 2);
      back = a;
    }
    const std::uint32_t node = add_node(p);
    join(back, node, edge);
    back = node;
  }
  // The same for the lower end.
  void close_front(std::uint32_t& front, std::uint32_t& back, std::uint32_t p,
                   EdgeId edge = kNone) {
    while (front != back && sees(front, nodes_[front].next, p)) {
      const std::uint32_t b = nodes_[front].next;
      edge = edge_id(emit(front, p, b, edge, kNone), 0);
      front = b;
    }
    const std::uint32_t node = add_node(p);
    join(node, front, edge);
    front = node;
  }
  // Joins p to both ends: this material ends at p.
  bool close(std::uint32_t front, std::uint32_t back, std::uint32_t p) {
    EdgeId edge = kNone;
    for (; front != back; front = nodes_[front].next) {
      if (!sees(front, nodes_[front].next, p)) return false;
      edge = edge_id(emit(front, p, nodes_[front].next, edge, kNone), 0);
    }
    return true;
  }

  bool add(std::uint32_t p) {
    const LatticePoint at = points_[p];
    // The edges that end in p are neighbours in the status.
    std::size_t low = 0, count = status_.size();
    while (count > 0) {
      const std::size_t half = count / 2;
      // Without a branch, because it would be unpredictable.
      const auto above = static_cast<std::size_t>(
          static_cast<std::uint64_t>(-orient2d(status_[low + half].a, status_[low + half].b, at)) >>
          63);
      low += above * (half + 1);
      count = above * (count - half - 1) + (1 - above) * half;
    }
    std::size_t high = low;
    while (high < status_.size() && status_[high].right == p)
      ++high;

    std::uint32_t lower_front = kNone, lower_back = kNone, upper_front = kNone, upper_back = kNone;
    const bool below = low > 0 && status_[low - 1].material_above;
    const bool above = high > low ? status_[high - 1].material_above : below;
    if (below) lower_front = status_[low - 1].front, lower_back = status_[low - 1].back;
    if (high > low) {
      if (below) close_back(lower_front, lower_back, p);
      for (std::size_t i = low; i + 1 < high; ++i) {
        if (status_[i].material_above && !close(status_[i].front, status_[i].back, p)) return false;
      }
      if (above) {
        upper_front = status_[high - 1].front, upper_back = status_[high - 1].back;
        close_front(upper_front, upper_back, p);
      }
    } else if (below) {
      // A hole begins. The rightmost point of the chain sees p, since nothing lies between them.
      std::uint32_t last = lower_front;
      for (std::uint32_t k = lower_front;; k = nodes_[k].next) {
        if (nodes_[k].point > nodes_[last].point) last = k;
        if (k == lower_back) break;
      }
      upper_front = add_node(nodes_[last].point);
      if (last == lower_back) {
        upper_back = upper_front;
      } else {
        join(upper_front, nodes_[last].next, nodes_[last].edge);
        upper_back = lower_back;
        lower_back = last;
      }
      // Both halves are joined to p by the diagonal from that point.
      const std::uint32_t diagonal = kDiagonal | static_cast<std::uint32_t>(diagonals_.size());
      diagonals_.push_back(kNone);
      close_back(lower_front, lower_back, p, diagonal);
      close_front(upper_front, upper_back, p, diagonal);
    }

    // The edges that start in p replace those that end there.
    const std::uint32_t first = first_edge_[p], last_edge = first_edge_[p + 1];
    if (first == last_edge) {
      if (below != above) return false;
      if (below) {
        // Both halves end in p: one chain.
        if (high == low) return false;
        if (upper_front != upper_back) {
          join(lower_back, nodes_[upper_front].next, nodes_[upper_front].edge);
          lower_back = upper_back;
        }
      }
      status_.erase(status_.begin() + static_cast<std::ptrdiff_t>(low),
                    status_.begin() + static_cast<std::ptrdiff_t>(high));
      if (below) status_[low - 1].front = lower_front, status_[low - 1].back = lower_back;
      return true;
    }
    const std::size_t more = last_edge - first, less = high - low;
    if (more > less) {
      status_.insert(status_.begin() + static_cast<std::ptrdiff_t>(high), more - less, Active{});
    } else if (less > more) {
      status_.erase(status_.begin() + static_cast<std::ptrdiff_t>(low + more),
                    status_.begin() + static_cast<std::ptrdiff_t>(high));
    }
    if (below) status_[low - 1].front = lower_front, status_[low - 1].back = lower_back;
    bool material = below;
    for (std::size_t i = 0; i < more; ++i) {
      const Edge& e = edges_[first + i];
      if (e.material_above == material)
        return false;  // two edges on each other, or a ring the wrong way round
      material = e.material_above;
      Active& active = status_[low + i];
      active = {e.left, e.right, at, points_[e.right], kNone, kNone, material};
      if (!material) continue;
      if (i + 1 < more)
        active.front = active.back = add_node(p);
      else
        active.front = upper_front, active.back = upper_back;
    }
    return material == above;
  }

  const Pslg& pslg_;
  CanonicalRotation rotate_;
  std::vector<LatticePoint> points_;
  std::vector<std::uint32_t> vertex_of_corner_, first_edge_;
  std::vector<Edge> edges_;
  std::vector<Node> nodes_;
  std::vector<Active> status_;
  std::vector<EdgeId> diagonals_;  // the first triangle's edge on each diagonal, or kNone
  SliceMesh mesh_;
  Neighbours beyond_;
  bool has_pinches_ = false;
};

// Flips edges until every one that is not on the outline is locally Delaunay.
void flip_to_delaunay(Triangulation& out) {
  std::vector<Triangle>& triangles = out.mesh.triangles;
  Neighbours& beyond = out.beyond;
  std::vector<EdgeId> stack;
  stack.reserve(triangles.size() * 3);
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (beyond[t][i] != kNone && beyond[t][i] > edge_id(t, i)) stack.push_back(edge_id(t, i));
    }
  }
  const auto connect = [&](EdgeId edge, EdgeId other) {
    beyond[triangle_of(edge)][index_of(edge)] = other;
    if (other != kNone) beyond[triangle_of(other)][index_of(other)] = edge;
  };
  while (!stack.empty()) {
    const std::uint32_t t = triangle_of(stack.back()), i = index_of(stack.back());
    stack.pop_back();
    if (beyond[t][i] == kNone) continue;  // a flip has moved an edge of the outline here
    const std::uint32_t u = triangle_of(beyond[t][i]), j = index_of(beyond[t][i]);
    const std::uint32_t b = triangles[t][i], c = triangles[t][next_corner(i)],
                        a = triangles[t][previous_corner(i)], d = triangles[u][previous_corner(j)];
    if (is_locally_delaunay(out.mesh.vertices[a], out.mesh.vertices[b], out.mesh.vertices[c],
                            out.mesh.vertices[d]))
      continue;
    // Triangles bca and cbd become bda and dca.
    const EdgeId beyond_ca = beyond[t][next_corner(i)], beyond_ab = beyond[t][previous_corner(i)];
    const EdgeId beyond_bd = beyond[u][next_corner(j)], beyond_dc = beyond[u][previous_corner(j)];
    triangles[t] = {b, d, a};
    triangles[u] = {d, c, a};
    connect(edge_id(t, 0), beyond_bd);
    connect(edge_id(t, 1), edge_id(u, 2));
    connect(edge_id(t, 2), beyond_ab);
    connect(edge_id(u, 0), beyond_dc);
    connect(edge_id(u, 1), beyond_ca);
    for (const EdgeId edge : {edge_id(t, 0), edge_id(t, 2), edge_id(u, 0), edge_id(u, 1)}) {
      if (beyond[triangle_of(edge)][index_of(edge)] != kNone) stack.push_back(edge);
    }
  }
}

// Gives each fan of triangles around a point its own vertex, and drops unused vertices.
void split_pinches(Triangulation& out) {
  // Corners of triangles around one vertex are joined across shared edges; each group is a fan.
  struct Corner {
    std::uint32_t triangle, corner;
  };
  const SliceMesh mesh = std::move(out.mesh);
  out.mesh = {};
  std::vector<Triangle> numbered(mesh.triangles.size(), {kNone, kNone, kNone});
  std::vector<Corner> stack;
  for (std::uint32_t first = 0; first < mesh.triangles.size(); ++first) {
    for (const std::uint32_t corner : {2U, 0U, 1U}) {
      if (numbered[first][corner] != kNone) continue;
      const std::uint32_t v = mesh.triangles[first][corner];
      const auto vertex = static_cast<std::uint32_t>(out.mesh.vertices.size());
      out.mesh.vertices.push_back(mesh.vertices[v]);
      numbered[first][corner] = vertex;
      stack.push_back({first, corner});
      while (!stack.empty()) {
        const auto [t, k] = stack.back();
        stack.pop_back();
        // The two edges that meet in the corner.
        for (const std::uint32_t edge : {previous_corner(k), k}) {
          if (out.beyond[t][edge] == kNone) continue;
          const std::uint32_t u = triangle_of(out.beyond[t][edge]);
          const std::uint32_t there = corner_of(mesh.triangles[u], v);
          if (numbered[u][there] == kNone) {
            numbered[u][there] = vertex;
            stack.push_back({u, there});
          }
        }
      }
    }
  }
  out.mesh.triangles = std::move(numbered);
}

}  // namespace

Result<Triangulation> triangulate(const Pslg& pslg) {
  const CanonicalRotation rotate = rotation_by_centroid(pslg);
  Sweep sweep(pslg, rotate);
  auto out = sweep.run();
  if (!out) return out;
  flip_to_delaunay(*out);
  if (doubled_area(out->mesh) != doubled_area(pslg))
    return bug("triangulation: its area is not the outline's");
  if (sweep.has_pinches()) split_pinches(*out);
  for (LatticePoint& p : out->mesh.vertices)
    p = rotate.back(p);
  return out;
}

}  // namespace trocar
