// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/overlay.h"

namespace trocar {
namespace {

bool boxes_apart(const Strand& s, const Strand& t) {
  if (s.second.x < t.first.x || t.second.x < s.first.x) return true;
  const auto [sl, sh] = std::minmax(s.first.y, s.second.y);
  const auto [tl, th] = std::minmax(t.first.y, t.second.y);
  return sh < tl || th < sl;
}

enum class Meeting { kApart, kTouches, kCrosses };

// Classifies the contact of two strands. With kTouches, `at` is an end of one of them that lies
// inside the other. With kCrosses, they share a point inside both.
Meeting meet(const Strand& s, const Strand& t, LatticePoint& at) {
  const std::int64_t t1 = orient2d(s.first, s.second, t.first);
  const std::int64_t t2 = orient2d(s.first, s.second, t.second);
  if ((t1 > 0 && t2 > 0) || (t1 < 0 && t2 < 0)) return Meeting::kApart;
  const std::int64_t s1 = orient2d(t.first, t.second, s.first);
  const std::int64_t s2 = orient2d(t.first, t.second, s.second);
  if ((s1 > 0 && s2 > 0) || (s1 < 0 && s2 < 0)) return Meeting::kApart;
  const auto inside = [&at](const Strand& other, std::int64_t side, LatticePoint p) {
    if (side != 0 || diametral_dot(other.first, other.second, p) >= 0) return false;
    at = p;
    return true;
  };
  if (inside(s, t1, t.first) || inside(s, t2, t.second) || inside(t, s1, s.first) ||
      inside(t, s2, s.second))
    return Meeting::kTouches;
  return t1 != 0 && t2 != 0 && s1 != 0 && s2 != 0 ? Meeting::kCrosses : Meeting::kApart;
}

// Returns true if p is on the material's side of the strand or on it, and for strands that
// are not on the cavity's boundary.
bool recedes(const Strand& s, LatticePoint p) {
  if (s.cavity == 0) return true;
  const std::int64_t side = orient2d(s.first, s.second, p);
  return s.cavity > 0 ? side >= 0 : side <= 0;
}

// Returns the canonical rotation of all corners of cavity and tool (contract 5).
CanonicalRotation rotation_of(const SheetMesh& mesh, const Cavity& cavity) noexcept {
  return rotation_by_moments([&](auto&& visit) {
    for (const std::uint32_t v : cavity.boundary_vertices)
      visit(mesh.vertices[v]);
    for (const OutlineEdge& e : cavity.tool)
      visit(e.a);
  });
}

// Returns the bend of contract 1, for two segments that cross properly.
LatticePoint bend_point(const Strand& s, const Strand& t, const CanonicalRotation& rotate) {
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
    // If there is no remainder, the crossing itself has this coordinate.
    const Int128 px = x0 + (x0 * m == x_num ? 0 : i / 2), py = y0 + (y0 * m == y_num ? 0 : i % 2);
    const Int128 ex = px * m - x_num, ey = py * m - y_num;
    const Int128 distance = ex * ex + ey * ey;
    const LatticePoint p{static_cast<std::int32_t>(a.x + px), static_cast<std::int32_t>(a.y + py)};
    const auto closer = [&](const std::optional<LatticePoint>& than, Int128 its_distance) {
      if (!than || distance != its_distance) return !than || distance < its_distance;
      return rotate(p) < rotate(*than);
    };
    if (closer(nearest, best)) nearest = p, best = distance;
    if (recedes(s, p) && recedes(t, p) && closer(nearest_receding, best_receding))
      nearest_receding = p, best_receding = distance;
  }
  return nearest_receding ? *nearest_receding : *nearest;
}

// Constructs one overlay. The construction stops as soon as a capacity is used up,
// which sets `full`.
class OverlayBuilder {
 public:
  OverlayBuilder(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                 Overlay& out)
      : mesh_(mesh), grid_(grid), cavity_(cavity), out_(out) {
    out.points.clear();
    out.strands.clear();
    out.absorb.clear();
    out.point_at.clear();
    out.strand_at.clear();
    out.pending.clear();
    out.boundary_point.clear();
    out.boundary_strand.clear();
    out.rotation = rotation_of(mesh, cavity);
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

  // Adds a strand between two points, with the same edges of cavity and tool as `like`, and
  // returns its number.
  std::uint32_t add(std::uint32_t from, std::uint32_t to, const Strand& like) {
    Strand strand = like;
    strand.gone = false;
    strand.a = from;
    strand.b = to;
    strand.first = out_.points[from];
    strand.second = out_.points[to];
    if (strand.second < strand.first) {
      std::swap(strand.a, strand.b);
      std::swap(strand.first, strand.second);
      strand.cavity = -strand.cavity;
      strand.tool = -strand.tool;
      strand.kept_right = !strand.kept_right;
    }
    const auto fresh = static_cast<std::uint32_t>(out_.strands.size());
    std::uint32_t* at = out_.strand_at.insert(pair_key(strand.a, strand.b), fresh);
    if (at != nullptr && *at != fresh && !out_.strands[*at].gone) {
      // A strand whose edges cancel stays in the list: its ends are points of the PSLG.
      out_.strands[*at].cavity += strand.cavity;
      out_.strands[*at].tool += strand.tool;
    } else if (at == nullptr || !push_within(out_.strands, strand)) {
      full_ = true;
      return 0;
    } else {
      *at = fresh;
    }
    return *at;
  }

  // Appends to the queue. If the queue is full, it is compacted first.
  void enqueue(std::uint32_t strand) {
    std::vector<std::uint32_t>& pending = out_.pending;
    if (pending.size() == pending.capacity() && next_ > 0) {
      pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(next_));
      next_ = 0;
    }
    if (!push_within(pending, strand)) full_ = true;
  }

