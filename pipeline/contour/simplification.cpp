// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/simplification.h"

#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "formats/base/disjoint_sets.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/outline_sweep.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/segment_grid.h"
#include "pipeline/contour/area_collapse.h"
#include "pipeline/contour/collapse_geometry.h"
#include "pipeline/contour/label_borders.h"
#include "pipeline/contour/outline_clearance.h"

namespace trocar::pipeline {
namespace {

// A contour and those of its vertices that are kept. A span runs from one kept vertex to the next;
// unless the contour is open, the last span runs on to the first vertex.
struct Simplified {
  const Ring* contour;
  bool is_open;
  std::vector<std::uint32_t> kept;  // ascending

  std::uint32_t size() const { return static_cast<std::uint32_t>(contour->size()); }
  LatticePoint at(std::uint32_t i) const { return (*contour)[i % size()]; }

  // The inner vertex of the span from i to j that is farthest from the chord, and its squared
  // distance. The index j may exceed the size.
  std::pair<std::uint32_t, double> farthest(std::uint32_t i, std::uint32_t j) const {
    std::pair<std::uint32_t, double> best{i, -1.0};
    const Point a = point(at(i)), b = point(at(j));
    const std::uint32_t n = size();
    for (std::uint32_t k = i + 1; k < j; ++k) {
      const double d = segment_distance2(a, b, point((*contour)[k < n ? k : k - n]));
      if (d > best.second) best = {k, d};
    }
    return best;
  }

  std::size_t spans() const { return kept.size() - (is_open ? 1 : 0); }
  std::uint32_t span_end(std::size_t k) const {
    return k + 1 < kept.size() ? kept[k + 1] : kept[0] + size();
  }

