// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/membrane/region.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

namespace trocar::runtime {
namespace {

constexpr std::size_t kFirstCapacity = 128;  // the table of a part with more triangles is made anew
static_assert(FlatTable::kAbsent == kNoSlot);

Eigen::Vector2d relative(LatticePoint p, const Eigen::Vector2d& centre) {
  return Eigen::Vector2d(p.x, p.y) - centre;
}

/// Squared distance of a triangle from the origin.
double distance2_to_origin(const std::array<Eigen::Vector2d, 3>& p) {
  double least = std::numeric_limits<double>::infinity();
  bool inside = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2d& a = p[k];
    const Eigen::Vector2d edge = p[(k + 1) % 3] - a;
    inside = inside && a.x() * edge.y() - a.y() * edge.x() >= 0;
    const double t = std::clamp(-a.dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * edge).squaredNorm());
  }
  return inside ? 0 : least;
}

using Eigen::Vector2d;

/// Converts the part to a sheet mesh with vertices and triangles in the same order, and with free
/// slots for those that refinement will add. O(slots).
SheetMesh to_sheet(const SheetPart& part, std::size_t spare_vertices, std::size_t spare_triangles) {
  SheetMesh out;
  out.vertices = part.mesh.vertices;
  out.triangles = part.mesh.triangles;
  out.across = part.across;
  out.add_slots(spare_vertices, spare_triangles);
  return out;
}

// Finds how each node of a region is held (NodeKind), from the region's boundary edges. A boundary
// edge lies on the tool, on the border to the rest of the sheet (the ring), or on the sheet's
// outline.

/// The boundary edges of a mesh. An edge is stored at the vertex where it starts: element v of each
/// vector describes the edge that starts at vertex v. At most one boundary edge starts at a vertex,
/// because the triangles of a vertex form one fan (sheet_mesh.h, invariant 3).
struct BoundaryEdges {
  std::vector<std::uint32_t> next;  ///< vertex where the edge ends; kNoSlot: no edge starts at v
  std::vector<NodeKind> kind;       ///< kFree for an edge on the sheet's outline
};

/// A node within this distance, in steps, of the tool's outline lies on the tool. The distance is
/// not zero because crossings of the two outlines are rounded to the lattice
/// (formats/mesh/cut.h).
constexpr double kOnTool = 2;

/// If the sheet's outline meets the tool's at a small angle, the tip of the wedge between them is
/// too thin for well-shaped triangles. The tip then moves with the tool: nodes of the outline that
/// are nearer to the tool than this fraction of its circumradius are kTool.
constexpr double kWedgeDistance = 0.02;

/// Returns the distance from a point to the tool's outline, in steps. O(corners).
double distance_to_outline(const Ring& tool, double x, double y) noexcept {
  const Vector2d p(x, y);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < tool.size(); ++k) {
    const Vector2d a(tool[k].x, tool[k].y);
    const LatticePoint to = tool[k + 1 == tool.size() ? 0 : k + 1];
    const Vector2d edge = Vector2d(to.x, to.y) - a;
    const double t = std::clamp((p - a).dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * edge - p).squaredNorm());
  }
  return std::sqrt(least);
}

bool is_near(LatticePoint p, double distance, const Ring& tool, const Circle& circle) {
  return (Vector2d(p.x, p.y) - circle.centre).norm() <= circle.radius + distance &&
         distance_to_outline(tool, p.x, p.y) <= distance;
}

BoundaryEdges boundary_edges(const SheetMesh& mesh) {
  BoundaryEdges out;
  out.next.assign(mesh.vertices.size(), kNoSlot);
  out.kind.assign(mesh.vertices.size(), NodeKind::kFree);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.triangles[t] == kFreeSlot) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] == kNoSlot)
        out.next[mesh.triangles[t][i]] = mesh.triangles[t][(i + 1) % 3];
    }
  }
  return out;
}

