// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/overlay.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace trocar::runtime {
namespace {

bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

bool boxes_apart(const Strand& s, const Strand& t) {
  if (s.second.x < t.first.x || t.second.x < s.first.x) return true;
  const auto [sl, sh] = std::minmax(s.first.y, s.second.y);
  const auto [tl, th] = std::minmax(t.first.y, t.second.y);
  return sh < tl || th < sl;
}

// An end of one segment inside the other.
std::optional<LatticePoint> touching(const Strand& s, const Strand& t) {
  if (strictly_between(s.first, s.second, t.first)) return t.first;
  if (strictly_between(s.first, s.second, t.second)) return t.second;
  if (strictly_between(t.first, t.second, s.first)) return s.first;
  if (strictly_between(t.first, t.second, s.second)) return s.second;
  return std::nullopt;
}

bool cross_properly(const Strand& s, const Strand& t) {
  const std::int64_t a = orient2d(s.first, s.second, t.first);
  const std::int64_t b = orient2d(s.first, s.second, t.second);
  const std::int64_t c = orient2d(t.first, t.second, s.first);
  const std::int64_t d = orient2d(t.first, t.second, s.second);
  return ((a < 0 && b > 0) || (a > 0 && b < 0)) && ((c < 0 && d > 0) || (c > 0 && d < 0));
}

// Is p on the material's side of the strand's piece of rim, or on it?
bool recedes(const Strand& s, LatticePoint p) {
  if (s.rim == 0) return true;
  const std::int64_t side = orient2d(s.first, s.second, p);
  return s.rim > 0 ? side >= 0 : side <= 0;
}

// The bend of law 1 for two segments that cross properly.
LatticePoint bend_point(const Strand& s, const Strand& t) {
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
    if (recedes(s, p) && recedes(t, p) && (!nearest_receding || distance < best_receding)) {
      nearest_receding = p, best_receding = distance;
    }
  }
  return nearest_receding ? *nearest_receding : *nearest;
}

// The work on one overlay. Whatever finds no room sets `full`, and all ends at once.
class Settling {
 public:
  Settling(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity, Overlay& out)
      : mesh_(mesh), grid_(grid), cavity_(cavity), out_(out) {
    out.points.clear();
    out.strands.clear();
    out.absorb.clear();
    out.point_at.clear();
    out.strand_at.clear();
    out.pending.clear();
  }

  bool full() const { return full_; }

  std::uint32_t point(LatticePoint p) {
    const auto fresh = static_cast<std::uint32_t>(out_.points.size());
    const std::uint32_t* at = out_.point_at.insert(Overlay::key(p), fresh);
    if (at == nullptr || (*at == fresh && !push_within(out_.points, p))) {
      full_ = true;
      return 0;
    }
    return *at;
  }

  // `like` says what runs from `from` to `to`.
  void add(LatticePoint from, LatticePoint to, const Strand& like, bool settled = false) {
    Strand strand = like;
    strand.gone = false;
    strand.first = from;
    strand.second = to;
    if (to < from) {
      std::swap(strand.first, strand.second);
      strand.rim = -strand.rim;
      strand.tool = -strand.tool;
      strand.kept_right = !strand.kept_right;
    }
    strand.a = point(strand.first);
    strand.b = point(strand.second);
    if (full_) return;
    const auto fresh = static_cast<std::uint32_t>(out_.strands.size());
    std::uint32_t* at = out_.strand_at.insert(pair_key(strand.a, strand.b), fresh);
    if (at != nullptr && *at != fresh && !out_.strands[*at].gone) {
      // Runs that cancel leave their edge: its ends stay points of the PSLG.
      out_.strands[*at].rim += strand.rim;
      out_.strands[*at].tool += strand.tool;
    } else if (at == nullptr || !push_within(out_.strands, strand)) {
      full_ = true;
      return;
    } else {
      *at = fresh;
    }
    if (!settled) wait(*at);
  }

  void settle() {
    while (next_ < out_.pending.size() && !full_) {
      const std::uint32_t s = out_.pending[next_++];
      if (out_.strands[s].gone) continue;
      for (std::uint32_t t = 0; t < out_.strands.size(); ++t) {
        const Strand &one = out_.strands[s], &other = out_.strands[t];
        if (other.gone || s == t || boxes_apart(one, other)) continue;
        if (resolve(s, t)) break;  // the list has changed
      }
    }
  }