  Ring ring() const {
    Ring out;
    for (std::uint32_t k : kept)
      out.push_back((*contour)[k]);
    return out;
  }
};

void keep_between(const Simplified& s, std::uint32_t first, std::uint32_t last, double tolerance2,
                  std::vector<std::uint32_t>& kept) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> spans{{first, last}};
  while (!spans.empty()) {
    const auto [i, j] = spans.back();
    spans.pop_back();
    const auto [k, d2] = s.farthest(i, j);
    if (d2 <= tolerance2) continue;
    kept.push_back(k % s.size());
    spans.emplace_back(i, k);
    spans.emplace_back(k, j);
  }
}

// The vertices farthest from the mean of all vertices; if there is only one, also those farthest
// from that one. Equally distant vertices are all taken, and the arithmetic is exact, so that the
// choice does not depend on the outline's first vertex, position or rotation.
std::vector<std::uint32_t> extreme_vertices(const Ring& contour) {
  const auto n = static_cast<std::int64_t>(contour.size());
  const LatticePoint origin = contour[0];
  std::int64_t sum_x = 0, sum_y = 0;
  for (const LatticePoint p : contour) {
    sum_x += std::int64_t{p.x} - origin.x;
    sum_y += std::int64_t{p.y} - origin.y;
  }
  std::vector<std::uint32_t> out;
  const auto add_farthest = [&](auto distance2_of) {
    Int128 most = -1;
    std::vector<std::uint32_t> farthest;
    for (std::uint32_t i = 0; i < contour.size(); ++i) {
      const Int128 d = distance2_of(contour[i]);
      if (d > most) farthest.clear();
      if (d >= most) farthest.push_back(i);
      most = std::max(most, d);
    }
    out.insert(out.end(), farthest.begin(), farthest.end());
  };
  add_farthest([&](LatticePoint p) {
    const Int128 x = n * (std::int64_t{p.x} - origin.x) - sum_x,
                 y = n * (std::int64_t{p.y} - origin.y) - sum_y;
    return x * x + y * y;
  });
  if (out.size() == 1) {
    const LatticePoint first = contour[out[0]];
    add_farthest([first](LatticePoint p) { return Int128{distance2(first, p)}; });
  }
  std::sort(out.begin(), out.end());
  return out;
}

Simplified simplified(const Ring& contour, bool is_open, double tolerance2) {
  const std::uint32_t last = static_cast<std::uint32_t>(contour.size()) - 1;
  const Simplified from{&contour, is_open,
                        is_open ? std::vector<std::uint32_t>{0, last} : extreme_vertices(contour)};
  Simplified out = from;
  for (std::size_t k = 0; k < from.spans(); ++k)
    keep_between(from, from.kept[k], from.span_end(k), tolerance2, out.kept);
  std::sort(out.kept.begin(), out.kept.end());
  return out;
}

std::vector<Ring> rings_of(const std::vector<Simplified>& rings) {
  std::vector<Ring> out;
  out.reserve(rings.size());
  for (const Simplified& s : rings)
    out.push_back(s.ring());
  return out;
}

void mark_all(std::vector<char>& marks) {
  std::fill(marks.begin(), marks.end(), char{1});
}

// Marks every span whose chord crosses another one; returns whether there is any.
bool mark_crossings(const std::vector<Simplified>& rings, std::vector<std::vector<char>>& marks) {
  std::vector<LatticeSegment> chords;
  std::vector<char*> marks_of;  // by chord
  for (std::size_t r = 0; r < rings.size(); ++r) {
    for (std::size_t k = 0; k < rings[r].spans(); ++k) {
      chords.push_back({rings[r].at(rings[r].kept[k]), rings[r].at(rings[r].span_end(k))});
      marks_of.push_back(&marks[r][k]);
    }
  }
  bool any = false;
  SegmentGrid(chords, 0).for_each_pair([&](std::uint32_t i, std::uint32_t j) {
    const auto& [a, b] = chords[i];
    const auto& [c, d] = chords[j];
    if ((*marks_of[i] != 0 && *marks_of[j] != 0) || apart(box_around(a, b), box_around(c, d)) ||
        !segments_cross(a, b, c, d))
      return;
    *marks_of[i] = *marks_of[j] = 1;
    any = true;
  });
  return any;
}

// Is the ring q inside the simple ring r, which it does not cross? The middle of an edge of q lies
// on no edge of r, so it decides for all of q, even if all vertices of q touch r.
bool is_inside(const Ring& q, const Ring& r) {
  return is_inside_ring(std::int64_t{q[0].x} + q[1].x, std::int64_t{q[0].y} + q[1].y, r);
}

// The same as mark_jumps(), by testing all pairs of rings.
bool mark_jumps_by_pairs(const std::vector<Simplified>& rings, const std::vector<Ring>& now,
                         std::vector<std::vector<char>>& marks) {
  bool any = false;
  std::vector<LatticeBox> boxes;
  boxes.reserve(rings.size());
  for (const Simplified& s : rings)
    boxes.push_back(box_around(*s.contour));
  const auto jumps = [&](std::size_t q, std::size_t r) {
    return is_inside(*rings[q].contour, *rings[r].contour) != is_inside(now[q], now[r]);
  };
  // Sorting by x restricts the comparisons to rings that overlap in x.
  std::vector<std::size_t> order(rings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&boxes](std::size_t r, std::size_t q) { return boxes[r].low.x < boxes[q].low.x; });
  for (auto i = order.begin(); i != order.end(); ++i) {
    for (auto j = i + 1; j != order.end() && boxes[*j].low.x <= boxes[*i].high.x; ++j) {
      if (apart(boxes[*i], boxes[*j]) || (!jumps(*i, *j) && !jumps(*j, *i))) continue;
      mark_all(marks[*i]);
      mark_all(marks[*j]);
      any = true;
    }
  }
  return any;
}

using EnclosingRings = std::optional<std::vector<std::uint32_t>>;  // result of enclosing_rings()

