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
#include "pipeline/contour/contour_grid.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {
namespace {

// Of the tolerance. Collapses use it up more evenly than Douglas-Peucker does: held to less, they
// leave the outline nearer on average, still with fewer vertices.
constexpr double kLeft = 0.1;
constexpr double kLeast = 0.5;      // steps
constexpr double kRounding = 1e-9;  // of a distance

// A point of a contour: on the edge from vertex k to the next, at the fraction t (0 <= t < 1).
struct Place {
  std::uint32_t k = 0;
  double t = 0;
};

// Collapses that move less than these shares of the tolerance, on average along what they replace,
// are made first, in this order.
constexpr std::array kSweeps = {1.0 / 64, 1.0 / 32, 1.0 / 16};

// Of a ring, as many vertices are queued together.
constexpr std::uint32_t kPart = 1024;

// Before, up to this many edges in a row become two, where that moves them by less than this share.
constexpr std::size_t kRun = 8;
constexpr std::size_t kSkip = 4;
constexpr double kRunShare = 2.0 / 3;

constexpr double kNever = std::numeric_limits<double>::infinity(), kUnknown = -1;
constexpr std::uint32_t kNone = 0xffffffff;

// Node i begins as vertex i of the contours, which are numbered ring by ring.
struct Node {
  LatticePoint p;
  std::uint32_t previous, next;
};
// What is needed less often.
struct NodeState {
  std::uint32_t ring, k;  // k, t: on the contour, within the tolerance of p
  double t = 0;
  double displacement = kUnknown;  // by the collapse of the edge to the next node
  double queued = kNever;          // the same when it was queued: the least of its tickets
  Place place() const { return {k, t}; }
  void put(Place place) { k = place.k, t = place.t; }
};

// The edge bc between a and d, as node numbers and as points.
struct Span {
  std::uint32_t ia, ib, ic, id;
  LatticePoint a, b, c, d;
  std::int64_t abc = orient2d(a, b, c), acd = orient2d(a, c, d), bcd = orient2d(b, c, d);

  // Twice the area between the path a, b, c, d and the line from d to a.
  std::int64_t doubled() const { return abc + acd; }
};

// Where the point that replaces an edge would keep the area, and the area that moves over; kNever:
// nowhere.
struct Ideal {
  Point at;
  double displacement = kNever;
};

bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return p != a && p != b && orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

// On the ray from `end` (a or d) through `near` (b or c), with `far` the other of the two and
// `other` the other end; `cross` is twice the signed area of the triangle a, near, d.
Ideal ideal_on_ray(LatticePoint end, LatticePoint near, LatticePoint far, LatticePoint other,
                   double area, std::int64_t cross) {
  if (cross == 0) return {};
  const double t = area / static_cast<double>(cross);
  if (!(t > 0)) return {};
  const Point from = point(end), n = point(near);
  const Point e{from.x + t * (n.x - from.x), from.y + t * (n.y - from.y)};
  // The new edge from e to `other` crosses near-far at near + u (far - near); what lies on either
  // side of that point is equal.
  const Point f = point(far), o = point(other);
  const double at_near = (o.x - e.x) * (n.y - e.y) - (o.y - e.y) * (n.x - e.x),
               at_far = (o.x - e.x) * (f.y - e.y) - (o.y - e.y) * (f.x - e.x);
  const double u = at_near == at_far ? 0 : std::clamp(at_near / (at_near - at_far), 0.0, 1.0);
  return {e, std::abs(u * ((n.x - e.x) * (f.y - n.y) - (n.y - e.y) * (f.x - n.x)))};
}

// The better one first.
std::array<Ideal, 2> ideals(const Span& s, double area) {
  if (s.abc == 0 && strictly_between(s.a, s.c, s.b)) return {Ideal{point(s.c), 0}, Ideal{}};
  if (s.bcd == 0 && strictly_between(s.b, s.d, s.c)) return {Ideal{point(s.b), 0}, Ideal{}};
  const Ideal on_ab = ideal_on_ray(s.a, s.b, s.c, s.d, area, s.abc + s.acd - s.bcd),
              on_dc = ideal_on_ray(s.d, s.c, s.b, s.a, area, s.acd);
  if (on_dc.displacement < on_ab.displacement) return {on_dc, on_ab};
  return {on_ab, on_dc};
}

// A part of a ring that a point e replaces, except for its ends; then e.
struct Path {
  std::array<std::uint32_t, kRun + 1> nodes;
  std::array<LatticePoint, kRun + 2> points;
  std::size_t size;  // without e

