// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/area_collapse.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/geometry/canonical_rotation.h"
#include "formats/geometry/lattice_box.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {
namespace {

// Of the tolerance. Collapses use it up more evenly than Douglas-Peucker does: held to less, they
// leave the outline nearer on average, still with fewer vertices. It also covers the rounding of
// distances, and of the points that refinement adds.
constexpr double kUsed = 0.9;

// A point of a contour: on the edge from vertex k to the next, at the fraction t (0 <= t < 1).
struct Place {
  std::uint32_t k = 0;
  double t = 0;
};

// Collapses that move less than these shares of the tolerance, on average along what they replace,
// are made first, in this order.
constexpr std::array kSweeps = {1.0 / 64, 1.0 / 32, 1.0 / 16};

constexpr double kNever = std::numeric_limits<double>::infinity();

struct Node {
  LatticePoint p;
  std::uint32_t previous, next, ring;
  std::uint32_t edge;            // the one to the next node
  Place place;                   // on the contour, within the tolerance of p
  LatticePoint home, home_next;  // the contour's edge that it began with
  double displacement = kNever;  // by the collapse of that edge
  double queued = kNever;        // the same when it was queued: the least of its tickets
};

// The outline's edges by cells of a grid; removed ones leave their cells when a search meets them.
class EdgeGrid {
 public:
  EdgeGrid(const LatticeBox& box, std::size_t edges) : low_(box.low) {
    const double width = 1.0 + static_cast<double>(box.high.x) - box.low.x,
                 height = 1.0 + static_cast<double>(box.high.y) - box.low.y;
    const double cells = 4 * static_cast<double>(edges);
    cell_ = std::max({1.0, std::sqrt(width * height / cells), width / cells, height / cells});
    columns_ = 1 + static_cast<std::int32_t>(width / cell_);
    rows_ = 1 + static_cast<std::int32_t>(height / cell_);
    heads_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), kNone);
    edges_.reserve(3 * edges);
  }

  struct Edge {
    LatticePoint from, to;
    std::uint32_t visit;
    bool is_removed;
  };

  std::uint32_t add(LatticePoint from, LatticePoint to) {
    const auto id = static_cast<std::uint32_t>(edges_.size());
    edges_.push_back({from, to, 0, false});
    LatticeBox box{from, from};
    widen(box, to);
    for_cells(box, [&](std::uint32_t& head) {
      entries_.push_back({id, head});
      head = static_cast<std::uint32_t>(entries_.size() - 1);
    });
    return id;
  }
  void remove(std::uint32_t id) { edges_[id].is_removed = true; }

  // Is there an edge near the box for which is_wanted(id, edge) holds?
  template <typename Wanted>
  bool any_near(const LatticeBox& box, const Wanted& is_wanted) {
    ++visits_;
    bool is_found = false;
    for_cells(box, [&](std::uint32_t& head) {
      for (std::uint32_t* link = &head; !is_found && *link != kNone;) {
        Entry& entry = entries_[*link];
        Edge& edge = edges_[entry.edge];
        if (edge.is_removed) {
          *link = entry.next;
          continue;
        }
        link = &entry.next;
        if (edge.visit == visits_) continue;
        edge.visit = visits_;
        is_found = overlaps(edge, box) && is_wanted(entry.edge, edge);
      }
    });
    return is_found;
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;
  struct Entry {
    std::uint32_t edge, next;
  };

  static bool overlaps(const Edge& e, const LatticeBox& box) {
    return std::max(e.from.x, e.to.x) >= box.low.x && std::min(e.from.x, e.to.x) <= box.high.x &&
           std::max(e.from.y, e.to.y) >= box.low.y && std::min(e.from.y, e.to.y) <= box.high.y;
  }

  // Points beyond the grid belong to its outermost cells.
  template <typename Visit>
  void for_cells(const LatticeBox& box, const Visit& visit) {
    const auto cell = [this](std::int32_t at, std::int32_t low, std::int32_t count) {
      const double c = (static_cast<double>(at) - low) / cell_;
      return static_cast<std::int32_t>(std::clamp(c, 0.0, static_cast<double>(count - 1)));
    };
    const std::int32_t x0 = cell(box.low.x, low_.x, columns_),
                       x1 = cell(box.high.x, low_.x, columns_);
    const std::int32_t y0 = cell(box.low.y, low_.y, rows_), y1 = cell(box.high.y, low_.y, rows_);
    for (std::int32_t y = y0; y <= y1; ++y) {
      for (std::int32_t x = x0; x <= x1; ++x)
        visit(heads_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
                     static_cast<std::size_t>(x)]);
    }
  }

  LatticePoint low_;
  double cell_ = 1;
  std::int32_t columns_ = 1, rows_ = 1;
  std::vector<std::uint32_t> heads_;
  std::vector<Entry> entries_;
  std::vector<Edge> edges_;
  std::uint32_t visits_ = 0;
};

