// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/outline_sweep.h"

#include <numeric>
#include <set>
#include <tuple>

namespace trocar {
namespace {

// Left and right follow LatticePoint's order: of two points with equal x, the lower one counts as
// the left one. So no edge counts as vertical.
//
// The sweep line moves from left to right and meets edges, ordered from below to above. Until it
// reaches the first point where two edges cross, the order of any two edges does not change, and
// those two edges are neighbours just before that point, or begin there. Therefore it is enough to
// test pairs of edges when they become neighbours, and the edges next to a point where edges begin.

// An edge that the sweep line meets. If it ends where another edge begins, that edge takes its
// place in the set, and the order of the set does not change.
struct Met {
  mutable LatticePoint left, right;
  mutable const Met *below = nullptr, *above = nullptr;  // neighbours on the sweep line
  mutable std::uint32_t edge;
  mutable std::int32_t winding_below;
  mutable bool is_forwards;  // the edge runs from left to right, with the material above it

  std::int32_t winding_above() const { return winding_below + (is_forwards ? 1 : -1); }
  std::int32_t winding_right() const { return is_forwards ? winding_below : winding_below - 1; }
};

// The order from below to above. A point on an edge is neither below nor above it.
class Below {
 public:
  using is_transparent = void;
  explicit Below(std::uint64_t& tests) : tests_(&tests) {}

  std::int64_t side(const Met& e, LatticePoint p) const {
    ++*tests_;
    return orient2d(e.left, e.right, p);
  }
  bool operator()(const Met& e, LatticePoint p) const { return side(e, p) > 0; }
  bool operator()(LatticePoint p, const Met& e) const { return side(e, p) < 0; }
  bool operator()(const Met& e, const Met& f) const {
    if (e.left == f.left) return side(e, f.right) > 0;
    return e.left < f.left ? side(e, f.left) > 0 : side(f, e.left) < 0;
  }
  // Are the two edges in this order at the right end of the one that ends first? They must not end
  // in the same point. There are no branches, because it cannot be predicted which one ends first.
  bool is_in_order_at_end(const Met& lower, const Met& upper) const {
    const bool lower_ends = sort_key(lower.right) < sort_key(upper.right);
    const std::array<const Met*, 2> both{&lower, &upper};
    const std::int64_t turn = side(*both[lower_ends ? 1 : 0], both[lower_ends ? 0 : 1]->right);
    return (lower_ends ? -turn : turn) > 0;
  }

 private:
  // A number for each point. The numbers have the order of the points.
  static std::int64_t sort_key(LatticePoint p) {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(static_cast<std::uint32_t>(p.x))
                                         << 32 |
                                     (static_cast<std::uint32_t>(p.y) ^ 0x80000000U));
  }
  std::uint64_t* tests_;
};

// An edge that begins without taking the place of an edge that ends; and the edge just below it, or
// kNoSweepEdge.
constexpr std::uint32_t kNoSweepEdge = 0xffffffff;
struct Beginning {
  std::uint32_t edge, below;
};

// Optional outputs of the sweep.
struct Wanted {
  std::vector<std::int32_t>* right_of = nullptr;  // for each edge
  std::vector<Beginning>* beginnings = nullptr;
};

class Sweeper {
 public:
  Sweeper(const EdgeLoops& loops, std::span<const char> is_swept, const Wanted& wanted)
      : loops_(loops), is_swept_(is_swept), wanted_(wanted), position_(loops.points.size()) {
    if (wanted.right_of != nullptr) wanted.right_of->assign(loops.points.size(), 0);
  }

  SweepResult run(std::span<const std::uint32_t> order) {
    for (std::size_t i = 0; i < order.size() && !result_.crosses;) {
      const LatticePoint p = loops_.points[order[i]];
      std::size_t end = i + 1;
      while (end < order.size() && loops_.points[order[end]] == p)
        ++end;
      if (!(end == i + 1 && pass_on(order[i]))) pass(p, order.subspan(i, end - i));
      i = end;
    }
    return result_;
  }

 private:
  using Line = std::set<Met, Below>;

  bool is_swept(std::uint32_t edge) const { return is_swept_.empty() || is_swept_[edge] != 0; }

  // Handles a point where one edge ends and one begins; false if the point is of another kind.
  bool pass_on(std::uint32_t vertex) {
    const std::uint32_t in = loops_.previous[vertex];
    const LatticePoint p = loops_.points[vertex], from = loops_.points[in], to = loops_.to(vertex);
    if ((from < p) != (p < to) || !is_swept(in) || !is_swept(vertex)) return false;
    const bool is_forwards = from < p;
    const Line::iterator at = position_[is_forwards ? in : vertex];
    replace(at, p, is_forwards ? to : from, is_forwards ? vertex : in);
    if (at->below != nullptr) look_at(*at->below, *at);
    if (at->above != nullptr) look_at(*at, *at->above);
    return true;
  }