  // Resolves one strand after the other with the first one that it touches or crosses.
  void resolve_crossings() {
    std::sort(out_.pending.begin(), out_.pending.end(), [this](std::uint32_t s, std::uint32_t t) {
      return comes_before(out_.strands[s], out_.strands[t]);
    });
    while (next_ < out_.pending.size() && !full_) {
      const std::uint32_t s = out_.pending[next_++];
      if (out_.strands[s].gone) continue;
      std::uint32_t first = kNoSlot;
      Meeting how = Meeting::kApart;
      LatticePoint where;
      for (std::uint32_t t = 0; t < out_.strands.size(); ++t) {
        const Strand &one = out_.strands[s], &other = out_.strands[t];
        if (other.gone || s == t || boxes_apart(one, other)) continue;
        LatticePoint p;
        const Meeting meeting = meet(one, other, p);
        if (meeting == Meeting::kApart) continue;
        if (meeting == Meeting::kCrosses) p = bend_point(one, other, out_.rotation);
        if (is_held(one, other, meeting, p)) continue;
        if (first != kNoSlot && !comes_before(other, out_.strands[first])) continue;
        first = t, how = meeting, where = p;
      }
      if (how != Meeting::kApart) resolve(s, first, where);
    }
  }

 private:
  void absorb(std::uint32_t triangle) {
    if (!push_within(out_.absorb, triangle)) full_ = true;
  }

  // Compares two strands in the rotated plane.
  bool comes_before(const Strand& s, const Strand& t) const {
    const auto ends = [this](const Strand& strand) {
      const LatticePoint a = out_.rotation(strand.first), b = out_.rotation(strand.second);
      return a < b ? std::pair(a, b) : std::pair(b, a);
    };
    return ends(s) < ends(t);
  }