// The edge bc between a and d, as node numbers and as points.
struct Span {
  std::uint32_t ia, ib, ic, id;
  LatticePoint a, b, c, d;

  // Twice the area between the path a, b, c, d and the line from d to a.
  std::int64_t doubled() const { return orient2d(a, b, c) + orient2d(a, c, d); }
};

// Where the point that replaces an edge would keep the area, and the area that moves over.
struct Ideal {
  Point at;
  double displacement;
};

bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return p != a && p != b && orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

// On the ray from `end` (a or d) through `near` (b or c), with `far` the other of the two and
// `other` the other end; `cross` is twice the signed area of the triangle a, near, d.
std::optional<Ideal> ideal_on_ray(LatticePoint end, LatticePoint near, LatticePoint far,
                                  LatticePoint other, double area, std::int64_t cross) {
  if (cross == 0) return std::nullopt;
  const double t = area / static_cast<double>(cross);
  if (!(t > 0)) return std::nullopt;
  const Point from = point(end), n = point(near);
  const Point e{from.x + t * (n.x - from.x), from.y + t * (n.y - from.y)};
  // The new edge from e to `other` crosses near-far at near + u (far - near); what lies on either
  // side of that point is equal.
  const Point f = point(far), o = point(other);
  const double at_near = (o.x - e.x) * (n.y - e.y) - (o.y - e.y) * (n.x - e.x),
               at_far = (o.x - e.x) * (f.y - e.y) - (o.y - e.y) * (f.x - e.x);
  const double u = at_near == at_far ? 0 : std::clamp(at_near / (at_near - at_far), 0.0, 1.0);
  return Ideal{e, std::abs(u * ((n.x - e.x) * (f.y - n.y) - (n.y - e.y) * (f.x - n.x)))};
}

// The better one first.
std::array<std::optional<Ideal>, 2> ideals(const Span& s, double area) {
  if (strictly_between(s.a, s.c, s.b)) return {Ideal{point(s.c), 0}, std::nullopt};
  if (strictly_between(s.b, s.d, s.c)) return {Ideal{point(s.b), 0}, std::nullopt};
  std::array out{ideal_on_ray(s.a, s.b, s.c, s.d, area, orient2d(s.a, s.b, s.d)),
                 ideal_on_ray(s.d, s.c, s.b, s.a, area, orient2d(s.a, s.c, s.d))};
  if (!out[0] || (out[1] && out[1]->displacement < out[0]->displacement)) std::swap(out[0], out[1]);
  return out;
}

// How often the closed path a, b, c, d, e winds around p, which lies on none of its edges.
int winding(const std::array<LatticePoint, 5>& path, LatticePoint p) {
  int out = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const LatticePoint from = path[i], to = path[(i + 1) % path.size()];
    if ((from.y <= p.y) == (to.y <= p.y)) continue;
    const std::int64_t side = orient2d(from, to, p);
    if (from.y <= p.y && side > 0) ++out;
    if (from.y > p.y && side < 0) --out;
  }
  return out;
}

class Collapser {
 public:
  // The contours are in the canonical orientation; their box's lower left corner is the origin.
  Collapser(const Pslg& contours, const LatticeBox& box, LatticePoint origin, std::size_t vertices,
            double tolerance)
      : contours_(contours),
        origin_(origin),
        tolerance2_(tolerance * kUsed * tolerance * kUsed),
        grid_(box, vertices) {
    nodes_.reserve(vertices);
    for (std::uint32_t r = 0; r < contours.rings.size(); ++r) {
      const Ring& ring = contours.rings[r];
      const auto first = static_cast<std::uint32_t>(nodes_.size()),
                 n = static_cast<std::uint32_t>(ring.size());
      rings_.push_back({first, n, 0});
      for (std::uint32_t k = 0; k < n; ++k)
        nodes_.push_back({ring[k],
                          first + (k + n - 1) % n,
                          first + (k + 1) % n,
                          r,
                          grid_.add(ring[k], ring[(k + 1) % n]),
                          {k, 0},
                          ring[k],
                          ring[(k + 1) % n]});
    }
  }