  LatticePoint a() const { return points[0]; }
  LatticePoint d() const { return points[size - 1]; }
  LatticePoint e() const { return points[size]; }
};

// How often the closed path winds around p, which lies on none of its edges.
int winding(const Path& path, LatticePoint p) {
  int out = 0;
  for (std::size_t i = 0; i <= path.size; ++i) {
    const LatticePoint from = path.points[i], to = path.points[i < path.size ? i + 1 : 0];
    if ((from.y <= p.y) == (to.y <= p.y)) continue;
    const std::int64_t side = orient2d(from, to, p);
    if (from.y <= p.y && side > 0) ++out;
    if (from.y > p.y && side < 0) --out;
  }
  return out;
}

// As segments_cross(), quick where cd lies to one side of ab, as it nearly always does.
bool crosses(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const std::int64_t to_c = orient2d(a, b, c), to_d = orient2d(a, b, d);
  if ((to_c > 0 && to_d > 0) || (to_c < 0 && to_d < 0)) return false;
  return segments_cross(a, b, c, d);
}

double used(double tolerance) {
  return (1 - kRounding) * (tolerance - left_for_refinement(tolerance));
}

class Collapser {
 public:
  // The contours are in the canonical orientation; their box's lower left corner is the origin.
  // An open one has no edge from its last vertex to its first.
  Collapser(const Pslg& contours, const std::vector<bool>& is_open, const LatticeBox& box,
            LatticePoint origin, std::size_t vertices, double tolerance)
      : origin_(origin),
        tolerance2_(used(tolerance) * used(tolerance)),
        reach_(static_cast<std::int32_t>(std::min(tolerance, 1.0 * kMaxCoordinate)) + 1),
        grid_(box, vertices) {
    nodes_.reserve(vertices);
    states_.reserve(vertices);
    points_.reserve(vertices + contours.rings.size());
    hints_.reserve(vertices + contours.rings.size());
    for (std::uint32_t r = 0; r < contours.rings.size(); ++r) {
      const Ring& ring = contours.rings[r];
      const auto first = static_cast<std::uint32_t>(nodes_.size()),
                 n = static_cast<std::uint32_t>(ring.size());
      const std::uint32_t on_contour = first + r;
      const bool open = !is_open.empty() && is_open[r];
      rings_.push_back({first, n, on_contour, n, open ? first + n - 1 : kNone, 0});
      for (std::uint32_t k = 0; k < n; ++k) {
        nodes_.push_back({ring[k], first + (k > 0 ? k : n) - 1, first + (k + 1 < n ? k + 1 : 0)});
        states_.push_back({r, k});
        hints_.push_back(first + k);
        points_.push_back(ring[k]);
        const LatticePoint next = k + 1 < n ? ring[k + 1] : ring[open ? k : 0];
        grid_.add(on_contour + k, ring[k], next, on_contour);
      }
      points_.push_back(ring[0]);
      hints_.push_back(first);
    }
  }

  Pslg run() {
    const std::vector<std::uint32_t> starts = starts_of_rings();
    for (const std::uint32_t start : starts)
      merge_runs(start);
    sweep(starts);
    is_queueing_ = true;
    for (const std::uint32_t start : starts)
      collapse_by_queue(start);
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
    std::uint32_t first, size;                  // a node, and how many there are
    std::uint32_t contour_first, contour_size;  // in points_
    std::uint32_t end;                          // the node without an edge, if it is open
    std::int64_t owed;                          // twice the contour's area less the ring's
  };
  struct Ticket {
    double displacement;
    std::uint32_t node;
  };
  // The least displacement first; equal ones by where they began, which no two edges share.
  struct Later {
    const Collapser& collapser;
    bool operator()(const Ticket& s, const Ticket& t) const {
      if (s.displacement != t.displacement) return s.displacement > t.displacement;
      return collapser.home(t.node) < collapser.home(s.node);
    }
  };
  // Replaces a span's edge.
  struct Replacement {
    LatticePoint e;
    Place place;
  };

