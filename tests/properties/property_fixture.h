// SPDX-License-Identifier: Apache-2.0
// rapidcheck with GoogleTest and a fixed seed (RC_PARAMS in the environment changes it, for example
// "seed=7 max_success=10000"), and random motions of the lattice.
#pragma once

#include <rapidcheck.h>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdint>
#include <cstdlib>

#include "tests/support/motions.h"

namespace trocar::test {

/// Before any property runs.
struct FixedSeed {
  FixedSeed() {
    ::setenv("RC_PARAMS", "seed=20 max_success=200", 0);  // NOLINT(concurrency-mt-unsafe)
  }
};
inline const FixedSeed kFixedSeed;

/// Uniform in [low, high) from the first case on: rapidcheck's own range grows from its lower end
/// and covers the upper one only in the last cases.
template <typename T>
rc::Gen<T> in_range(T low, T high) {
  return rc::gen::resize(rc::kNominalSize, rc::gen::inRange<T>(low, high));
}
template <typename T>
T any_in(T low, T high) {
  return *in_range<T>(low, high);
}

/// All 64 bits at every size. Not shrunk: another seed is another case, not a simpler one.
inline std::uint64_t any_seed() {
  return *rc::gen::noShrink(rc::gen::resize(rc::kNominalSize, rc::gen::arbitrary<std::uint64_t>()));
}

/// Large enough that floating-point arithmetic on absolute positions would round differently.
inline Motion any_translation() {
  return {0, {any_in(-200'000'000, 200'000'000), any_in(-200'000'000, 200'000'000)}};
}
inline Motion any_motion() {
  Motion out = any_translation();
  out.quarters = any_in(1, 4);
  return out;
}

}  // namespace trocar::test

namespace rc {
template <>
struct Arbitrary<trocar::LatticePoint> {
  /// Often small, so that degenerate cases are frequent; sometimes at the ends of the lattice.
  static Gen<trocar::LatticePoint> arbitrary() {
    const auto coordinate = gen::weightedOneOf<std::int32_t>(
        {{4, trocar::test::in_range<std::int32_t>(-4, 5)},
         {2, trocar::test::in_range<std::int32_t>(-1000, 1001)},
         {2, trocar::test::in_range<std::int32_t>(-trocar::kMaxCoordinate,
                                                  trocar::kMaxCoordinate + 1)},
         {1, gen::element<std::int32_t>(-trocar::kMaxCoordinate, trocar::kMaxCoordinate)}});
    return gen::construct<trocar::LatticePoint>(coordinate, coordinate);
  }
};
}  // namespace rc

namespace trocar {
inline void showValue(LatticePoint p, std::ostream& out) {
  out << '(' << p.x << ", " << p.y << ')';
}
}  // namespace trocar