/// Returns the boundary edges of a mesh out of which the tool was cut. `outer` is SheetPart::outer,
/// in ascending order, and `circle` is circle_around(tool). Edges in `outer` are kBorder, edges
/// along the tool are kTool, and all other edges are kFree. O(slots).
BoundaryEdges classified_boundary(const SheetMesh& mesh, const std::vector<OuterEdge>& outer,
                                  const Ring& tool, const Circle& circle) {
  BoundaryEdges edges = boundary_edges(mesh);
  for (std::size_t v = 0; v < edges.next.size(); ++v) {
    if (edges.next[v] == kNoSlot) continue;
    const LatticePoint from = mesh.vertices[v], to = mesh.vertices[edges.next[v]];
    if (std::binary_search(outer.begin(), outer.end(), OuterEdge{from, to})) {
      edges.kind[v] = NodeKind::kBorder;
    } else if (is_near(from, kOnTool, tool, circle) && is_near(to, kOnTool, tool, circle)) {
      // The middle must be on the tool, too, to exclude an edge across one of the tool's corners.
      const double x = (static_cast<double>(from.x) + to.x) / 2;
      const double y = (static_cast<double>(from.y) + to.y) / 2;
      if (distance_to_outline(tool, x, y) <= kOnTool) edges.kind[v] = NodeKind::kTool;
    }
  }
  return edges;
}

/// Returns the kind of each vertex slot of the refined mesh. `before` contains the boundary edges
/// before refinement. If refinement split an edge, the parts have the kind of the edge. A node
/// between a kTool edge and another edge is kTool. A node between a kBorder edge and a kFree edge
/// is kBorder. Nodes of the sheet's outline very close to the tool are kTool as well (region.h,
/// contract 2). O(slots).
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundaryEdges& before,
                                 const Ring& tool, const Circle& circle) {
  const BoundaryEdges after = boundary_edges(refined);
  std::vector<NodeKind> kind(refined.vertices.size(), NodeKind::kFree);
  const auto hold = [&](std::uint32_t v, NodeKind by) {
    if (by != NodeKind::kFree && kind[v] != NodeKind::kTool) kind[v] = by;
  };
  for (std::uint32_t v = 0; v < before.next.size(); ++v) {
    if (before.next[v] == kNoSlot) continue;
    std::uint32_t at = v;
    for (hold(at, before.kind[v]); at != before.next[v] && after.next[at] != kNoSlot;) {
      at = after.next[at];
      hold(at, before.kind[v]);
    }
  }
  const double near_tool = std::max(kOnTool, kWedgeDistance * circle.radius);
  for (std::size_t v = 0; v < kind.size(); ++v) {
    if (kind[v] == NodeKind::kFree && after.next[v] != kNoSlot &&
        is_near(refined.vertices[v], near_tool, tool, circle))
      kind[v] = NodeKind::kTool;
  }
  return kind;
}

constexpr std::uint32_t kNoUnknown = 0xffffffff;

/// Returns the free nodes in an order that keeps the factor sparse.
std::vector<std::uint32_t> elimination_order(const Network& network,
                                             std::span<const NodeKind> kind) {
  std::vector<std::uint32_t> free;
  std::vector<int> number(network.size(), -1);
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    if (kind[i] != NodeKind::kFree) continue;
    number[i] = static_cast<int>(free.size());
    free.push_back(i);
  }
  if (free.empty()) return {};  // Eigen 3.4 reads beyond a matrix without columns
  const auto n = static_cast<int>(free.size());
  Eigen::SparseMatrix<double> pattern(n, n);
  std::vector<int> per_column(free.size());
  for (std::size_t u = 0; u < free.size(); ++u)
    per_column[u] = 1 + static_cast<int>(network.first[free[u] + 1] - network.first[free[u]]);
  pattern.reserve(per_column);
  for (int u = 0; u < n; ++u) {
    const std::uint32_t i = free[static_cast<std::size_t>(u)];
    pattern.insert(u, u) = 1;  // without this entry the ordering treats the column as dense
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const int v = number[network.neighbour[k]];
      if (v > u) pattern.insert(v, u) = 1;
    }
  }
  pattern.makeCompressed();
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern.selfadjointView<Eigen::Lower>(), order);
  std::vector<std::uint32_t> nodes(free.size());
  for (std::size_t u = 0; u < free.size(); ++u)
    nodes[u] = free[static_cast<std::size_t>(order.indices()[static_cast<Eigen::Index>(u)])];
  return nodes;
}