  // The contour's edge that the node began with.
  std::array<double, 4> home(std::uint32_t i) const {
    const std::size_t at = i + states_[i].ring;
    const Point p = point(points_[at]), next = point(points_[at + 1]);
    return {p.x, p.y, next.x, next.y};
  }

  Span span_of(std::uint32_t b) const {
    const std::uint32_t a = nodes_[b].previous, c = nodes_[b].next, d = nodes_[c].next;
    return {a, b, c, d, nodes_[a].p, nodes_[b].p, nodes_[c].p, nodes_[d].p};
  }

  // Each ring's least vertex, so that the order of the input does not matter.
  std::vector<std::uint32_t> starts_of_rings() const {
    std::vector<std::uint32_t> starts;
    for (const RingState& ring : rings_) {
      const auto first = nodes_.begin() + ring.first;
      starts.push_back(static_cast<std::uint32_t>(
          std::min_element(first, first + ring.size,
                           [](const Node& m, const Node& n) { return m.p < n.p; }) -
          nodes_.begin()));
    }
    std::sort(starts.begin(), starts.end(),
              [this](std::uint32_t i, std::uint32_t j) { return home(i) < home(j); });
    return starts;
  }

  // Runs of the contour that two edges hardly differ from.
  void merge_runs(std::uint32_t start) {
    RingState& ring = rings_[states_[start].ring];
    std::uint32_t i = start;
    std::size_t most = kRun;  // more is tried only next to where nearly as much was merged
    for (std::size_t left = ring.size; left > 2 * kRun;) {
      std::size_t edges = most;
      while (edges > 2 && !merge(i, edges, ring))
        edges /= 2;
      most = std::clamp<std::size_t>(2 * edges, 4, kRun);
      if (edges > 2) {
        i = nodes_[nodes_[i].next].next;
        left -= edges;
      } else {
        for (std::size_t k = 0; k < kSkip; ++k)
          i = nodes_[i].next;
        left -= kSkip;
      }
    }
  }

  bool merge(std::uint32_t first, std::size_t edges, RingState& ring) {
    Path path;
    path.size = edges + 1;
    std::uint32_t node = first;
    for (std::size_t k = 0; k <= edges; ++k) {
      if (node == ring.end && k < edges) return false;
      path.nodes[k] = node;
      path.points[k] = nodes_[node].p;
      node = nodes_[node].next;
    }
    const LatticePoint a = path.a(), d = path.d();
    const std::int64_t base2 = distance2(a, d);
    if (base2 == 0) return false;
    // The point is beside the vertex that is farthest from the line.
    std::int64_t doubled = 0, farthest = 0;
    LatticePoint beside = path.points[edges / 2];
    for (std::size_t k = 1; k < edges; ++k) {
      doubled += orient2d(a, path.points[k], path.points[k + 1]);
      const std::int64_t off = std::abs(orient2d(a, path.points[k], d));
      if (off > farthest) farthest = off, beside = path.points[k];
    }
    const double base = std::sqrt(static_cast<double>(base2)),
                 area = static_cast<double>(doubled) +
                        std::clamp(static_cast<double>(ring.owed), -base, base);
    const double by =
        (static_cast<double>(orient2d(a, beside, d)) - area) / static_cast<double>(base2);
    const Point at{beside.x - by * (d.y - a.y), beside.y + by * (d.x - a.x)};
    const auto near = nearest(at);
    if (!near) return false;
    const auto e = rounded(a, d, *near, at, area);
    if (!e || !is_on_lattice({e->x + origin_.x, e->y + origin_.y})) return false;
    const std::int64_t side = orient2d(a, *e, d);
    if (side == 0 && !strictly_between(a, d, *e)) return false;
    path.points[path.size] = *e;
    const auto place =
        place_within(path.nodes[0], path.nodes[edges], *e, kRunShare * kRunShare * tolerance2_);
    if (!place || !is_clear(path, ring)) return false;
    ring.owed -= side - doubled;
    ring.size -= static_cast<std::uint32_t>(edges - 2);
    if (ring.end == kNone) ring.first = first;
    const std::uint32_t kept = path.nodes[1], last = path.nodes[edges];
    for (std::size_t k = 2; k < edges; ++k)
      nodes_[path.nodes[k]] = {{}, kept, kNone};
    nodes_[kept] = {*e, first, last};
    states_[kept].put(*place);
    nodes_[last].previous = kept;
    return true;
  }