// Marks both rings of each pair in which one ring is inside the other before simplification but not
// afterwards, or the reverse. This can happen without a crossing. `before` belongs to the contours.
bool mark_jumps(const std::vector<Simplified>& rings, const EnclosingRings& before,
                std::vector<std::vector<char>>& marks) {
  const std::vector<Ring> now = rings_of(rings);
  const EnclosingRings after = enclosing_rings(now);
  if (!before || !after) return mark_jumps_by_pairs(rings, now, marks);
  if (*before == *after) return false;
  const auto all_enclosing = [](const std::vector<std::uint32_t>& around, std::uint32_t ring) {
    std::vector<std::uint32_t> out;
    while ((ring = around[ring]) != kNoRing)
      out.push_back(ring);
    std::sort(out.begin(), out.end());
    return out;
  };
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const auto first = all_enclosing(*before, r), last = all_enclosing(*after, r);
    std::vector<std::uint32_t> changed;
    std::set_symmetric_difference(first.begin(), first.end(), last.begin(), last.end(),
                                  std::back_inserter(changed));
    if (!changed.empty()) mark_all(marks[r]);
    for (const std::uint32_t other : changed)
      mark_all(marks[other]);
  }
  return true;
}

// Is p outside the closed path from vertex i of the contour to vertex j and back along the chord?
// A point on the path is not outside.
bool is_outside_span(const Simplified& s, std::uint32_t i, std::uint32_t j, LatticePoint p) {
  bool is_between = false;
  for (std::uint32_t k = i; k <= j; ++k) {
    const LatticePoint a = s.at(k), b = s.at(k < j ? k + 1 : i);
    if (is_on_segment(a, b, p)) return false;
    if ((a.y > p.y) != (b.y > p.y) && (orient2d(a, b, p) > 0) == (b.y > a.y))
      is_between = !is_between;
  }
  return !is_between;
}

// A quick test: true means that no ring jumps, false means that mark_jumps() has to decide. Rings
// that do not cross, before simplification and after it, jump only if a vertex kept by
// simplification lies between a span of another ring and its chord. It suffices to test one kept
// vertex of each ring.
bool is_free_of_jumps(const std::vector<Simplified>& rings) {
  // Sort the vertices into the cells of a grid.
  std::vector<LatticePoint> points;
  std::size_t spans = 0;
  for (const Simplified& s : rings) {
    points.push_back(s.at(s.kept[0]));
    spans += s.spans();
  }
  if (points.size() < 2) return true;
  const LatticeCells cells(box_around(points), static_cast<double>(points.size()));
  const auto cell = [&cells](std::int32_t at, std::int32_t low, std::int32_t count) {
    const double number = (static_cast<double>(at) - low) / cells.size;
    return static_cast<std::int32_t>(std::clamp(number, -1.0, static_cast<double>(count)));
  };
  const auto column = [&](std::int32_t x) { return cell(x, cells.low.x, cells.columns); };
  const auto row = [&](std::int32_t y) { return cell(y, cells.low.y, cells.rows); };
  const auto number = [&cells](std::int32_t x, std::int32_t y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(cells.columns) +
           static_cast<std::size_t>(x);
  };
  std::vector<std::uint32_t> first(cells.count() + 1, 0), ring_of(points.size());
  for (const LatticePoint p : points)
    ++first[number(column(p.x), row(p.y)) + 1];
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t q = 0; q < points.size(); ++q)
    ring_of[next[number(column(points[q].x), row(points[q].y))]++] = q;

  // Long spans meet many cells, so the work is bounded.
  std::size_t cells_left = 16 * (spans + points.size());
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const Simplified& s = rings[r];
    for (std::size_t k = 0; k < s.spans(); ++k) {
      const std::uint32_t i = s.kept[k], j = s.span_end(k);
      LatticeBox box = box_around(s.at(i), s.at(j));
      for (std::uint32_t m = i + 1; m < j; ++m)
        widen(box, s.at(m));
      const std::int32_t left = std::max(column(box.low.x), 0),
                         right = std::min(column(box.high.x), cells.columns - 1),
                         low = std::max(row(box.low.y), 0),
                         high = std::min(row(box.high.y), cells.rows - 1);
      for (std::int32_t y = low; y <= high; ++y) {
        for (std::int32_t x = left; x <= right; ++x) {
          if (cells_left-- == 0) return false;
          for (std::size_t at = first[number(x, y)]; at < first[number(x, y) + 1]; ++at) {
            const std::uint32_t q = ring_of[at];
            if (q != r && !apart(box, {points[q], points[q]}) &&
                !is_outside_span(s, i, j, points[q]))
              return false;
          }
        }
      }
    }
  }
  return true;
}