/// Calls visit(neighbour, stiffness) for the springs of node i.
template <typename Visit>
void for_each_spring(const Network& network, std::size_t i, Visit&& visit) {
  for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
    visit(network.neighbour[k], network.stiffness_N_per_m[k]);
}

/// Returns the equilibrium with the held nodes of the kind `at_one` at 1 and all other held
/// nodes at 0.
std::vector<double> unit_shape(const Network& network, std::span<const NodeKind> kind,
                               const SparseFactor& factor, NodeKind at_one) {
  std::vector<double> w(network.size(), 0), x(factor.size(), 0);
  for (std::size_t u = 0; u < factor.size(); ++u) {
    for_each_spring(network, factor.nodes()[u], [&](std::uint32_t j, double stiffness) {
      if (kind[j] == at_one) x[u] += stiffness;
    });
  }
  factor.solve(x);
  for (std::size_t u = 0; u < factor.size(); ++u)
    w[factor.nodes()[u]] = x[u];
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == at_one) w[i] = 1;
  }
  return w;
}

double tool_force(const Network& network, std::span<const NodeKind> kind,
                  std::span<const double> w) {
  double sum = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == NodeKind::kTool) sum += reaction_N(network, w, i);
  }
  return sum;
}

/// Computes the bounds of laws 2 and 3.
RingBounds bounds_by_maximum_principle(const Network& network, std::span<const NodeKind> kind,
                                       const LocalSolution& solution) {
  const std::vector<double> p = unit_shape(network, kind, solution.factor, NodeKind::kBorder);
  double highest = 0, sum = 0;
  for (std::size_t m = 0; m < network.size(); ++m) {
    if (kind[m] != NodeKind::kBorder) continue;
    double g = 0, against = network.foundation_N_per_m[m];
    for_each_spring(network, m, [&](std::uint32_t j, double stiffness) {
      if (kind[j] == NodeKind::kBorder) return;
      g += stiffness * solution.w[j];
      against += stiffness * (1 - p[j]);
    });
    if (g > 0) highest = std::max(highest, g / against);
    sum += g;
  }
  return {std::min(1.0, highest * sum / solution.stiffness_N_per_m), std::min(1.0, highest), true};
}

/// Returns F_n of law 1, the force on the tool with the ring nodes free; -1 if there
/// is no solution.
double force_without_ring(const Network& network, std::span<const NodeKind> kind) {
  std::vector<NodeKind> released(kind.begin(), kind.end());
  std::replace(released.begin(), released.end(), NodeKind::kBorder, NodeKind::kFree);
  SparseFactor factor;
  if (!factor.make(network, released)) return -1;
  return tool_force(network, released, unit_shape(network, released, factor, NodeKind::kTool));
}

/// Free slots for a cut without refinement. If they do not suffice, the cut is repeated with more.
constexpr std::size_t kSpareForCut = 64;
constexpr std::size_t kMaxSpare = std::size_t{1} << 20;

void move_by(LatticePoint by, std::vector<LatticePoint>& points) {
  for (LatticePoint& p : points)
    p = {p.x + by.x, p.y + by.y};
}

/// First moment of the mesh's area about `origin`, in steps^3.
Vector2d moment(const SheetMesh& mesh, LatticePoint origin) {
  Vector2d sum = Vector2d::Zero();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!mesh.in_use(t)) continue;
    const auto [a, b, c] = corners(mesh, t);
    sum += static_cast<double>(orient2d(a, b, c)) / 6 *
           (offset_in_steps(a, origin) + offset_in_steps(b, origin) + offset_in_steps(c, origin));
  }
  return sum;
}

/// Gives `work` the capacity for this mesh.
void ensure_capacity(const SheetMesh& mesh, RegionWorkspace& work) {
  if (work.refinement && mesh.vertices.size() <= work.vertex_slots &&
      mesh.triangles.size() <= work.triangle_slots)
    return;
  work.vertex_slots = std::max(work.vertex_slots, mesh.vertices.size());
  work.triangle_slots = std::max(work.triangle_slots, mesh.triangles.size());
  work.edit = SheetEdit(work.vertex_slots, work.triangle_slots);
  work.cut = CutWorkspace({work.triangle_slots, work.vertex_slots + kSpareForCut,
                           3 * work.triangle_slots + kSpareForCut});
  work.refinement.emplace(work.vertex_slots, work.triangle_slots);
}