  // Collapses that hardly move anything, most of all, in the rings' order: much faster than by the
  // queue.
  void sweep(const std::vector<std::uint32_t>& starts) {
    for (std::uint32_t start : starts) {
      const RingState& ring = rings_[states_[start].ring];
      for (const double share : kSweeps) {
        std::uint32_t i = start;
        for (std::uint32_t left = ring.size; left > 0 && ring.size > 3; --left) {
          const double moved = displacement(i);
          const std::uint32_t c = nodes_[i].next;
          const LatticePoint a = nodes_[nodes_[i].previous].p, d = nodes_[nodes_[c].next].p;
          if (moved * moved <= share * share * tolerance2_ * static_cast<double>(distance2(a, d)) &&
              collapse(i) && start == c)
            start = i;
          i = nodes_[i].next;
        }
      }
    }
  }

  // By displacement, of one part of the ring after the other: collapses that are far apart do not
  // matter to each other, and a part stays in the cache.
  void collapse_by_queue(std::uint32_t start) {
    std::uint32_t i = start;
    for (std::uint32_t left = rings_[states_[start].ring].size; left > 0;) {
      while (nodes_[i].next == kNone)
        i = nodes_[i].previous;
      for (std::uint32_t k = 0; k < kPart && left > 0; ++k, --left) {
        queue(i);
        i = nodes_[i].next;
      }
      empty_queue();
    }
  }

  void empty_queue() {
    while (!tickets_.empty()) {
      std::pop_heap(tickets_.begin(), tickets_.end(), later_);
      const Ticket ticket = tickets_.back();
      tickets_.pop_back();
      NodeState& node = states_[ticket.node];
      if (ticket.displacement != node.queued) continue;
      node.queued = kNever;
      if (node.displacement == ticket.displacement) {
        node.displacement = kNever;
        collapse(ticket.node);
      } else if (node.displacement != kNever) {
        push(ticket.node);
      }
    }
  }

  // A ticket that has become too early is queued again when its turn comes.
  void queue(std::uint32_t b) {
    NodeState& node = states_[b];
    if (rings_[node.ring].size <= 3) {
      node.displacement = kNever;
    } else if (displacement(b) < node.queued) {
      push(b);
    }
  }
  double displacement(std::uint32_t b) {
    NodeState& node = states_[b];
    if (node.displacement == kUnknown) {
      const Span s = span_of(b);
      node.displacement = kNever;
      const std::uint32_t end = rings_[node.ring].end;
      if (end != kNone && (s.ia == end || s.ib == end || s.ic == end)) return kNever;
      const std::array path{point(s.a), point(s.b), point(s.c), point(s.d)};
      const auto both = ideals(s, static_cast<double>(s.doubled()));
      for (const Ideal& ideal : both) {
        if (ideal.displacement == kNever || is_too_far(path, ideal.at)) continue;
        node.displacement = both[0].displacement;
        break;
      }
    }
    return node.displacement;
  }
  void push(std::uint32_t b) {
    states_[b].queued = states_[b].displacement;
    tickets_.push_back({states_[b].displacement, b});
    std::push_heap(tickets_.begin(), tickets_.end(), later_);
  }

