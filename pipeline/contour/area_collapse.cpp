// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/area_collapse.h"

#include <queue>

#include "pipeline/contour/contour.h"

namespace trocar::pipeline {
namespace {

using namespace collapse;  // collapse_geometry.h

// Fraction of the tolerance that is left to refinement. Collapses use the tolerance up more evenly
// than Douglas-Peucker does: with less of it, they keep the outline nearer on average and still
// need fewer vertices.
constexpr double kRefinementFraction = 0.1, kMinRefinement_steps = 0.5;  // lattice steps
constexpr double kRounding = 1e-9;  // relative rounding error of a distance

// First, runs of up to kMaxRun edges are replaced by two edges if that moves the outline by less
// than the fraction kRunFraction of the tolerance.
constexpr std::size_t kSkip = 4;
constexpr double kRunFraction = 2.0 / 3;

// Then sweeps make the collapses whose mean displacement along the replaced edges is less than
// these fractions of the tolerance, in this order.
constexpr std::array kSweeps = {1.0 / 64, 1.0 / 32, 1.0 / 16};

// Finally, a queue makes the rest. It takes this many consecutive vertices of a ring at a time.
constexpr std::uint32_t kQueueChunk = 1024;

constexpr std::uint32_t kNoNode = 0xffffffff;

class Collapser {
 public:
  // The contours are in the canonical orientation, and the lower left corner of their box is at the
  // origin. An open contour has no edge from its last vertex to its first.
  Collapser(const Pslg& contours, const std::vector<bool>& is_open, const LatticeBox& box,
            LatticePoint origin, std::size_t vertices, double tolerance)
      : origin_(origin),
        tolerance2_(left_for_collapse(tolerance) * left_for_collapse(tolerance)),
        margin_(static_cast<std::int32_t>(std::min(tolerance, 1.0 * kMaxCoordinate)) + 1),
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
      rings_.push_back({first, n, on_contour, n, open ? first + n - 1 : kNoNode, 0});
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

  SimplifiedOutline run() {
    const std::vector<std::uint32_t> starts = starts_of_rings();
    for (const std::uint32_t start : starts)
      merge_runs(start);
    sweep(starts);
    is_queueing_ = true;
    for (const std::uint32_t start : starts)
      collapse_by_queue(start);
    SimplifiedOutline out;
    for (const RingState& ring : rings_) {
      out.outline.rings.emplace_back().reserve(ring.size);
      out.positions.emplace_back().reserve(ring.size);
      out.area_errors.push_back(ring.area_error);
      std::uint32_t i = ring.first;
      do {
        out.outline.rings.back().push_back(nodes_[i].p);
        out.positions.back().push_back(states_[i].position());
        i = nodes_[i].next;
      } while (i != ring.first);
    }
    return out;
  }

 private:
  struct RingState {
    std::uint32_t first, size;                  // a node of the ring, and the number of nodes
    std::uint32_t contour_first, contour_size;  // its contour's points in points_
    std::uint32_t end;                          // the last node of an open ring, else kNoNode
    std::int64_t area_error;                    // twice the contour's area minus twice the ring's
  };
  struct QueueEntry {
    double displacement;
    std::uint32_t node;
  };
  // Orders entries by displacement, the smallest first. Ties are broken by the original edge, which
  // no two nodes share.
  struct Later {
    const Collapser& collapser;
    bool operator()(const QueueEntry& s, const QueueEntry& t) const {
      if (s.displacement != t.displacement) return s.displacement > t.displacement;
      return collapser.original_edge(t.node) < collapser.original_edge(s.node);
    }
  };
  // The point that replaces a span's edge, and its position on the contour.
  struct Replacement {
    LatticePoint e;
    ContourPosition position;
  };

  // The contour's edge that started at this node before any collapse.
  std::array<double, 4> original_edge(std::uint32_t i) const {
    const std::size_t at = i + states_[i].ring;
    const Point p = point(points_[at]), next = point(points_[at + 1]);
    return {p.x, p.y, next.x, next.y};
  }

  Span span_of(std::uint32_t b) const {
    const std::uint32_t a = nodes_[b].previous, c = nodes_[b].next, d = nodes_[c].next;
    return {a, b, c, d, nodes_[a].p, nodes_[b].p, nodes_[c].p, nodes_[d].p};
  }