  // Returns true if one of the strands is a shared edge that would be bent. Its triangle is then
  // listed, to be added to the cavity for the next round.
  bool is_held(const Strand& s, const Strand& t, Meeting meeting, LatticePoint p) {
    bool held = false;
    for (const Strand* strand : {&s, &t}) {
      const bool is_split = p != strand->first && p != strand->second;
      if (strand->kept == kNoSlot || !(is_split || meeting == Meeting::kCrosses)) continue;
      absorb(strand->kept);
      held = true;
    }
    return held;
  }

  // Splits two strands at p, where they cross or touch.
  void resolve(std::uint32_t i, std::uint32_t j, LatticePoint p) {
    const Strand s = out_.strands[i], t = out_.strands[j];  // copies: the list may grow
    const bool split_s = p != s.first && p != s.second;
    const bool split_t = p != t.first && p != t.second;
    if (split_s) split(i, s, p);
    if (split_t) split(j, t, p);
    if (!split_s) enqueue(i);
    if (!split_t) enqueue(j);
  }

  void split(std::uint32_t index, const Strand& s, LatticePoint p) {
    if (!recedes(s, p)) absorb_swept(s, p);
    out_.strands[index].gone = true;
    const std::uint32_t middle = point(p);
    if (full_) return;
    // The part with the end that comes first in the rotated plane is added first.
    const bool as_it_is = out_.rotation(s.first) < out_.rotation(s.second);
    for (const bool is_first : {as_it_is, !as_it_is}) {
      enqueue(is_first ? add(s.a, middle, s) : add(middle, s.b, s));
      if (full_) return;
    }
  }

  // The rare bend outwards (contract 1) must not cover kept material.
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
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (mesh_.across[k][i] != kNoSlot) continue;
        const LatticePoint a = c[i], b = c[next_corner(i)];
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
  std::size_t next_ = 0;  // index in `pending`
  bool full_ = false;
};

}  // namespace

void Overlay::allocate(std::size_t max_triangles, std::size_t max_points, std::size_t max_strands) {
  reserve_touched(points, max_points);
  reserve_touched(strands, max_strands);
  reserve_touched(absorb, max_strands);
  reserve_touched(pending, 2 * max_strands);
  reserve_touched(boundary_point, 3 * max_triangles);
  reserve_touched(boundary_strand, 3 * max_triangles);
  point_at.allocate(max_points);
  strand_at.allocate(max_strands);
}

StageOutcome build_overlay(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                           Overlay& out) noexcept {
  OverlayBuilder builder(mesh, grid, cavity, out);
  for (const std::uint32_t v : cavity.boundary_vertices)
    out.boundary_point.push_back(builder.point(mesh.vertices[v]));
  Strand boundary;
  boundary.cavity = 1;
  boundary.kept_right = true;
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (builder.full()) return StageOutcome::kCapacity;
    boundary.kept = e.kept;
    out.boundary_strand.push_back(
        builder.add(out.boundary_point[e.from], out.boundary_point[e.to], boundary));
  }
  Strand edge;
  edge.tool = 1;
  for (const OutlineEdge& e : cavity.tool) {
    const std::uint32_t a = builder.point(e.a), b = builder.point(e.b);
    if (builder.full()) return StageOutcome::kCapacity;
    builder.enqueue(builder.add(a, b, edge));
  }
  builder.resolve_crossings();
  if (builder.full()) return StageOutcome::kCapacity;
  if (!out.absorb.empty()) return StageOutcome::kAgain;

  // Vertices within the cavity that the tool does not cover are kept for the quality of the mesh,
  // unless a bend runs through them.
  for (const std::uint32_t v : cavity.inner) {
    const LatticePoint p = mesh.vertices[v];
    if (!strictly_outside(p, cavity.tool)) continue;
    const bool on_edge = std::any_of(out.strands.begin(), out.strands.end(), [p](const Strand& s) {
      return !s.gone && is_inside_segment(s.first, s.second, p);
    });
    if (!on_edge) builder.point(p);
  }
  return builder.full() ? StageOutcome::kCapacity : StageOutcome::kDone;
}

}  // namespace trocar