 private:
  // First in, first out; what has been taken out makes room when the list is full.
  void wait(std::uint32_t strand) {
    std::vector<std::uint32_t>& pending = out_.pending;
    if (pending.size() == pending.capacity() && next_ > 0) {
      pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(next_));
      next_ = 0;
    }
    if (!push_within(pending, strand)) full_ = true;
  }

  void absorb(std::uint32_t triangle) {
    if (!push_within(out_.absorb, triangle)) full_ = true;
  }

  // Makes an end of what crosses or touches; false if there was nothing to do.
  bool resolve(std::uint32_t i, std::uint32_t j) {
    const Strand s = out_.strands[i], t = out_.strands[j];
    std::optional<LatticePoint> p = touching(s, t);
    const bool bends = !p && cross_properly(s, t);
    if (!p && !bends) return false;
    if (bends) p = bend_point(s, t);
    const bool split_s = *p != s.first && *p != s.second;
    const bool split_t = *p != t.first && *p != t.second;
    // A shared edge stays; the bend waits for the next round.
    bool held = false;
    for (const auto& [strand, is_split] : {std::pair{&s, split_s}, std::pair{&t, split_t}}) {
      if (strand->kept == kNone || !(is_split || bends)) continue;
      absorb(strand->kept);
      held = true;
    }
    if (held) return false;
    if (split_s) split(i, s, *p);
    if (split_t) split(j, t, *p);
    if (!split_s) wait(i);
    if (!split_t) wait(j);
    return true;
  }

  void split(std::uint32_t index, const Strand& s, LatticePoint p) {
    if (!recedes(s, p)) absorb_swept(s, p);
    out_.strands[index].gone = true;
    add(s.first, p, s);
    add(p, s.second, s);
  }

  // The rare bend outwards (law 1) must not run over material that stays.
  void absorb_swept(const Strand& s, LatticePoint p) {
    std::array<LatticePoint, 3> swept = {s.first, p, s.second};
    if (orient2d(swept[0], swept[1], swept[2]) < 0) std::swap(swept[0], swept[2]);
    auto inside = [&swept, &s, p](LatticePoint q) {
      return q != s.first && q != s.second && q != p && orient2d(swept[0], swept[1], q) >= 0 &&
             orient2d(swept[1], swept[2], q) >= 0 && orient2d(swept[2], swept[0], q) >= 0;
    };
    grid_.for_each(mesh_, box_around(swept), [&](std::uint32_t k) {
      if (cavity_.contains(k)) return;
      const std::array<LatticePoint, 3> c = corners(mesh_, k);
      for (std::size_t i = 0; i < 3; ++i) {
        if (mesh_.across[k][i] != kNone) continue;
        const LatticePoint a = c[i], b = c[(i + 1) % 3];
        if (inside(a) || inside(b) || segments_cross(a, b, s.first, p) ||
            segments_cross(a, b, p, s.second)) {
          absorb(k);
          return;
        }
      }
    });
  }

  const SheetMesh& mesh_;
  const TriangleGrid& grid_;
  const Cavity& cavity_;
  Overlay& out_;
  std::size_t next_ = 0;  // of `pending`
  bool full_ = false;
};

}  // namespace

void Overlay::allocate(std::size_t max_points, std::size_t max_strands) {
  reserve_touched(points, max_points);
  reserve_touched(strands, max_strands);
  reserve_touched(absorb, max_strands);
  reserve_touched(pending, 2 * max_strands);
  point_at.allocate(max_points);
  strand_at.allocate(max_strands);
}

Stage settle_overlay(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                     Outline tool, Overlay& out) noexcept {
  Settling settling(mesh, grid, cavity, out);
  Strand rim;
  rim.rim = 1;
  rim.kept_right = true;
  for (const RimEdge& e : cavity.rim) {
    rim.kept = e.kept;
    settling.add(mesh.vertices[e.from], mesh.vertices[e.to], rim, true);
  }
  Strand edge;
  edge.tool = 1;
  for (std::size_t i = 0, n = tool.size(); i < n; ++i)
    settling.add(tool[i], tool[i + 1 == n ? 0 : i + 1], edge);
  settling.settle();
  if (settling.full()) return Stage::kCapacity;
  if (!out.absorb.empty()) return Stage::kAgain;

  // Vertices within the cavity that the tool does not cover stay for the mesh's
  // sake, unless a bend ran through them.
  for (const std::uint32_t v : cavity.inner) {
    const LatticePoint p = mesh.vertices[v];
    if (!strictly_outside(p, tool)) continue;
    const bool on_edge = std::any_of(out.strands.begin(), out.strands.end(), [p](const Strand& s) {
      return !s.gone && strictly_between(s.first, s.second, p);
    });
    if (!on_edge) settling.point(p);
  }
  return settling.full() ? Stage::kCapacity : Stage::kDone;
}

}  // namespace trocar::runtime