  // Returns the smallest vertex of each ring, so that the order of the input does not matter.
  std::vector<std::uint32_t> starts_of_rings() const {
    std::vector<std::uint32_t> starts;
    for (const RingState& ring : rings_) {
      const auto first = nodes_.begin() + ring.first;
      starts.push_back(static_cast<std::uint32_t>(
          std::min_element(first, first + ring.size,
                           [](const Node& m, const Node& n) { return m.p < n.p; }) -
          nodes_.begin()));
    }
    std::sort(starts.begin(), starts.end(), [this](std::uint32_t i, std::uint32_t j) {
      return original_edge(i) < original_edge(j);
    });
    return starts;
  }

  // Replaces runs of the contour by two edges where the two hardly differ from the run.
  void merge_runs(std::uint32_t start) {
    RingState& ring = rings_[states_[start].ring];
    std::uint32_t i = start;
    std::size_t most = kMaxRun;  // a long run is tried only after one nearly as long was merged
    for (std::size_t left = ring.size; left > 2 * kMaxRun;) {
      std::size_t edges = most;
      while (edges > 2 && !merge(i, edges, ring))
        edges /= 2;
      most = std::clamp<std::size_t>(2 * edges, 4, kMaxRun);
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
    const auto [at, area, doubled] = ideal_for_run(path, base2, ring.area_error);
    const auto near = nearest(at);
    if (!near) return false;
    const LatticePoint e = rounded(a, d, *near, at, area);
    if (!is_on_lattice({e.x + origin_.x, e.y + origin_.y})) return false;
    const std::int64_t side = orient2d(a, e, d);
    if (side == 0 && !is_inside_segment(a, d, e)) return false;
    path.points[path.size] = e;
    const auto position = position_within(contour_part(first, path.nodes[edges]), a, d, e,
                                          kRunFraction * kRunFraction * tolerance2_);
    if (!position || !is_clear(path, ring)) return false;
    ring.area_error -= side - doubled;
    ring.size -= static_cast<std::uint32_t>(edges - 2);
    if (ring.end == kNoNode) ring.first = first;
    const std::uint32_t kept = path.nodes[1], last = path.nodes[edges];
    for (std::size_t k = 2; k < edges; ++k)
      nodes_[path.nodes[k]] = {{}, kept, kNoNode};
    nodes_[kept] = {e, first, last};
    states_[kept].put(*position);
    nodes_[last].previous = kept;
    return true;
  }

  // Makes the collapses that hardly move the outline, which are most of them, in ring order. This
  // is much faster than the queue.
  void sweep(const std::vector<std::uint32_t>& starts) {
    for (std::uint32_t start : starts) {
      const RingState& ring = rings_[states_[start].ring];
      for (const double fraction : kSweeps) {
        std::uint32_t i = start;
        for (std::uint32_t left = ring.size; left > 0 && ring.size > 3; --left) {
          const double moved = displacement(i);
          const std::uint32_t c = nodes_[i].next;
          const LatticePoint a = nodes_[nodes_[i].previous].p, d = nodes_[nodes_[c].next].p;
          if (moved * moved <=
                  fraction * fraction * tolerance2_ * static_cast<double>(distance2(a, d)) &&
              collapse(i) && start == c)
            start = i;
          i = nodes_[i].next;
        }
      }
    }
  }

  // Makes collapses in the order of displacement, within one chunk of the ring after the other:
  // distant collapses do not affect each other, and a chunk stays in the cache.
  void collapse_by_queue(std::uint32_t start) {
    std::uint32_t i = start;
    for (std::uint32_t left = rings_[states_[start].ring].size; left > 0;) {
      while (nodes_[i].next == kNoNode)
        i = nodes_[i].previous;
      for (std::uint32_t k = 0; k < kQueueChunk && left > 0; ++k, --left) {
        queue(i);
        i = nodes_[i].next;
      }
      empty_queue();
    }
  }

  void empty_queue() {
    while (!entries_.empty()) {
      const QueueEntry entry = entries_.top();
      entries_.pop();
      NodeState& node = states_[entry.node];
      if (entry.displacement != node.queued) continue;
      node.queued = kNever;
      if (node.displacement == entry.displacement) {
        node.displacement = kNever;
        collapse(entry.node);
      } else if (node.displacement != kNever) {
        push(entry.node);
      }
    }
  }

  // Queues a node. If its displacement grows later, the entry is queued again when its turn comes.
  void queue(std::uint32_t b) {
    NodeState& node = states_[b];
    if (rings_[node.ring].size <= 3)
      node.displacement = kNever;
    else if (displacement(b) < node.queued)
      push(b);
  }
  double displacement(std::uint32_t b) {
    NodeState& node = states_[b];
    if (node.displacement == kUnknown) {
      const Span s = span_of(b);
      node.displacement = kNever;
      const std::uint32_t end = rings_[node.ring].end;
      if (end != kNoNode && (s.ia == end || s.ib == end || s.ic == end)) return kNever;
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
    entries_.push({states_[b].displacement, b});
  }

  bool collapse(std::uint32_t b) {
    const Span s = span_of(b);
    RingState& ring = rings_[states_[b].ring];
    if (ring.size <= 3) return false;
    const std::optional<Replacement> found = replacement(s, ring);
    if (!found) return false;
    ring.area_error -= orient2d(s.a, found->e, s.d) - s.doubled();
    --ring.size;
    if (ring.first == s.ic) ring.first = s.ib;
    states_[s.ic].queued = states_[s.ic].displacement = kNever;
    nodes_[s.ic].next = kNoNode;
    nodes_[s.ib].p = found->e;
    states_[s.ib].put(found->position);
    nodes_[s.ib].next = s.id;
    nodes_[s.id].previous = s.ib;
    const std::array changed{nodes_[s.ia].previous, s.ia, s.ib, s.id};
    for (const std::uint32_t i : changed)
      states_[i].displacement = kUnknown;
    for (std::size_t k = 0; is_queueing_ && k < changed.size(); ++k)
      queue(changed[k]);
    return true;
  }

  std::optional<Replacement> replacement(const Span& s, const RingState& ring) {
    if (s.a == s.d) return std::nullopt;
    const std::array path{point(s.a), point(s.b), point(s.c), point(s.d)};
    // The point makes up for at most one lattice step's height of the ring's area error, since a
    // larger correction would be visible.
    const double most = std::sqrt(static_cast<double>(distance2(s.a, s.d)));
    const double area = static_cast<double>(s.doubled()) +
                        std::clamp(static_cast<double>(ring.area_error), -most, most);
    for (const Ideal& ideal : ideals(s, area)) {
      if (ideal.displacement == kNever) break;
      const std::optional<LatticePoint> near = nearest(ideal.at);
      if (!near) continue;
      // A vertex on the line between its neighbours is dropped, and no point moves.
      const bool is_exact =
          (*near == s.b || *near == s.c) && orient2d(s.a, *near, s.d) == s.doubled();
      const LatticePoint e = is_exact ? *near : rounded(s.a, s.d, *near, ideal.at, area);
      if (!is_on_lattice({e.x + origin_.x, e.y + origin_.y}) || is_too_far(path, point(e)))
        continue;
      const std::int64_t side = orient2d(s.a, e, s.d);
      if (side == 0 && !is_inside_segment(s.a, s.d, e)) continue;
      if (ring.size == 4 && (side > 0) != (s.doubled() > 0)) continue;
      const std::optional<ContourPosition> position =
          position_within(contour_part(s.ia, s.id), s.a, s.d, e, tolerance2_);
      const Path replaced{{s.ia, s.ib, s.ic, s.id}, {s.a, s.b, s.c, s.d, e}, 4};
      if (position && is_clear(replaced, ring)) return Replacement{e, *position};
    }
    return std::nullopt;
  }

  // Is e so far from the present outline that it must be too far from the contour?
  bool is_too_far(const std::array<Point, 4>& path, Point e) const {
    const double most2 = 4.001 * tolerance2_;
    for (std::size_t i = 0; i < 3; ++i)
      if (segment_distance2(path[i], path[i + 1], e) <= most2) return false;
    return true;
  }

  // The part of the contour that the outline from node a to node d replaces.
  ContourPart contour_part(std::uint32_t a, std::uint32_t d) const {
    const RingState& ring = rings_[states_[a].ring];
    return {points_.data() + ring.contour_first, ring.contour_size, states_[a].position(),
            states_[d].position()};
  }

  // Does the outline's edge from this node replace the contour's edge from vertex k?
  bool replaces(std::uint32_t i, std::uint32_t k, std::uint32_t n) const {
    const ContourPosition from = states_[i].position(), to = states_[nodes_[i].next].position();
    std::uint32_t to_k = along(from.k, k, n), to_end = along(from.k, to.k, n);
    if (to_k == 0 && from.t > 0) to_k = n;
    if (to_end == 0 && to.t < from.t) to_end = n;
    return to_k < to_end || (to_k == to_end && to.t > 0);
  }

  // The first node whose edge replaces the contour's edge from `vertex`, or begins and ends there.
  // The search starts at the node found the last time. Returns kNoNode if there is none, which has
  // never been observed.
  std::uint32_t node_at(std::uint32_t vertex) {
    std::uint32_t i = hints_[vertex];
    while (nodes_[i].next == kNoNode)
      i = nodes_[i].previous;
    const RingState& ring = rings_[states_[i].ring];
    const std::uint32_t k = vertex - ring.contour_first, n = ring.contour_size;
    const std::uint32_t ahead = along(states_[i].k, k, n);
    const bool is_ahead = ahead > 0 ? ahead <= n / 2 : states_[i].t == 0;
    std::uint32_t left = ring.size;
    for (; left > 0 && !replaces(i, k, n); --left)
      i = is_ahead ? nodes_[i].next : nodes_[i].previous;
    if (left == 0) return kNoNode;
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

  // Do the new edges cross nothing, and does no vertex lie between them and the old ones?
  bool is_clear(const Path& path, const RingState& ring) {
    LatticeBox box = box_around(path.a(), path.e());
    for (std::size_t i = 1; i < path.size; ++i)
      widen(box, path.points[i]);
    const LatticeBox around = widened(box, margin_);
    // If the ring becomes a triangle, its third edge meets both new ones.
    const std::uint32_t closing = ring.size == path.size ? path.nodes[path.size - 1] : kNoNode;
    const auto blocks = [&](std::uint32_t i) {
      const bool is_end = i == rings_[states_[i].ring].end;
      const LatticePoint p = nodes_[i].p, q = is_end ? p : nodes_[nodes_[i].next].p;
      if (apart(box_around(p, q), box) || i == closing) return false;
      for (std::size_t k = 0; k + 1 < path.size; ++k)
        if (i == path.nodes[k]) return false;
      return meets(path, box, p, q, is_end);
    };
    runs_.clear();
    grid_.any_near(around, [&](const ContourGrid::Run& run) {
      const auto at = std::find_if(runs_.begin(), runs_.end(), [&run](const ContourGrid::Run& r) {
        return run.first <= r.last + 1 && r.first <= run.last + 1;
      });
      if (at == runs_.end())
        runs_.push_back(run);
      else
        *at = {std::min(at->first, run.first), std::max(at->last, run.last), kNoNode};
      return false;
    });
    return std::none_of(runs_.begin(), runs_.end(), [&](const ContourGrid::Run& run) {
      const std::uint32_t start = node_at(run.first);
      if (start == kNoNode) return true;
      const RingState& other = rings_[states_[start].ring];
      const std::uint32_t first = run.first - other.contour_first;
      std::uint32_t i = start;
      do {
        if (blocks(i)) return true;
        i = nodes_[i].next;
      } while (i != start &&
               along(first, states_[i].k, other.contour_size) <= run.last - run.first);
      return false;
    });
  }

  LatticePoint origin_;
  double tolerance2_;
  std::int32_t margin_;  // at least the tolerance
  ContourGrid grid_;
  std::vector<Node> nodes_;
  std::vector<NodeState> states_;       // by node
  std::vector<ContourGrid::Run> runs_;  // scratch of is_clear()
  std::vector<LatticePoint> points_;    // contours, each closed by a copy of its first point
  std::vector<std::uint32_t> hints_;    // start of node_at() by vertex of the contours
  std::vector<RingState> rings_;
  bool is_queueing_ = false;
  std::priority_queue<QueueEntry, std::vector<QueueEntry>, Later> entries_{Later{*this}};
};

}  // namespace

double left_for_refinement(double tolerance) {
  return std::max(kRefinementFraction * tolerance, std::min(kMinRefinement_steps, 0.5 * tolerance));
}

double left_for_collapse(double tolerance) {
  return (1 - kRounding) * (tolerance - left_for_refinement(tolerance));
}

SimplifiedOutline collapse_segments(const Pslg& contours, double tolerance,
                                    const std::vector<bool>& is_open) {
  std::size_t vertices = 0;
  for (const Ring& ring : contours.rings)
    vertices += ring.size();
  if (vertices == 0) return {contours, {}, {}};
  // If the outline is moved or rotated by a quarter turn, the result moves and rotates with it.
  const CanonicalFrame frame(contours);
  const auto& [low, high] = frame.box();
  const LatticeBox box{{0, 0}, {high.x - low.x, high.y - low.y}};
  Pslg moved = contours;
  frame.enter(moved.rings);
  SimplifiedOutline out = Collapser(moved, is_open, box, low, vertices, tolerance).run();
  frame.leave(out.outline.rings);
  return out;
}

}  // namespace trocar::pipeline
