// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/overlay.h"

#include <algorithm>
#include <array>
#include <deque>
#include <map>
#include <optional>
#include <utility>

namespace trocar::runtime {
namespace {

using Segment = std::pair<LatticePoint, LatticePoint>;  // first < second

// What runs along a segment, counted from its first to its second end.
struct Strand {
  int rim = 0;
  int tool = 0;
  std::uint32_t kept = kNone;
  bool kept_right = false;
};

bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

bool boxes_apart(const Segment& s, const Segment& t) {
  if (s.second.x < t.first.x || t.second.x < s.first.x) return true;
  const auto [sl, sh] = std::minmax(s.first.y, s.second.y);
  const auto [tl, th] = std::minmax(t.first.y, t.second.y);
  return sh < tl || th < sl;
}

// An end of one segment inside the other.
std::optional<LatticePoint> touching(const Segment& s, const Segment& t) {
  if (strictly_between(s.first, s.second, t.first)) return t.first;
  if (strictly_between(s.first, s.second, t.second)) return t.second;
  if (strictly_between(t.first, t.second, s.first)) return s.first;
  if (strictly_between(t.first, t.second, s.second)) return s.second;
  return std::nullopt;
}

bool cross_properly(const Segment& s, const Segment& t) {
  const std::int64_t a = orient2d(s.first, s.second, t.first);
  const std::int64_t b = orient2d(s.first, s.second, t.second);
  const std::int64_t c = orient2d(t.first, t.second, s.first);
  const std::int64_t d = orient2d(t.first, t.second, s.second);
  return ((a < 0 && b > 0) || (a > 0 && b < 0)) && ((c < 0 && d > 0) || (c > 0 && d < 0));
}

// Is p on the material's side of the strand's piece of rim, or on it?
bool recedes(const Segment& s, const Strand& strand, LatticePoint p) {
  if (strand.rim == 0) return true;
  const std::int64_t side = orient2d(s.first, s.second, p);
  return strand.rim > 0 ? side >= 0 : side <= 0;
}

// The bend of law 1 for two segments that cross properly.
LatticePoint bend_point(const Segment& s, const Strand& of_s, const Segment& t,
                        const Strand& of_t) {
  const LatticePoint a = s.first, b = s.second, c = t.first, d = t.second;
  const std::int64_t bx = std::int64_t{b.x} - a.x, by = std::int64_t{b.y} - a.y;
  const std::int64_t dx = std::int64_t{d.x} - c.x, dy = std::int64_t{d.y} - c.y;
  const std::int64_t cx = std::int64_t{c.x} - a.x, cy = std::int64_t{c.y} - a.y;
  // The crossing is a + (b - a) n / m.
  std::int64_t n = cx * dy - cy * dx, m = bx * dy - by * dx;
  if (m < 0) n = -n, m = -m;
  auto floor_div = [m](Int128 v) { return v >= 0 ? v / m : -((-v + m - 1) / m); };
  const Int128 x_num = Int128{bx} * n, y_num = Int128{by} * n;  // over m, from a
  const Int128 x0 = floor_div(x_num), y0 = floor_div(y_num);
  std::optional<LatticePoint> nearest, nearest_receding;
  Int128 best = 0, best_receding = 0;
  for (int i = 0; i < 4; ++i) {
    // Without a remainder the lower corner alone stands for the coordinate.
    const Int128 px = x0 + (x0 * m == x_num ? 0 : i / 2), py = y0 + (y0 * m == y_num ? 0 : i % 2);
    const Int128 ex = px * m - x_num, ey = py * m - y_num;
    const Int128 distance = ex * ex + ey * ey;
    const LatticePoint p{static_cast<std::int32_t>(a.x + px), static_cast<std::int32_t>(a.y + py)};
    if (!nearest || distance < best) nearest = p, best = distance;
    if (recedes(s, of_s, p) && recedes(t, of_t, p) &&
        (!nearest_receding || distance < best_receding)) {
      nearest_receding = p, best_receding = distance;
    }
  }
  return nearest_receding ? *nearest_receding : *nearest;
}

class Settling {
 public:
  Settling(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity)
      : sheet_(sheet), neighbours_(neighbours), cavity_(cavity) {}

  void add(LatticePoint from, LatticePoint to, Strand strand) {
    if (to < from) {
      std::swap(from, to);
      strand.rim = -strand.rim;
      strand.tool = -strand.tool;
      strand.kept_right = !strand.kept_right;
    }
    const auto [at, is_new] = strands_.try_emplace({from, to}, strand);
    if (!is_new) {
      // Runs that cancel leave their edge: its ends stay points of the PSLG.
      at->second.rim += strand.rim;
      at->second.tool += strand.tool;
    }
    pending_.push_back({from, to});
  }

  /// What has been added so far is known to have no crossings.
  void all_settled() { pending_.clear(); }

  void settle() {
    while (!pending_.empty()) {
      const Segment s = pending_.front();
      pending_.pop_front();
      if (!strands_.contains(s)) continue;
      for (const auto& [t, strand] : strands_) {
        if (boxes_apart(s, t) || s == t) continue;
        if (resolve(s, t)) break;  // the map has changed
      }
    }
  }