/// Cuts the tool out of the part. If they do not overlap, the part is unchanged. Returns false if
/// there are too few free slots.
Result<bool> cut_tool(SheetMesh& mesh, const Ring& tool, RegionWorkspace& work,
                      MaterialUnderTool& under_tool) {
  work.edit.begin(mesh);
  const CutReport report = cut_in_place(mesh, TriangleGrid(mesh), tool, work.cut, work.edit);
  switch (report.outcome) {
    case CutOutcome::kCut:
    case CutOutcome::kNoOverlap:
      break;
    case CutOutcome::kInvalidTool:
      return refused("tool polygon: not simple, counter-clockwise and on the lattice, of 3 to " +
                     std::to_string(kMaxToolCorners) + " corners");
    case CutOutcome::kBug:
      return bug(std::string("region: ") + report.bug);
    case CutOutcome::kCapacity:
      return false;
  }
  under_tool.area_steps2 = static_cast<double>(report.doubled_area_removed) / 2;
  return true;
}

/// Refines towards the tool, and where possible until no spring is negative. Edges on the ring are
/// not split, so that the region still conforms to the rest of the sheet.
void refine(SheetMesh& mesh, const BoundaryEdges& edges, const Ring& tool, double circumradius,
            const Grading& grading, RegionWorkspace& work) {
  work.edit.begin(mesh);
  work.queue.clear();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t)) work.queue.push_back(t);
  }
  const double at_tool = grading.at_tool * circumradius;
  const auto size = [&](double x, double y) {
    return at_tool + grading.grade * distance_to_outline(tool, x, y);
  };
  const auto is_ring = [&](std::uint32_t from, std::uint32_t to) {
    return from < edges.next.size() && edges.kind[from] == NodeKind::kBorder &&
           edges.next[from] == to;
  };
  LocalRefinementOptions options;
  options.size = size;
  options.max_new_vertices = grading.max_new_vertices;
  options.split_outline = true;
  options.keep_edge = is_ring;
  refine_locally(mesh, work.edit, work.queue, options, *work.refinement);
}

/// Copies the vertices and triangles in use, in the order of their slots as in to_slice_mesh(),
/// with their kinds.
void compact(const SheetMesh& mesh, const std::vector<NodeKind>& by_slot, RegionMesh& region) {
  region.mesh = to_slice_mesh(mesh);
  std::vector<std::uint8_t> used(mesh.vertices.size(), 1);
  for (std::uint32_t v : mesh.free_vertices)
    used[v] = 0;
  region.kind.reserve(region.mesh.vertices.size());
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) region.kind.push_back(by_slot[v]);
  }
}

}  // namespace

Circle circle_around(const Ring& tool) noexcept {
  Circle circle;
  for (const LatticePoint& p : tool)
    circle.centre += Eigen::Vector2d(p.x, p.y) / static_cast<double>(tool.size());
  for (const LatticePoint& p : tool)
    circle.radius = std::max(circle.radius, relative(p, circle.centre).norm());
  return circle;
}