  void pass(LatticePoint p, std::span<const std::uint32_t> vertices) {
    begin_.clear();
    ends_.clear();
    for (const std::uint32_t v : vertices) {
      const std::uint32_t in = loops_.previous[v];
      for (const auto& [edge, other] :
           {std::pair{in, loops_.points[in]}, std::pair{v, loops_.to(v)}}) {
        if (!is_swept(edge)) continue;
        if (other < p)
          ends_.push_back(edge);
        else
          begin_.push_back({p, other, nullptr, nullptr, edge, 0, edge == v});
      }
    }
    Line::iterator above;
    if (ends_.empty()) {
      if (begin_.empty()) return;
      above = line_.lower_bound(p);
      if (above != line_.end() && line_.key_comp().side(*above, p) == 0)
        return found(*above, begin_.front());
    } else {
      // Edges that end in one point are neighbours.
      for (const std::uint32_t edge : ends_) {
        join(position_[edge]->below, position_[edge]->above);
        above = line_.erase(position_[edge]);
      }
    }
    std::sort(begin_.begin(), begin_.end(),
              [this](const Met& e, const Met& f) { return line_.key_comp().side(e, f.right) > 0; });
    for (std::size_t i = 0; i + 1 < begin_.size(); ++i) {
      if (line_.key_comp().side(begin_[i], begin_[i + 1].right) == 0)
        return found(begin_[i], begin_[i + 1]);
    }
    const Met* below = above == line_.begin() ? nullptr : &*std::prev(above);
    if (begin_.empty()) {
      if (below != nullptr && above != line_.end()) look_at(*below, *above);
      return;
    }
    if (below != nullptr) look_at(*below, begin_.front());
    if (above != line_.end()) look_at(begin_.back(), *above);
    if (result_.crosses) return;
    std::int32_t winding = below == nullptr ? 0 : below->winding_above();
    std::uint32_t edge_below = below == nullptr ? kNoSweepEdge : below->edge;
    for (Met& met : begin_) {
      if (wanted_.beginnings != nullptr) wanted_.beginnings->push_back({met.edge, edge_below});
      edge_below = met.edge;
      met.winding_below = winding;
      winding = met.winding_above();
      const Line::iterator at = line_.insert(above, met);
      join(below, &*at);
      join(&*at, above == line_.end() ? nullptr : &*above);
      below = &*at;
      position_[met.edge] = at;
      note(*at);
    }
  }

  static void join(const Met* lower, const Met* upper) {
    if (lower != nullptr) lower->above = upper;
    if (upper != nullptr) upper->below = lower;
  }

  void replace(Line::iterator at, LatticePoint left, LatticePoint right, std::uint32_t edge) {
    at->left = left;
    at->right = right;
    at->edge = edge;
    position_[edge] = at;
    note(*at);
  }

  void note(const Met& met) {
    const std::int32_t winding = met.winding_right();
    result_.winds_once = result_.winds_once && winding == 0;
    if (wanted_.right_of != nullptr) (*wanted_.right_of)[met.edge] = winding;
  }

  // Tests two neighbours. Until one of them ends, the lower one must stay below the other; only a
  // common end is allowed.
  void look_at(const Met& lower, const Met& upper) {
    if (lower.right == upper.right) return;
    if (!line_.key_comp().is_in_order_at_end(lower, upper)) found(lower, upper);
  }

  void found(const Met& one, const Met& other) {
    result_.crosses = true;
    result_.first = one.edge;
    result_.second = other.edge;
  }

  const EdgeLoops& loops_;
  std::span<const char> is_swept_;
  Wanted wanted_;
  SweepResult result_;
  Line line_{Below(result_.tests)};
  std::vector<Line::iterator> position_;  // position of each edge in line_
  std::vector<Met> begin_;                // workspace of pass()
  std::vector<std::uint32_t> ends_;
};

// Largest number of bits in a digit of the radix sort. The counts of all values of such a digit fit
// into the L1 cache.
constexpr int kMaxDigitBits = 11;

}  // namespace

void EdgeLoops::add(std::span<const LatticePoint> ring) {
  const auto first = static_cast<std::uint32_t>(points.size()),
             size = static_cast<std::uint32_t>(ring.size());
  points.insert(points.end(), ring.begin(), ring.end());
  for (std::uint32_t i = 0; i < size; ++i) {
    next.push_back(first + (i + 1 < size ? i + 1 : 0));
    previous.push_back(first + (i > 0 ? i : size) - 1);
  }
}