  const std::map<Segment, Strand>& strands() const { return strands_; }
  std::vector<std::uint32_t> absorb() const { return absorb_; }

 private:
  // Makes an end of what crosses or touches; false if there was nothing to do.
  bool resolve(Segment s, Segment t) {
    const Strand of_s = strands_.at(s), of_t = strands_.at(t);
    std::optional<LatticePoint> p = touching(s, t);
    const bool bends = !p && cross_properly(s, t);
    if (!p && !bends) return false;
    if (bends) p = bend_point(s, of_s, t, of_t);
    const bool split_s = *p != s.first && *p != s.second;
    const bool split_t = *p != t.first && *p != t.second;
    // A shared edge stays; the bend waits for the next round.
    bool held = false;
    for (const auto& [strand, is_split] : {std::pair{of_s, split_s}, std::pair{of_t, split_t}}) {
      if (strand.kept == kNone || !(is_split || bends)) continue;
      absorb_.push_back(strand.kept);
      held = true;
    }
    if (held) return false;
    if (split_s) split(s, of_s, *p);
    if (split_t) split(t, of_t, *p);
    if (!split_s) pending_.push_back(s);
    if (!split_t) pending_.push_back(t);
    return true;
  }

  void split(const Segment& s, const Strand& strand, LatticePoint p) {
    if (!recedes(s, strand, p)) absorb_swept(s, p);
    strands_.erase(s);
    add(s.first, p, strand);
    add(p, s.second, strand);
  }

  // The rare bend outwards (law 1) must not run over material that stays.
  void absorb_swept(const Segment& s, LatticePoint p) {
    std::array<LatticePoint, 3> swept = {s.first, p, s.second};
    if (orient2d(swept[0], swept[1], swept[2]) < 0) std::swap(swept[0], swept[2]);
    auto inside = [&swept, &s, p](LatticePoint q) {
      return q != s.first && q != s.second && q != p && orient2d(swept[0], swept[1], q) >= 0 &&
             orient2d(swept[1], swept[2], q) >= 0 && orient2d(swept[2], swept[0], q) >= 0;
    };
    for (std::uint32_t k = 0; k < sheet_.triangles.size(); ++k) {
      if (cavity_.contains[k] != 0) continue;
      const std::array<LatticePoint, 3> c = corners(sheet_, k);
      for (std::size_t i = 0; i < 3; ++i) {
        if (neighbours_[k][i] != kNone) continue;
        const LatticePoint a = c[i], b = c[(i + 1) % 3];
        if (inside(a) || inside(b) || segments_cross(a, b, s.first, p) ||
            segments_cross(a, b, p, s.second)) {
          absorb_.push_back(k);
        }
      }
    }
  }

  const SliceMesh& sheet_;
  const Neighbours& neighbours_;
  const Cavity& cavity_;
  std::map<Segment, Strand> strands_;
  std::deque<Segment> pending_;
  std::vector<std::uint32_t> absorb_;
};

}  // namespace

Overlay overlay(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity,
                const Ring& tool) {
  Settling settling(sheet, neighbours, cavity);
  for (const RimEdge& e : cavity.rim) {
    settling.add(sheet.vertices[e.from], sheet.vertices[e.to],
                 {.rim = 1, .tool = 0, .kept = e.kept, .kept_right = true});
  }
  settling.all_settled();
  for (std::size_t i = 0, n = tool.size(); i < n; ++i) {
    settling.add(tool[i], tool[i + 1 == n ? 0 : i + 1], {.rim = 0, .tool = 1});
  }
  settling.settle();

  Overlay out;
  out.absorb = settling.absorb();
  if (!out.absorb.empty()) return out;
  for (const auto& [s, strand] : settling.strands()) {
    out.points.push_back(s.first);
    out.points.push_back(s.second);
  }
  // Vertices within the cavity that the tool does not cover stay for the mesh's
  // sake, unless a bend ran through them.
  for (std::uint32_t v : cavity.inner) {
    const LatticePoint p = sheet.vertices[v];
    const bool on_edge = std::any_of(
        settling.strands().begin(), settling.strands().end(),
        [p](const auto& s) { return strictly_between(s.first.first, s.first.second, p); });
    if (!on_edge && strictly_outside(p, tool)) out.points.push_back(p);
  }
  std::sort(out.points.begin(), out.points.end());
  out.points.erase(std::unique(out.points.begin(), out.points.end()), out.points.end());
  auto index = [&out](LatticePoint p) {
    return static_cast<std::uint32_t>(std::lower_bound(out.points.begin(), out.points.end(), p) -
                                      out.points.begin());
  };
  for (const auto& [s, strand] : settling.strands()) {
    out.edges.push_back(
        {index(s.first), index(s.second), strand.rim, strand.tool, strand.kept, strand.kept_right});
  }
  return out;
}

}  // namespace trocar::runtime