  Pslg run() {
    sweep();
    is_queueing_ = true;
    for (const RingState& ring : rings_) {
      std::uint32_t i = ring.first;
      do {
        queue(i);
        i = nodes_[i].next;
      } while (i != ring.first);
    }
    while (!tickets_.empty()) {
      std::pop_heap(tickets_.begin(), tickets_.end(), later_);
      const Ticket ticket = tickets_.back();
      tickets_.pop_back();
      Node& node = nodes_[ticket.node];
      if (ticket.displacement != node.queued) continue;
      node.queued = kNever;
      if (node.displacement == ticket.displacement) {
        node.displacement = kNever;
        collapse(ticket.node);
      } else if (node.displacement != kNever) {
        push(ticket.node);
      }
    }
    Pslg out;
    for (const RingState& ring : rings_) {
      out.rings.emplace_back();
      std::uint32_t i = ring.first;
      do {
        out.rings.back().push_back(nodes_[i].p);
        i = nodes_[i].next;
      } while (i != ring.first);
    }
    return out;
  }

 private:
  struct RingState {
    std::uint32_t first, size;
    std::int64_t owed;  // twice the contour's area less the ring's
  };
  struct Ticket {
    double displacement;
    std::uint32_t node;
  };
  // The least displacement first; equal ones by where they began, which no two edges share.
  struct Later {
    const std::vector<Node>& nodes;
    bool operator()(const Ticket& s, const Ticket& t) const {
      if (s.displacement != t.displacement) return s.displacement > t.displacement;
      return edge_of(t.node) < edge_of(s.node);
    }
    std::pair<LatticePoint, LatticePoint> edge_of(std::uint32_t i) const {
      return {nodes[i].home, nodes[i].home_next};
    }
  };
  // Replaces a span's edge.
  struct Replacement {
    LatticePoint e;
    Place place;
  };

  Span span_of(std::uint32_t b) const {
    const std::uint32_t a = nodes_[b].previous, c = nodes_[b].next, d = nodes_[c].next;
    return {a, b, c, d, nodes_[a].p, nodes_[b].p, nodes_[c].p, nodes_[d].p};
  }

  // Collapses that hardly move anything, most of all, in the rings' order: much faster than by the
  // queue. Each ring starts at its least vertex, so that the order of the input does not matter.
  void sweep() {
    std::vector<std::uint32_t> starts;
    for (std::uint32_t r = 0; r < rings_.size(); ++r) {
      const auto first = nodes_.begin() + rings_[r].first;
      starts.push_back(static_cast<std::uint32_t>(
          std::min_element(first, first + rings_[r].size,
                           [](const Node& m, const Node& n) { return m.home < n.home; }) -
          nodes_.begin()));
    }
    std::sort(starts.begin(), starts.end(), [this](std::uint32_t i, std::uint32_t j) {
      return std::tie(nodes_[i].home, nodes_[i].home_next) <
             std::tie(nodes_[j].home, nodes_[j].home_next);
    });
    for (std::uint32_t& start : starts) {
      const RingState& ring = rings_[nodes_[start].ring];
      for (const double share : kSweeps) {
        std::uint32_t i = start;
        for (std::uint32_t left = ring.size; left > 0 && ring.size > 3; --left) {
          const Span s = span_of(i);
          const auto best = ideals(s, static_cast<double>(s.doubled()))[0];
          const double most2 = share * share * tolerance2_;
          if (best && best->displacement * best->displacement <=
                          most2 * static_cast<double>(distance2(s.a, s.d))) {
            if (collapse(i) && start == s.ic) start = s.ib;
          }
          i = nodes_[i].next;
        }
      }
    }
  }

  // A ticket that has become too early is queued again when its turn comes.
  void queue(std::uint32_t b) {
    Node& node = nodes_[b];
    node.displacement = kNever;
    if (rings_[node.ring].size <= 3) return;
    const Span s = span_of(b);
    if (const auto best = ideals(s, static_cast<double>(s.doubled()))[0])
      node.displacement = best->displacement;
    if (node.displacement < node.queued) push(b);
  }
  void push(std::uint32_t b) {
    nodes_[b].queued = nodes_[b].displacement;
    tickets_.push_back({nodes_[b].displacement, b});
    std::push_heap(tickets_.begin(), tickets_.end(), later_);
  }

