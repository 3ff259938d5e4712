// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <boost/multiprecision/cpp_int.hpp>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/geometry/lattice.h"
#include "tests/bench/conditioning.h"

namespace trocar::test {
namespace {

using Big = boost::multiprecision::int512_t;
using nlohmann::json;
using Points = std::array<LatticePoint, 4>;

// The textbook formulas, for any type of number.

template <typename Number>
int sign(const Number& value) {
  return value > 0 ? 1 : (value < 0 ? -1 : 0);
}

template <typename Number>
int orient(LatticePoint a, LatticePoint b, LatticePoint c) {
  return sign(Number((Number(b.x) - Number(a.x)) * (Number(c.y) - Number(a.y)) -
                     (Number(b.y) - Number(a.y)) * (Number(c.x) - Number(a.x))));
}

// The lifted 4 x 4 determinant, expanded along its column of ones.
template <typename Number>
int circle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const auto lift = [](LatticePoint p) {
    return Number(Number(p.x) * Number(p.x) + Number(p.y) * Number(p.y));
  };
  const auto minor = [&](LatticePoint p, LatticePoint q, LatticePoint r) {
    return Number(Number(p.x) * (Number(q.y) * lift(r) - lift(q) * Number(r.y)) -
                  Number(p.y) * (Number(q.x) * lift(r) - lift(q) * Number(r.x)) +
                  lift(p) * (Number(q.x) * Number(r.y) - Number(q.y) * Number(r.x)));
  };
  return sign(Number(minor(a, b, c) - minor(a, b, d) + minor(a, c, d) - minor(b, c, d)));
}

template <typename Number>
int diametral(LatticePoint a, LatticePoint b, LatticePoint p) {
  return sign(Number((Number(a.x) - Number(p.x)) * (Number(b.x) - Number(p.x)) +
                     (Number(a.y) - Number(p.y)) * (Number(b.y) - Number(p.y))));
}

template <typename Number>
bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return orient<Number>(a, b, p) == 0 && diametral<Number>(a, b, p) < 0;
}

template <typename Number>
int cross(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  if (orient<Number>(a, b, c) * orient<Number>(a, b, d) < 0 &&
      orient<Number>(c, d, a) * orient<Number>(c, d, b) < 0)
    return 1;
  if (a != b && ((a == c && b == d) || (a == d && b == c))) return 1;
  return strictly_between<Number>(a, b, c) || strictly_between<Number>(a, b, d) ||
         strictly_between<Number>(c, d, a) || strictly_between<Number>(c, d, b);
}

// Inputs, the same with every standard library.

class Inputs {
 public:
  std::int32_t within(std::int32_t extent) {
    return static_cast<std::int32_t>(bits_() % (2 * static_cast<std::uint64_t>(extent) + 1)) -
           extent;
  }
  double unit() { return static_cast<double>(bits_() >> 11) * 0x1p-53; }
  LatticePoint point(std::int32_t extent) { return {within(extent), within(extent)}; }
  LatticePoint beside(LatticePoint p) { return {p.x + within(1), p.y + within(1)}; }

 private:
  std::mt19937_64 bits_{2026};
};

constexpr std::int32_t kHalf = kMaxCoordinate / 2;

Points anywhere(Inputs& in, std::int32_t extent) {
  return {in.point(extent), in.point(extent), in.point(extent), in.point(extent)};
}

// c and d on the line ab or one step beside it.
Points nearly_collinear(Inputs& in) {
  const LatticePoint a = in.point(kHalf), b = in.point(kHalf);
  const auto on_line = [&] {
    const double t = in.unit();
    return in.beside({static_cast<std::int32_t>(std::lrint(a.x + t * (b.x - a.x))),
                      static_cast<std::int32_t>(std::lrint(a.y + t * (b.y - a.y)))});
  };
  return {a, b, on_line(), on_line()};
}

// Points as near to a line as lattice points of this extent can be: c with p_x q_y - p_y q_x = 1, 0
// or -1 for p = b - a, q = c - a; the same for d.
Points next_to_collinear(Inputs& in) {
  const LatticePoint a{-kMaxCoordinate + 4 + in.within(3), -kMaxCoordinate + 4 + in.within(3)};
  std::int64_t px = kHalf / 2 + 1 + in.within(kHalf / 2), py = kHalf / 2 + 1 + in.within(kHalf / 2);
  // Extended Euclid: px qy - py qx = gcd.
  std::int64_t r0 = px, r1 = py, s0 = 1, s1 = 0, t0 = 0, t1 = 1;
  while (r1 != 0) {
    const std::int64_t quotient = r0 / r1;
    std::tie(r0, r1) = std::pair{r1, r0 - quotient * r1};
    std::tie(s0, s1) = std::pair{s1, s0 - quotient * s1};
    std::tie(t0, t1) = std::pair{t1, t0 - quotient * t1};
  }
  px /= r0;
  py /= r0;
  const auto at = [&a](std::int64_t x, std::int64_t y) {
    return LatticePoint{static_cast<std::int32_t>(a.x + x), static_cast<std::int32_t>(a.y + y)};
  };
  const auto beside = [&] {
    const std::int64_t off = in.within(1), along = in.within(1) + 1;
    return at(along * px - off * t0, along * py + off * s0);
  };
  const LatticePoint c = beside(), d = beside();
  return {a, at(2 * px, 2 * py), c, d};
}