  bool collapse(std::uint32_t b) {
    const Span s = span_of(b);
    RingState& ring = rings_[states_[b].ring];
    if (ring.size <= 3) return false;
    const std::optional<Replacement> found = replacement(s, ring);
    if (!found) return false;
    ring.owed -= orient2d(s.a, found->e, s.d) - s.doubled();
    --ring.size;
    if (ring.first == s.ic) ring.first = s.ib;
    states_[s.ic].queued = states_[s.ic].displacement = kNever;
    nodes_[s.ic].next = kNone;
    nodes_[s.ib].p = found->e;
    states_[s.ib].put(found->place);
    nodes_[s.ib].next = s.id;
    nodes_[s.id].previous = s.ib;
    const std::array changed{nodes_[s.ia].previous, s.ia, s.ib, s.id};
    for (const std::uint32_t i : changed)
      states_[i].displacement = kUnknown;
    if (is_queueing_) {
      for (const std::uint32_t i : changed)
        queue(i);
    }
    return true;
  }

  std::optional<Replacement> replacement(const Span& s, const RingState& ring) {
    if (s.a == s.d) return std::nullopt;
    const std::array path{point(s.a), point(s.b), point(s.c), point(s.d)};
    // At most a step's height of what the ring is owed: more would show.
    const double most = std::sqrt(static_cast<double>(distance2(s.a, s.d)));
    const double area =
        static_cast<double>(s.doubled()) + std::clamp(static_cast<double>(ring.owed), -most, most);
    for (const Ideal& ideal : ideals(s, area)) {
      if (ideal.displacement == kNever) break;
      const std::optional<LatticePoint> near = nearest(ideal.at);
      if (!near) continue;
      // A vertex on a line is left out, and nothing moved.
      const bool is_exact =
          (*near == s.b || *near == s.c) && orient2d(s.a, *near, s.d) == s.doubled();
      const std::optional<LatticePoint> e =
          is_exact ? near : rounded(s.a, s.d, *near, ideal.at, area);
      if (!e || !is_on_lattice({e->x + origin_.x, e->y + origin_.y})) continue;
      if (is_too_far(path, point(*e))) continue;
      const std::int64_t side = orient2d(s.a, *e, s.d);
      if (side == 0 && !strictly_between(s.a, s.d, *e)) continue;
      if (ring.size == 4 && (side > 0) != (s.doubled() > 0)) continue;
      const std::optional<Place> place = place_within(s.ia, s.id, *e, tolerance2_);
      const Path replaced{{s.ia, s.ib, s.ic, s.id}, {s.a, s.b, s.c, s.d, *e}, 4};
      if (place && is_clear(replaced, ring)) return Replacement{*e, *place};
    }
    return std::nullopt;
  }

  static std::optional<LatticePoint> nearest(Point p) {
    constexpr double kFar = 1 << 30;
    if (!(std::abs(p.x) < kFar && std::abs(p.y) < kFar)) return std::nullopt;
    return LatticePoint{static_cast<std::int32_t>(std::lrint(p.x)),
                        static_cast<std::int32_t>(std::lrint(p.y))};
  }

  // Of the lattice points around `near`, the one that keeps the area best.
  static std::optional<LatticePoint> rounded(LatticePoint a, LatticePoint d, LatticePoint near,
                                             Point ideal, double area) {
    const std::int64_t per_x = std::int64_t{d.y} - a.y, per_y = std::int64_t{a.x} - d.x,
                       middle = orient2d(a, near, d);
    std::optional<LatticePoint> best;
    double least_off = 0, least2 = 0;
    for (std::int32_t dx = -1; dx <= 1; ++dx) {
      for (std::int32_t dy = -1; dy <= 1; ++dy) {
        const LatticePoint e{near.x + dx, near.y + dy};
        if (e == a || e == d) continue;
        const double off = std::abs(static_cast<double>(middle + dx * per_x + dy * per_y) - area);
        if (best && off > least_off) continue;
        const double x = e.x - ideal.x, y = e.y - ideal.y, away2 = x * x + y * y;
        if (!best || off < least_off || away2 < least2) best = e, least_off = off, least2 = away2;
      }
    }
    return best;
  }

  // So far from the present outline that it must be too far from the contour.
  bool is_too_far(const std::array<Point, 4>& path, Point e) const {
    const double most2 = 4.001 * tolerance2_;
    for (std::size_t i = 0; i < 3; ++i)
      if (segment_distance2(path[i], path[i + 1], e) <= most2) return false;
    return true;
  }