SheetPart part_around(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                      const Circle& circle, double radius, std::vector<std::uint32_t>& queue) {
  FlatTable taken;  // maps the slot of a triangle to its index in the queue
  taken.allocate(kFirstCapacity);
  queue.clear();
  const auto take = [&](std::uint32_t t) {
    const auto number = static_cast<std::uint32_t>(queue.size());
    queue.push_back(t);
    if (taken.insert(t, number) != nullptr) return;
    taken.allocate(4 * queue.size());
    for (std::uint32_t k = 0; k <= number; ++k)
      taken.insert(queue[k], k);
  };
  for (std::uint32_t t : seeds) {
    if (!taken.contains(t)) take(t);
  }
  const double reach = circle.radius + radius;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    for (std::uint32_t u : sheet.across[queue[k]]) {
      if (u == kNoSlot || taken.contains(u)) continue;
      const std::array<LatticePoint, 3> p = corners(sheet, u);
      if (!(distance2_to_origin({relative(p[0], circle.centre), relative(p[1], circle.centre),
                                 relative(p[2], circle.centre)}) < reach * reach))
        continue;
      take(u);
    }
  }

  // Neighbours are given by their index in the queue. Each fan of triangles gets its own vertex: if
  // the border passes through a vertex twice, the part contains that vertex twice.
  const auto n = static_cast<std::uint32_t>(queue.size());
  SheetPart part;
  std::vector<std::array<std::uint32_t, 3>>& across = part.across;
  across.resize(n);
  part.mesh.triangles.assign(n, kFreeSlot);
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t t = queue[k];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t u = sheet.across[t][i];
      across[k][i] = u == kNoSlot ? kNoSlot : taken.find(u);
      if (u != kNoSlot && across[k][i] == kNoSlot) {
        part.outer.push_back({sheet.vertices[sheet.triangles[t][i]],
                              sheet.vertices[sheet.triangles[t][(i + 1) % 3]]});
      }
    }
  }
  for (std::uint32_t k = 0; k < n; ++k) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (part.mesh.triangles[k][i] != kNoSlot) continue;
      const std::uint32_t slot = sheet.triangles[queue[k]][i];
      const auto vertex = static_cast<std::uint32_t>(part.mesh.vertices.size());
      part.mesh.vertices.push_back(sheet.vertices[slot]);
      part.parent.push_back(slot);
      // Walk around the vertex, across the edge that ends in it, until the fan closes or the border
      // is reached. If it was the border, walk in the other direction, too.
      std::uint32_t t = k, corner = i;
      const auto number = [&] { part.mesh.triangles[t][corner] = vertex; };
      const auto step = [&](std::uint32_t edge) {
        t = across[t][edge];
        if (t == kNoSlot) return false;
        const Triangle& next = sheet.triangles[queue[t]];
        corner = next[0] == slot ? 0 : next[1] == slot ? 1 : 2;
        return t != k;
      };
      for (number(); step((corner + 2) % 3);)
        number();
      if (t == k) continue;
      t = k;
      for (corner = i; step(corner);)
        number();
    }
  }
  std::sort(part.outer.begin(), part.outer.end());
  return part;
}

bool SparseFactor::make(const Network& network, std::span<const NodeKind> kind) {
  *this = SparseFactor();
  std::vector<std::uint32_t> nodes = elimination_order(network, kind);
  const auto n = static_cast<std::uint32_t>(nodes.size());
  std::vector<std::uint32_t> unknown(network.size(), kNoUnknown);
  for (std::uint32_t u = 0; u < n; ++u)
    unknown[nodes[u]] = u;

  // Find the elimination tree and the length of each column. The entries of row u of L are on the
  // tree's paths from the row's matrix entries up to u.
  std::vector<std::uint32_t> parent(n, kNoUnknown), seen(n), length(n, 0);
  const auto for_each_earlier = [&](std::uint32_t u, auto&& visit) {
    const std::uint32_t i = nodes[u];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t v = unknown[network.neighbour[k]];
      if (v != kNoUnknown && v < u) visit(v, network.stiffness_N_per_m[k]);
    }
  };
  for (std::uint32_t u = 0; u < n; ++u) {
    seen[u] = u;
    for_each_earlier(u, [&](std::uint32_t v, double) {
      for (; seen[v] != u; v = parent[v]) {
        if (parent[v] == kNoUnknown) parent[v] = u;
        ++length[v];
        seen[v] = u;
      }
    });
  }
  std::vector<std::uint32_t> first(n + 1, 0);
  for (std::uint32_t u = 0; u < n; ++u)
    first[u + 1] = first[u] + length[u];

  // Compute each row by a solve with the rows above it.
  std::vector<std::uint32_t> row(first[n]), path(n), filled(n, 0);
  std::vector<double> value(first[n]), inverse_pivot(n), y(n, 0);
  for (std::uint32_t u = 0; u < n; ++u) {
    const std::uint32_t i = nodes[u];
    double diagonal = network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
      diagonal += network.stiffness_N_per_m[k];
    // Find the row's pattern in topological order: each entry precedes those that it changes.
    std::uint32_t top = n;
    seen[u] = u + n;  // larger than any mark of the first pass
    for_each_earlier(u, [&](std::uint32_t v, double stiffness) {
      y[v] -= stiffness;
      std::uint32_t count = 0;
      for (; seen[v] != u + n; v = parent[v]) {
        path[count++] = v;
        seen[v] = u + n;
      }
      while (count > 0)
        path[--top] = path[--count];
    });
    for (; top < n; ++top) {
      const std::uint32_t v = path[top];
      const double y_v = y[v];
      y[v] = 0;
      const std::uint32_t end = first[v] + filled[v];
      for (std::uint32_t k = first[v]; k < end; ++k)
        y[row[k]] -= value[k] * y_v;
      const double entry = y_v * inverse_pivot[v];
      diagonal -= entry * y_v;
      row[end] = u;
      value[end] = entry;
      ++filled[v];
    }
    if (!(diagonal > 0)) return false;
    inverse_pivot[u] = 1 / diagonal;
  }
  node_ = std::move(nodes);
  first_ = std::move(first);
  row_ = std::move(row);
  value_ = std::move(value);
  inverse_pivot_ = std::move(inverse_pivot);
  return true;
}