bool mark_by(const MarkMisplaced& mark_misplaced, const std::vector<Simplified>& rings,
             std::vector<std::vector<char>>& marks) {
  const std::vector<Ring> now = rings_of(rings);
  std::vector<char> is_misplaced(rings.size(), 0);
  mark_misplaced(now, is_misplaced);
  bool any = false;
  for (std::size_t r = 0; r < rings.size(); ++r) {
    if (is_misplaced[r] == 0) continue;
    mark_all(marks[r]);
    any = true;
  }
  return any;
}

bool rotation_may_map_to_itself(const Pslg& outline) {
  const CentroidOffset offset = collapse::centroid_offset(outline);
  return offset.x() == 0 && offset.y() == 0;
}

// If `is_open` is given, lines for which it holds are open, and `mark_misplaced` must be given too.
SimplifiedOutline douglas_peucker(const Pslg& contours, double tolerance,
                                  const std::vector<bool>& is_open,
                                  const MarkMisplaced& mark_misplaced) {
  std::vector<Simplified> rings;
  for (std::size_t r = 0; r < contours.rings.size(); ++r) {
    const bool open = !is_open.empty() && is_open[r];
    rings.push_back(simplified(contours.rings[r], open, tolerance * tolerance));
  }

  std::optional<EnclosingRings> around;  // for the contours, computed when first needed

  // Split every span that takes part in a violation at its farthest vertex, until there is no
  // violation. At the latest this ends with the contours themselves, which are valid.
  while (true) {
    std::vector<std::vector<char>> marks;
    marks.reserve(rings.size());
    for (const Simplified& s : rings)
      marks.emplace_back(s.kept.size(), char{0});
    bool any = false;
    for (std::size_t r = 0; r < rings.size(); ++r) {
      if (rings[r].is_open) continue;
      const bool collapsed = rings[r].kept.size() < 3 || (doubled_area(rings[r].ring()) > 0) !=
                                                             (doubled_area(*rings[r].contour) > 0);
      if (collapsed) {
        mark_all(marks[r]);
        any = true;
      }
    }
    any = mark_crossings(rings, marks) || any;
    if (!any && mark_misplaced) {
      any = mark_by(mark_misplaced, rings, marks);
    } else if (!any && !is_free_of_jumps(rings)) {
      if (!around) around = enclosing_rings(contours.rings);
      any = mark_jumps(rings, *around, marks);
    }
    if (!any) break;
    bool split = false;
    for (std::size_t r = 0; r < rings.size(); ++r) {
      Simplified& s = rings[r];
      const Simplified before = s;
      for (std::size_t k = 0; k < before.spans(); ++k) {
        if (marks[r][k] == 0) continue;
        const std::uint32_t i = before.kept[k], j = before.span_end(k);
        if (j - i < 2) continue;
        const std::uint32_t m = s.farthest(i, j).first;
        s.kept.push_back(m % s.size());
        // The halves' chords are new: the tolerance applies to them too.
        keep_between(s, i, m, tolerance * tolerance, s.kept);
        keep_between(s, m, j, tolerance * tolerance, s.kept);
        split = true;
      }
      std::sort(s.kept.begin(), s.kept.end());
    }
    if (!split) break;  // the contours themselves are invalid; the caller's check reports it
  }

  SimplifiedOutline out;
  for (const Simplified& s : rings) {
    out.outline.rings.push_back(s.ring());
    out.positions.emplace_back().reserve(s.kept.size());
    for (const std::uint32_t k : s.kept)
      out.positions.back().push_back({k, 0});
  }
  out.area_errors.assign(rings.size(), 0);
  return out;
}