  // The nearest place on the contour between those of a and d, if a-e and e-d are within the
  // tolerance of the contour up to it and from it on, both ways. It suffices that e is near the
  // place and the contour's vertices near the edge: then the contour's nearest points run along the
  // whole edge, except for its ends, which are near their places.
  std::optional<Place> place_within(std::uint32_t a, std::uint32_t d, LatticePoint e,
                                    double tolerance2) const {
    const RingState& ring = rings_[states_[a].ring];
    const std::uint32_t n = ring.contour_size;
    const LatticePoint* const contour = points_.data() + ring.contour_first;
    const Place from = states_[a].place(), to = states_[d].place();
    std::uint32_t inner = to.k >= from.k ? to.k - from.k : to.k + n - from.k;
    if (inner == 0 && to.t < from.t) inner = n;  // all round
    const Point at = point(e);
    // Pieces j = 0 .. inner: from vertex (or `from`) to the next vertex (or `to`).
    Place nearest;
    double least = std::numeric_limits<double>::max();
    std::uint32_t nearest_piece = 0;
    for (std::uint32_t j = 0, k = from.k; j <= inner; ++j) {
      const Point p = point(contour[k]), q = point(contour[k + 1]);
      const double low = j == 0 ? from.t : 0, high = j == inner ? to.t : 1;
      const double t = std::clamp(fraction_along(p, q, at), low, high);
      const double d2 = distance2_between({p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)}, at);
      if (d2 < least) least = d2, nearest = {k, t}, nearest_piece = j;
      k = k + 1 < n ? k + 1 : 0;
    }
    if (least > tolerance2) return std::nullopt;
    const auto are_near = [&](Point end, std::uint32_t first, std::uint32_t last) {
      std::uint32_t k = from.k + first < n ? from.k + first : from.k + first - n;
      for (std::uint32_t j = first; j <= last; ++j) {
        if (segment_distance2(end, at, point(contour[k])) > tolerance2) return false;
        k = k + 1 < n ? k + 1 : 0;
      }
      return true;
    };
    if (!are_near(point(nodes_[a].p), 1, nearest_piece) ||
        !are_near(point(nodes_[d].p), nearest_piece + 1, inner))
      return std::nullopt;
    if (nearest.t >= 1) nearest = {nearest.k + 1 < n ? nearest.k + 1 : 0, 0};
    return nearest;
  }

  // How far along the ring's contour k is from another vertex.
  static std::uint32_t along(std::uint32_t from, std::uint32_t k, std::uint32_t n) {
    return k >= from ? k - from : k + n - from;
  }

  // Does the outline's edge from this node stand for the contour from vertex k on?
  bool stands_for(std::uint32_t i, std::uint32_t k, std::uint32_t n) const {
    const Place from = states_[i].place(), to = states_[nodes_[i].next].place();
    std::uint32_t to_k = along(from.k, k, n), to_end = along(from.k, to.k, n);
    if (to_k == 0 && from.t > 0) to_k = n;
    if (to_end == 0 && to.t < from.t) to_end = n;
    return to_k < to_end || (to_k == to_end && to.t > 0);
  }

  // The first node whose edge does, or begins and ends there; found from where it was the last
  // time. None has been seen to be missing: kNone.
  std::uint32_t node_at(std::uint32_t vertex) {
    std::uint32_t i = hints_[vertex];
    while (nodes_[i].next == kNone)
      i = nodes_[i].previous;
    const RingState& ring = rings_[states_[i].ring];
    const std::uint32_t k = vertex - ring.contour_first, n = ring.contour_size;
    const std::uint32_t ahead = along(states_[i].k, k, n);
    const bool is_ahead = ahead > 0 ? ahead <= n / 2 : states_[i].t == 0;
    std::uint32_t left = ring.size;
    for (; left > 0 && !stands_for(i, k, n); --left)
      i = is_ahead ? nodes_[i].next : nodes_[i].previous;
    if (left == 0) return kNone;
    hints_[vertex] = i;
    const auto begins_there = [&](std::uint32_t j) {
      return states_[j].k == k && states_[j].t == 0;
    };
    if (begins_there(i)) {
      for (; left > 0 && begins_there(nodes_[i].previous); --left)
        i = nodes_[i].previous;
    }
    return i;
  }