  bool collapse(std::uint32_t b) {
    const Span s = span_of(b);
    RingState& ring = rings_[nodes_[b].ring];
    if (ring.size <= 3) return false;
    const std::optional<Replacement> found = replacement(s, ring);
    if (!found) return false;
    for (const std::uint32_t i : {s.ia, s.ib, s.ic})
      grid_.remove(nodes_[i].edge);
    ring.owed -= orient2d(s.a, found->e, s.d) - s.doubled();
    --ring.size;
    if (ring.first == s.ic) ring.first = s.ib;
    nodes_[s.ic].queued = nodes_[s.ic].displacement = kNever;
    nodes_[s.ib].p = found->e;
    nodes_[s.ib].place = found->place;
    nodes_[s.ib].next = s.id;
    nodes_[s.id].previous = s.ib;
    nodes_[s.ia].edge = grid_.add(s.a, found->e);
    nodes_[s.ib].edge = grid_.add(found->e, s.d);
    if (is_queueing_) {
      for (const std::uint32_t i : {nodes_[s.ia].previous, s.ia, s.ib, s.id})
        queue(i);
    }
    return true;
  }

  std::optional<Replacement> replacement(const Span& s, const RingState& ring) {
    if (s.a == s.d) return std::nullopt;
    // At most a step's height of what the ring is owed: more would show.
    const double most = std::sqrt(static_cast<double>(distance2(s.a, s.d)));
    const double area =
        static_cast<double>(s.doubled()) + std::clamp(static_cast<double>(ring.owed), -most, most);
    for (const std::optional<Ideal>& ideal : ideals(s, area)) {
      if (!ideal) continue;
      const std::optional<LatticePoint> e = rounded(s, ideal->at, area);
      if (!e || !is_on_lattice({e->x + origin_.x, e->y + origin_.y})) continue;
      const std::optional<Place> place = place_within_tolerance(s, *e);
      if (place && is_clear(s, *e, ring)) return Replacement{*e, *place};
    }
    return std::nullopt;
  }

  // Of the lattice points around, the one that keeps the area best.
  static std::optional<LatticePoint> rounded(const Span& s, Point ideal, double area) {
    constexpr double kFar = 1 << 30;
    if (!(std::abs(ideal.x) < kFar && std::abs(ideal.y) < kFar)) return std::nullopt;
    const LatticePoint near{static_cast<std::int32_t>(std::lrint(ideal.x)),
                            static_cast<std::int32_t>(std::lrint(ideal.y))};
    if (near == s.b || near == s.c) {  // a vertex on a line is left out, and nothing moved
      if (orient2d(s.a, near, s.d) == s.doubled()) return near;
    }
    std::optional<LatticePoint> best;
    std::tuple<double, double> least{};
    for (std::int32_t dx = -1; dx <= 1; ++dx) {
      for (std::int32_t dy = -1; dy <= 1; ++dy) {
        const LatticePoint e{near.x + dx, near.y + dy};
        if (e == s.a || e == s.d) continue;
        const double x = e.x - ideal.x, y = e.y - ideal.y;
        const std::tuple badness{std::abs(static_cast<double>(orient2d(s.a, e, s.d)) - area),
                                 x * x + y * y};
        if (!best || badness < least) best = e, least = badness;
      }
    }
    return best;
  }