// Compares simplified chains, which do not cross, with the original chains. The two embeddings are
// topologically equal if at every node the chains leave in the same order, each loop around a
// material has the same orientation, and each connected component of the borders lies inside the
// same loops of the other components.
class Embedding {
 public:
  explicit Embedding(const LabelBorders& borders) : borders_(borders), components_(chains()) {
    for (const BorderNode& node : borders.nodes) {
      for (int k = 1; k < node.count; ++k)
        components_.join(node.ends[0].chain, node.ends[static_cast<std::size_t>(k)].chain);
    }
    members_.resize(chains());
    for (std::uint32_t c = 0; c < chains(); ++c)
      members_[components_.root(c)].push_back(c);
    const auto is_any = [](MaterialNumber /*m*/) { return true; };
    for_loops(borders, is_any, std::equal_to<>{},
              [this](const ChainLoop& loop) { loops_.push_back(loop); });
    for (const ChainLoop& loop : loops_)
      rings_.push_back(loop.ring(borders));
    for (std::uint32_t i = 0; i < loops_.size(); ++i)
      boxes_.push_back({box_around(rings_[i]), i, true});
    for (std::uint32_t c = 0; c < chains(); ++c) {
      if (members_[c].empty()) continue;
      LatticeBox box = box_around(borders.chains[c].points);
      for (const std::uint32_t member : members_[c])
        widen(box, borders.chains[member].points);
      boxes_.push_back({box, c, false});
    }
    std::sort(boxes_.begin(), boxes_.end(),
              [](const Boxed& a, const Boxed& b) { return a.box.low.x < b.box.low.x; });
  }

  void mark_differences(const std::vector<Ring>& lines, std::vector<char>& marks) {
    for (const BorderNode& node : borders_.nodes) {
      if (is_in_order(node, lines)) continue;
      for (int k = 0; k < node.count; ++k)
        marks[node.ends[static_cast<std::size_t>(k)].chain] = 1;
    }
    LabelBorders now = borders_;
    for (std::size_t c = 0; c < lines.size(); ++c)
      now.chains[c].points = lines[c];
    std::vector<Ring> rings_now;
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      rings_now.push_back(loops_[i].ring(now));
      const std::int64_t area = doubled_area(rings_now[i]);
      if (area == 0 || (area > 0) != (doubled_area(rings_[i]) > 0)) mark_loop(i, marks);
    }
    for (auto i = boxes_.begin(); i != boxes_.end(); ++i) {
      for (auto j = i + 1; j != boxes_.end() && j->box.low.x <= i->box.high.x; ++j) {
        if (i->is_loop == j->is_loop || apart(i->box, j->box)) continue;
        const auto& [loop, other] = i->is_loop ? std::pair{*i, *j} : std::pair{*j, *i};
        if (components_.root(loops_[loop.index].chains[0] / 2) == other.index) continue;
        if (is_inside(borders_.chains[other.index].points, rings_[loop.index]) ==
            is_inside(lines[other.index], rings_now[loop.index]))
          continue;
        mark_loop(loop.index, marks);
        for (const std::uint32_t c : members_[other.index])
          marks[c] = 1;
      }
    }
  }

 private:
  // A loop, or a connected component of the borders.
  struct Boxed {
    LatticeBox box;
    std::uint32_t index;
    bool is_loop;
  };

  std::size_t chains() const { return borders_.chains.size(); }

  void mark_loop(std::size_t i, std::vector<char>& marks) const {
    for (const DirectedChain d : loops_[i].chains)
      marks[d / 2] = 1;
  }

  // The middle of an edge lies on no edge of another component's loop, so it decides for the line.
  static bool is_inside(const Ring& line, const Ring& loop) {
    return is_inside_ring(std::int64_t{line[0].x} + line[1].x, std::int64_t{line[0].y} + line[1].y,
                          loop);
  }

  // Do the node's first edges follow each other counter-clockwise within one turn?
  static bool is_in_order(const BorderNode& node, const std::vector<Ring>& lines) {
    constexpr LatticePoint kOrigin{0, 0};
    std::vector<LatticePoint> way;
    for (int k = 0; k < node.count; ++k) {
      const BorderNode::End end = node.ends[static_cast<std::size_t>(k)];
      const Ring& line = lines[end.chain];
      const LatticePoint next = end.is_start ? line[1] : line[line.size() - 2];
      way.push_back({next.x - node.at.x, next.y - node.at.y});
    }
    // Sorts by the angle from the first edge, in [0, 360) degrees.
    const auto half = [&](LatticePoint p) {
      const std::int64_t side = orient2d(kOrigin, way[0], p);
      return side > 0 ? 1 : side < 0 ? 3 : diametral_dot(way[0], p, kOrigin) > 0 ? 0 : 2;
    };
    for (std::size_t k = 1; k < way.size(); ++k) {
      const int before = half(way[k - 1]), after = half(way[k]);
      if (after == 0 || after < before) return false;
      if (after == before && orient2d(kOrigin, way[k - 1], way[k]) <= 0) return false;
    }
    return true;
  }

  const LabelBorders& borders_;
  DisjointSets components_;                          // the root is the component's first chain
  std::vector<std::vector<std::uint32_t>> members_;  // chains of each component, by its root
  std::vector<ChainLoop> loops_;
  std::vector<Ring> rings_;
  std::vector<Boxed> boxes_;
};