// Points of a circle, rounded to the lattice.
Points nearly_cocircular(Inputs& in) {
  const LatticePoint middle = in.point(kHalf);
  const double radius = in.unit() * kHalf;
  Points out;
  for (LatticePoint& p : out) {
    const double angle = 2 * std::numbers::pi * in.unit();
    p = {middle.x + static_cast<std::int32_t>(std::lrint(radius * std::cos(angle))),
         middle.y + static_cast<std::int32_t>(std::lrint(radius * std::sin(angle)))};
  }
  return out;
}

// Exactly on one circle: (+-x, +-y), (+-y, +-x) about a centre; in half of the cases the last point
// is moved by a step.
Points cocircular(Inputs& in) {
  const LatticePoint middle = in.point(kHalf);
  const std::int32_t x = in.within(kHalf - 1), y = in.within(kHalf - 1);
  const std::array<LatticePoint, 8> ring{
      {{x, y}, {-x, y}, {x, -y}, {-x, -y}, {y, x}, {-y, x}, {y, -x}, {-y, -x}}};
  Points out;
  for (LatticePoint& p : out) {
    const LatticePoint r = ring[static_cast<std::size_t>(in.unit() * 8)];
    p = {middle.x + r.x, middle.y + r.y};
  }
  if (in.unit() < 0.5) out[3] = in.beside(out[3]);
  return out;
}

// Within a few steps of each other, far from the origin.
Points huddled(Inputs& in) {
  const LatticePoint at{kMaxCoordinate - 2, -kMaxCoordinate + 2};
  Points out;
  for (LatticePoint& p : out)
    p = {at.x + in.within(2), at.y + in.within(2)};
  return out;
}

struct Kind {
  const char* name;
  std::function<Points(Inputs&)> make;
};

struct Predicate {
  const char* name;
  std::function<int(const Points&)> ours, exact, doubles;
};

bool counter_clockwise(const Points& p) {
  return orient<Big>(p[0], p[1], p[2]) > 0;
}

}  // namespace

json predicate_rows(int inputs) {
  const std::vector<Kind> kinds{
      {"anywhere", [](Inputs& in) { return anywhere(in, kMaxCoordinate); }},
      {"on a grid of 5 x 5", [](Inputs& in) { return anywhere(in, 2); }},
      {"nearly collinear", nearly_collinear},
      {"collinear, or the next lattice point to it", next_to_collinear},
      {"nearly cocircular", nearly_cocircular},
      {"cocircular, or one step off", cocircular},
      {"huddled at the lattice's corner", huddled}};
  const std::vector<Predicate> predicates{
      {"orient2d", [](const Points& p) { return sign(orient2d(p[0], p[1], p[2])); },
       [](const Points& p) { return orient<Big>(p[0], p[1], p[2]); },
       [](const Points& p) { return orient<double>(p[0], p[1], p[2]); }},
      {"in_circle",
       [](const Points& p) { return counter_clockwise(p) ? in_circle(p[0], p[1], p[2], p[3]) : 0; },
       [](const Points& p) {
         return counter_clockwise(p) ? circle<Big>(p[0], p[1], p[2], p[3]) : 0;
       },
       [](const Points& p) {
         return counter_clockwise(p) ? circle<double>(p[0], p[1], p[2], p[3]) : 0;
       }},
      {"diametral_dot", [](const Points& p) { return sign(diametral_dot(p[0], p[1], p[2])); },
       [](const Points& p) { return diametral<Big>(p[0], p[1], p[2]); },
       [](const Points& p) { return diametral<double>(p[0], p[1], p[2]); }},
      {"segments_cross",
       [](const Points& p) { return int{segments_cross(p[0], p[1], p[2], p[3])}; },
       [](const Points& p) { return cross<Big>(p[0], p[1], p[2], p[3]); },
       [](const Points& p) { return cross<double>(p[0], p[1], p[2], p[3]); }}};
  json rows = json::array();
  for (const Kind& kind : kinds) {
    for (const Predicate& predicate : predicates) {
      Inputs in;
      int wrong = 0, wrong_in_doubles = 0, zero = 0;
      for (int i = 0; i < inputs; ++i) {
        const Points p = kind.make(in);
        const int exact = predicate.exact(p);
        zero += exact == 0 ? 1 : 0;
        wrong += predicate.ours(p) != exact ? 1 : 0;
        wrong_in_doubles += predicate.doubles(p) != exact ? 1 : 0;
      }
      rows.push_back({{"id", std::string(predicate.name) + ", " + kind.name},
                      {"predicate", predicate.name},
                      {"inputs", kind.name},
                      {"count", inputs},
                      {"of_these_zero", zero},
                      {"wrong_signs", wrong},
                      {"wrong_signs_of_doubles", wrong_in_doubles},
                      {"bound", 0}});
    }
  }
  return rows;
}

}  // namespace trocar::test