  // The nearest place on the contour between those of a and d, if a-e and e-d are within the
  // tolerance of the contour up to it and from it on, both ways. It suffices that e is near the
  // place and the contour's vertices near the edge: then the contour's nearest points run along the
  // whole edge, except for its ends, which are near their places.
  std::optional<Place> place_within_tolerance(const Span& s, LatticePoint e) const {
    const Ring& contour = contours_.rings[nodes_[s.ib].ring];
    const auto n = static_cast<std::uint32_t>(contour.size());
    const Place from = nodes_[s.ia].place, to = nodes_[s.id].place;
    std::uint32_t inner = to.k >= from.k ? to.k - from.k : to.k + n - from.k;
    if (inner == 0 && to.t < from.t) inner = n;  // all round
    // Pieces j = 0 .. inner: from vertex (or `from`) to the next vertex (or `to`).
    Place nearest;
    double least = std::numeric_limits<double>::max();
    std::uint32_t nearest_piece = 0;
    for (std::uint32_t j = 0; j <= inner; ++j) {
      const std::uint32_t k = from.k + j < n ? from.k + j : from.k + j - n;
      const Point p = point(contour[k]), q = point(contour[k + 1 < n ? k + 1 : 0]);
      const double low = j == 0 ? from.t : 0, high = j == inner ? to.t : 1;
      const double t = std::clamp(fraction_along(p, q, point(e)), low, high);
      const double d2 = distance2_between({p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)}, point(e));
      if (d2 < least) least = d2, nearest = {k, t}, nearest_piece = j;
    }
    if (least > tolerance2_) return std::nullopt;
    for (std::uint32_t j = 1; j <= inner; ++j) {
      const std::uint32_t k = from.k + j < n ? from.k + j : from.k + j - n;
      const LatticePoint end = j <= nearest_piece ? s.a : s.d;
      if (segment_distance2(point(end), point(e), point(contour[k])) > tolerance2_)
        return std::nullopt;
    }
    if (nearest.t >= 1) nearest = {nearest.k + 1 < n ? nearest.k + 1 : 0, 0};
    return nearest;
  }

  // Do the new edges cross nothing, and is no vertex between them and the old ones?
  bool is_clear(const Span& s, LatticePoint e, const RingState& ring) {
    const std::int64_t side = orient2d(s.a, e, s.d);
    if (side == 0 && !strictly_between(s.a, s.d, e)) return false;
    if (ring.size == 4 && (side > 0) != (s.doubled() > 0)) return false;
    LatticeBox box{s.a, s.a};
    for (const LatticePoint p : {s.b, s.c, s.d, e})
      widen(box, p);
    const std::array<LatticePoint, 5> path{s.a, s.b, s.c, s.d, e};
    const std::uint32_t ab = nodes_[s.ia].edge, bc = nodes_[s.ib].edge, cd = nodes_[s.ic].edge,
                        closing = ring.size == 4 ? nodes_[s.id].edge : cd;
    return !grid_.any_near(box, [&](std::uint32_t id, const EdgeGrid::Edge& edge) {
      if (id == ab || id == bc || id == cd || id == closing) return false;
      const LatticePoint p = edge.from, q = edge.to;
      const bool at_end = p == s.a || p == s.d;
      // An edge from a to d, of a ring that touches this one, may be passed without a crossing.
      if (at_end && (q == s.a || q == s.d)) return true;
      if (!at_end && (p == s.b || p == s.c || p == e || winding(path, p) != 0)) return true;
      return segments_cross(s.a, e, p, q) || segments_cross(e, s.d, p, q);
    });
  }

  const Pslg& contours_;
  LatticePoint origin_;
  double tolerance2_;
  EdgeGrid grid_;
  std::vector<Node> nodes_;
  std::vector<RingState> rings_;
  bool is_queueing_ = false;
  Later later_{nodes_};
  std::vector<Ticket> tickets_;
};

}  // namespace

Pslg collapse_segments(const Pslg& contours, double tolerance) {
  CentroidOffset offset;
  std::size_t vertices = 0;
  for (const Ring& ring : contours.rings) {
    for (const LatticePoint p : ring)
      offset.add(p);
    vertices += ring.size();
  }
  if (vertices == 0) return contours;
  // The same outline elsewhere, or rotated, has the same result, moved and rotated.
  const CanonicalRotation rotate = CanonicalRotation::of(offset.x(), offset.y());
  LatticeBox box{rotate(contours.rings[0][0]), rotate(contours.rings[0][0])};
  widen(box, rotate(offset.box().low));
  widen(box, rotate(offset.box().high));
  const LatticePoint low = box.low;
  Pslg moved = contours;
  for (Ring& ring : moved.rings) {
    for (LatticePoint& p : ring) {
      const LatticePoint r = rotate(p);
      p = {r.x - low.x, r.y - low.y};
    }
  }
  const LatticeBox at_origin{{0, 0}, {box.high.x - low.x, box.high.y - low.y}};
  Pslg out = Collapser(moved, at_origin, low, vertices, tolerance).run();
  for (Ring& ring : out.rings) {
    for (LatticePoint& p : ring)
      p = rotate.back({p.x + low.x, p.y + low.y});
  }
  return out;
}

}  // namespace trocar::pipeline