void SparseFactor::solve(std::span<double> x) const noexcept {
  const std::size_t n = inverse_pivot_.size();
  for (std::size_t u = 0; u < n; ++u) {
    const double x_u = x[u];
    for (std::uint32_t k = first_[u]; k < first_[u + 1]; ++k)
      x[row_[k]] -= value_[k] * x_u;
    x[u] = x_u * inverse_pivot_[u];
  }
  for (std::size_t u = n; u-- > 0;) {
    double x_u = x[u];
    for (std::uint32_t k = first_[u]; k < first_[u + 1]; ++k)
      x_u -= value_[k] * x[row_[k]];
    x[u] = x_u;
  }
}

bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options) {
  if (!solution.factor.make(network, kind)) return false;
  solution.w = unit_shape(network, kind, solution.factor, NodeKind::kTool);
  solution.stiffness_N_per_m = tool_force(network, kind, solution.w);
  solution.bounds = {};
  const bool has_ring = std::find(kind.begin(), kind.end(), NodeKind::kBorder) != kind.end();
  if (!options.bounds || !has_ring || !(solution.stiffness_N_per_m > 0)) return true;
  solution.bounds = bounds_by_maximum_principle(network, kind, solution);
  if (negative_at_free_nodes(network, kind) != 0) {
    solution.bounds.proved = false;
    const double least = force_without_ring(network, kind);
    solution.bounds.force = std::clamp(1 - least / solution.stiffness_N_per_m, 0.0, 1.0);
  }
  return true;
}

Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool_in_sheet, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace) {
  if (tool_in_sheet.size() < 3) return refused("a tool has at least three corners");
  if (!(options.radius_m > 0)) return refused("a region's radius must be positive");
  RegionMesh region;
  const std::vector<std::uint32_t> under = seeds_under_tool(sheet, seeds, tool_in_sheet);
  SheetPart part;
  if (!under.empty())
    part = part_around(sheet, under, circle_around(tool_in_sheet),
                       options.radius_m / lattice.step_m(), workspace.queue);
  // Coordinates are now relative to the tool and in a canonical rotation by right angles.
  // So rounding depends neither on the position in the slice nor on the rotation of the
  // slice (contract 5).
  const CanonicalRotation rotation = rotation_by_moments([&](auto&& visit) {
    for (const LatticePoint p : part.mesh.vertices)
      visit(p);
    for (const LatticePoint p : tool_in_sheet)
      visit(p);
  });
  Ring tool;
  for (const LatticePoint p : tool_in_sheet)
    tool.push_back(rotation(p));
  const LatticePoint here = box_around(tool).low;
  move_by({-here.x, -here.y}, tool);
  const Circle circle = circle_around(tool);
  const LatticePoint middle{static_cast<std::int32_t>(std::lround(circle.centre.x())),
                            static_cast<std::int32_t>(std::lround(circle.centre.y()))};
  region.origin = rotation.back(LatticePoint{here.x + middle.x, here.y + middle.y});
  if (under.empty()) return region;

  const auto to_canonical = [&](LatticePoint p) {
    const LatticePoint q = rotation(p);
    return LatticePoint{q.x - here.x, q.y - here.y};
  };
  for (LatticePoint& p : part.mesh.vertices)
    p = to_canonical(p);
  for (OuterEdge& edge : part.outer)
    edge = {to_canonical(edge.from), to_canonical(edge.to)};
  std::sort(part.outer.begin(), part.outer.end());
  for (std::size_t spare = options.grading.graded ? kSpareForCut + options.grading.max_new_vertices
                                                  : kSpareForCut;
       spare <= kMaxSpare; spare *= 8) {
    SheetMesh mesh = to_sheet(part, spare, 2 * spare);
    ensure_capacity(mesh, workspace);
    region.under_tool.moment_steps3 = moment(mesh, middle);
    const auto done = cut_tool(mesh, tool, workspace, region.under_tool);
    if (!done) return done.error();
    if (!*done) continue;
    region.under_tool.moment_steps3 -= moment(mesh, middle);
    const BoundaryEdges edges = classified_boundary(mesh, part.outer, tool, circle);
    if (options.grading.graded)
      refine(mesh, edges, tool, circle.radius, options.grading, workspace);
    compact(mesh, node_kinds(mesh, edges, tool, circle), region);
    move_by(here, region.mesh.vertices);
    for (LatticePoint& p : region.mesh.vertices)
      p = rotation.back(p);
    region.under_tool.moment_steps3 = rotation.back(region.under_tool.moment_steps3);
    return region;
  }
  return bug("region: no capacity suffices for the cut");
}