  // Do the new edges cross nothing, and is no vertex between them and the old ones?
  bool is_clear(const Path& path, const RingState& ring) {
    const LatticePoint a = path.a(), d = path.d(), e = path.e();
    LatticeBox box = box_around(a, e);
    for (std::size_t i = 1; i < path.size; ++i)
      widen(box, path.points[i]);
    const LatticeBox around{{box.low.x - reach_, box.low.y - reach_},
                            {box.high.x + reach_, box.high.y + reach_}};
    // Of a ring that becomes a triangle, the third edge meets both new ones.
    const std::uint32_t closing = ring.size == path.size ? path.nodes[path.size - 1] : kNone;
    const auto is_in_the_way = [&](std::uint32_t i) {
      const bool is_end = i == rings_[states_[i].ring].end;
      const LatticePoint p = nodes_[i].p, q = is_end ? p : nodes_[nodes_[i].next].p;
      if (apart(box_around(p, q), box) || i == closing) return false;
      for (std::size_t k = 0; k + 1 < path.size; ++k)
        if (i == path.nodes[k]) return false;
      const bool at_end = p == a || p == d;
      if (at_end && is_end) return false;
      // An edge from a to d, of a ring that touches this one, may be passed without a crossing.
      if (at_end && (q == a || q == d)) return true;
      if (!at_end && !apart({p, p}, box)) {
        for (std::size_t k = 1; k <= path.size; ++k)
          if (p == path.points[k]) return true;
        if (winding(path, p) != 0) return true;
      }
      return crosses(a, e, p, q) || crosses(e, d, p, q);
    };
    runs_.clear();
    grid_.any_near(around, [&](const ContourGrid::Run& run) {
      const auto at = std::find_if(runs_.begin(), runs_.end(), [&run](const ContourGrid::Run& r) {
        return run.first <= r.last + 1 && r.first <= run.last + 1;
      });
      if (at == runs_.end()) {
        runs_.push_back(run);
      } else {
        *at = {std::min(at->first, run.first), std::max(at->last, run.last), kNone};
      }
      return false;
    });
    return std::none_of(runs_.begin(), runs_.end(), [&](const ContourGrid::Run& run) {
      const std::uint32_t start = node_at(run.first);
      if (start == kNone) return true;
      const RingState& other = rings_[states_[start].ring];
      const std::uint32_t first = run.first - other.contour_first;
      std::uint32_t i = start;
      do {
        if (is_in_the_way(i)) return true;
        i = nodes_[i].next;
      } while (i != start &&
               along(first, states_[i].k, other.contour_size) <= run.last - run.first);
      return false;
    });
  }

  LatticePoint origin_;
  double tolerance2_;
  std::int32_t reach_;  // no less than the tolerance
  ContourGrid grid_;
  std::vector<Node> nodes_;
  std::vector<NodeState> states_;       // by node
  std::vector<ContourGrid::Run> runs_;  // of is_clear()
  std::vector<LatticePoint> points_;    // of the contours, each ring's first one again at its end
  std::vector<std::uint32_t> hints_;    // by vertex of the contours: where node_at() begins
  std::vector<RingState> rings_;
  bool is_queueing_ = false;
  Later later_{*this};
  std::vector<Ticket> tickets_;
};

}  // namespace

double left_for_refinement(double tolerance) {
  return std::max(kLeft * tolerance, std::min(kLeast, 0.5 * tolerance));
}

Pslg collapse_segments(const Pslg& contours, double tolerance, const std::vector<bool>& is_open) {
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
  Pslg out = Collapser(moved, is_open, at_origin, low, vertices, tolerance).run();
  for (Ring& ring : out.rings) {
    for (LatticePoint& p : ring)
      p = rotate.back({p.x + low.x, p.y + low.y});
  }
  return out;
}

}  // namespace trocar::pipeline