std::vector<std::uint32_t> in_sweep_order(std::span<const LatticePoint> points) {
  // Radix sort, beginning with the lowest digit. It has no unpredictable branches. Digits in which
  // all points agree are skipped.
  struct Key {
    std::uint64_t point;
    std::uint32_t number;
  };
  if (points.empty()) return {};
  const LatticeBox box = box_around(points);
  const auto above = [](std::int32_t c, std::int32_t low) {
    return static_cast<std::uint32_t>(c) - static_cast<std::uint32_t>(low);
  };
  const auto width = [](auto n) { return static_cast<int>(std::bit_width(n)); };
  const int y_bits = width(above(box.high.y, box.low.y)),
            bits = y_bits + width(above(box.high.x, box.low.x));
  std::vector<Key> keys(points.size()), sorted(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i)
    keys[i] = {
        std::uint64_t{above(points[i].x, box.low.x)} << y_bits | above(points[i].y, box.low.y), i};
  // Counting takes time for each value of a digit, so digits are chosen such that they have about
  // as many values as there are points.
  const int max_bits = std::clamp(width(points.size()), 6, kMaxDigitBits),
            passes = std::max(1, (bits + max_bits - 1) / max_bits),
            digit_bits = (bits + passes - 1) / passes;
  const std::uint64_t digits = (std::uint64_t{1} << digit_bits) - 1;
  std::vector<std::uint32_t> next;
  for (int shift = 0; shift < bits; shift += digit_bits) {
    next.assign(digits + 2, 0);
    for (const Key& k : keys)
      ++next[(k.point >> shift & digits) + 1];
    for (std::size_t d = 1; d < next.size(); ++d)
      next[d] += next[d - 1];
    for (const Key& k : keys)
      sorted[next[k.point >> shift & digits]++] = k;
    keys.swap(sorted);
  }
  std::vector<std::uint32_t> out(keys.size());
  std::transform(keys.begin(), keys.end(), out.begin(), [](const Key& k) { return k.number; });
  return out;
}

SweepResult sweep(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                  std::span<const char> is_swept, std::vector<std::int32_t>* right_of) {
  return Sweeper(loops, is_swept, {right_of, nullptr}).run(order);
}

std::optional<std::vector<std::uint32_t>> enclosing_rings(const std::vector<Ring>& rings) {
  EdgeLoops loops;
  std::vector<std::uint32_t> ring_of;  // ring of each edge
  for (const Ring& ring : rings) {
    ring_of.insert(ring_of.end(), ring.size(), static_cast<std::uint32_t>(&ring - rings.data()));
    loops.add(ring);
  }
  std::vector<std::int32_t> right_of;
  std::vector<Beginning> beginnings;
  const SweepResult swept =
      Sweeper(loops, {}, {&right_of, &beginnings}).run(in_sweep_order(loops.points));
  if (swept.crosses) return std::nullopt;
  // Along a ring that no other ring crosses, the winding number is constant.
  for (std::size_t e = 0; e < right_of.size(); ++e) {
    if (right_of[e] != right_of[loops.next[e]]) return std::nullopt;
  }
  constexpr std::uint32_t kUnknown = kNoRing - 1;
  std::vector<std::uint32_t> out(rings.size(), kUnknown);
  // The first beginning of a ring is the lower edge at its leftmost point. The edge below it
  // belongs to another ring, whose own first beginning was earlier.
  for (const auto& [edge, below] : beginnings) {
    std::uint32_t& around = out[ring_of[edge]];
    if (around != kUnknown) continue;
    around = kNoRing;
    if (below == kNoSweepEdge) continue;
    const std::uint32_t other = ring_of[below];
    const bool is_forwards =
        loops.points[below]<loops.to(below), is_outer = doubled_area(rings[other])> 0;
    around = is_forwards == is_outer ? other : out[other];
  }
  return out;
}

Result<void> check_no_crossing(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                               const SweepResult& swept, const char* what) {
  if (!swept.crosses) return {};
  // Find the shortest prefix of this list in which two edges cross.
  std::vector<std::uint32_t> edges(loops.points.size());
  std::iota(edges.begin(), edges.end(), 0U);
  std::sort(edges.begin(), edges.end(), [&loops](std::uint32_t e, std::uint32_t f) {
    const auto key = [&loops](std::uint32_t i) {
      const LatticePoint a = loops.points[i], b = loops.to(i);
      return std::tuple{std::min(a.x, b.x), a, b};
    };
    return key(e) < key(f);
  });
  std::vector<std::uint32_t> rank(edges.size());
  for (std::uint32_t i = 0; i < edges.size(); ++i)
    rank[edges[i]] = i;
  std::vector<char> is_swept(edges.size());
  const auto last_of = [&rank](const SweepResult& s) {
    return std::max(rank[s.first], rank[s.second]);
  };
  std::uint32_t last = last_of(swept);  // the list up to here has two edges that cross
  for (std::uint32_t low = 1; low < last;) {
    const std::uint32_t middle = low + (last - low) / 2;
    for (std::size_t e = 0; e < edges.size(); ++e)
      is_swept[e] = rank[e] <= middle ? 1 : 0;
    const SweepResult part = sweep(loops, order, is_swept);
    if (part.crosses)
      last = last_of(part);
    else
      low = middle + 1;
  }
  const LatticePoint p = loops.points[edges[last]];
  return refused(std::string(what) + " cross near " + to_text(p));
}

}  // namespace trocar