std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds,
                                            const Ring& tool) {
  std::vector<OutlineEdge> edges;
  for (std::size_t i = 0; i < tool.size(); ++i) {
    const std::array<LatticePoint, 2> ends{tool[i], tool[(i + 1) % tool.size()]};
    edges.push_back({ends[0], ends[1], box_around(ends)});
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t t : seeds) {
    if (t < sheet.triangles.size() && sheet.in_use(t) &&
        intersect_tool(corners(sheet, t), edges) == ToolIntersection::kOverlaps)
      out.push_back(t);
  }
  return out;
}

PropagationPlan plan_propagation(const Network& network, std::span<const NodeKind> kind,
                                 const PropagationOptions& options) {
  PropagationPlan plan;
  plan.options = options;
  plan.options.damping = std::clamp(options.damping, kMinDamping, 1.0);
  std::vector<std::uint8_t> reached(network.size(), 0);
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    if (kind[i] != NodeKind::kTool) continue;
    plan.tool.push_back(i);
    reached[i] = 1;
  }
  std::vector<std::uint32_t> ring = plan.tool, next;
  for (int depth = 1; depth <= options.depth && !ring.empty(); ++depth) {
    next.clear();
    for (std::uint32_t i : ring) {
      for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
        const std::uint32_t j = network.neighbour[k];
        if (reached[j] != 0 || kind[j] != NodeKind::kFree) continue;
        reached[j] = 1;
        next.push_back(j);
      }
    }
    plan.active.insert(plan.active.end(), next.begin(), next.end());
    ring.swap(next);
  }
  for (std::uint32_t i : plan.active) {
    double stiffness = network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
      stiffness += network.stiffness_N_per_m[k];
    plan.inverse_stiffness_m_per_N.push_back(1 / stiffness);
  }
  return plan;
}

PropagationState make_propagation_state(const Network& network, const PropagationPlan& plan) {
  return {std::vector<double>(network.size(), 0), std::vector<double>(plan.active.size(), 0)};
}

double propagate(const Network& network, const PropagationPlan& plan, double depth_m,
                 PropagationState& state) noexcept {
  for (std::uint32_t i : plan.tool)
    state.w_m[i] = depth_m;
  const double kept = 1 - plan.options.damping;
  for (int sweep = 0; sweep < plan.options.sweeps; ++sweep) {
    for (std::size_t a = 0; a < plan.active.size(); ++a) {
      const std::uint32_t i = plan.active[a];
      double& velocity = state.velocity_m_per_sweep[a];
      velocity =
          kept * velocity - reaction_N(network, state.w_m, i) * plan.inverse_stiffness_m_per_N[a];
      state.w_m[i] += velocity;
    }
  }
  double force_N = 0;
  for (std::uint32_t i : plan.tool)
    force_N += reaction_N(network, state.w_m, i);
  return force_N;
}

}  // namespace trocar::runtime