Pslg simplify_lines(const Pslg& lines, const std::vector<bool>& is_open, const Lattice& lattice,
                    const SimplificationOptions& options, const MarkMisplaced& mark_misplaced) {
  const double tolerance = options.tolerance_mm / lattice.step_mm();
  const bool keeps_area = options.method == SimplificationMethod::kArea && tolerance > 0;
  SimplifiedOutline out = keeps_area ? collapse_segments(lines, tolerance, is_open)
                                     : douglas_peucker(lines, tolerance, is_open, mark_misplaced);
  // The result of Douglas-Peucker moves with every outline, also with one that a rotation maps to
  // itself. Such an outline has no canonical orientation to order the steps of clearing by.
  if (keeps_area || !rotation_may_map_to_itself(lines))
    clear_outline(lines, is_open, keeps_area ? left_for_collapse(tolerance) : tolerance, out);
  return std::move(out.outline);
}

}  // namespace

double left_for_refinement_steps(const Lattice& lattice, const SimplificationOptions& options) {
  return options.method == SimplificationMethod::kArea && options.tolerance_mm > 0
             ? left_for_refinement(options.tolerance_mm / lattice.step_mm())
             : std::numeric_limits<double>::infinity();
}

Pslg simplify(const Pslg& contours, const Lattice& lattice, const SimplificationOptions& options) {
  return simplify_lines(contours, {}, lattice, options, {});
}
// Implements simplify() of label_borders.h.

LabelBorders simplify(const LabelBorders& borders, const Lattice& lattice,
                      const SimplificationOptions& options) {
  Pslg lines;
  std::vector<bool> is_open;
  for (const BorderChain& chain : borders.chains) {
    lines.rings.push_back(chain.points);
    is_open.push_back(!chain.is_closed);
  }
  std::optional<Embedding> embedding;  // only Douglas-Peucker needs it
  Pslg simple = simplify_lines(lines, is_open, lattice, options,
                               [&](const std::vector<Ring>& now, std::vector<char>& marks) {
                                 if (!embedding) embedding.emplace(borders);
                                 embedding->mark_differences(now, marks);
                               });
  LabelBorders out = borders;
  for (std::size_t c = 0; c < out.chains.size(); ++c)
    out.chains[c].points = std::move(simple.rings[c]);
  return out;
}

}  // namespace trocar::pipeline
